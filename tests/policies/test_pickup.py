"""The pickup episode: refreshed after every step, ended by a collision, and the same thing as its plan."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import WorldConfig
from basenet_jax.policies.pickup import as_plan, choose_nearest, choose_random, episode_cost, rollout
from tests import compiled

OBJECTS = np.array([1, 3, 5, 5])


@dataclasses.dataclass
class Beside:
    """A base-pose policy by hand: opposite the object, at the table's long side on which the robot is."""

    distance: float = 0.95

    def __call__(self, grasp, robot_pose):
        y = jnp.where(robot_pose[..., 1] < 0, -self.distance, self.distance)
        return jnp.stack([grasp[..., 0], y, 0.1 * robot_pose[..., 0]], axis=-1)


@pytest.fixture(scope="module")
def scenes(room):
    drawn = (compiled.draw_scene(seed, count, room, slots=5) for seed, count in enumerate(OBJECTS))
    return jax.tree.map(lambda *x: jnp.stack(x), *drawn)


@pytest.fixture(scope="module")
def play(robot, scenes):
    def run(policy, choose=choose_random, seed=1):
        return rollout(robot, scenes, policy, choose, jax.random.key(seed), WorldConfig())

    return run


def test_every_object_is_chosen_once(play, scenes):
    steps = play(Beside())
    chosen = np.asarray(jnp.where(steps.active, steps.choice, -1)).T
    for row, mask in zip(chosen, np.asarray(scenes.mask), strict=True):
        assert sorted(row[row >= 0]) == list(np.flatnonzero(mask))


def test_state_is_refreshed_after_every_step(play, scenes):
    steps = play(Beside())
    np.testing.assert_array_equal(steps.state.robot_pose[0], scenes.robot_start)
    moved = np.asarray(steps.active[1:])[..., None]
    np.testing.assert_array_equal(
        np.where(moved, steps.state.robot_pose[1:], 0), np.where(moved, steps.base_pose[:-1], 0)
    )
    headings = np.asarray(steps.base_pose[..., 2])
    np.testing.assert_allclose(headings[1, 3], 0.1 * steps.base_pose[0, 3, 0], atol=1e-6)


def test_an_episode_is_its_plan_executed(robot, play, scenes):
    steps = play(Beside())
    outcome = compiled.execute(robot, scenes, as_plan(steps))
    np.testing.assert_allclose(outcome.navigation, steps.navigation_time.sum(0), atol=1e-3)


def test_a_collision_ends_the_episode_and_costs_every_object_left(robot, play, scenes):
    steps = play(Beside(distance=0.5))
    assert not bool(jnp.any(steps.executed))
    np.testing.assert_allclose(episode_cost(steps, 15.0), 15.0 * OBJECTS, atol=1e-4)
    outcome = compiled.execute(robot, scenes, as_plan(steps))
    assert int(outcome.grasped.sum()) == 0
    assert float(outcome.execution.sum()) == 0.0


def test_nearest_takes_the_nearest_and_random_varies(play, scenes):
    steps = play(Beside(), choose_nearest(scenes))
    distance = np.linalg.norm(
        np.asarray(scenes.first_grasp)[..., :2] - np.asarray(scenes.robot_start)[:, None, :2], axis=-1
    )
    distance[~np.asarray(scenes.mask)] = np.inf
    np.testing.assert_array_equal(steps.choice[0], distance.argmin(-1))
    assert not np.array_equal(play(Beside(), seed=1).choice, play(Beside(), seed=2).choice)
