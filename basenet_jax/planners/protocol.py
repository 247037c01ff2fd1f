"""What every planner has in common."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, TypeVar, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.config import AlignedConfig, GridConfig, WorldConfig
from basenet_jax.devices import Devices
from basenet_jax.planners.aligned_stops import sure_lines
from basenet_jax.planners.candidates import grid_poses
from basenet_jax.planners.prepared_stops import filled_up, prepared_stops
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.drive_times import DriveTimes
from basenet_jax.task.drives import Drives, GivenDrives, PointDrives, are_docked, make_drives
from basenet_jax.task.plan import Plan
from basenet_jax.task.prepared_world import PreparedWorld, prepare_world
from basenet_jax.task.reliability import Chance
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import compiled_base_collides
from basenet_jax.world.scene import Scene

Tree = TypeVar("Tree")


class Planner(Protocol):
    """Plans one scene: `planner(scene, key)`; the first call for a number of slots compiles.

    A planner is made for one robot and table, from a `PlannerSetup`.
    """

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """A plan for an unbatched scene.

        Args:
            scene: with the table that the planner was made for.
            key: consumed by planners that draw random numbers; the others ignore it.

        Raises:
            PlanningError: the planner can't serve such a scene; the message says what can.
        """
        ...


@runtime_checkable
class BatchPlanner(Planner, Protocol):
    """A planner that plans many scenes in one program."""

    def plan_batch(self, scenes: Scene, key: Array) -> Plan:
        """The plans of a batch, each that of its scene alone with its part of the key.

        Args:
            scenes: with one leading axis.
            key: split into one for each scene.

        Raises:
            PlanningError: the planner can't serve such a scene; the message says what can.
        """
        ...


@runtime_checkable
class PreparedPlanner(Planner, Protocol):
    """A planner whose programs may be made ready before the first call, side by side."""

    def preparations(self, scene: Scene) -> Sequence[Callable[[], object]]:
        """What makes the programs for scenes of this shape ready, to be run by `compilation.together`."""
        ...


def plan_batch(planner: Planner, scenes: Scene, key: Array) -> Plan:
    """Plans a batch of scenes: in one program where the planner can, else one scene after the other.

    Args:
        planner: of the scenes' robot and table.
        scenes: with one leading axis.
        key: split into one for each scene.

    Raises:
        PlanningError: the planner can't serve such a scene; the message says what can.
    """
    if isinstance(planner, BatchPlanner):
        return planner.plan_batch(scenes, key)
    keys = jax.random.split(key, len(scenes.mask))
    plans = [planner(*jax.tree.map(lambda x, i=i: x[i], (scenes, keys))) for i in range(len(keys))]
    return jax.tree.map(lambda *x: jnp.stack(x), *plans)


def in_parts(plan: Callable[[Scene, Array], Tree], scenes: Scene, keys: Array, *, devices: Devices, most: int) -> Tree:
    """What a compiled program makes of a batch, called with parts of one size.

    Sizes grow fourfold, so that few of them are ever compiled. The last part is filled up with scenes without objects,
    which cost next to nothing.

    Args:
        plan: of scenes and their keys; what it returns are batches.
        scenes: with one leading axis.
        keys: one for each scene.
        devices: that share a part.
        most: scenes of a part on each device.
    """
    count, size = len(scenes.mask), 1
    while size < min(most, -(-count // devices.count)):
        size = min(4 * size, most)
    size, parts = size * devices.count, []
    for start in range(0, count, size):
        rows = np.arange(start, start + size)
        own, own_keys = jax.tree.map(lambda x, rows=rows: x[np.minimum(rows, count - 1)], (scenes, keys))
        own = dataclasses.replace(own, mask=own.mask & (rows < count)[:, None])
        parts.append(jax.tree.map(lambda x, start=start: x[: count - start], plan(own, own_keys)))
    return jax.tree.map(lambda *x: jnp.concatenate(x), *parts)


class PlanningError(ValueError):
    """A scene that a planner can't serve, and what to use instead."""


@dataclass(frozen=True)
class PlannerSetup:
    """What planners are made for, shared by all of one evaluation; each has its own options beside."""

    robot: Robot = field(default_factory=lambda: jax.device_put(load_robot()))
    room: Room = field(default_factory=Room.from_config)
    world: WorldConfig = field(default_factory=WorldConfig)
    grid: GridConfig = field(default_factory=GridConfig)
    drive_times: DriveTimes | None = None  # instead of the room's own drives, whose poses are then the stops
    chance: Chance | None = None  # how sure every pick is to be where the base parks with errors; None: as if it didn't

    @cached_property
    def grid_poses(self) -> Float[np.ndarray, "K 3"]:
        """The grid's base poses (x, y, heading in W) that touch nothing; in rooms some twice, see `filled_up`."""
        poses = grid_poses(self.robot, self.room, self.grid, self.world.pick)
        return filled_up(poses) if are_docked(self.room, self.world.navigation) else poses

    @cached_property
    def drives(self) -> Drives:
        """How the base gets about in the room."""
        if self.drive_times is not None:
            return jax.device_put(GivenDrives.of(self.drive_times))
        return make_drives(self.robot, self.room, self.world.navigation)

    @property
    def docked(self) -> Drives | None:
        """The drives where the judge must be given them: those of a point are each scene's own."""
        return None if isinstance(self.drives, PointDrives) else self.drives

    def aligned_stops(self, aligned: AlignedConfig = AlignedConfig()) -> PreparedWorld:
        """The stops in line with the surfaces, or those that there are drive times for; with the drives between them.

        Where the base parks with errors, the lines are as far off as these need.

        Raises:
            PlanningError: the base can't stand at any of the poses that there are drive times for.
        """
        if self.chance is not None:
            aligned = sure_lines(self.robot, self.chance, aligned, self.world.pick)
        if self.drive_times is None:
            return prepared_stops(self.robot, self.room, aligned, self.world.pick, self.world.navigation)
        pick, poses = self.world.pick, self.drive_times.poses.astype(np.float32)
        collides = compiled_base_collides(self.robot, poses, self.room, pick.base_clearance_m, pick.touching_m)
        if np.all(collides):
            found = f"{self.drive_times.source}: poses: found {len(poses)} at which the base is too near to something"
            raise PlanningError(f"{found}, allowed are some more than {pick.base_clearance_m:g} m clear")
        return prepare_world(self.robot, self.drives, poses[~np.asarray(collides)])

    @cached_property
    def grid_stops(self) -> PreparedWorld:
        """The grid's poses; they are too many for all drives between them."""
        return prepare_world(self.robot, self.drives, self.grid_poses, all_pairs=False)

    def with_room(self, room: Room) -> "PlannerSetup":
        """The same for another room."""
        return dataclasses.replace(self, room=room)


def assemble_plan(
    scene: Scene, order: Int[np.ndarray, " S"], base_pose: Float[np.ndarray, "S 3"], reason: Int[np.ndarray, " M"]
) -> Plan:
    """A plan from its served steps; the scene's other objects follow as unserved steps.

    Args:
        scene: unbatched.
        order: slots of the served objects, in the order of the picks.
        base_pose: where the base parks for each, (x, y, heading) in W.
        reason: by slot, why it is not served (ignored for served ones).
    """
    mask = np.asarray(scene.mask)
    rest = np.setdiff1d(np.flatnonzero(mask), order)
    slots = len(mask)
    index = np.full(slots, -1, np.int32)
    index[: len(order) + len(rest)] = np.concatenate([order, rest])
    poses = np.zeros((slots, 3), np.float32)
    poses[: len(order)] = base_pose
    reasons = np.zeros(slots, np.int32)
    reasons[len(order) : len(order) + len(rest)] = np.asarray(reason)[rest]
    served: Bool[np.ndarray, " M"] = np.arange(slots) < len(order)
    return Plan(*(jnp.asarray(x) for x in (index, poses, served, reasons)))


def no_plan(scene: Scene) -> Plan:
    """A plan of no steps for the scene's number of slots, on the host: what programs for plans are prepared with."""
    index = np.full(len(scene.mask), -1, np.int32)
    none: Any = (index, np.zeros((len(index), 3), np.float32), index >= 0, np.zeros_like(index))
    return Plan(*none)
