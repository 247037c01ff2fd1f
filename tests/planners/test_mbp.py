"""MBP: no fewer stops would do, the nearest is visited next, and all that a stop serves is picked there."""

import dataclasses
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax.config import NavigationConfig
from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.mbp import Mbp, nearest_stops, picks_at_stops
from basenet_jax.planners.reachability import MapStore, map_candidates
from basenet_jax.task.drives import PointDrives
from basenet_jax.task.picking import Reason
from basenet_jax.task.prepared_world import prepare_world
from basenet_jax.world.boxes import Room
from tests import compiled
from tests.oracles.navigation import navigate

# T's slope at 0 is infinite: float32's 1e-7 rad of heading are a millisecond.
TIME = 5e-3
KEY = jax.random.key(0)


def follow_tour(scene, base_pose, stop_of_pose, visited):
    """Checks that each visited candidate is the nearest one of all stops still open; returns the stops left."""
    pose, remaining = np.asarray(scene.robot_start, float), set(stop_of_pose.tolist()) - {-1}
    for goal in visited:
        drives = {k: navigate(pose, base_pose[k]).time for k in range(len(base_pose)) if stop_of_pose[k] in remaining}
        assert drives[goal] <= min(drives.values()) + TIME
        remaining.remove(stop_of_pose[goal])
        pose = base_pose[goal]
    return remaining


def as_candidates(poses, serves, pick_time=None):
    time = np.where(serves, 1.0, np.inf) if pick_time is None else pick_time
    base_pose, served, pick = (jnp.asarray(x) for x in (poses, serves, time))
    return Candidates(base_pose, served, pick, jnp.zeros(serves.shape[1], int))


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_stop_is_visited_next(robot, random_scene, setup, seed):
    rng = np.random.default_rng(seed)
    scene = random_scene(seed)
    poses = rng.permutation(setup.grid_poses)
    stop = np.where(np.arange(len(poses)) < 60, rng.integers(-1, 4, len(poses)), -1)
    candidates = as_candidates(poses, np.ones((len(poses), 6), bool))
    stops = prepare_world(robot, PointDrives(scene.room, NavigationConfig()), candidates.base_pose, all_pairs=False)
    visited = np.asarray(nearest_stops(robot, scene, candidates, jnp.asarray(stop), stops))
    assert (visited >= 0).tolist() == [True] * 4 + [False] * 2
    assert not follow_tour(scene, poses.astype(float), stop, visited[:4].tolist())


def test_a_stop_that_can_not_be_driven_to_is_left_out(robot, random_scene, setup):
    poses = setup.grid_poses.copy()
    poses[7] = 0.0  # inside the table
    stop = np.full(len(poses), -1)
    stop[[3, 7, 20]] = [0, 1, 2]
    candidates = as_candidates(poses, np.ones((len(poses), 6), bool))
    stops = prepare_world(
        robot, PointDrives(random_scene(0).room, NavigationConfig()), candidates.base_pose, all_pairs=False
    )
    visited = np.asarray(nearest_stops(robot, random_scene(0), candidates, jnp.asarray(stop), stops))
    assert sorted(visited.tolist()) == [-1, -1, -1, -1, 3, 20]


def test_picks_at_a_stop_are_the_fastest_first_then_the_nearest():
    poses = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], np.float32)
    serves = np.array([[True, True, True, False], [False, True, False, True]])
    pick_time = np.where(serves, [[9.0, 9.0, 8.0, 0.0], [0.0, 1.0, 0.0, 1.0]], np.inf)
    far = [np.inf, np.inf]  # pads
    grasps = np.array([[[0.5, 0.0], far], [[0.3, 0.0], [0.1, 0.0]], [[0.9, 0.0], far], [[0.0, 0.3], far]])
    order, pose = picks_at_stops(np.array([0, 1]), as_candidates(poses, serves, pick_time), grasps)
    assert order.tolist() == [2, 1, 0, 3]
    assert pose.tolist() == [0, 0, 0, 1]


def fewest_stops(serves):
    """By trying all choices of distinct coverage sets."""
    sets, wanted = np.unique(serves, axis=0), serves.any(axis=0)
    maximal = [a for a in sets if not any((b >= a).all() and (b > a).any() for b in sets)]
    for size in range(len(maximal) + 1):
        if any((np.any([*chosen, ~wanted], axis=0)).all() for chosen in combinations(maximal, size)):
            return size
    raise AssertionError("all sets together cover what can be covered")


@pytest.fixture(scope="module")
def mbp(setup):
    return Mbp(setup, checked=False)


@pytest.fixture(scope="module")
def mbp_gc(setup):
    return Mbp(setup, checked=True)


@pytest.fixture(scope="module")
def candidates_of(setup):
    maps = MapStore(setup.robot, setup.grid, setup.world.pick, None)
    poses = jnp.asarray(setup.grid_poses)

    def make(scene, checked=False):
        if checked:
            return compiled.check_candidates(setup.robot, scene, poses, setup.world)
        return jax.device_get(map_candidates(maps.for_scene(scene), scene, poses))

    return make


def check_plan(scene, candidates, plan):
    """Fewest stops, visited by the rule, each of them left only when nothing that it serves remains."""
    plan = jax.device_get(plan)
    slots, poses = plan.object_index[plan.served], plan.base_pose[plan.served]
    served = candidates.serves.any(axis=0)
    assert sorted(slots.tolist()) == np.flatnonzero(served).tolist()
    row = {tuple(pose): k for k, pose in enumerate(candidates.base_pose.tolist())}
    stops = [row[tuple(pose)] for pose in poses.tolist()]
    visited = list(dict.fromkeys(stops))
    assert len(visited) == fewest_stops(candidates.serves)
    assert stops == sorted(stops, key=visited.index), "a stop is made once"
    remaining = set(slots.tolist())
    for stop in visited:
        here = {slot for slot, at in zip(slots.tolist(), stops, strict=True) if at == stop}
        assert here == remaining & set(np.flatnonzero(candidates.serves[stop]).tolist())
        remaining -= here
    same = [(candidates.serves == candidates.serves[stop]).all(axis=1) for stop in visited]
    stop_of_pose = np.select(same, list(range(len(visited))), -1)
    assert not follow_tour(scene, candidates.base_pose.astype(float), stop_of_pose, visited)


@settings(max_examples=12)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 6))
def test_plans_by_the_map(mbp, candidates_of, random_scene, seed, count):
    scene = random_scene(seed, count=count)
    check_plan(scene, candidates_of(scene), mbp(scene, KEY))


def test_checked_plans(mbp_gc, candidates_of, setup, random_scene):
    scene = random_scene(5)
    candidates, plan = candidates_of(scene, checked=True), mbp_gc(scene, KEY)
    check_plan(scene, candidates, plan)
    outcome = compiled.execute(setup.robot, scene, plan)
    np.testing.assert_array_equal(outcome.feasible, plan.served)
    planned = np.sum(
        [candidates.pick_time[(candidates.base_pose == pose).all(axis=1), slot] for pose, slot in steps(plan)]
    )
    assert float(outcome.picking) == pytest.approx(float(planned), abs=1e-3)


def steps(plan):
    """Base pose and slot of each served step."""
    plan = jax.device_get(plan)
    return zip(plan.base_pose[plan.served], plan.object_index[plan.served], strict=True)


@pytest.mark.parametrize("name", ["mbp", "mbp_gc"])
def test_an_object_out_of_reach_is_reported_and_the_rest_planned(request, name, random_scene, hopeless, candidates_of):
    planner = request.getfixturevalue(name)
    scene = hopeless(random_scene(5), [0, 3])
    plan = planner(scene, KEY)
    check_plan(scene, candidates_of(scene, checked=name == "mbp_gc"), plan)
    index = np.asarray(plan.object_index).tolist()
    for slot in (0, 3):
        assert plan.reason[index.index(slot)] == Reason.OUT_OF_REACH
        assert not plan.served[index.index(slot)]
    assert sorted(index) == list(range(6))
    assert np.sum(plan.served) >= 3


def test_nothing_in_reach(mbp, random_scene, hopeless):
    plan = mbp(hopeless(random_scene(5, count=5), range(6)), KEY)
    assert not np.any(plan.served)
    assert np.asarray(plan.reason).tolist() == 5 * [Reason.OUT_OF_REACH] + [Reason.NONE]


def test_a_start_that_nothing_can_be_reached_from(mbp, random_scene):
    """From inside the table no way leads out."""
    scene = dataclasses.replace(random_scene(5, count=5), robot_start=np.zeros(3, np.float32))
    plan = mbp(scene, KEY)
    assert not np.any(plan.served)
    assert set(np.asarray(plan.reason)[:5].tolist()) <= {Reason.UNREACHABLE, Reason.OUT_OF_REACH}
    assert Reason.UNREACHABLE in np.asarray(plan.reason)


def test_empty_slots_change_nothing(mbp, random_scene, spoilt):
    scene = random_scene(6, count=4)
    plan, other = jax.device_get((mbp(scene, KEY), mbp(spoilt(scene), KEY)))
    jax.tree.map(np.testing.assert_array_equal, plan, other)
    assert plan.object_index[4:].tolist() == [-1, -1]
    assert not plan.served[4:].any()


def test_a_table_that_fills_the_grid_leaves_nothing_to_choose(setup, random_scene):
    huge = Room.of_table(half_size=jnp.array([3.0, 3.0]), height=jnp.array(0.75))
    scene = dataclasses.replace(random_scene(5, count=5), room=huge)
    plan = Mbp(setup.with_room(huge), checked=False)(scene, KEY)
    assert not np.any(plan.served)
    assert np.asarray(plan.reason).tolist() == 5 * [Reason.BASE_COLLIDES] + [Reason.NONE]
