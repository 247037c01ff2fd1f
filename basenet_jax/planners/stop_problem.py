"""A scene as a problem on a graph of stops: what picks cost at each, and drives between them."""

from collections import defaultdict
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.exact_sequence import best_sequence, sets_of
from basenet_jax.planners.protocol import assemble_plan
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene

_BUCKET = 256  # the number of stops is rounded up to a multiple, so that few shapes are compiled

_best_sequence = jax.jit(best_sequence)


class Sizes:
    """The sizes that a planner's problems are filled up to, so that planning again what is left compiles nothing.

    A scene with all slots in use has as many stops as it needs, in whole buckets. One with empty slots takes the size
    of an earlier problem that holds it: what is left of a scene has fewer objects and stops than the scene.
    """

    def __init__(self, exact_objects: int):
        """So many objects are planned exactly, whose tables double with each; for more, columns are cheap."""
        self._exact, self._known = exact_objects, defaultdict[int, set[int]](set)

    def fit(self, mask: Bool[np.ndarray, " M"], objects: int, stops: int) -> tuple[int, int]:
        """Columns and stops for so many of them."""
        slots = len(mask)
        columns = min(slots, self._exact) if objects <= self._exact else slots
        known = self._known[columns]
        larger = () if np.all(mask) else tuple(size for size in tuple(known) if size >= stops)
        size = min(larger, default=stops + -stops % _BUCKET)
        known.add(size)
        return columns, size


class StopProblem(NamedTuple):
    """P stops, of which every one serves something but those that fill up, and the N objects that are served. In s.

    C columns, of which the first N are the objects'; the others fill up.
    """

    pick_time: Float[Array, "P C"]  # infinite where the stop doesn't serve the object
    first_drive: Float[Array, " P"]  # from the robot's start
    drive: Float[Array, "P P"]  # from stop to stop; 0 for staying
    poses: Float[np.ndarray, "P 3"]  # (x, y, heading) in W
    slots: Int[np.ndarray, " N"]  # of the objects
    reason: Int[np.ndarray, " M"]  # a `Reason`, by slot: why an object is not among them

    @property
    def costs(self) -> tuple[Float[Array, "P C"], Float[Array, " P"], Float[Array, "P P"]]:
        """What planners of sequences take: pick times, first drives, drives between the stops."""
        return self.pick_time, self.first_drive, self.drive

    def best_steps(self) -> tuple[Int[np.ndarray, " N"], Int[np.ndarray, " N"]]:
        """The cheapest way to pick all N objects, at least one: which is picked by each step, at which of the stops."""
        count = len(self.slots)
        order, stops = jax.device_get(_best_sequence(*self.costs, sets_of(count, self.pick_time.shape[1])))
        return order[-count:], stops[-count:]

    def plan(self, scene: Scene, order: Int[np.ndarray, " S"], stops: Int[np.ndarray, " S"]) -> Plan:
        """The plan of some steps; objects without one come last.

        Args:
            scene: of the problem.
            order: which of the N objects each step picks.
            stops: at which of the P stops.
        """
        return assemble_plan(scene, self.slots[order], self.poses[stops], self.reason)

    def plan_nothing(self, scene: Scene) -> Plan:
        """The plan of no step, where nothing is served."""
        nothing = np.zeros(0, np.int32)
        return self.plan(scene, nothing, nothing)


def stop_problem(
    robot: Robot, drives: Drives, scene: Scene, candidates: Candidates, sizes: Sizes | None = None
) -> StopProblem:
    """The problem on the useful candidates.

    Args:
        robot: its base's speeds and accelerations count.
        drives: of the scene's room.
        scene: unbatched.
        candidates: base poses with validated costs.
        sizes: of the problems before; None: a column for each object, and stops in whole buckets.
    """
    pick_time, pose = np.asarray(candidates.pick_time), np.asarray(candidates.base_pose)
    first = np.asarray(drives.matrix(robot, scene.robot_start[None], candidates.base_pose))[0]
    # What only such poses serve can't be had. Round one table no drive leads to them, wherever it begins: they are
    # inside the table grown by the path margin. In a room they are shut in.
    reachable = np.isfinite(first)
    served = np.flatnonzero(np.any(np.isfinite(pick_time[reachable]), axis=0))
    reason = np.where(np.any(np.isfinite(pick_time), axis=0), int(Reason.UNREACHABLE), np.asarray(candidates.reason))
    # A pose that serves nothing is no stop of any plan, since each step of a plan picks.
    useful = np.flatnonzero(reachable & np.any(np.isfinite(pick_time), axis=1))
    columns, stops = len(served), len(useful) + -len(useful) % _BUCKET
    if sizes is not None:
        columns, stops = sizes.fit(np.asarray(scene.mask), len(served), len(useful))
    padding, empty = stops - len(useful), columns - len(served)
    poses = np.pad(pose[useful], ((0, padding), (0, 0)))
    picks = np.pad(pick_time[np.ix_(useful, served)], ((0, padding), (0, empty)), constant_values=np.inf)
    first = np.pad(first[useful], (0, padding), constant_values=np.inf)
    drive = jnp.asarray(drives.matrix(robot, poses, poses))
    return StopProblem(jax.device_put(picks), jax.device_put(first), drive, poses, served, reason)
