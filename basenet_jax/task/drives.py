"""How the base gets about in a room: the kinds of drives, each with what it needs prepared, behind one face.

Planners ask for the `ends` of many poses once and for `times` between them as often as they like; the judge asks for
`each` drive of a plan. A new kind of drive is one more class here.
"""

import functools
import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float, Int

from basenet_jax import rounds, struct
from basenet_jax.compilation import Stored
from basenet_jax.config import DockedConfig, NavigationConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task.docked_drives import compiled_gates, drive_matrix, drive_times, drives_between, shared_gates
from basenet_jax.task.docked_manoeuvre import find_manoeuvre
from basenet_jax.task.drive_times import DriveTimes
from basenet_jax.task.gates import gates
from basenet_jax.task.manoeuvre import Manoeuvre, along_path
from basenet_jax.task.navigation import navigation_path, navigation_time
from basenet_jax.task.near_drives import fastest_roads, times_over
from basenet_jax.task.roadmap import Roadmap, make_roadmap
from basenet_jax.trigonometry import wrap_angle
from basenet_jax.world.boxes import Room, fingerprint

Ends: TypeAlias = Any  # of S poses: a pytree of arrays whose first axis is S
Goals: TypeAlias = Any  # ends, or what `goals` makes of them
Roads: TypeAlias = Any  # of drives: a pytree of arrays whose first axis counts them
_DRIVES_AT_ONCE = 64

SAME_POSE_IN_TABLE = 1e-4  # m or rad: a table's decimals and float32 make no difference
_POSES = 64  # tables are padded to a multiple
_FAR = 1e6


@struct.dataclass
class PointDrives:
    """Drives of a point round the one table of a room, the paper's world; see `task.navigation`."""

    room: Room
    config: NavigationConfig = struct.field(pytree_node=False)

    def ends(self, robot: Robot, poses: Float[Array, "S 3"]) -> Ends:
        """What `times` asks of poses (x, y, heading in W)."""
        del robot
        return poses

    def goals(self, robot: Robot, poses: Float[Array, "S 3"]) -> tuple[Ends, Goals]:
        """The ends of poses, and the same as goals of many drives, on the host."""
        del robot
        return poses, poses

    def between(self, robot: Robot, goals: Goals) -> ArrayLike:
        """The times (s) of the drives from each of many goals to each, on the host."""
        return _point_matrix(self, robot, goals, goals)

    def times(self, robot: Robot, start: Ends, goal: Goals) -> Float[Array, "S T"]:
        """Least times (s) from all starts to all goals; infinite where there is no way."""
        return navigation_time(robot, start[:, None], goal, self.room, self.config)

    def roads(self, robot: Robot, ends: Ends) -> Roads:
        """Of the drives from each pose to the next, what `times_near` asks: nothing."""
        del robot, ends
        return ()

    def times_near(self, robot: Robot, start: Ends, goal: Ends, road: Roads) -> Float[Array, "S T"]:
        """Times (s) of drives between poses near to those of a known one."""
        del road
        return self.times(robot, start, goal)

    def matrix(self, robot: Robot, start: Float[ArrayLike, "S 3"], goal: Float[ArrayLike, "T 3"]) -> ArrayLike:
        """The same between many poses, on the host."""
        return _point_matrix(self, robot, start, goal)

    def each(
        self, robot: Robot, start: Float[Array, "*batch 3"], goal: Float[Array, "*batch 3"]
    ) -> Float[Array, "*batch"]:
        """Least times (s) of single drives."""
        return navigation_time(robot, start, goal, self.room, self.config)

    def manoeuvre(self, robot: Robot, start: Float[ArrayLike, "3"], goal: Float[ArrayLike, "3"]) -> Manoeuvre:
        """The legs of the drive that takes the least time, on the host.

        Raises:
            ValueError: the goal can't be reached.
        """
        path = navigation_path(robot, start, goal, self.room, self.config)
        config = self.config
        how = {"same_pose": config.same_pose, "keep_heading": config.straight, "reverse": config.reverse}
        return along_path(robot, path, start, goal, **how)


@struct.dataclass
class DockedDrives:
    """Drives true to the footprint among boxes; see `task.docked_drives`."""

    roadmap: Roadmap

    def ends(self, robot: Robot, poses: Float[Array, "S 3"]) -> Ends:
        """What `times` asks of poses (x, y, heading in W)."""
        return gates(robot, self.roadmap.space, poses)

    def goals(self, robot: Robot, poses: Float[Array, "S 3"]) -> tuple[Ends, Goals]:
        """The ends of poses, and the same as goals of many drives, on the host: places that they share count once."""
        ends = compiled_gates(robot, self.roadmap, poses)
        return ends, shared_gates(robot, ends, reverse=self.roadmap.reverse)

    def between(self, robot: Robot, goals: Goals) -> ArrayLike:
        """The times (s) of the drives from each of many goals to each, on the host."""
        return drives_between(robot, self.roadmap, goals, goals)

    def times(self, robot: Robot, start: Ends, goal: Goals) -> Float[Array, "S T"]:
        """Least times (s) from all starts to all goals; infinite where there is no way."""
        return drive_times(robot, self.roadmap, start, goal)

    def roads(self, robot: Robot, ends: Ends) -> Roads:
        """Of the drives from each pose to the next, what `times_near` asks."""
        return fastest_roads(robot, self.roadmap, ends)

    def times_near(self, robot: Robot, start: Ends, goal: Ends, road: Roads) -> Float[Array, "S T"]:
        """Times (s) of drives between poses near to those of a known one, over the vias that it goes over."""
        return times_over(robot, self.roadmap, start, goal, road)

    def matrix(self, robot: Robot, start: Float[ArrayLike, "S 3"], goal: Float[ArrayLike, "T 3"]) -> ArrayLike:
        """The same between many poses, on the host, where turning places that poses share are used once."""
        return drive_matrix(robot, self.roadmap, start, goal)

    def each(
        self, robot: Robot, start: Float[Array, "*batch 3"], goal: Float[Array, "*batch 3"]
    ) -> Float[Array, "*batch"]:
        """Least times (s) of single drives."""
        batch = jnp.broadcast_shapes(start.shape[:-1], goal.shape[:-1])
        ends = [
            self.ends(robot, jnp.broadcast_to(poses, (*batch, 3)).reshape(math.prod(batch), 3))
            for poses in (start, goal)
        ]

        def some(pairs: tuple[Ends, Ends]) -> Array:
            """One search for all of them: the drives that nobody asks for cost less than loops of their own."""
            return jnp.diagonal(self.times(robot, *pairs))

        return rounds.in_chunks(some, tuple(ends), _DRIVES_AT_ONCE).reshape(batch)

    def manoeuvre(self, robot: Robot, start: Float[ArrayLike, "3"], goal: Float[ArrayLike, "3"]) -> Manoeuvre:
        """The legs of the drive that takes the least time, on the host.

        Raises:
            ValueError: the goal can't be reached.
        """
        return find_manoeuvre(robot, self.roadmap, start, goal)


@struct.dataclass
class GivenDrives:
    """Drives that take what a table says, between its P poses; from or to any other pose there is none.

    What the base does on its way isn't known, so these have no `manoeuvre`.
    """

    poses: Float[Array, "P 3"]  # (x, y, heading) in W; those that pad are far away
    seconds: Float[Array, "P+1 P+1"]  # infinite where there is no way; last come the poses that aren't in the table

    @classmethod
    def of(cls, table: DriveTimes) -> "GivenDrives":
        """A table's, padded so that tables share programs; on the host."""
        count = len(table.poses)
        padding = -count % _POSES
        poses: Any = np.pad(table.poses, [(0, padding), (0, 0)], constant_values=_FAR).astype(np.float32)
        seconds: Any = np.pad(table.seconds, (0, padding + 1), constant_values=np.inf).astype(np.float32)
        return cls(poses, seconds)

    def ends(self, robot: Robot, poses: Float[Array, "*batch 3"]) -> Int[Array, "*batch"]:
        """Which of the table's poses each is; P: none."""
        del robot
        apart = jnp.asarray(poses)[..., None, :] - self.poses
        apart = jnp.concatenate([apart[..., :2], wrap_angle(apart[..., 2:])], axis=-1)
        same = jnp.all(jnp.abs(apart) <= SAME_POSE_IN_TABLE, axis=-1)
        return jnp.where(jnp.any(same, axis=-1), jnp.argmax(same, axis=-1), len(self.poses))

    def goals(self, robot: Robot, poses: Float[Array, "S 3"]) -> tuple[Ends, Goals]:
        """The ends of poses, and the same as goals of many drives, on the host."""
        ends = _given_ends(self, robot, poses)
        return ends, ends

    def between(self, robot: Robot, goals: Goals) -> ArrayLike:
        """The times (s) of the drives from each of many goals to each, on the host."""
        return _given_times(self, robot, goals)

    def times(self, robot: Robot, start: Ends, goal: Goals) -> Float[Array, "S T"]:
        """The times (s) from all starts to all goals."""
        del robot
        return self.seconds[start[:, None], goal]

    def roads(self, robot: Robot, ends: Ends) -> Roads:
        """Of the drives from each pose to the next, what `times_near` asks: nothing."""
        del robot, ends
        return ()

    def times_near(self, robot: Robot, start: Ends, goal: Ends, road: Roads) -> Float[Array, "S T"]:
        """Times (s) of drives between poses near to those of a known one: of the table's poses alone there are some."""
        del road
        return self.times(robot, start, goal)

    def matrix(self, robot: Robot, start: Float[ArrayLike, "S 3"], goal: Float[ArrayLike, "T 3"]) -> ArrayLike:
        """The same between many poses, on the host."""
        return _given_matrix(self, robot, start, goal)

    def each(
        self, robot: Robot, start: Float[Array, "*batch 3"], goal: Float[Array, "*batch 3"]
    ) -> Float[Array, "*batch"]:
        """The times (s) of single drives."""
        return self.seconds[self.ends(robot, start), self.ends(robot, goal)]


OwnDrives: TypeAlias = PointDrives | DockedDrives
Drives: TypeAlias = OwnDrives | GivenDrives


def are_docked(room: Room, config: NavigationConfig) -> bool:
    """Whether one drives true to the footprint in a room, or a batch of rooms."""
    return config.drives == "docked" or (config.drives == "by-room" and room.boxes.low.shape[-1] != 1)


def make_drives(robot: Robot, room: Room, config: NavigationConfig = NavigationConfig()) -> OwnDrives:
    """The drives of a room, on the host: of a point where it has one table (the paper's world), else docked.

    Args:
        robot: its base counts.
        room: one room, concrete.
        config: which of the two, and their numbers.

    Raises:
        ValueError: drives of a point are asked for in a room of several boxes.
    """
    if config.drives == "point" and room.boxes.low.shape[-1] != 1:
        raise ValueError("drives: found point in a room, allowed is docked; point goes round one table that is alone")
    if are_docked(room, config):
        host, concrete = jax.tree.map(np.asarray, jax.device_get((robot, room)))
        known = (_Known(base_identity(host), host), _Known(fingerprint(room), concrete))
        return DockedDrives(_roadmap(*known, config.docked, config.reverse))
    return PointDrives(room, config)


@dataclass(frozen=True)
class _Known:
    """Something that the cache of roadmaps knows again."""

    identity: Hashable
    value: Any = field(compare=False)


@functools.lru_cache(maxsize=16)
def _roadmap(robot: _Known, room: _Known, config: DockedConfig, reverse: bool) -> Roadmap:
    return jax.device_put(make_roadmap(robot.value, room.value, config, reverse=reverse))


def base_identity(robot: Robot) -> Hashable:
    """All of a robot that drives, and where its base may stand, depend on: what tells bases apart, for caches."""
    sizes = (robot.footprint_half_size, robot.body_center, robot.body_half_size)
    arrays = (np.asarray(x) for x in (*sizes, robot.base_speed, robot.base_acceleration))
    return robot.omnidirectional, *(x.tobytes() for x in arrays)


@jax.jit
def _given_ends(drives: GivenDrives, robot: Robot, poses: Array) -> Array:
    return drives.ends(robot, poses)


@jax.jit
def _given_times(drives: GivenDrives, robot: Robot, ends: Array) -> Array:
    return drives.times(robot, ends, ends)


@jax.jit
def _given_matrix(drives: GivenDrives, robot: Robot, start: Array, goal: Array) -> Array:
    return drives.times(robot, drives.ends(robot, start), drives.ends(robot, goal))


@Stored
def _point_matrix(drives: PointDrives, robot: Robot, start: Array, goal: Array) -> Array:
    return drives.times(robot, start, goal)
