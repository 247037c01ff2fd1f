import dataclasses
import subprocess
import sys
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.task.picking import pick
from basenet_jax.world import clearance, mujoco_scene
from basenet_jax.world.boxes import UNBOUNDED, Boxes, Room
from basenet_jax.world.grasps import top_down
from tests import compiled
from tests.world.states import DOF, ROUNDING, TOUCHING, doubtful

# MJX drops some contacts of a capsule with a box's edge (see the module): 1 in 750 touching states, none deeper than
# the capsule's radius.
MJX_MISSES, MJX_MISS_DEPTH = 0.005, 0.06


@pytest.fixture(scope="module")
def mjx():
    """The module: imported here because the import takes seconds."""
    from basenet_jax.world import mjx

    return mjx


@pytest.fixture(scope="module")
def world(mjx, robot, room):
    return mjx.MjxScene.create(robot, room, slots=3)


def test_mjx_base_contacts_agree_with_mujoco(world, states, distances):
    def touches(pose):
        return world.base_touches(world.move(world.blank, pose, jnp.zeros(DOF)))

    count = 4000
    found = np.asarray(jax.jit(jax.vmap(touches))(states[:count, :3].astype(np.float32)))
    clear = ~doubtful(distances[:count, 0], TOUCHING)
    np.testing.assert_array_equal(found[clear], distances[:count][clear, 0] <= TOUCHING)


@pytest.fixture(scope="module")
def mjx_arm_check(mjx):
    """Any number of states, a table for each, by one program."""
    touches = jax.jit(mjx.arm_touches)

    def check(robot, pose, joints, room):
        def of_rows(pose, joints, room):
            return touches(robot, tuple(pose.T), joints.transpose(2, 1, 0), room).T

        half_size = np.broadcast_to(room.table_half_size, (len(pose), 2))
        rooms = Room.of_table(half_size=half_size, height=np.broadcast_to(room.table_height, len(pose)))  # pyright: ignore
        return compiled.by_rows(of_rows, pose, joints, rooms, size=500)

    return check


def test_mjx_arm_contacts_agree_with_mujoco_but_for_dropped_edges(mjx_arm_check, robot, room, states, distances):
    pairs = states.reshape(-1, 2, 9)  # two states of the arm for each pose: the second's own pose isn't used
    found = mjx_arm_check(robot, pairs[:, 0, :3], pairs[:, :1, 3:].repeat(2, axis=1), room)[:, 0]
    distance = distances[::2, 1]
    assert not np.any(found & (distance > ROUNDING))
    missed = ~found & (distance < -ROUNDING)
    assert missed.sum() <= MJX_MISSES * np.sum(distance <= 0.0)
    assert np.all(distance[missed] > -MJX_MISS_DEPTH)


def test_mjx_arm_check_takes_a_table_per_state_and_broadcasts(mjx_arm_check, robot, room, states):
    count = 500
    pose = states[:count, :3]
    joints = np.stack([states[:count, 3:], states[:count, 3:] + 0.5], axis=1)
    rooms = Room.of_table(
        half_size=jnp.broadcast_to(room.table_half_size, (count, 2)), height=jnp.linspace(0.1, 1.3, count)
    )
    found = mjx_arm_check(robot, pose, joints, rooms)
    each = Room.of_table(half_size=rooms.table_half_size[:, None], height=rooms.table_height[:, None])
    expected = compiled.arm_collides(robot, pose[:, None], joints, each)
    assert found.shape == (count, 2)
    # Dropped edges, see above, and states that rounding decides; another height changes the answer for 1 in 20.
    assert np.mean(found != expected) < 2 * MJX_MISSES
    same_table = mjx_arm_check(robot, pose, joints, room)
    assert np.mean(found != same_table) > 4 * MJX_MISSES


@pytest.fixture(scope="module")
def three_boxes():
    """A turned table, a board that the base passes under, a rectangle to keep out of, and one that only pads."""
    rows = [
        (0.3, -0.2, 0.4, 0.6, 0.4),
        (1.4, 0.9, -0.8, 0.5, 0.3),
        (-1.2, 0.8, 1.1, 0.4, 0.4),
        (0.0, 0.0, 0.0, 0.0, 0.0),
    ]
    numbers = np.array(rows, np.float32)
    leaves: tuple[Any, ...] = (
        numbers[:, :3],
        numbers[:, 3:],
        np.array([0.0, 1.0, 0.0, 0.0], np.float32),
        np.array([0.75, 1.1, 0.01, 0.0], np.float32),
        np.array([True, True, True, False]),
        np.array([True, True, False, False]),
        np.array([True, True, False, False]),
    )
    floor: Any = np.array(UNBOUNDED, np.float32)
    return Room(Boxes(*leaves), floor)


def test_contacts_in_a_room_agree_with_mujoco(mjx, robot, three_boxes, states):
    """Turned boxes, and those that block base or arm alone; misses and rounding as with one table."""
    count = 1000
    states = states[:count]
    distance = mujoco_scene.MujocoChecker(robot, three_boxes).distances(states[:, :3], states[:, 3:])
    # Made for a room of as many boxes that block nothing: all is in what the room is given later.
    nothing = jax.tree.map(lambda x: np.zeros_like(x), three_boxes.boxes)
    empty = mjx.MjxScene.create(robot, dataclasses.replace(three_boxes, boxes=nothing), slots=0)

    def touches(room, state):
        own = empty.with_room(room)
        data = own.move(own.blank, state[:3], state[3:])
        return own.base_touches(data), own.arm_touches(data)

    found = jax.jit(lambda room, states: jax.vmap(partial(touches, room))(states))
    base, arm = (np.asarray(x) for x in found(three_boxes, states.astype(np.float32)))
    clear = ~doubtful(distance[:, 0], TOUCHING)
    np.testing.assert_array_equal(base[clear], distance[clear, 0] <= TOUCHING)
    assert 0.1 < base.mean() < 0.9
    assert not np.any(arm & (distance[:, 1] > ROUNDING))
    missed = ~arm & (distance[:, 1] < -ROUNDING)
    assert missed.sum() <= 4 * MJX_MISSES * np.sum(distance[:, 1] <= 0.0) + 1  # few states: chance has its part
    assert np.all(distance[missed, 1] > -MJX_MISS_DEPTH)
    by_kernel = compiled.arm_collides(robot, states[:, :3], states[:, 3:], three_boxes)
    clear = ~doubtful(distance[:, 1], 0.0) & ~missed
    np.testing.assert_array_equal(arm[clear], np.asarray(by_kernel)[clear])
    of_table = distance[:, 1] <= 0.0
    own = mujoco_scene.MujocoChecker(robot, Room.from_config()).distances(states[:, :3], states[:, 3:])[:, 1] <= 0.0
    assert np.mean(of_table != own) > 0.02, "says little"


def test_a_room_of_another_number_of_boxes_is_refused(world, three_boxes):
    with pytest.raises(ValueError, match="room: found 4 boxes, allowed are 1, as the model has"):
        world.with_room(three_boxes)


@pytest.mark.slow
def test_mjx_base_contacts_follow_the_table(world, robot, states):
    small = Room.of_table(half_size=jnp.array([0.5, 0.9]), height=jnp.array(0.4))
    own, pose = world.with_room(small), jnp.asarray(states[:1000, :3], jnp.float32)
    found = jax.jit(jax.vmap(lambda pose: own.base_touches(own.move(own.blank, pose, jnp.zeros(DOF)))))(pose)
    shrunk, grown = (clearance.base_collides(robot, pose, small, touching=TOUCHING + d) for d in (-ROUNDING, ROUNDING))
    clear = np.asarray(shrunk == grown)
    np.testing.assert_array_equal(np.asarray(found)[clear], np.asarray(grown)[clear])


def test_pick_takes_the_mjx_check(mjx, robot, room):
    base_pose = jnp.array([[0.3, -0.85, 0.0], [0.3, -0.85, np.pi], [0.0, -0.9, 1.0], [2.5, 0.0, 0.0]])
    grasp = jnp.array([0.2, -0.2, 1.155, 0.4])
    config = PickConfig(chunk=4)
    by_kernel = compiled.pick(robot, base_pose, grasp, room)
    by_mjx = jax.jit(lambda: pick(robot, base_pose, top_down(grasp), room, config, arm_check=mjx.arm_touches))()
    assert by_kernel.feasible.any()
    np.testing.assert_array_equal(by_mjx.reason, by_kernel.reason)
    np.testing.assert_allclose(by_mjx.time, by_kernel.time, rtol=1e-6)


def test_placed_scene_has_the_frames_of_mujoco(world, robot, scene):
    """MJX in float32 against MuJoCo, after up to nine joints: 1e-6 m."""
    model, data = mujoco_scene.scene_model(robot, scene)
    placed = jax.jit(world.place)(scene, scene.robot_start, jnp.asarray(robot.home, jnp.float32))
    by_name = mujoco_scene.build_model(robot, scene.room, np.full((3, 3), 0.1))
    for index in range(model.nbody):
        other = by_name.body(model.body(index).name).id
        np.testing.assert_allclose(placed.xpos[other], data.xpos[index], atol=2e-6)
        np.testing.assert_allclose(placed.xmat[other].reshape(-1), data.xmat[index], atol=2e-6)
    assert placed.xpos[by_name.body("object 2").id, 2] < -1.0


def test_world_can_be_vmapped_over_tables_and_scenes(world, scene, robot):
    """Objects stand on their surface, whatever its height."""
    scenes = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), scene)
    heights = jnp.array([0.75, 0.2])

    def place(scene, height):
        scene = dataclasses.replace(scene, surface_height=jnp.full(3, height))
        own = world.with_room(Room.of_table(scene.room.table_half_size, height))
        return own.place(scene, scene.robot_start, jnp.asarray(robot.home, jnp.float32)).mocap_pos[:, 2]

    z = jax.jit(jax.vmap(place))(scenes, heights)
    np.testing.assert_allclose(z[:, 0], heights + 0.105, rtol=1e-6)
    np.testing.assert_allclose(z[:, 2], mujoco_scene.PARKED[2])


def test_import_is_silent_and_nobody_imports_it_by_default():
    code = "import sys, basenet_jax.task.picking; assert 'mujoco.mjx' not in sys.modules; import basenet_jax.world.mjx"
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert finished.stdout == ""
