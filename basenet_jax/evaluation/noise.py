"""What errors of parking make of plans: how sure their picks are, and what executing them with errors comes to."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.config import WorldConfig
from basenet_jax.evaluation.scene_sets import SceneSet
from basenet_jax.planners.candidates import check_candidates, only_reachable
from basenet_jax.planners.chance import reliable
from basenet_jax.planners.options import GreedyStopsOptions
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.progress import Reporter
from basenet_jax.task.noisy_execution import Replanning, simulate_execution
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.task.prepared_world import PreparedWorld, compiled_first_drives
from basenet_jax.task.reliability import Chance, with_reliability
from basenet_jax.world.boxes import fingerprint
from basenet_jax.world.scene import Scene

_PAIRS_AT_ONCE = 1536  # of stop and object: all those of ten objects and the aligned stops in reach


@dataclass(frozen=True)
class Noise:
    """How plans are judged where the robot parks with errors."""

    chance: Chance
    executed: bool  # whether they are executed with errors too
    seed: int = 0


@dataclass(frozen=True)
class NoisyScores:
    """One planner's figures on each of B scenes with errors, means over the draws. Times in seconds."""

    reliability: Float[np.ndarray, " B"]  # mean over the objects; 0 for those that aren't grasped without errors either
    executed: Mapping[str, Float[np.ndarray, " B"]]  # by figure; none where plans aren't executed


def judge_noisy(setup: PlannerSetup, scenes: SceneSet, plans: Plan, noise: Noise, reporter: Reporter) -> NoisyScores:
    """Judges one planner's plans, scene after scene; the errors are the same for every planner.

    Whatever made the plan, what is left after a failure is planned by the rule of greedy-stops over stops in line with
    the surfaces: for a robust planner over reliable picks.

    Args:
        setup: that the planner was made for; its room is replaced by the scenes'.
        scenes: B scenes.
        plans: for them.
        noise: the errors.
        reporter: told of every scene.
    """
    stops: dict[Any, tuple[PlannerSetup, PreparedWorld]] = {}
    rows: list[dict[str, float]] = []
    for index in range(len(scenes)):
        scene, plan = scenes.scene(index), jax.tree.map(lambda x, index=index: x[index], plans)
        room = fingerprint(scene.room)
        if room not in stops:
            own = setup.with_room(scene.room)
            stops[room] = own, own.aligned_stops()
        rows.append(_judge_one(*stops[room], scene, plan, noise, index))
        reporter.update(index + 1, {})
    by_figure = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return NoisyScores(by_figure.pop("reliability"), by_figure)


def _judge_one(
    setup: PlannerSetup, prepared: PreparedWorld, scene: Scene, plan: Plan, noise: Noise, index: int
) -> dict[str, float]:
    robot, world, uncertainty = setup.robot, setup.world, noise.chance.uncertainty
    outcome = compiled_execute(robot, scene, plan, setup.docked, config=world)
    outcome = with_reliability(robot, scene, plan, outcome, noise.chance, world.pick)
    objects = int(np.sum(scene.mask))
    shares = np.asarray(outcome.reliability, float)
    sure = float(np.sum(np.where(outcome.feasible, shares, 0.0))) / objects
    if not noise.executed:
        return {"reliability": sure}
    times = _pick_times(setup, prepared, scene, world)
    how = Replanning(prepared, times, GreedyStopsOptions().seconds_per_object)
    key = jax.random.fold_in(jax.random.key(noise.seed), index)
    without = dataclasses.replace(outcome, reliability=None)
    done = jax.device_get(
        simulate_execution(robot, scene, plan, without, how, key, uncertainty=uncertainty, world=world)
    )
    return {
        "reliability": sure,
        "at_first": float(np.mean(done.at_first & (done.grasped == objects))),
        "grasped": float(np.mean(done.grasped)) / objects,
        "navigation_s": float(np.mean(done.navigation)),
        "grasping_s": float(np.mean(done.picking)),
        "execution_s": float(np.mean(done.navigation + done.picking)),
        "parkings": float(np.mean(done.parkings)),
    }


def _pick_times(setup: PlannerSetup, prepared: PreparedWorld, scene: Scene, world: WorldConfig) -> Any:
    candidates = check_candidates(setup.robot, scene, prepared.poses, world=world, pairs_at_once=_PAIRS_AT_ONCE)
    if setup.docked is not None:
        candidates = only_reachable(candidates, compiled_first_drives(setup.robot, prepared, scene.robot_start))
    if setup.chance is not None:
        candidates = reliable(setup.robot, scene, candidates, setup.chance, world=world, fine=False)
    return candidates.pick_time
