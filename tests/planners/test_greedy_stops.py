import jax
import numpy as np

from basenet_jax.planners.greedy_stops import GreedyStops, greedy_stops
from tests import compiled

WORTH = 4.0


def plainly(robot, scene, candidates):
    """The rule once more, in plain NumPy."""
    pick = np.asarray(candidates.pick_time)
    serves = np.isfinite(pick)
    excess = np.where(serves, pick, 0.0) - np.where(serves.any(axis=0), pick.min(axis=0), 0.0)
    pose, remaining, stops = scene.robot_start, set(np.flatnonzero(scene.mask).tolist()), []
    while remaining:
        drive = compiled.navigation_time(robot, pose, candidates.base_pose, scene.room)
        cost = [
            drive[p] - sum(WORTH - excess[p, o] for o in remaining if serves[p, o])
            if any(serves[p, o] for o in remaining)
            else np.inf
            for p in range(len(pick))
        ]
        best = int(np.argmin(cost))
        served = {o for o in remaining if serves[best, o]}
        stops.append((best, served))
        remaining -= served
        pose = candidates.base_pose[best]
    return stops


def test_it_follows_the_rule(setup, four_objects):
    poses = setup.grid_poses
    candidates = compiled.check_candidates(setup.robot, four_objects, poses)
    stops = greedy_stops(setup.robot, four_objects, candidates, WORTH, setup.grid_stops)
    for index, (pose, served) in enumerate(plainly(setup.robot, four_objects, candidates)):
        np.testing.assert_array_equal(stops.base_pose[index], poses[pose])
        assert set(np.flatnonzero(stops.serves[index]).tolist()) == served


def test_it_grasps_everything_that_can_be_grasped(setup, four_objects):
    plan = GreedyStops(setup)(four_objects, jax.random.key(0))
    assert int(compiled.execute(setup.robot, four_objects, plan).grasped) == 4
