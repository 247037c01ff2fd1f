"""PBG's rule, followed step by step in plain Python along the planned poses."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import NavigationConfig
from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.pbg import Pbg, nearest_first
from basenet_jax.planners.reachability import MapStore, map_candidates
from basenet_jax.task.drives import PointDrives
from basenet_jax.task.picking import Reason
from basenet_jax.task.prepared_world import prepare_world
from basenet_jax.world.boxes import Room
from tests import compiled
from tests.oracles.navigation import navigate

# T's slope at 0 is infinite: float32's 1e-7 rad of heading are a millisecond.
TIME, DISTANCE = 5e-3, 1e-5
KEY = jax.random.key(0)


def follow(scene, candidates, slots, poses):
    """Checks that these steps obey the rule; returns the slots that it passes over or that remain.

    Where two choices are equally good, the planned one is followed.
    """
    grasps, serves = np.asarray(scene.first_grasp, float), np.asarray(candidates.serves)
    base_pose = np.asarray(candidates.base_pose, float)
    pose, remaining, passed = np.asarray(scene.robot_start, float), set(np.flatnonzero(scene.mask).tolist()), []
    for slot, goal in zip(slots, np.asarray(poses, float), strict=True):
        distance = {o: math.dist(grasps[o, :2], pose[:2]) for o in remaining}
        while not serves[:, min(distance, key=lambda o: distance[o])].any():  # nobody serves the nearest
            nearest = min(distance, key=lambda o: distance[o])
            passed.append(nearest)
            remaining.remove(nearest)
            del distance[nearest]
        assert distance[slot] <= min(distance.values()) + DISTANCE
        drives = {tuple(q): navigate(pose, q).time for q in base_pose[serves[:, slot]]}
        assert drives[tuple(goal)] <= min(drives.values()) + TIME
        pose = goal
        remaining.remove(slot)
    return set(passed) | remaining


def as_candidates(poses, serves, reason):
    base_pose, served, why = (jnp.asarray(x) for x in (poses, serves, reason))
    return Candidates(base_pose, served, jnp.where(served, 1.0, jnp.inf), why)


def random_candidates(rng, scene, poses, each):
    """Each of the first four objects is served by so many random poses: few send the base all round the table."""
    serves = np.zeros((len(poses), len(scene.mask)), bool)
    for slot in range(4):
        serves[rng.permutation(len(poses))[:each], slot] = True
    reason = np.where(scene.mask & ~serves.any(axis=0), Reason.ARM_COLLIDES, Reason.NONE)
    return as_candidates(poses, serves, reason)


@pytest.mark.parametrize("each", [1, 3, 50])
@pytest.mark.parametrize("seed", range(4))
def test_every_step_is_the_rules(robot, random_scene, setup, seed, each):
    rng = np.random.default_rng(seed)
    scene = random_scene(seed, count=5)
    candidates = random_candidates(rng, scene, rng.permutation(setup.grid_poses), each)
    stops = prepare_world(robot, PointDrives(scene.room, NavigationConfig()), candidates.base_pose, all_pairs=False)
    steps, reason = jax.device_get(nearest_first(robot, scene, candidates, stops))
    found = steps.found
    left = follow(scene, candidates, steps.slot[found].tolist(), steps.base_pose[found])
    assert left == {4}
    assert reason[4] == Reason.ARM_COLLIDES
    assert found.sum() == 4


def test_an_object_that_can_not_be_driven_to_is_passed_over(robot, random_scene, setup):
    """The only pose that serves object 2 is inside the table, where no way leads."""
    scene = random_scene(2, count=5)
    poses = setup.grid_poses.copy()
    poses[0] = 0.0
    serves = np.tile(scene.mask, (len(poses), 1))
    serves[1:, 2] = False
    candidates = as_candidates(poses, serves, np.zeros(6, int))
    stops = prepare_world(robot, PointDrives(scene.room, NavigationConfig()), candidates.base_pose, all_pairs=False)
    steps, reason = jax.device_get(nearest_first(robot, scene, candidates, stops))
    assert sorted(steps.slot[steps.found].tolist()) == [0, 1, 3, 4]
    assert reason[2] == Reason.UNREACHABLE
    assert not (steps.base_pose[:, :2] == 0).all(axis=1).any()


@pytest.fixture(scope="module")
def pbg(setup):
    return Pbg(setup, checked=False)


@pytest.fixture(scope="module")
def pbg_gc(setup):
    return Pbg(setup, checked=True)


def steps_of(plan):
    """Slots and base poses of a plan's served steps."""
    plan = jax.device_get(plan)
    return plan.object_index[plan.served].tolist(), plan.base_pose[plan.served]


def test_by_the_map(pbg, setup, random_scene):
    scene = random_scene(4, count=5)
    reach_map = MapStore(setup.robot, setup.grid, setup.world.pick, None).for_scene(scene)
    candidates = map_candidates(reach_map, scene, jnp.asarray(setup.grid_poses))
    plan = pbg(scene, KEY)
    left = follow(scene, candidates, *steps_of(plan))
    assert left == {slot for slot in range(5) if candidates.reason[slot]}
    assert np.asarray(plan.object_index).tolist()[5:] == [-1]
    assert len(steps_of(plan)[0]) >= 4


def test_checked(pbg_gc, setup, random_scene):
    """Every planned pick succeeds; that is what the check is for."""
    scene = random_scene(4, count=5)
    candidates = compiled.check_candidates(setup.robot, scene, setup.grid_poses, setup.world)
    plan = pbg_gc(scene, KEY)
    left = follow(scene, candidates, *steps_of(plan))
    assert left == {slot for slot in range(5) if candidates.reason[slot]}
    outcome = compiled.execute(setup.robot, scene, plan)
    np.testing.assert_array_equal(outcome.feasible, plan.served)
    assert int(outcome.grasped) >= 4


@pytest.mark.parametrize("name", ["pbg", "pbg_gc"])
def test_an_object_out_of_reach_is_reported_and_the_rest_planned(request, name, random_scene, hopeless):
    planner = request.getfixturevalue(name)
    scene = random_scene(4, count=5)
    every, rest = planner(scene, KEY), planner(hopeless(scene, [1]), KEY)
    assert np.asarray(rest.served).tolist() == [slot < np.sum(every.served) - 1 for slot in range(6)]
    step = np.asarray(rest.object_index).tolist().index(1)
    assert rest.reason[step] == Reason.OUT_OF_REACH
    assert np.asarray(rest.base_pose)[step].tolist() == [0.0, 0.0, 0.0]
    assert sorted(np.asarray(rest.object_index).tolist()) == [-1, 0, 1, 2, 3, 4]


def test_empty_slots_change_nothing(pbg, random_scene, spoilt):
    scene = random_scene(4, count=4)
    plan, other = jax.device_get((pbg(scene, KEY), pbg(spoilt(scene), KEY)))
    jax.tree.map(np.testing.assert_array_equal, plan, other)
    assert plan.object_index[4:].tolist() == [-1, -1]
    assert not plan.served[4:].any()


def test_a_table_that_fills_the_grid_leaves_nothing_to_choose(setup, random_scene):
    huge = Room.of_table(half_size=jnp.array([3.0, 3.0]), height=jnp.array(0.75))
    scene = dataclasses.replace(random_scene(4, count=5), room=huge)
    plan = Pbg(setup.with_room(huge), checked=False)(scene, KEY)
    assert not np.any(plan.served)
    assert np.asarray(plan.reason).tolist() == 5 * [Reason.BASE_COLLIDES] + [Reason.NONE]
