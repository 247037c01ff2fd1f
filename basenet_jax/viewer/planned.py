"""Plans as the page shows them: judged, set in motion, and with what planning took."""

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from basenet_jax import api
from basenet_jax.config import GridConfig, WorldConfig
from basenet_jax.planners.registry import find_planner
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
    world: WorldConfig = field(default_factory=WorldConfig)  # that it was judged in


@dataclass(frozen=True)
class Refused:
    """Why a planner has no plan of a scene."""

    maker: str
    reason: str


@dataclass(frozen=True)
class Awaited:
    """A plan that is still being made."""

    maker: str
    keep: bool = False  # whether the one before, of a scene that is nearly the same, stays on the page meanwhile


Shown = Planned | Refused | Awaited


@dataclass(frozen=True)
class Choices:
    """Of the command line."""

    planners: tuple[str, ...] = ("basenet",)  # one, or two to compare
    options: Mapping[str, Any] = field(default_factory=dict)  # of planners; each takes those that it has
    robot: str | None = None  # instead of the one that scenes name
    world: WorldConfig = field(default_factory=WorldConfig)
    grid: GridConfig = field(default_factory=GridConfig)


def make_plan(scene: NamedScene, planner: str, choices: Choices = Choices()) -> Planned:
    """Has a scene planned; the first time for a planner, a robot, a table and a number of slots it compiles.

    dp and refined compile now and then for known sizes too, where more stops serve something than before.

    Raises:
        ValueError: the planner can't serve the scene, or its weights can't be used.
    """
    made = planner_for(scene, planner, choices)
    arrays = jax.device_put(scene.arrays)
    begin = time.perf_counter()
    plan = jax.block_until_ready(made.planner(arrays, jax.random.key(0)))
    return judge_plan(scene, plan, planner, time.perf_counter() - begin, world=choices.world)


def planner_for(scene: NamedScene, planner: str, choices: Choices) -> api.ScenePlanner:
    """The planner of a name for a scene's robot and table, with those of the chosen options that it has.

    Raises:
        ValueError: there is none of that name, or its weights can't be used.
    """
    own = {name: value for name, value in choices.options.items() if name in find_planner(planner).option_names}
    room, world = scene.arrays.room, choices.world
    return api.make_planner(planner, robot=scene.robot, room=room, world=world, grid=choices.grid, **own)


def judge_plan(
    scene: NamedScene,
    plan: Plan,
    maker: str,
    planning_s: float | None = None,
    *,
    world: WorldConfig = WorldConfig(),
) -> Planned:
    """A plan with its outcome and its motion."""
    outcome = api.execute(scene, plan, world=world)
    plan, outcome = jax.device_get((plan, outcome))
    motion = plan_motion(load_robot(scene.robot), scene.arrays, plan, outcome, world)
    return Planned(maker, scene, plan, outcome, motion, planning_s, world)


def warm_up(scene: NamedScene, planner: str, choices: Choices = Choices()) -> None:
    """Compiles what a planner needs once an object can't be reached, so that no later scene has to wait for it.

    Raises:
        ValueError: see `make_plan`.
    """
    grasps = scene.arrays.object_grasps
    pose = np.array(grasps.pose)
    pose[0, :, 2] += _FAR_UP_M
    arrays = dataclasses.replace(scene.arrays, object_grasps=dataclasses.replace(grasps, pose=pose))
    make_plan(dataclasses.replace(scene, arrays=arrays), planner, choices)
