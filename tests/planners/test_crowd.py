"""Planners where objects stand so close that what is picked first decides what can be picked then."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.planners.candidates import check_candidates
from basenet_jax.planners.explanation import what_waits
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Reason, pick
from basenet_jax.task.plan import judge
from benchmarks.crowds import CrowdsOptions, draw_crowd

OBJECTS = 6

compiled_pick = jax.jit(pick, static_argnames="config")


@pytest.fixture(scope="module")
def crowd():
    """Six objects on 36 x 26 cm: one of them is free at no stop at first."""
    return draw_crowd(CrowdsOptions(objects=OBJECTS, strip_m=(0.36, 0.26), gap_m=0.008), 3).arrays


@pytest.fixture(scope="module")
def crowd_setup(crowd):
    return PlannerSetup(robot=jax.device_put(load_robot()), room=crowd.room)


@pytest.fixture(scope="module")
def candidates(crowd, crowd_setup):
    stops = crowd_setup.aligned_stops()
    return jax.device_get(check_candidates(crowd_setup.robot, crowd, stops.poses, world=crowd_setup.world))


def test_the_crowd_is_one(crowd, candidates):
    """Most objects can be had, and one only once another is gone."""
    assert np.sum(np.any(candidates.serves, axis=0)) >= OBJECTS - 1
    at_first = np.isfinite(candidates.clutter.times_among(crowd.mask, np))
    assert np.sum(candidates.serves & ~at_first) > 10
    assert not np.all(np.any(at_first, axis=0))
    slower = candidates.clutter.times_among(crowd.mask, np) > candidates.pick_time + 0.1
    assert np.sum(slower & at_first) > 0


@pytest.mark.parametrize(
    "name",
    [
        "greedy-stops",
        "dp",
        "basenet",
        "pbg-gc",
        "mbp-gc",
        pytest.param("refined", marks=pytest.mark.slow),
        pytest.param("basenet-sample", marks=pytest.mark.slow),
    ],
)
def test_it_grasps_what_any_order_can(name, crowd, crowd_setup, candidates):
    """The judge, who looks at what still stands, finds every step feasible; what is left out can't be had."""
    plan = make_planner(name, crowd_setup)(crowd, jax.random.key(0))
    outcome = jax.device_get(judge(crowd_setup.robot, crowd, plan, crowd_setup.world))
    served = np.asarray(plan.served)
    assert np.all(outcome.feasible[served]), [Reason(reason).name for reason in outcome.reason[served]]
    assert int(outcome.grasped) >= int(np.sum(np.any(candidates.serves, axis=0)))


def test_what_waits_could_not_have_been_picked_so_before(crowd, crowd_setup):
    """Each object that waits, tried again with one of the others back: not at all, or not as fast."""
    plan = jax.device_get(make_planner("dp", crowd_setup)(crowd, jax.random.key(0)))
    outcome = jax.device_get(judge(crowd_setup.robot, crowd, plan, crowd_setup.world))
    waits = what_waits(crowd_setup, crowd, plan)
    assert waits
    order = [slot for slot in plan.object_index.tolist() if slot >= 0]
    for slot, needed in waits:
        step = order.index(slot)
        assert all(order.index(other) < step for other in needed)
        for other in needed:
            stands = np.isin(np.arange(len(crowd.mask)), [*order[step + 1 :], other])
            left = dataclasses.replace(crowd.object_boxes, blocks_arm=stands)
            again = compiled_pick(
                crowd_setup.robot,
                plan.base_pose[step],
                crowd.grasps[slot],
                crowd.room,
                config=crowd_setup.world.pick,
                neighbours=left,
            )
            assert not again.feasible or again.time > outcome.pick_time[step] + 0.01
