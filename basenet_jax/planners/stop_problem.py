"""A scene as a problem on a graph of stops: what picks cost at each, and drives between them."""

from typing import NamedTuple

import jax
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from basenet_jax.config import NavigationConfig
from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.protocol import assemble_plan
from basenet_jax.robot.model import Robot
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan
from basenet_jax.world.boxes import Room
from basenet_jax.world.scene import Scene

_BUCKET = 256  # the number of stops is rounded up to a multiple, so that few shapes are compiled


class StopProblem(NamedTuple):
    """P stops, of which every one serves something but those that fill up, and the N objects that are served. In s."""

    pick_time: Float[Array, "P N"]  # infinite where the stop doesn't serve the object
    first_drive: Float[Array, " P"]  # from the robot's start
    drive: Float[Array, "P P"]  # from stop to stop; 0 for staying
    poses: Float[np.ndarray, "P 3"]  # (x, y, heading) in W
    slots: Int[np.ndarray, " N"]  # of the objects
    reason: Int[np.ndarray, " M"]  # a `Reason`, by slot: why an object is not among them

    @property
    def costs(self) -> tuple[Float[Array, "P N"], Float[Array, " P"], Float[Array, "P P"]]:
        """What planners of sequences take: pick times, first drives, drives between the stops."""
        return self.pick_time, self.first_drive, self.drive

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
    robot: Robot, scene: Scene, candidates: Candidates, config: NavigationConfig = NavigationConfig()
) -> StopProblem:
    """The problem on the useful candidates.

    Args:
        robot: its base's speeds and accelerations count.
        scene: unbatched.
        candidates: base poses with validated costs.
        config: of the drives.
    """
    pick_time, pose = np.asarray(candidates.pick_time), np.asarray(candidates.base_pose)
    first = np.asarray(_drives_from(robot, scene.robot_start, candidates.base_pose, scene.room, config))
    # What only such poses serve can't be had: a drive to them is never allowed, wherever it begins (they lie inside
    # the table grown by the path margin), so leaving them out loses no plan.
    reachable = np.isfinite(first)
    served = np.flatnonzero(np.any(np.isfinite(pick_time[reachable]), axis=0))
    reason = np.where(np.any(np.isfinite(pick_time), axis=0), int(Reason.UNREACHABLE), np.asarray(candidates.reason))
    # A pose that serves nothing is no stop of any plan, since each step of a plan picks.
    useful = np.flatnonzero(reachable & np.any(np.isfinite(pick_time), axis=1))
    padding = -len(useful) % _BUCKET
    poses = np.pad(pose[useful], ((0, padding), (0, 0)))
    picks = np.pad(pick_time[np.ix_(useful, served)], ((0, padding), (0, 0)), constant_values=np.inf)
    first = np.pad(first[useful], (0, padding), constant_values=np.inf)
    drive = _drives_between(robot, poses, scene.room, config)
    return StopProblem(jax.device_put(picks), jax.device_put(first), drive, poses, served, reason)


@jax.jit(static_argnames="config")
def _drives_from(
    robot: Robot, start: Float[Array, "3"], poses: Float[Array, "P 3"], room: Room, config: NavigationConfig
) -> Float[Array, " P"]:
    return navigation_time(robot, start, poses, room, config)


@jax.jit(static_argnames="config")
def _drives_between(
    robot: Robot, poses: Float[Array, "P 3"], room: Room, config: NavigationConfig
) -> Float[Array, "P P"]:
    return navigation_time(robot, poses[:, None], poses, room, config)
