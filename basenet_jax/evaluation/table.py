"""The paper's Table I: what planners' plans cost on the same scenes, by the one judge and MuJoCo's replay."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from basenet_jax.config import WorldConfig
from basenet_jax.evaluation.noise import Noise, NoisyScores, judge_noisy
from basenet_jax.evaluation.planning import ROBUST, Planned, Planners, plan_all
from basenet_jax.evaluation.replay import confirmed, replay
from basenet_jax.evaluation.scene_sets import SceneSet
from basenet_jax.planners.protocol import PlanningError
from basenet_jax.progress import Reporter
from basenet_jax.robot.model import Robot
from basenet_jax.task import plan
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Outcome
from basenet_jax.world.scene import Scene

REFERENCE = "dp"  # of the ratios


@dataclass(frozen=True)
class Scores:
    """One planner's figures on each of B scenes. Times in seconds."""

    planning_s: Float[np.ndarray, " B"]  # P; NaN where the scene was planned together with others
    compile_s: Float[np.ndarray, " B"]  # by how much each scene's first call took longer; likewise
    grasped: Int[np.ndarray, " B"]  # number of objects
    navigation_s: Float[np.ndarray, " B"]  # N
    grasping_s: Float[np.ndarray, " B"]  # G
    disagreements: Int[np.ndarray, " B"]  # picks that the judge allows and MuJoCo doesn't
    reasons: tuple[dict[str, int], ...]  # per scene: how many objects are not grasped, by `Reason`
    noisy: NoisyScores | None = None  # where the robot parks with errors; None: not looked at

    @property
    def execution_s(self) -> Float[np.ndarray, " B"]:
        """N + G."""
        return self.navigation_s + self.grasping_s

    @property
    def total_s(self) -> Float[np.ndarray, " B"]:
        """P + N + G; NaN where P is not known."""
        return self.planning_s + self.execution_s


@dataclass(frozen=True)
class Row:
    """One planner on one set of scenes."""

    planner: str
    objects: int
    labels: tuple[str, ...]  # of the scenes
    scores: Scores | None = field(repr=False)
    refused: str | None = None  # why there are no scores


def compare(
    planners: Planners,
    sets: Sequence[SceneSet],
    *,
    repeats: int,
    seed: int,
    reporter: Reporter,
    timed: int | None = None,
    noise: Noise | None = None,
) -> list[Row]:
    """Runs every planner on every scene and judges all plans.

    A planner that refuses a scene (`PlanningError`) gets a row that says so; the others go on.

    Args:
        planners: the planners.
        sets: the scenes.
        repeats: warm calls per scene and planner.
        seed: of planners that draw random numbers.
        reporter: told of the progress.
        timed: so many scenes, the first ones, give the planning time; see `plan_all`.
        noise: if given, plans are judged with errors of parking too.

    Returns:
        A row for each set and planner, in their order.

    Raises:
        ValueError: a planner's weights can't be used.
        RuntimeError: a planner made a plan that doesn't have each object exactly once.
    """
    rows = []
    for scenes in sets:
        planned: dict[str, Planned] = {}
        refused: dict[str, str] = {}
        for name in planners.names:
            try:
                planned[name] = plan_all(
                    planners, name, scenes, repeats=repeats, seed=seed, reporter=reporter, timed=timed
                )
            except PlanningError as error:
                refused[name] = str(error)
                reporter.note(f"{scenes.objects} objects, {name}: refused: {error}")
        scores: dict[str, Scores] = {}
        if planned:
            reporter.stage(f"{scenes.objects} objects: judging and replaying {len(planned) * len(scenes)} plans")
            scores = judge(planners.setup.robot, scenes.scenes, planned, planners.setup.world)
            if noise is not None:
                scores = {
                    name: dataclasses.replace(own, noisy=_noisy(planners, name, scenes, planned[name], noise, reporter))
                    for name, own in scores.items()
                }
        rows += [
            Row(name, scenes.objects, scenes.labels, scores.get(name), refused.get(name)) for name in planners.names
        ]
    return rows


def _noisy(
    planners: Planners, name: str, scenes: SceneSet, planned: Planned, noise: Noise, reporter: Reporter
) -> NoisyScores:
    setup = planners.setup
    if name.endswith(ROBUST):
        setup = dataclasses.replace(setup, chance=noise.chance)
    reporter.start(f"{scenes.objects} objects, {name}, with errors", len(scenes), unit="scenes")
    try:
        return judge_noisy(setup, scenes, planned.plans, noise, reporter)
    finally:
        reporter.finish()


def judge(robot: Robot, scenes: Scene, planned: dict[str, Planned], world: WorldConfig) -> dict[str, Scores]:
    """Executes all plans in one batch and replays them in MuJoCo; a pick that it finds impossible is not grasped.

    Args:
        robot: the robot.
        scenes: a batch of B scenes.
        planned: by planner, plans for them.
        world: of navigation and picks.
    """
    plans = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *(each.plans for each in planned.values()))
    scenes = jax.tree.map(lambda x: jnp.concatenate([x] * len(planned)), scenes)
    outcomes: Outcome = jax.device_get(plan.judge(robot, scenes, plans, world))
    broken = replay(robot, scenes, plans, outcomes, world)
    outcomes = confirmed(outcomes, broken)
    scores = {}
    for index, (name, each) in enumerate(planned.items()):
        part = slice(index * len(each.planning_s), (index + 1) * len(each.planning_s))
        scores[name] = _scores(each, jax.tree.map(lambda x, part=part: x[part], outcomes), broken[part])
    return scores


def _scores(planned: Planned, outcomes: Outcome, broken: Int[np.ndarray, "B M"]) -> Scores:
    failed = outcomes.is_step & ~np.asarray(outcomes.feasible)
    return Scores(
        planning_s=planned.planning_s,
        compile_s=planned.compile_s,
        grasped=np.sum(outcomes.feasible, axis=-1),
        navigation_s=np.sum(outcomes.navigation_time, axis=-1, dtype=float),
        grasping_s=np.sum(outcomes.pick_time, axis=-1, dtype=float),
        disagreements=np.sum(broken != Reason.NONE, axis=-1),
        reasons=tuple(_counts(np.asarray(row)[fails]) for row, fails in zip(outcomes.reason, failed, strict=True)),
    )


def _counts(reasons: Int[np.ndarray, " F"]) -> dict[str, int]:
    values, counts = np.unique(reasons, return_counts=True)
    return {Reason(value).name.lower(): int(count) for value, count in zip(values, counts, strict=True)}
