"""The judge: what a plan's execution comes to, by the rules of episodes."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import dataclasses

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from basenet_jax.robot.robot_mjcf import TOOL_SITE
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan, with_singular_values
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import of_class
from tests import compiled

GOOD = np.array([0.35, -0.9, 0.05], np.float32)


@pytest.fixture(scope="module")
def judge(robot):
    return lambda scene, plan: compiled.execute(robot, scene, plan)


@pytest.fixture(scope="module")
def scene(room, robot):
    """Four mugs that can all be picked from `GOOD`, in the first slots of six."""
    scene = compiled.draw_scene(0, 4, room)
    x = [-0.05, 0.1, 0.25, 0.4, 0.0, 0.0]
    scene = dataclasses.replace(
        scene,
        object_pose=np.stack([x, np.full(6, -0.25), np.linspace(0, 1, 6)], axis=-1).astype(np.float32),
        object_size=np.tile(np.array([0.08, 0.08, 0.082], np.float32), (6, 1)),
        object_grasps=of_class(np.tile(np.array([-0.06, 0.30, 0.0], np.float32), (6, 1)), np),
        robot_start=np.array([2.6, -0.5, 1.0], np.float32),
    )
    assert np.all(compiled.pick(robot, GOOD, scene.first_grasp[:4], room).feasible), (
        "the scene is not what these tests need"
    )
    return scene


def make_plan(poses, order=(2, 0, 3, 1, -1, -1), served=None):
    served = [index >= 0 for index in order] if served is None else served
    parts = np.array(order), np.stack(poses).astype(np.float32), np.array(served), np.zeros(6, np.int32)
    return Plan(*parts)  # pyright: ignore[reportArgumentType]


def test_times_are_those_of_the_cost_functions(judge, scene, robot, room):
    there = np.array([0.28, -0.83, 0.05], np.float32)
    plan = make_plan([GOOD, GOOD, there, there, GOOD, GOOD])
    outcome = judge(scene, plan)
    starts = np.stack([scene.robot_start, GOOD, GOOD, there])
    drives = compiled.navigation_time(robot, starts, plan.base_pose[:4], room)
    picks = compiled.pick(robot, plan.base_pose[:4], np.asarray(scene.first_grasp)[plan.object_index[:4]], room)
    np.testing.assert_allclose(outcome.navigation_time[:4], drives, atol=1e-5)
    np.testing.assert_allclose(outcome.pick_time[:4], picks.time, atol=1e-5)
    assert float(outcome.navigation_time[1]) == 0.0, "staying costs nothing"
    assert int(outcome.grasped) == 4
    assert float(outcome.execution) == pytest.approx(float(drives.sum() + picks.time.sum()), abs=1e-4)
    assert not np.any(np.asarray(outcome.is_step[4:]))
    assert float(outcome.navigation_time[4:].sum()) == 0.0


def test_an_infeasible_pick_costs_nothing_and_the_episode_goes_on(judge, scene):
    far = np.array([-2.0, 1.5, 0.0])
    outcome = judge(scene, make_plan([GOOD, far, GOOD, GOOD, GOOD, GOOD]))
    assert list(np.asarray(outcome.reason[:4])) == [0, Reason.OUT_OF_REACH, 0, 0]
    assert float(outcome.pick_time[1]) == 0.0
    assert float(outcome.navigation_time[1]) > 0.0, "the drive was made"
    assert float(outcome.navigation_time[2]) > 0.0, "and so was the one back"
    assert int(outcome.grasped) == 3


def test_a_collision_ends_the_episode(judge, scene):
    inside = np.array([0.3, -0.5, 0.0])
    outcome = judge(scene, make_plan([GOOD, inside, GOOD, GOOD, GOOD, GOOD]))
    assert list(np.asarray(outcome.reason[:4])) == [0, Reason.BASE_COLLIDES, Reason.NOT_EXECUTED, Reason.NOT_EXECUTED]
    assert float(outcome.navigation_time[1:].sum()) == 0.0
    assert int(outcome.grasped) == 1


def test_an_object_without_base_pose_is_a_step_that_costs_nothing(judge, scene):
    plan = make_plan([GOOD] * 6, served=[True, True, True, False, False, False])
    plan = dataclasses.replace(plan, reason=np.where(np.arange(6) == 3, Reason.ARM_COLLIDES, 0))
    outcome = judge(scene, plan)
    assert int(outcome.reason[3]) == Reason.ARM_COLLIDES
    assert not bool(outcome.feasible[3])
    assert float(outcome.navigation_time[3]) == 0.0
    assert int(outcome.grasped) == 3


def test_a_batch_is_its_plans_one_by_one_even_on_different_tables(robot, judge, scene):
    on_low, half_size = (
        Room.of_table(scene.room.table_half_size, np.float32(0.55), np),
        np.array([1.0, 0.6], np.float32),
    )
    low = dataclasses.replace(scene, room=on_low, surface_height=np.full(6, 0.55, np.float32))
    wide = dataclasses.replace(scene, room=Room.of_table(half_size, scene.room.table_height, np))
    plan = make_plan([GOOD] * 6)
    batch = jax.tree.map(lambda *x: np.stack(x), scene, low, wide)
    together = judge(batch, jax.tree.map(lambda x: np.stack([x] * 3), plan))
    for row, single in enumerate((scene, low, wide)):
        alone = judge(single, plan)
        np.testing.assert_array_equal(together.reason[row], alone.reason)
        np.testing.assert_allclose(together.execution[row], alone.execution, atol=1e-4)
    assert int(together.reason[2, 0]) == Reason.BASE_COLLIDES


def least_by_mujoco(robot, waypoints):
    """The least singular value of MuJoCo's Jacobian of tool0 over some joint states, in float64."""
    model = mujoco.MjModel.from_xml_string(robot.model_xml)
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in robot.joint_names]
    jacobian = np.zeros((len(waypoints), 6, model.nv))
    for rows, state in zip(jacobian, np.asarray(waypoints, float), strict=True):
        data.qpos[[joint.qposadr[0] for joint in joints]] = state
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, rows[:3], rows[3:], model.site(TOOL_SITE).id)
    return np.linalg.svd(jacobian[..., [joint.dofadr[0] for joint in joints]], compute_uv=False)[:, -1].min()


def test_the_least_singular_value_of_each_pick_is_that_of_mujocos_jacobian(judge, scene, robot):
    outcome = judge(scene, make_plan([GOOD, [-2.0, 1.5, 0.0], GOOD, GOOD, GOOD, GOOD]))
    joints = np.array(outcome.joints)
    joints[2, 3, 2] = 0.0  # a stretched elbow, between pre-grasp and grasp
    outcome = with_singular_values(robot, dataclasses.replace(outcome, joints=joints))
    least = np.array(outcome.least_singular_value)
    assert list(least[[1, 4, 5]]) == [0.0, 0.0, 0.0], "nothing is picked"
    assert least[2] == pytest.approx(0.0, abs=1e-6)
    # float32, of a matrix of norm 2
    np.testing.assert_allclose(least[[0, 2, 3]], [least_by_mujoco(robot, joints[k]) for k in (0, 2, 3)], atol=1e-6)
    assert least[0] > 0.02


@pytest.mark.slow
def test_float64_agrees(judge, scene):
    plan = make_plan([GOOD, GOOD + 0.01, GOOD - 0.02, GOOD, GOOD, GOOD])
    single = judge(scene, plan)

    def widen(x):
        return np.asarray(x, np.float64) if x.dtype == np.float32 else np.asarray(x)

    with jax.enable_x64(True):
        double = judge(jax.tree.map(widen, scene), jax.tree.map(widen, plan))
        assert double.pick_time.dtype == jnp.float64
    np.testing.assert_array_equal(single.reason, double.reason)
    # T's slope at 0 is infinite: float32's 1e-7 rad of heading are a millisecond.
    np.testing.assert_allclose(single.navigation_time, double.navigation_time, atol=5e-3)
    np.testing.assert_allclose(single.pick_time, double.pick_time, atol=5e-4)
