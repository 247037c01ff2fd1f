"""Execution with errors against a plain loop: one draw after the other, one parking after the other."""

import math

import jax
import numpy as np
import pytest

from basenet_jax.config import PickConfig, UncertaintyConfig, WorldConfig
from basenet_jax.planners.greedy_stops import GreedyStops
from basenet_jax.task.noisy_execution import MOST_TRIES, Replanning, simulate_execution
from basenet_jax.task.plan import compiled_execute
from basenet_jax.task.prepared_world import prepare_world
from tests import compiled
from tests.task.test_reliability import composed, seen_grasp

DRAWS, WORTH, KEY = 12, 4.0, jax.random.key(3)
# The clearance of planning, so that `pick` is the program that other tests compiled, and parking fails often.
UNCERTAINTY = UncertaintyConfig(sd_xy_m=0.08, sd_heading_rad=0.15, draws=DRAWS, base_clearance_m=0.1)


@pytest.fixture(scope="module")
def scene(room):
    return compiled.draw_scene(8, compiled.SLOTS, room)


@pytest.fixture(scope="module")
def setup(robot):
    return compiled.make_setup(robot)


@pytest.fixture(scope="module")
def plan(setup, scene):
    return jax.device_get(GreedyStops(setup)(scene, KEY))


@pytest.fixture(scope="module")
def outcome(robot, scene, plan):
    return compiled.execute(robot, scene, plan)


@pytest.fixture(scope="module")
def replanning(setup, scene):
    """Every second stop in line with the table, so that not all objects have one."""
    poses = setup.aligned_stops(compiled.ALIGNED).poses[::2]
    candidates = compiled.check_candidates(setup.robot, scene, poses)
    return Replanning(prepare_world(setup.robot, setup.drives, poses), candidates.pick_time, WORTH)


def normal(key, shape, spread):
    return np.asarray(jax.random.normal(key, shape), float) * np.array(spread)


def execute_one(robot, scene, plan, outcome, replanning, key):
    """One draw: objects grasped, N, G, parkings, and whether all went well at first."""
    base_spread = (UNCERTAINTY.sd_xy_m, UNCERTAINTY.sd_xy_m, UNCERTAINTY.sd_heading_rad)
    seen_spread = (UNCERTAINTY.sd_object_m, UNCERTAINTY.sd_object_m, UNCERTAINTY.sd_object_rad)
    route = [(int(slot), tuple(plan.base_pose[i])) for i, slot in enumerate(plan.object_index) if outcome.feasible[i]]
    options = [
        (pose, dict(enumerate(row))) for pose, row in zip(replanning.prepared.poses, replanning.pick_time, strict=True)
    ]
    visits = []
    for step, (slot, pose) in enumerate(route):
        if not visits or visits[-1][0] != pose:
            visits.append((pose, {}))
        visits[-1][1][slot] = float(outcome.pick_time[step])
    options += visits
    poses = np.array([pose for pose, _ in options], np.float32)
    fastest = {slot: min(times.get(slot, math.inf) for _, times in options) for slot, _ in route}
    left, tries, follows, first = {slot for slot, _ in route}, {}, True, True
    stands = intended = np.asarray(scene.robot_start, float)
    grasped = parkings = 0
    navigation = picking = 0.0
    while left:
        key, base_key, seen_key = jax.random.split(key, 3)
        drives = compiled.navigation_time(robot, stands.astype(np.float32), poses, scene.room)
        if not np.any(np.isfinite(drives)):
            drives = compiled.navigation_time(robot, intended.astype(np.float32), poses, scene.room)
        if follows:
            choice = len(options) - len(visits) + next(i for i, (_, own) in enumerate(visits) if left & own.keys())
        else:
            costs = []
            for (_, times), drive in zip(options, drives, strict=True):
                can = [slot for slot in left if math.isfinite(times.get(slot, math.inf))]
                gain = sum(WORTH - (times[slot] - fastest[slot]) for slot in can)
                costs.append(drive - gain if can else math.inf)
            choice = int(np.argmin(costs))
            if not math.isfinite(costs[choice]):
                first = False
                break
        intended, times = np.asarray(options[choice][0], float), options[choice][1]
        stands = composed(intended, normal(base_key, (3,), base_spread))
        seen = normal(seen_key, (len(scene.mask), 3), seen_spread)
        targets = sorted(slot for slot in left if math.isfinite(times.get(slot, math.inf)))
        grasps = np.array([seen_grasp(scene, slot, seen[slot]) for slot in targets], np.float32)
        picks = compiled.pick(robot, np.tile(stands, (len(targets), 1)).astype(np.float32), grasps, scene.room)
        navigation, parkings = navigation + float(drives[choice]), parkings + 1
        for slot, feasible, time in zip(targets, picks.feasible, picks.time, strict=True):
            if feasible:
                grasped, picking = grasped + 1, picking + float(time)
                left.discard(slot)
            else:
                follows = first = False
                tries[slot] = tries.get(slot, 0) + 1
                if tries[slot] == MOST_TRIES:
                    left.discard(slot)
    return grasped, navigation, picking, parkings, first


def test_agrees_with_a_plain_loop(robot, scene, plan, outcome, replanning):
    found = jax.device_get(simulate_execution(robot, scene, plan, outcome, replanning, KEY, uncertainty=UNCERTAINTY))
    expected = [execute_one(robot, scene, plan, outcome, replanning, key) for key in jax.random.split(KEY, DRAWS)]
    grasped, navigation, picking, parkings, first = (np.array(each) for each in zip(*expected, strict=True))
    np.testing.assert_array_equal(found.grasped, grasped)
    np.testing.assert_array_equal(found.parkings, parkings)
    np.testing.assert_array_equal(found.at_first, first)
    # A drive of some metres rounds its angles to 1e-6 rad, whose square roots are times.
    np.testing.assert_allclose(found.navigation, navigation, rtol=1e-3)
    np.testing.assert_allclose(found.picking, picking, rtol=1e-3)
    assert np.any(grasped < len(scene.mask)), "nothing is given up"
    assert np.any(parkings > 4), "nothing is tried again"


@pytest.mark.slow
@pytest.mark.parametrize("in_the_way", ["off", "on"])
def test_without_errors_the_judge_agrees(robot, scene, plan, replanning, in_the_way):
    world = WorldConfig(pick=PickConfig(object_in_the_way=in_the_way))
    still = UncertaintyConfig(
        sd_xy_m=0, sd_heading_rad=0, sd_object_m=0, sd_object_rad=0, draws=2, base_clearance_m=0.1
    )
    outcome = jax.device_get(compiled_execute(robot, scene, plan, None, config=world))
    found = simulate_execution(robot, scene, plan, outcome, replanning, KEY, uncertainty=still, world=world)
    np.testing.assert_array_equal(found.grasped, outcome.grasped)
    np.testing.assert_allclose(found.navigation, outcome.navigation, rtol=1e-4)
    np.testing.assert_allclose(found.picking, outcome.picking, rtol=1e-4)
    assert np.all(found.at_first)
