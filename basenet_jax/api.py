"""The library's front door: scenes in, plans, verdicts and pictures out, with the default world.

The batched functions underneath (`task.plan.execute`, `pick`, `navigation_time`, ...) take the robot as an argument and
go under jit, vmap and sharding; these here compile for themselves and keep what they made for the next call.
"""

import dataclasses
import functools
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import PRNGKeyArray

from basenet_jax.config import WorldConfig
from basenet_jax.devices import ONE_DEVICE, Devices
from basenet_jax.planners import registry
from basenet_jax.planners.protocol import Planner, PlannerSetup
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import DEFAULT_ROBOT, Stamp, load_robot, robot_stamp
from basenet_jax.task import plan as judge
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.naming import name_objects
from basenet_jax.world.scene import MAX_OBJECTS, NamedScene, Scene, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from basenet_jax.exports import Export

_draw_scene = jax.jit(draw_scene, static_argnames="slots")


def sample_scene(key: PRNGKeyArray, *, objects: int = 10, robot: str = DEFAULT_ROBOT) -> NamedScene:
    """A random scene, objects named `mug_1` and so on.

    Args:
        key: consumed.
        objects: their number, 1 to 50.
        robot: a packaged one's name, or the path of a robot file.

    Raises:
        ValueError: the number is out of range, or so many objects found no place on the table (try another key).
    """
    if not 1 <= objects <= MAX_OBJECTS:
        raise ValueError(f"objects: found {objects}, allowed are 1 to {MAX_OBJECTS}")
    arrays, placed = _draw_scene(key, objects, Table.from_config(), slots=objects)
    if not bool(placed):
        raise ValueError(f"objects: found {objects}, which found no place on the table; draw another scene, or fewer")
    return name_objects(arrays, robot)


def make_plan(
    scene: NamedScene | Scene,
    *,
    planner: str = "basenet",
    weights: str | os.PathLike[str] | None = None,
    budget_s: float = 0.0,
    samples: int = 256,
    key: Array | None = None,
) -> Plan:
    """Plans one scene: where the robot parks, and in which order it picks.

    Args:
        scene: unbatched; planned for its robot, or without one for `ur5e_mobile`.
        planner: pbg, pbg-gc, mbp, mbp-gc, dp, greedy-stops, refined, basenet-paper, basenet or basenet-sample.
        weights: a file of the learned planners' weights; by default those shipped with the package.
        budget_s: how long an anytime planner (refined) goes on for a better plan; its first one it always finishes.
        samples: rollouts that basenet-sample draws and takes the best of.
        key: for planners that draw random numbers; by default `jax.random.key(0)`.

    Raises:
        ValueError: there is no such planner, its weights can't be used, or (`PlanningError`) it can't serve the scene.
    """
    _, made = planner_for(scene, planner, weights, budget_s, samples)
    return made(_arrays(scene), jax.random.key(0) if key is None else key)


def replan(
    scene: NamedScene | Scene,
    robot_pose: Sequence[float] | Array,
    gone: Iterable[str | int],
    *,
    planner: str = "basenet",
    weights: str | os.PathLike[str] | None = None,
    budget_s: float = 0.0,
    samples: int = 256,
    key: Array | None = None,
) -> Plan:
    """Plans what is left, from where the robot stands now: after each pick, and whenever something has changed.

    The scene keeps its number of slots, and the plan's steps name the same ones, so most planners compile nothing
    again; `dp` and `refined` do once for each number of objects that remain.

    Args:
        scene: as it is now, unbatched: objects that were moved are where they are now.
        robot_pose: the base's present (x, y, heading) in W, m and rad; where it parked for a pick will do.
        gone: names or slots of the objects that are not on the table any more, picked or taken away.
        planner: as for `make_plan`.
        weights: likewise.
        budget_s: likewise.
        samples: likewise.
        key: likewise.

    Raises:
        ValueError: there is no such object; or see `make_plan`.
    """
    arrays = _arrays(scene)
    mask = np.array(arrays.mask)
    for each in gone:
        mask[_slot(scene, each)] = False
    start = jnp.asarray(robot_pose, arrays.robot_start.dtype)
    if start.shape != (3,) or not bool(jnp.all(jnp.isfinite(start))):
        raise ValueError(f"robot_pose: found {np.asarray(robot_pose).tolist()}, needs x, y and heading, all finite")
    left = dataclasses.replace(arrays, mask=jnp.asarray(mask), robot_start=start)
    again = dataclasses.replace(scene, arrays=left) if isinstance(scene, NamedScene) else left
    return make_plan(again, planner=planner, weights=weights, budget_s=budget_s, samples=samples, key=key)


def execute(scene: NamedScene | Scene, plan: Plan, *, robot: str | None = None) -> Outcome:
    """The judge's verdict on a plan, per step and in total.

    Args:
        scene: one, or a batch of `Scene`.
        plan: of the same batch shape.
        robot: a packaged one's name, or a robot file; by default the scene's, or without one `ur5e_mobile`.
    """
    return judge.compiled_execute(_robot(robot or _robot_name(scene)), _arrays(scene), plan, config=WorldConfig())


def plot_plan(scene: NamedScene | Scene, plan: Plan) -> "Figure":
    """Top view of one scene and its plan, as a Matplotlib figure."""
    from basenet_jax import plots  # Matplotlib takes half a second to import

    return plots.plot_plan(_robot(_robot_name(scene)), _arrays(scene), plan, execute(scene, plan))


def export_plan(
    scene: NamedScene,
    plan: Plan,
    directory: str | os.PathLike[str],
    *,
    table_pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    map_frame: str = "map",
    formats: Sequence[str] = ("yaml", "csv", "bag"),
) -> "Export":
    """Writes a plan for a robot: base goals and arm trajectories as messages of ROS 2, and the states over time.

    Steps that the judge finds infeasible are left out, their drives too.

    Args:
        scene: one scene.
        plan: of that scene.
        directory: new or empty; the folder above must be there.
        table_pose: x, y (m) and yaw (rad) of the table's frame in the map that the robot navigates in.
        map_frame: the name of that map's frame.
        formats: yaml for `plan.yaml`, csv for `execution.csv`, bag for a ROS 2 bag (which needs the extra `ros`).

    Raises:
        ValueError: (`exports.ExportError`) the folder isn't empty, a format is unknown or lacks its package, the pose
            isn't finite, or no step is feasible. Nothing is written.
        OSError: something can't be written; then nothing is.
    """
    from basenet_jax.exports import export  # most plans are not exported

    robot, outcome = _robot(_robot_name(scene)), execute(scene, plan)
    return export(robot, scene, plan, outcome, directory, table_pose=table_pose, map_frame=map_frame, formats=formats)


def planner_for(
    scene: NamedScene | Scene,
    name: str,
    weights: str | os.PathLike[str] | None = None,
    budget_s: float = 0.0,
    samples: int = 256,
    devices: Devices = ONE_DEVICE,
) -> tuple[PlannerSetup, Planner]:
    """A planner for a scene's robot and table, and what it was made for; made once and kept.

    Raises:
        ValueError: there is no such planner, its weights can't be used, the budget is negative or not finite, or
            there is no sample.
    """
    if not 0 <= budget_s < math.inf:
        raise ValueError(f"budget: found {budget_s}, allowed are 0 and more seconds")
    if samples < 1:
        raise ValueError(f"samples: found {samples}, allowed are 1 and more")
    table = jax.device_get(_arrays(scene).table)
    path = None if weights is None else Path(weights)
    # A file that was written anew is another one.
    version = path.stat().st_mtime_ns if path is not None and path.exists() else None
    sides = (float(table.half_size[0]), float(table.half_size[1]))
    robot = _robot_name(scene)
    stamp = robot_stamp(robot)
    return _planner(name, robot, stamp, sides, float(table.height), budget_s, samples, devices, path, version)


@functools.lru_cache(maxsize=16)
def _planner(
    name: str,
    robot: str,
    stamp: Stamp,
    half_size: tuple[float, float],
    height: float,
    budget_s: float,
    samples: int,
    devices: Devices,
    weights: Path | None,
    version: int | None,
) -> tuple[PlannerSetup, Planner]:
    del stamp, version
    table = Table(half_size=jnp.array(half_size), height=jnp.array(height))
    own = {"weights": weights, "samples": samples, "budget_s": budget_s, "devices": devices}
    setup = PlannerSetup(_robot(robot), table, **own)
    return setup, registry.make_planner(name, setup)


def _robot(name: str) -> Robot:
    return _robot_on_device(name, robot_stamp(name))


@functools.lru_cache(maxsize=16)
def _robot_on_device(name: str, stamp: Stamp) -> Robot:
    del stamp
    return jax.device_put(load_robot(name))


def _slot(scene: NamedScene | Scene, which: str | int) -> int:
    """The slot of an object given by its name or slot."""
    if isinstance(which, str):
        names = scene.names if isinstance(scene, NamedScene) else ()
        if which not in names:
            allowed = ", ".join(names) or "slots, as numbers"
            raise ValueError(f"gone: found {which!r}, allowed are {allowed}")
        return names.index(which)
    slots = len(_arrays(scene).mask)
    if not 0 <= which < slots:
        raise ValueError(f"gone: found {which}, allowed are 0 to {slots - 1}")
    return which


def _robot_name(scene: NamedScene | Scene) -> str:
    return scene.robot if isinstance(scene, NamedScene) else DEFAULT_ROBOT


def _arrays(scene: NamedScene | Scene) -> Scene:
    return scene.arrays if isinstance(scene, NamedScene) else scene
