"""The problem that exact planning and search are given: of few sizes, so that little is compiled."""

import dataclasses
from collections import defaultdict
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.exact_sequence import best_sequence, sets_of
from basenet_jax.planners.protocol import assemble_plan
from basenet_jax.robot.model import Robot
from basenet_jax.task.clutter import Clutter, as_bits, as_members
from basenet_jax.task.drives import Drives
from basenet_jax.task.plan import Plan
from basenet_jax.task.stop_problem import StopProblem, make_problem
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


class SizedProblem(NamedTuple):
    """A scene's problem cut down to what counts, then filled up to a size that few programs are compiled for.

    Its columns are the objects that can be had and then none, in an order of their own; so those of the scene are told
    apart from them.
    """

    problem: StopProblem  # P stops, of which every one serves something but those that fill up, and C columns
    slots: Int[np.ndarray, " N"]  # of the first columns' objects
    reason: Int[np.ndarray, " M"]  # a `Reason`, by slot: why an object is not among them

    @property
    def costs(self) -> tuple[Float[Array, "P C"], Float[Array, " P"], Float[Array, "P P"]]:
        """What planners of sequences take: pick times, first drives, drives between the stops."""
        return self.problem.pick_time, self.problem.first_drive, self.problem.drive

    def best_steps(self) -> tuple[Int[np.ndarray, " N"], Int[np.ndarray, " N"]]:
        """The cheapest way to pick all N objects, at least one: which is picked by each step, at which of the stops."""
        count = len(self.slots)
        sets = sets_of(count, len(self.problem.mask))
        order, stops = jax.device_get(_best_sequence(*self.costs, sets, self.problem.clutter))
        return order[-count:], stops[-count:]

    def plan(self, scene: Scene, order: Int[np.ndarray, " S"], stops: Int[np.ndarray, " S"]) -> Plan:
        """The plan of some steps; objects without one come last.

        Args:
            scene: of the problem.
            order: which of the N objects each step picks.
            stops: at which of the P stops.
        """
        return assemble_plan(scene, self.slots[order], np.asarray(self.problem.poses)[stops], self.reason)

    def plan_nothing(self, scene: Scene) -> Plan:
        """The plan of no step, where nothing is served."""
        nothing = np.zeros(0, np.int32)
        return self.plan(scene, nothing, nothing)


def stop_problem(
    robot: Robot,
    drives: Drives,
    scene: Scene,
    candidates: Candidates,
    sizes: Sizes | None = None,
    *,
    between: Float[ArrayLike, "K K"] | None = None,
) -> SizedProblem:
    """The problem on the useful candidates.

    Args:
        robot: its base's speeds and accelerations count.
        drives: of the scene's room.
        scene: unbatched.
        candidates: base poses with validated costs.
        sizes: of the problems before; None: a column for each object, and stops in whole buckets.
        between: drives (s) between the candidates, where they are known.
    """
    poses, times, reason, mask, clutter = jax.device_get(
        (candidates.base_pose, candidates.pick_time, candidates.reason, scene.mask, candidates.clutter)
    )
    if candidates.first_drive is None:
        first = np.asarray(drives.matrix(robot, scene.robot_start[None], candidates.base_pose))[0]
    else:
        first = np.asarray(candidates.first_drive)
    # What only poses with an infinite first drive serve can't be had. Round one table no drive leads to them, wherever
    # it begins: they are inside the table grown by the path margin. In a room they are shut in.
    nothing: Any = np.zeros((0, 0))
    whole = make_problem(poses, nothing, times, first, mask, reason, np, clutter=clutter)
    times, clutter = whole.pick_time, whole.clutter
    served = np.flatnonzero(whole.mask)
    # A pose that serves nothing is no stop of any plan, since each step of a plan picks.
    useful = np.flatnonzero(np.isfinite(first) & np.any(np.isfinite(times), axis=1))
    columns, stops = len(served), len(useful) + -len(useful) % _BUCKET
    if sizes is not None:
        columns, stops = sizes.fit(np.asarray(mask), len(served), len(useful))
    padding, empty = stops - len(useful), columns - len(served)
    poses = np.pad(poses[useful], ((0, padding), (0, 0)))
    times = np.pad(times[np.ix_(useful, served)], ((0, padding), (0, empty)), constant_values=np.inf)
    first = np.pad(first[useful], (0, padding), constant_values=np.inf)
    if between is None:
        drive = jnp.asarray(drives.matrix(robot, poses, poses))
    else:
        drive = jax.device_put(np.pad(np.asarray(between)[np.ix_(useful, useful)], (0, padding)))
    there = np.arange(columns) < len(served)
    if clutter is not None:
        clutter = _cut_down(clutter, useful, served, padding, empty)
    problem = make_problem(poses, drive, times, first, there, clutter=clutter, numpy=np)
    costs: Any = jax.device_put((problem.pick_time, problem.first_drive, problem.clutter))
    problem = dataclasses.replace(problem, pick_time=costs[0], first_drive=costs[1], clutter=costs[2])
    return SizedProblem(problem, served, np.asarray(whole.reason))


def _cut_down(
    clutter: Clutter, stops: Int[np.ndarray, " P"], served: Int[np.ndarray, " N"], padding: int, empty: int
) -> Clutter:
    """The ways of some stops and objects, whose bits are numbered anew, filled up with none."""
    own = np.asarray(clutter.time)[np.ix_(stops, served)]
    members = as_members(np.asarray(clutter.blockers)[np.ix_(stops, served)], clutter.time.shape[1])[..., served]
    fill = ((0, padding), (0, empty), (0, 0))
    members: Any = np.pad(members, (*fill, (0, empty)))
    time: Any = np.pad(own, fill, constant_values=np.inf)
    return Clutter(time, as_bits(members, np))
