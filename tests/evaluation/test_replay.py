"""MuJoCo's second opinion: it agrees with good picks and finds each kind of bad one."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.evaluation.replay import PickReplay, confirmed, replay
from basenet_jax.planners.basenet import BaSeNet
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import execute
from basenet_jax.world.boxes import Room
from tests.judged import GOOD


@pytest.fixture(scope="module")
def good_pick(batch, plans, outcomes):
    """Base pose, joints and grasp of the first pick, in float64."""
    grasp = jax.tree.map(lambda x: np.asarray(x[0, 0, 0]), batch.grasps)
    return np.array(GOOD, float), np.array(outcomes.joints[0, 0], float), grasp


@pytest.fixture(scope="module")
def referee(robot, room):
    return PickReplay(robot, room)


def test_mujoco_agrees_with_good_picks(robot, batch, plans, outcomes):
    assert np.all(replay(robot, batch, plans, outcomes) == Reason.NONE)


def test_a_good_pick_breaks_no_rule(referee, good_pick):
    assert referee.broken_rule(*good_pick) == Reason.NONE


def test_a_base_in_the_table_is_found(referee, good_pick):
    pose, joints, grasp = good_pick
    assert referee.broken_rule(pose + np.array([0.0, 0.3, 0.0]), joints, grasp) == Reason.BASE_COLLIDES


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        ([0.9e-3, 0, 0, 0], Reason.NONE),
        ([1.1e-3, 0, 0, 0], Reason.OUT_OF_REACH),
        ([0, 0, -1.1e-3, 0], Reason.OUT_OF_REACH),
        ([0, 0, 0, np.radians(0.48)], Reason.NONE),
        ([0, 0, 0, np.radians(0.52)], Reason.OUT_OF_REACH),
        ([0, 0, 0, np.pi], Reason.NONE),  # the gripper is symmetric
        ([0, 0, 0, np.pi / 2], Reason.OUT_OF_REACH),
    ],
)
def test_a_tool_beside_its_grasp_is_found(referee, good_pick, offset, expected):
    pose, joints, grasp = good_pick
    x, y, z, yaw = offset
    moved = dataclasses.replace(grasp, pose=grasp.pose.astype(float) + np.array([x, y, z, 0.0, 0.0, yaw]))
    assert referee.broken_rule(pose, joints, moved) == expected


def test_a_waypoint_out_of_place_is_found(referee, good_pick):
    pose, joints, grasp = good_pick
    for waypoint in range(len(joints)):
        moved = joints.copy()
        moved[waypoint, 3] += 0.02
        assert referee.broken_rule(pose, moved, grasp) == Reason.OUT_OF_REACH


def test_an_arm_in_the_table_is_found(robot, batch, good_pick):
    pose, joints, grasp = good_pick
    raised = jax.tree.map(lambda x: x[0], batch.room)
    top = np.float32(float(grasp.pose[2]) - 0.2)  # touches the gripper's end
    raised = Room.of_table(raised.table_half_size, top)
    assert PickReplay(robot, raised).broken_rule(pose, joints, grasp) == Reason.ARM_COLLIDES


def test_a_collision_only_on_the_way_to_stow_is_found(robot, room, good_pick):
    """With a stow posture deep in the table, nothing but the last of the swept points touches."""
    pose, joints, grasp = good_pick
    deep = np.array(joints[-1])
    deep[1] += 0.8
    lowered = dataclasses.replace(robot, stow=deep)
    assert PickReplay(lowered, room).broken_rule(pose, joints, grasp) == Reason.ARM_COLLIDES
    assert PickReplay(dataclasses.replace(robot, stow=joints[0]), room).broken_rule(pose, joints, grasp) == Reason.NONE


def test_each_scene_is_replayed_on_its_own_table(robot, batch, plans, outcomes):
    heights = jnp.array([0.75, 1.0, 0.75])  # the second table rises to the gripper, the objects don't
    risen = dataclasses.replace(batch, room=Room.of_table(batch.room.table_half_size, heights))
    np.testing.assert_array_equal(risen.first_grasp, batch.first_grasp)
    broken = replay(robot, risen, plans, outcomes)
    np.testing.assert_array_equal(broken[1], Reason.ARM_COLLIDES)
    np.testing.assert_array_equal(broken[[0, 2]], Reason.NONE)


def test_infeasible_picks_are_not_replayed_and_disagreements_are_not_grasped(robot, batch, plans, outcomes):
    shifted = dataclasses.replace(outcomes, joints=outcomes.joints + 0.05)
    skipped = dataclasses.replace(shifted, feasible=shifted.feasible & (np.arange(3) > 0)[:, None])
    broken = replay(robot, batch, plans, skipped)
    np.testing.assert_array_equal(broken[0], Reason.NONE)
    np.testing.assert_array_equal(broken[1:], Reason.OUT_OF_REACH)
    after = confirmed(outcomes, broken)
    np.testing.assert_array_equal(np.sum(after.feasible, axis=1), [2, 0, 0])
    np.testing.assert_allclose(np.sum(after.pick_time, axis=1)[1:], 0.0)
    assert float(after.picking[0]) == pytest.approx(float(outcomes.picking[0]))
    np.testing.assert_array_equal(after.reason[1:], Reason.OUT_OF_REACH)
    np.testing.assert_array_equal(after.navigation_time, outcomes.navigation_time)


@pytest.mark.slow
def test_mujoco_agrees_with_a_thousand_plans(robot):
    scenes = random_scenes(jax.random.key(11), 10, 1000)
    planner = BaSeNet(PlannerSetup(robot=jax.device_put(robot)))
    plans = [planner(jax.tree.map(lambda x, i=i: x[i], scenes), jax.random.key(0)) for i in range(1000)]
    plans = jax.tree.map(lambda *leaves: jnp.stack(leaves), *plans)
    outcomes = jax.jit(execute)(robot, scenes, plans)
    assert float(jnp.mean(outcomes.feasible)) > 0.9
    assert np.sum(replay(robot, scenes, plans, outcomes) != Reason.NONE) == 0
