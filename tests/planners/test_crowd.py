"""Planners where objects stand so close that what is picked first decides what can be picked then."""

import jax
import numpy as np
import pytest

from basenet_jax.planners.candidates import check_candidates
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import judge
from benchmarks.crowds import CrowdsOptions, draw_crowd

OBJECTS = 6


@pytest.fixture(scope="module")
def crowd():
    """Six objects on a strip of half a metre."""
    return draw_crowd(CrowdsOptions(objects=OBJECTS, strip_m=(0.42, 0.3), gap_m=0.01), 3).arrays


@pytest.fixture(scope="module")
def crowd_setup(crowd):
    return PlannerSetup(robot=jax.device_put(load_robot()), room=crowd.room)


@pytest.fixture(scope="module")
def candidates(crowd, crowd_setup):
    stops = crowd_setup.aligned_stops()
    return jax.device_get(check_candidates(crowd_setup.robot, crowd, stops.poses, world=crowd_setup.world))


def test_the_crowd_is_one(crowd, candidates):
    """Most objects can be had, and some only from a stop or by a way that needs another gone."""
    assert np.sum(np.any(candidates.serves, axis=0)) >= OBJECTS - 1
    at_first = np.isfinite(candidates.clutter.times_among(crowd.mask, np))
    assert np.sum(candidates.serves & ~at_first) > 10
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
