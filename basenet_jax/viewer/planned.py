"""Plans as the page shows them: judged, set in motion, and with what planning took."""

import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from basenet_jax import api
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.motion import Motion, plan_motion
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.scene import NamedScene

_FAR_UP_M = 5.0  # above an object, where no arm reaches


@dataclass(frozen=True)
class Planned:
    """A plan of a scene; arrays are on the host."""

    maker: str  # the planner's name, or the plan file's
    scene: NamedScene
    plan: Plan
    outcome: Outcome
    motion: Motion
    planning_s: float | None  # None: not planned here


@dataclass(frozen=True)
class Refused:
    """Why a planner has no plan of a scene."""

    maker: str
    reason: str


@dataclass(frozen=True)
class Awaited:
    """A plan that is still being made."""

    maker: str


Shown = Planned | Refused | Awaited


def make_plan(scene: NamedScene, planner: str, weights: Path | None = None) -> Planned:
    """Has a scene planned; the first time for a planner, a robot, a table and a number of slots it compiles.

    dp and refined, which are exact, compile for every number of objects.

    Raises:
        ValueError: the planner can't serve the scene, or its weights can't be used.
    """
    _, make = api.planner_for(scene, planner, weights)
    arrays = jax.device_put(scene.arrays)
    begin = time.perf_counter()
    plan = jax.block_until_ready(make(arrays, jax.random.key(0)))
    return judge_plan(scene, plan, planner, time.perf_counter() - begin)


def judge_plan(scene: NamedScene, plan: Plan, maker: str, planning_s: float | None = None) -> Planned:
    """A plan with its outcome and its motion."""
    outcome = api.execute(scene, plan)
    plan, outcome = jax.device_get((plan, outcome))
    motion = plan_motion(load_robot(scene.robot), scene.arrays, plan, outcome)
    return Planned(maker, scene, plan, outcome, motion, planning_s)


def warm_up(scene: NamedScene, planner: str, weights: Path | None = None) -> None:
    """Compiles what a planner needs once an object can't be reached, so that no later scene has to wait for it.

    Raises:
        ValueError: see `make_plan`.
    """
    grasp = np.array(scene.arrays.object_grasp)
    grasp[0, 1] += _FAR_UP_M
    arrays = dataclasses.replace(scene.arrays, object_grasp=grasp)
    make_plan(dataclasses.replace(scene, arrays=arrays), planner, weights)
