"""The inverse reachability map: from which base poses, seen from the tool, the arm reaches a top-down grasp.

A map knows the arm alone: no pre-grasp, no descent, no collision. It is made once per robot and grasp height and kept,
in memory and in the user's cache folder; looking a pose up costs nothing, which is why the paper's simplest planners
trust it.
"""

import dataclasses
import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds, struct
from basenet_jax.config import GridConfig, PickConfig
from basenet_jax.geometry import relative
from basenet_jax.planners.candidates import Candidates, check_candidates, join, only_reachable
from basenet_jax.planners.chance import reliable
from basenet_jax.planners.grasp_map import grasp_map_candidates
from basenet_jax.planners.grasp_map_file import KeptGraspMap
from basenet_jax.planners.map_files import fingerprint, keep, map_folder
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot.ik import damped_least_squares, residual
from basenet_jax.robot.kinematics import reach_sphere
from basenet_jax.robot.model import Robot
from basenet_jax.task import arm_solutions
from basenet_jax.task.picking import Reason
from basenet_jax.task.prepared_world import PreparedWorld, compiled_first_drives, join_worlds
from basenet_jax.weights_file import load_weights, save_weights
from basenet_jax.world.grasps import Grasps, top_down
from basenet_jax.world.scene import MAX_OBJECTS, Scene

# Of map files; the number goes up whenever maps are computed in another way.
FORMAT = "basenet-reachability/1"
# Maps are made for heights rounded to this (m), a tenth of the tolerance of inverse kinematics.
HEIGHT_STEP = 1e-4

_reach_sphere = jax.jit(reach_sphere)  # one program instead of twenty small ones, before anything else runs


@struct.dataclass
class ReachabilityMap:
    """Which bins of base poses reach a grasp, in layers of one grasp height each.

    The tool's planar frame has its origin at the grasp, x along the grasp's yaw. Bin `[h, i, j, t]` holds the base
    poses nearest to `(axis_m[i], axis_m[j], heading[t])` in that frame. All bins at the border are unreachable.
    """

    reachable: Bool[np.ndarray, "H side side turns"]
    height: Float[np.ndarray, " H"]  # m, of tool0 above the floor
    step_m: float = struct.field(pytree_node=False)  # between neighbouring bins' centres, along x and along y

    @property
    def origin(self) -> int:
        """Index, along x and along y, of the bin at 0."""
        return self.reachable.shape[1] // 2

    @property
    def axis_m(self) -> Float[np.ndarray, " side"]:
        """Centres of the bins along x, and along y (m): integer multiples of the step."""
        return np.arange(-self.origin, self.origin + 1) * self.step_m

    @property
    def heading(self) -> Float[np.ndarray, " turns"]:
        """Headings of the base at the bins' centres (rad, in [0, 2 pi)), cyclic."""
        return _headings(self.reachable.shape[3])


def build_map(
    robot: Robot, heights: Sequence[float], grid: GridConfig = GridConfig(), config: PickConfig = PickConfig()
) -> ReachabilityMap:
    """The map of a robot at some grasp heights, in one jitted sweep that compiles once for any of them.

    A bin is reachable if inverse kinematics exists at its centre: a solution of the grasp pose alone, in one of the
    gripper's yaws, within the tolerances and the joint limits.

    Args:
        robot: the robot.
        heights: of tool0 above the floor at the grasp (m).
        grid: its step and number of headings are the bins'.
        config: tolerances, symmetry of the gripper and how solutions are found.
    """
    slots = np.zeros(-(-max(len(heights), 1) // MAX_OBJECTS) * MAX_OBJECTS, np.float32)
    slots[: len(heights)] = heights
    reachable = _sweep(robot, slots, len(heights), map_shape(robot, grid, config), grid.step_m, config)
    return ReachabilityMap(
        reachable=np.asarray(reachable)[: len(heights)], height=slots[: len(heights)], step_m=grid.step_m
    )


def map_shape(robot: Robot, grid: GridConfig = GridConfig(), config: PickConfig = PickConfig()) -> tuple[int, int, int]:
    """Bins along x, along y, and of heading: a window whose border even the stretched arm can't reach."""
    center, radius = _reach_sphere(robot)
    in_base = robot.mount_position + robot.mount_rotation @ np.asarray(center)
    reach = float(np.hypot(in_base[0], in_base[1]) + radius) + config.position_tolerance_m
    beyond = math.floor(reach / grid.step_m) + 1
    return 2 * beyond + 1, 2 * beyond + 1, grid.turns


@jax.jit
def map_candidates(reach_map: ReachabilityMap, scene: Scene, base_pose: Float[Array, "K 3"]) -> Candidates:
    """What the map says of all pairs of pose and object: no times, and no reason but reach.

    Args:
        reach_map: with one layer for each of the scene's M slots, in their order; see `MapStore`.
        scene: unbatched.
        base_pose: the poses to choose from, (x, y, heading) in W.
    """
    layers, side, _, turns = reach_map.reachable.shape
    if layers != len(scene.mask):
        raise ValueError(f"reach_map: found {layers} layers, needs one for each of the scene's {len(scene.mask)} slots")
    in_tool = relative(scene.first_grasp[:, jnp.array([0, 1, 3])], base_pose[:, None])
    # What lies outside the window is counted to its border, which is unreachable too.
    cell = jnp.clip(jnp.round(in_tool[..., :2] / reach_map.step_m) + reach_map.origin, 0, side - 1).astype(jnp.int32)
    turn = jnp.round(in_tool[..., 2] * (turns / (2.0 * jnp.pi))).astype(jnp.int32) % turns
    reachable = reach_map.reachable[jnp.arange(layers), cell[..., 0], cell[..., 1], turn]
    serves = reachable & scene.mask
    lost = scene.mask & ~jnp.any(serves, axis=0)
    return Candidates(
        base_pose=base_pose,
        serves=serves,
        pick_time=jnp.where(serves, 0.0, jnp.inf),
        reason=jnp.where(lost, Reason.OUT_OF_REACH, Reason.NONE),
    )


def _headings(turns: int) -> Float[np.ndarray, " turns"]:
    return np.arange(turns) * (2.0 * np.pi / turns)


@partial(jax.jit, static_argnames=("shape", "step_m", "config"))
def _sweep(
    robot: Robot,
    heights: Float[Array, " slots"],
    count: int,
    shape: tuple[int, int, int],
    step_m: float,
    config: PickConfig,
) -> Bool[Array, "slots side side turns"]:
    """The first `count` layers, the others empty; `config.chunk` bins at a time keep in a CPU core's cache."""
    axis = (np.arange(shape[0]) - shape[0] // 2) * step_m
    centres = np.stack(np.meshgrid(axis, axis, _headings(shape[2]), indexing="ij"), axis=-1).reshape(-1, 3)
    bins = jnp.asarray(centres, heights.dtype)

    def layer(index: Array, layers: Array) -> Array:
        def reached(base_pose: Array) -> Array:
            grasp = jnp.zeros((len(base_pose), 4), heights.dtype).at[:, 2].set(heights[index])
            # W is the tool's planar frame here
            return _solution_exists(robot, arm_solutions.make_picks(base_pose, top_down(grasp)), config)

        return layers.at[index].set(rounds.in_chunks(reached, bins, config.chunk).reshape(shape))

    return jax.lax.fori_loop(0, count, layer, jnp.zeros((len(heights), *shape), bool))


class _Search(NamedTuple):
    """K arm solutions of each of B grasps, tried one after the other."""

    estimate: Float[Array, "K B"]  # s; infinite for what is no solution, or was tried
    found: Bool[Array, " B"]


def _solution_exists(robot: Robot, picks: arm_solutions.Picks, config: PickConfig) -> Bool[Array, " B"]:
    """Whether the arm reaches each grasp: a solution is within the limits and, refined, within the tolerances.

    It is the search for a pick's solutions with the pre-grasp at the grasp itself.
    """
    config = dataclasses.replace(config, pregrasp_height_m=0.0, descent_heights_m=())
    solutions = arm_solutions.solve(robot, picks, config)

    def attempt(search: _Search) -> _Search:
        choice = jnp.argmin(search.estimate, axis=0)
        target, joints = arm_solutions.waypoints(robot, picks, solutions, choice, config)
        joints = damped_least_squares(robot, target, joints, config.refinements)
        position_error, orientation_error = (error[-1] for error in residual(robot, target, joints))
        close = position_error <= config.position_tolerance_m
        reached = close & (orientation_error <= config.orientation_tolerance_rad)
        untried = jnp.isfinite(jnp.min(search.estimate, axis=0))
        found = search.found | (untried & reached)
        estimate = search.estimate.at[choice, jnp.arange(len(choice))].set(jnp.inf)
        return _Search(jnp.where(found, jnp.inf, estimate), found)

    start = _Search(solutions.estimate, jnp.zeros(solutions.estimate.shape[1:], bool))
    return jax.lax.while_loop(lambda search: jnp.any(jnp.isfinite(search.estimate)), attempt, start).found


def save_map(
    path: str | os.PathLike[str], reach_map: ReachabilityMap, robot: Robot, grid: GridConfig, config: PickConfig
) -> None:
    """Writes a map, whole or not at all, with the marks of its robot and configuration.

    Raises:
        OSError: the file can't be written.
    """
    arrays = {"height": np.asarray(reach_map.height, np.float32), "reachable": np.asarray(reach_map.reachable)}
    save_weights(path, arrays, {"format": FORMAT, "made_for": fingerprint(robot, grid.step_m, grid.turns, config)})


def load_map(
    path: str | os.PathLike[str], heights: np.ndarray, robot: Robot, grid: GridConfig, config: PickConfig
) -> ReachabilityMap:
    """Reads what `save_map` wrote.

    Args:
        path: of the file.
        heights: of the map that is wanted (m).
        robot: that it is wanted for.
        grid: likewise.
        config: likewise.

    Raises:
        ValueError: the file is missing, damaged, or holds a map of another format, robot, configuration or other
            heights; the message names the file and what is wrong.
    """
    heights = np.asarray(heights, np.float32)
    like = {
        "height": jax.ShapeDtypeStruct(heights.shape, jnp.float32),
        "reachable": jax.ShapeDtypeStruct((len(heights), *map_shape(robot, grid, config)), jnp.bool_),
    }
    arrays, metadata = load_weights(path, like)
    if metadata.get("format") != FORMAT:
        raise ValueError(f"{path}: format: found {metadata.get('format')!r}, needs {FORMAT!r}")
    if metadata.get("made_for") != fingerprint(robot, grid.step_m, grid.turns, config):
        raise ValueError(f"{path}: made_for: the map was made for another robot or configuration")
    found, reachable = (np.asarray(arrays[name]) for name in ("height", "reachable"))
    if not np.array_equal(found, heights):
        raise ValueError(f"{path}: height: found {found.tolist()}, needs {heights.tolist()}")
    return ReachabilityMap(reachable, heights, grid.step_m)


class MapStore:
    """The maps of one robot.

    A file that is missing, damaged or made for something else is made anew and replaced.
    """

    def __init__(self, robot: Robot, grid: GridConfig, config: PickConfig, folder: Path | None):
        """Reads nothing yet.

        Args:
            robot: the robot.
            grid: its step and number of headings are the bins'.
            config: of inverse kinematics.
            folder: where to keep maps; it is created when needed. None: in memory alone.
        """
        self._robot, self._grid, self._config = robot, grid, config
        self._folder = folder
        self._shape = map_shape(robot, grid, config)
        self._layers: dict[int, np.ndarray] = {}  # by height in steps

    def for_scene(self, scene: Scene) -> ReachabilityMap:
        """A map with one layer for each slot of an unbatched scene, in their order; those of empty slots are empty."""
        mask, height = jax.device_get((scene.mask, _grasp_height(scene)))
        steps = [round(float(z) / HEIGHT_STEP) for z in height]
        self._make_available({step for step, is_object in zip(steps, mask, strict=True) if is_object})
        layers = np.zeros((len(mask), *self._shape), bool)
        for slot in np.flatnonzero(mask):
            layers[slot] = self._layers[steps[slot]]
        return ReachabilityMap(layers, np.array(steps, np.float32) * np.float32(HEIGHT_STEP), self._grid.step_m)

    def _make_available(self, steps: Iterable[int]) -> None:
        """Loads the layers of these heights, or builds all that can't be loaded in one sweep."""
        missing = [step for step in sorted(set(steps) - set(self._layers)) if not self._load(step)]
        if not missing:
            return
        built = build_map(self._robot, [step * HEIGHT_STEP for step in missing], self._grid, self._config)
        for step, layer in zip(missing, built.reachable, strict=True):
            self._layers[step] = layer
        self._save(missing)

    def _load(self, step: int) -> bool:
        """Whether the layer's file could be used; a cache's faults are no errors: the layer is then built again."""
        if self._folder is None:
            return False
        height = np.array([step * HEIGHT_STEP])
        try:
            loaded = load_map(self._path(self._folder, step), height, self._robot, self._grid, self._config)
        except ValueError:
            return False
        self._layers[step] = loaded.reachable[0]
        return True

    def _save(self, steps: list[int]) -> None:
        def write(folder: Path) -> None:
            for step in steps:
                height = np.array([step * HEIGHT_STEP], np.float32)
                layer = ReachabilityMap(self._layers[step][None], height, self._grid.step_m)
                save_map(self._path(folder, step), layer, self._robot, self._grid, self._config)

        keep(self._folder, write)

    def _path(self, folder: Path, step: int) -> Path:
        name = re.sub(r"\W", "_", self._robot.name)
        return folder / f"{name}-{self._grid.step_m:g}m-{self._grid.turns}-{step * HEIGHT_STEP:.4f}.map"


@jax.jit
def _grasp_height(scene: Scene) -> Float[Array, " M"]:
    return scene.first_grasp[:, 2]


class CandidateSource:
    """Where PBG and MBP have their candidates from: the map, or for the -GC variants the full check of every pair."""

    def __init__(self, setup: PlannerSetup, *, checked: bool):
        """Of the setup's candidate poses.

        Args:
            setup: of the planner.
            checked: whether all pairs of pose and object are checked and timed, or looked up in the map.
        """
        self._setup = setup
        # In rooms the stops in line with the surfaces, and the grid round these where they don't serve every object.
        self._first = setup.grid_stops if setup.docked is None else setup.aligned_stops()
        pick, folder = setup.world.pick, map_folder()
        self._maps = None if checked else MapStore(setup.robot, setup.grid, pick, folder)
        self._any_grasp = None if checked else KeptGraspMap(setup.robot, pick, folder)

    def __call__(self, scene: Scene) -> tuple[Candidates, PreparedWorld]:
        """The candidates of an unbatched scene, and the stops that they are.

        There are none at all where no pose is clear of the boxes.
        """
        candidates = self._of(scene, self._first)
        everything = self._setup.docked is None or bool(jnp.all(jnp.any(candidates.serves, axis=0) | ~scene.mask))
        if everything:
            return self._reliable(scene, candidates), self._first
        grid = self._setup.grid_stops
        both = join(candidates, self._of(scene, grid))
        return self._reliable(scene, both), join_worlds(self._first, grid)

    @property
    def poses(self) -> Float[Array, "K 3"]:
        """Those that are looked at first."""
        return self._first.poses

    def preparations(self, scene: Scene) -> list[Callable[[], object]]:
        """What makes the programs for scenes of this shape ready, of candidates that are checked."""
        setup = self._setup
        tasks: list[Callable[[], object]] = [
            partial(check_candidates.prepare, setup.robot, scene, self.poses, world=setup.world)
        ]
        if setup.docked is not None:
            tasks.append(partial(compiled_first_drives.prepare, setup.robot, self._first, scene.robot_start))
        return tasks

    def _reliable(self, scene: Scene, candidates: Candidates) -> Candidates:
        setup = self._setup
        if setup.chance is None:
            return candidates
        return reliable(setup.robot, scene, candidates, setup.chance, world=setup.world)

    def _of(self, scene: Scene, stops: PreparedWorld) -> Candidates:
        setup, poses = self._setup, stops.poses
        if not len(poses):
            nothing = jnp.zeros((0, len(scene.mask)))
            reason = jnp.full(len(scene.mask), Reason.BASE_COLLIDES)
            return Candidates(poses, nothing.astype(bool), nothing, reason)
        if self._maps is None or self._any_grasp is None:
            candidates = check_candidates(setup.robot, scene, poses, world=setup.world)
        elif only_from_above(scene):
            candidates = map_candidates(self._maps.for_scene(scene), scene, poses)
        else:
            candidates = grasp_map_candidates(self._any_grasp.map, scene, poses)
        if setup.docked is None:  # there are no other poses instead of those that can't be reached
            return candidates
        return only_reachable(candidates, compiled_first_drives(setup.robot, stops, scene.robot_start))


def only_from_above(scene: Scene) -> bool:
    """Whether every object of an unbatched scene has one top-down grasp, as in the paper's world."""
    mask, grasps = jax.device_get((scene.mask, scene.object_grasps))
    own = grasps.pose[mask][:, :, 3:5]
    return bool(
        np.all(np.sum(grasps.there[mask], axis=1) == 1) and np.all(own[:, 0] == np.array([np.pi, 0.0], np.float32))
    )


def nearest_grasp(grasps: Grasps, base_pose: Float[Array, "3"]) -> Float[Array, " M"]:
    """Distance (m) on the floor from a base pose to the nearest grasp of each object.

    Args:
        grasps: in W, "M G" of them.
        base_pose: (x, y, heading) in W.
    """
    distance = jnp.linalg.norm(grasps.pose[..., :2] - base_pose[:2], axis=-1)
    return jnp.min(jnp.where(grasps.there, distance, jnp.inf), axis=-1)


def unserved_reason(candidates: Candidates) -> Int[Array, " M"]:
    """Why an object of each slot is not served: its candidates' reason, or that none of them can be driven to."""
    return jnp.where(candidates.reason == Reason.NONE, Reason.UNREACHABLE, candidates.reason)
