"""The library's front door: scenes in, plans, verdicts and pictures out.

The batched functions underneath (`task.plan.execute`, `pick`, `navigation_time`, ...) take the robot as an argument and
go under jit, vmap and sharding; these here compile for themselves and keep what they made for the next call.
"""

import dataclasses
import functools
import os
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from basenet_jax.config import AlignedConfig, GridConfig, UncertaintyConfig, WorldConfig
from basenet_jax.planners import protocol, registry
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.protocol import Planner, PlannerSetup
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import DEFAULT_ROBOT, load_robot, robot_digest, robot_stamp
from basenet_jax.settings import Settings
from basenet_jax.task import plan as judge
from basenet_jax.task.drive_times import DriveFunction, DriveTimes, load_drive_times, tabulate_drives
from basenet_jax.task.drives import GivenDrives
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.task.reliability import Chance
from basenet_jax.world.boxes import Room, fingerprint
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.naming import name_objects
from basenet_jax.world.scene import MAX_OBJECTS, NamedScene, Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from basenet_jax.exports import Export

DriveTable = DriveTimes | str | os.PathLike[str]  # itself, or the path of its file
RobotLike = Robot | str | os.PathLike[str]  # itself, a packaged one's name, or the path of a robot file

_draw_scene = jax.jit(draw_scene, static_argnames=("slots", "config"))


def sample_scene(
    key: PRNGKeyArray, *, objects: int = 10, robot: RobotLike = DEFAULT_ROBOT, world: WorldConfig = WorldConfig()
) -> NamedScene:
    """A random scene, objects named `mug_1` and so on.

    Args:
        key: consumed.
        objects: their number, 1 to 50.
        robot: the one that the scene names: a packaged one's name, the path of a robot file, or a robot.
        world: of its table, and how scenes are drawn.

    Raises:
        ValueError: the number is out of range, or so many objects found no place on the table (try another key).
    """
    if not 1 <= objects <= MAX_OBJECTS:
        raise ValueError(f"objects: found {objects}, allowed are 1 to {MAX_OBJECTS}")
    arrays, placed = _draw_scene(key, objects, Room.from_config(world.table), slots=objects, config=world.scene)
    if not bool(placed):
        raise ValueError(f"objects: found {objects}, which found no place on the table; draw another scene, or fewer")
    return name_objects(arrays, robot.name if isinstance(robot, Robot) else os.fspath(robot))


@dataclass(frozen=True)
class ScenePlanner:
    """A planner for scenes of one robot, one table and one world; made by `make_planner`."""

    name: str
    setup: PlannerSetup  # robot, table and world
    options: Settings | None  # its own
    planner: Planner  # what plans arrays

    def __call__(self, scene: NamedScene | Scene, key: Array | None = None) -> Plan:
        """Plans one scene; the first call for a number of objects compiles.

        Args:
            scene: unbatched, with the planner's table.
            key: for planners that draw random numbers; by default `jax.random.key(0)`.

        Raises:
            ValueError: the table is another one, or (`PlanningError`) the planner can't serve the scene.
        """
        return self.planner(_arrays(scene), jax.random.key(0) if key is None else key)

    def plan_batch(self, scenes: Scene, key: Array | None = None) -> Plan:
        """Plans many scenes in one call: the learned planners in one program, the others one after the other.

        Args:
            scenes: with one leading axis, and the planner's table.
            key: split into one for each scene; by default `jax.random.key(0)`.

        Raises:
            ValueError: it is no batch, a table is another one, or (`PlanningError`) a scene can't be served.
        """
        if scenes.mask.ndim != 2 or not len(scenes.mask):
            raise ValueError(
                f"scenes: found a mask of shape {scenes.mask.shape}, needs scenes x objects, at least one scene"
            )
        return protocol.plan_batch(self.planner, scenes, jax.random.key(0) if key is None else key)


def make_planner(
    name: str = "basenet",
    *,
    robot: RobotLike = DEFAULT_ROBOT,
    room: Room | None = None,
    world: WorldConfig = WorldConfig(),
    grid: GridConfig = GridConfig(),
    drive_times: DriveTable | None = None,
    uncertainty: UncertaintyConfig | None = None,
    reliability: float = 0.95,
    **options: Any,
) -> ScenePlanner:
    """A planner by its name, for as many scenes as one likes; made once for the same arguments, and kept.

    Args:
        name: pbg, pbg-gc, mbp, mbp-gc, dp, greedy-stops, refined, basenet-paper, basenet or basenet-sample.
        robot: a packaged one's name, the path of a robot file, or a robot.
        room: of the scenes; by default one with the world's table.
        world: of drives and picks.
        grid: of base poses that the classical planners choose from, and others fall back on.
        drive_times: instead of the room's own drives; its poses are the stops, and where the robot may start. A file of
            them, or `tabulate_drives` of a function.
        uncertainty: the errors that the robot parks with: every pick is to be possible all the same, as often as
            `reliability` says; None: it parks without. pbg, mbp and basenet-paper can't plan for errors.
        reliability: 0 to 1; an object that can't be picked so reliably is picked as reliably as it can be.
        options: the planner's own, such as `samples=512` of basenet-sample; `planners.options` has them all.

    Raises:
        ValueError: there is no such planner or robot, the planner has no such option, its weights or the drive times
            can't be used.
    """
    if options.get("weights") is not None:
        options["weights"] = Path(options["weights"])
    if not 0.0 <= reliability <= 1.0:
        raise ValueError(f"reliability: found {reliability}, allowed are 0 to 1")
    own = registry.make_options(name, options)
    weights = options.get("weights")
    # A file that was written anew is another one.
    version = weights.stat().st_mtime_ns if weights is not None and weights.exists() else None
    own_room: Room = Room.from_config(world.table) if room is None else jax.device_get(room)
    in_room = _IdentifiedRoom(fingerprint(own_room), own_room)
    times = None if drive_times is None else _identified_times(_table(drive_times))
    sure = None if uncertainty is None else (uncertainty, float(reliability))
    return _planner(name, _identified(robot), in_room, world, grid, times, sure, own, version)


def make_plan(
    scene: NamedScene | Scene,
    *,
    planner: str | ScenePlanner = "basenet",
    robot: RobotLike | None = None,
    world: WorldConfig | None = None,
    drive_times: DriveTable | DriveFunction | None = None,
    key: Array | None = None,
    **options: Any,
) -> Plan:
    """Plans one scene: where the robot parks, and in which order it picks.

    Args:
        scene: unbatched.
        planner: a name, as for `make_planner`, or what that made: then robot, world and options are its own.
        robot: as for `make_planner`; by default the scene's, or without one `ur5e_mobile`.
        world: of drives and picks; by default `WorldConfig()`.
        drive_times: as for `make_planner`; or a function of poses [S, 3] and poses [T, 3], (x, y, heading) in W, that
            returns seconds [S, T], infinite where there is no way. It is called once, with `drive_poses`.
        key: for planners that draw random numbers; by default `jax.random.key(0)`.
        options: the planner's own, as for `make_planner`, such as `budget_s=2.0` of refined; `uncertainty` and
            `reliability` too.

    Raises:
        ValueError: there is no such planner, it has no such option, its weights can't be used, or (`PlanningError`) it
            can't serve the scene.
    """
    return planner_of(scene, planner, robot, world, drive_times, options)(scene, key)


def replan(
    scene: NamedScene | Scene,
    robot_pose: Sequence[float] | Array,
    gone: Iterable[str | int],
    *,
    planner: str | ScenePlanner = "basenet",
    robot: RobotLike | None = None,
    world: WorldConfig | None = None,
    drive_times: DriveTable | DriveFunction | None = None,
    key: Array | None = None,
    **options: Any,
) -> Plan:
    """Plans what is left, from where the robot stands now: after each pick, and whenever something has changed.

    The scene keeps its number of slots, and the plan's steps name the same ones, so nothing is compiled again after the
    whole scene was planned by the same planner (by `refined`: once, where 11 objects are left of more).

    Args:
        scene: as it is now, unbatched: objects that were moved are where they are now.
        robot_pose: the base's present (x, y, heading) in W, m and rad; where it parked for a pick will do.
        gone: names or slots of the objects that are not on the table any more, picked or taken away.
        planner: as for `make_plan`.
        robot: likewise.
        world: likewise.
        drive_times: likewise.
        key: likewise.
        options: likewise.

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
    return make_plan(again, planner=planner, robot=robot, world=world, drive_times=drive_times, key=key, **options)


def drive_poses(
    scene: NamedScene | Scene,
    *,
    robot: RobotLike | None = None,
    world: WorldConfig = WorldConfig(),
    aligned: AlignedConfig = AlignedConfig(),
) -> Float[np.ndarray, "1+K 3"]:
    """The poses that drive times of one's own are wanted for: where the robot starts, and the stops to choose from.

    Args:
        scene: unbatched.
        robot: as for `make_planner`; by default the scene's, or without one `ur5e_mobile`.
        world: of picks: how near to things the base may stop.
        aligned: of the stops, in line with the surfaces: how far from one to the next.

    Returns:
        (x, y, heading) in W, the start first.
    """
    arrays = jax.device_get(_arrays(scene))
    stops = aligned_poses(_robot(robot, scene), arrays.room, aligned, world.pick)
    return np.concatenate([np.asarray(arrays.robot_start)[None], stops])


def execute(
    scene: NamedScene | Scene,
    plan: Plan,
    *,
    robot: RobotLike | None = None,
    world: WorldConfig = WorldConfig(),
    drive_times: DriveTable | DriveFunction | None = None,
) -> Outcome:
    """The judge's verdict on a plan, per step and in total, with the least singular value of each pick.

    Args:
        scene: one, or a batch of `Scene`.
        plan: of the same batch shape.
        robot: as for `make_planner`; by default the scene's, or without one `ur5e_mobile`.
        world: of drives and picks.
        drive_times: as for `make_plan`, instead of the world's drives.

    Raises:
        ValueError: the drive times can't be used.
    """
    robot = _robot(robot, scene)
    given = None if drive_times is None else GivenDrives.of(_times_of(drive_times, _arrays(scene), plan))
    return judge.with_singular_values(robot, judge.judge(robot, _arrays(scene), plan, world, given))


def plot_plan(
    scene: NamedScene | Scene,
    plan: Plan,
    *,
    robot: RobotLike | None = None,
    world: WorldConfig = WorldConfig(),
    drive_times: DriveTable | DriveFunction | None = None,
) -> "Figure":
    """Top view of one scene and its plan, as a Matplotlib figure; robot, world and drive times as for `execute`."""
    from basenet_jax import plots  # Matplotlib takes half a second to import

    outcome = execute(scene, plan, robot=robot, world=world, drive_times=drive_times)
    names = scene.names if isinstance(scene, NamedScene) else None
    own = _robot(robot, scene)
    return plots.plot_plan(own, _arrays(scene), plan, outcome, names=names, navigation=world.navigation)


def export_plan(
    scene: NamedScene,
    plan: Plan,
    directory: str | os.PathLike[str],
    *,
    table_pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    map_frame: str = "map",
    formats: Sequence[str] = ("yaml", "csv", "bag"),
    robot: RobotLike | None = None,
    world: WorldConfig = WorldConfig(),
    drive_times: DriveTable | DriveFunction | None = None,
) -> "Export":
    """Writes a plan for a robot: base goals and arm trajectories as messages of ROS 2, and the states over time.

    Steps that the judge finds infeasible are left out, their drives too.

    Args:
        scene: one scene.
        plan: of that scene.
        directory: new or empty; the folder above must be there.
        table_pose: x, y (m) and yaw (rad) of the table's frame in the map that the robot navigates in. A room's poses
            are in its own frame, the map's.
        map_frame: the name of that map's frame.
        formats: yaml for `plan.yaml`, csv for `execution.csv`, bag for a ROS 2 bag (which needs the extra `ros`).
        robot: as for `execute`.
        world: likewise.
        drive_times: likewise; the drives that are written are the room's own, in these times.

    Raises:
        ValueError: (`exports.ExportError`) the folder isn't empty, a format is unknown or lacks its package, the pose
            isn't finite or beside a room's map, or no step is feasible. Nothing is written.
        OSError: something can't be written; then nothing is.
    """
    from basenet_jax.exports import export  # most plans are not exported

    outcome = execute(scene, plan, robot=robot, world=world, drive_times=drive_times)
    where = {"table_pose": table_pose, "map_frame": map_frame, "given_times": drive_times is not None}
    return export(_robot(robot, scene), scene, plan, outcome, directory, **where, formats=formats, world=world)


def planner_of(
    scene: NamedScene | Scene,
    planner: str | ScenePlanner,
    robot: RobotLike | None,
    world: WorldConfig | None,
    drive_times: DriveTable | DriveFunction | None,
    options: dict[str, Any],
    starts: Float[np.ndarray, "B 3"] | None = None,
) -> ScenePlanner:
    """A planner for a scene's table, and its robot unless there is another; see `make_plan`.

    Starts are those that drive times are tabulated for, by default the scene's.
    """
    if isinstance(planner, ScenePlanner):
        given = {"robot": robot, "world": world, "drive_times": drive_times, **options}
        if found := [name for name, value in given.items() if value is not None]:
            raise ValueError(f"{found[0]}: found beside a planner that is made; give it to make_planner")
        return planner
    robot = _robot_name(scene) if robot is None else robot
    room, world = jax.device_get(_arrays(scene).room), world or WorldConfig()
    if callable(drive_times):
        poses = drive_poses(scene, robot=robot, world=world, aligned=options.get("aligned", AlignedConfig()))
        drive_times = tabulate_drives(drive_times, poses if starts is None else np.concatenate([starts, poses[1:]]))
    return make_planner(planner, robot=robot, room=room, world=world, drive_times=drive_times, **options)


def _table(drive_times: DriveTable) -> DriveTimes:
    return drive_times if isinstance(drive_times, DriveTimes) else load_drive_times(drive_times)


def _times_of(drive_times: DriveTable | DriveFunction, scene: Scene, plan: Plan) -> DriveTimes:
    """A table; of a function, with the poses of a plan, or of a batch of plans."""
    if not callable(drive_times):
        return _table(drive_times)
    stops = np.asarray(plan.base_pose)[np.asarray(plan.served)]
    starts = np.asarray(scene.robot_start).reshape(-1, 3)
    return tabulate_drives(drive_times, np.unique(np.concatenate([starts, stops]), axis=0))


@functools.lru_cache(maxsize=16)
def _planner(
    name: str,
    robot: "_Identified",
    room: "_IdentifiedRoom",
    world: WorldConfig,
    grid: GridConfig,
    drive_times: "_IdentifiedTimes | None",
    sure: tuple[UncertaintyConfig, float] | None,
    options: Settings | None,
    version: int | None,
) -> ScenePlanner:
    del version
    times = None if drive_times is None else drive_times.times
    chance = None if sure is None else Chance.of(*sure)
    setup = PlannerSetup(robot.on_device(), jax.device_put(room.room), world, grid, times, chance)
    return ScenePlanner(name, setup, options, registry.make_planner(name, setup, options))


@dataclass(frozen=True)
class _IdentifiedRoom:
    """A room that caches know again."""

    identity: Hashable
    room: Room = field(compare=False)


@dataclass(frozen=True)
class _IdentifiedTimes:
    """Drive times that caches know again."""

    identity: Hashable
    times: DriveTimes = field(compare=False)


def _identified_times(times: DriveTimes) -> _IdentifiedTimes:
    return _IdentifiedTimes((times.poses.tobytes(), times.seconds.tobytes(), times.source), times)


@dataclass(frozen=True)
class _Identified:
    """A robot that caches know again."""

    identity: Hashable
    robot: Robot = field(compare=False)

    def on_device(self) -> Robot:
        """Its arrays on JAX's device."""
        return _robot_on_device(self)


def _identified(robot: RobotLike) -> _Identified:
    if isinstance(robot, Robot):
        return _Identified(robot_digest(robot), robot)
    name = os.fspath(robot)
    return _Identified((name, robot_stamp(name)), load_robot(name))


@functools.lru_cache(maxsize=16)
def _robot_on_device(robot: _Identified) -> Robot:
    return jax.device_put(robot.robot)


def _robot(robot: RobotLike | None, scene: NamedScene | Scene) -> Robot:
    """The robot that is asked for, else the scene's."""
    return _identified(_robot_name(scene) if robot is None else robot).on_device()


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
