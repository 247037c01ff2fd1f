"""What is shown of a plan's execution: objects go with the gripper, and then with the robot."""

import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.robot.kinematics import forward_kinematics
from basenet_jax.viewer.bodies import Bodies
from basenet_jax.viewer.execution import Execution, placed_on_surface


@pytest.fixture(scope="module")
def bodies(robot):
    return Bodies(robot)


@pytest.fixture(scope="module")
def execution(planned, robot, bodies):
    return Execution(planned, robot, bodies)


@pytest.fixture(scope="module")
def grasps(planned):
    """When each of the two objects is taken, and when it is put down (s)."""
    motion = planned.motion
    taken = [float(motion.time[np.argmax(motion.held == slot)]) for slot in (0, 1)]
    put_down = [float(motion.time[np.argmax(motion.done == count)]) for count in (1, 2)]
    return list(zip(taken, put_down, strict=True))


def test_bodies_are_where_kinematics_says(robot, bodies):
    base_pose, joints = np.array([0.4, -1.1, 0.7]), np.asarray(robot.home) + 0.1
    frames = [np.eye(4)]
    for body, (position, wxyz) in zip(bodies.bodies, bodies.place(base_pose, joints), strict=True):
        frames.append(frames[body.parent + 1] @ as_matrix(position, wxyz))
    assert [body.parent for body in bodies.bodies] == list(range(-1, robot.dof + 1))
    position, rotation = forward_kinematics(robot, jnp.asarray(joints))
    in_arm = np.linalg.inv(frames[2]) @ bodies.tool(base_pose, joints)  # bodies: the base, the arm's base, its links
    np.testing.assert_allclose(in_arm[:3, 3], position, atol=1e-5)
    np.testing.assert_allclose(in_arm[:3, :3], rotation, atol=1e-5)


def test_every_geom_that_is_drawn_has_a_mesh(bodies):
    shapes = [shape for body in bodies.bodies for shape in body.shapes]
    assert all(len(shape.vertices) >= 8 and shape.faces.max() < len(shape.vertices) for shape in shapes)
    base = np.concatenate([shape.vertices for shape in bodies.bodies[0].shapes])
    np.testing.assert_allclose(base.min(axis=0)[:2], [-0.4, -0.25], atol=0.02)


def test_objects_stand_on_the_table_until_they_are_taken(planned, execution, grasps):
    for time in (0.0, grasps[0][0] - 1e-3):
        for slot, name in enumerate(planned.scene.names):
            close(execution.objects_at(time)[name], placed_on_surface(planned.scene.arrays, slot))


def test_the_gripper_takes_an_object_along_without_a_jump(planned, execution, bodies, grasps):
    for name, (taken, put_down) in zip(planned.scene.names, grasps, strict=True):
        before, after = (execution.objects_at(taken + step)[name] for step in (-1e-6, 1e-6))
        close(before, after, atol=1e-4)
        held = [in_tool(execution, bodies, name, time) for time in np.linspace(taken, put_down - 1e-3, 5)]
        for later in held[1:]:
            np.testing.assert_allclose(later, held[0], atol=1e-6)


def test_afterwards_objects_ride_on_the_deck_each_in_its_own_place(planned, execution, robot):
    places = execution.objects_at(execution.end_s)
    base_pose, _ = execution.robot_at(execution.end_s)
    x, y, length, width = np.asarray(robot.deck)
    found = []
    for position, _ in places.values():
        delta = position[:2] - base_pose[:2]
        cosine, sine = np.cos(base_pose[2]), np.sin(base_pose[2])
        found.append([cosine * delta[0] + sine * delta[1], cosine * delta[1] - sine * delta[0]])
        assert position[2] == pytest.approx(0.75 + 0.082 / 2)
    assert np.all(np.abs(np.array(found) - [x, y]) <= [length / 2, width / 2])
    assert np.linalg.norm(np.subtract(*found)) > 0.08


def test_it_takes_as_long_as_the_plan(planned, execution):
    assert execution.end_s == pytest.approx(float(planned.outcome.execution), abs=1e-3)


def as_matrix(position, wxyz):
    w, x, y, z = wxyz
    matrix = np.eye(4)
    matrix[:3, 3] = position
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return matrix


def in_tool(execution, bodies, name, time):
    return np.linalg.inv(bodies.tool(*execution.robot_at(time))) @ as_matrix(*execution.objects_at(time)[name])


def close(first, second, atol=1e-9):
    np.testing.assert_allclose(as_matrix(*first), as_matrix(*second), atol=atol)
