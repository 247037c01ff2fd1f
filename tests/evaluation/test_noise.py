"""Plans judged with errors of parking: the figures, and where they are shown."""

import jax
import numpy as np
import pytest

from basenet_jax.config import UncertaintyConfig
from basenet_jax.evaluation import noise
from basenet_jax.evaluation.noise import Noise, judge_noisy
from basenet_jax.evaluation.planning import choose_planners
from basenet_jax.evaluation.scene_sets import SceneSet
from basenet_jax.planners.greedy_stops import GreedyStops
from basenet_jax.planners.registry import PlannerKind
from basenet_jax.progress import Reporter
from basenet_jax.task.reliability import Chance
from tests import compiled

CHANCE = Chance.of(UncertaintyConfig(sd_xy_m=0.05, sd_heading_rad=0.08, draws=8), 0.9)


class Silent:
    """Is told of progress."""

    def __getattr__(self, name):
        return lambda *args, **more: None


@pytest.mark.slow
def test_figures_are_means_over_draws_and_the_same_again(robot, room, monkeypatch):
    monkeypatch.setattr(noise, "check_candidates", compiled.check_candidates)
    setup = compiled.make_setup(robot)
    scenes = [compiled.draw_scene(seed, compiled.SLOTS, room) for seed in range(2)]
    plans = jax.tree.map(lambda *x: np.stack(x), *(GreedyStops(setup)(scene, jax.random.key(0)) for scene in scenes))
    batch = SceneSet(("a", "b"), jax.tree.map(lambda *x: np.stack(x), *scenes))
    reporter: Reporter = Silent()  # pyright: ignore[reportAssignmentType]
    found, again = (judge_noisy(setup, batch, plans, Noise(CHANCE, executed=True), reporter) for _ in range(2))
    for name, values in found.executed.items():
        np.testing.assert_array_equal(values, again.executed[name])
    executed = found.executed
    np.testing.assert_allclose(executed["execution_s"], executed["navigation_s"] + executed["grasping_s"], rtol=1e-5)
    assert np.all((executed["grasped"] > 0.5) & (executed["grasped"] <= 1.0))
    assert np.all((found.reliability > 0.2) & (found.reliability <= 1.0))
    assert np.all(executed["at_first"] < 1.0)


def test_planners_that_can_are_there_twice():
    options = {"pbg": None, "dp": None, "greedy-stops": None}
    assert list(choose_planners(options)) == list(options)
    assert list(choose_planners(options, CHANCE)) == ["pbg", "dp", "dp robust", "greedy-stops", "greedy-stops robust"]


def test_a_robust_planner_is_given_the_errors(monkeypatch):
    setups = []
    monkeypatch.setattr(PlannerKind, "make_planner", lambda self, setup, options: setups.append(setup))
    setup = compiled.make_setup(None)  # pyright: ignore[reportArgumentType]
    for make in choose_planners({"dp": None}, CHANCE).values():
        make(setup)
    assert [each.chance for each in setups] == [None, CHANCE]
