"""Exact dynamic programming over (objects grasped, last base pose) on validated costs (Held and Karp, 1962)."""

import jax
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from basenet_jax.config import NavigationConfig
from basenet_jax.planners.candidates import Candidates, check_candidates
from basenet_jax.planners.exact_sequence import best_sequence
from basenet_jax.planners.protocol import PlannerSetup, PlanningError, assemble_plan
from basenet_jax.robot.model import Robot
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene, Table

MAX_OBJECTS = 14  # 2^14 subsets x 2,500 poses: 160 MiB and some ten seconds on two cores; each more doubles both
_BUCKET = 256  # the number of poses is rounded up to a multiple, so that few shapes are compiled


class Dp:
    """The least-cost plan among all whose base poses are on the grid."""

    def __init__(self, setup: PlannerSetup):
        self._setup = setup

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        del key
        setup = self._setup
        check_size(int(np.sum(scene.mask)))
        candidates = check_candidates(setup.robot, scene, setup.grid_poses, setup.world)
        return plan_exactly(setup.robot, scene, candidates, setup.world.navigation)


def check_size(objects: int) -> None:
    """Refuses scenes that would take minutes and gigabytes.

    Raises:
        PlanningError: with what to use instead.
    """
    if objects > MAX_OBJECTS:
        raise PlanningError(
            f"objects: found {objects}, dp plans at most {MAX_OBJECTS} (its time and memory double with each); "
            "use basenet, mbp-gc or pbg-gc"
        )


def plan_exactly(
    robot: Robot, scene: Scene, candidates: Candidates, config: NavigationConfig = NavigationConfig()
) -> Plan:
    """The plan of least N + G over all orders and all choices among the candidates; unserved objects come last.

    Args:
        robot: its base's speeds and accelerations count.
        scene: unbatched.
        candidates: base poses with validated costs.
        config: of the drives.
    """
    pick_time, pose = np.asarray(candidates.pick_time), np.asarray(candidates.base_pose)
    first = np.asarray(_drives_from(robot, scene.robot_start, candidates.base_pose, scene.table, config))
    # What only such poses serve can't be had: a drive to them is never allowed, wherever it begins (they lie inside
    # the table grown by the path margin), so leaving them out loses no plan.
    reachable = np.isfinite(first)
    served = np.flatnonzero(np.any(np.isfinite(pick_time[reachable]), axis=0))
    reason = np.where(np.any(np.isfinite(pick_time), axis=0), int(Reason.UNREACHABLE), np.asarray(candidates.reason))
    # The only pruning: a pose that serves nothing is no stop of any plan, since each step of a plan picks.
    useful = np.flatnonzero(reachable & np.any(np.isfinite(pick_time), axis=1))
    if not len(served):
        return assemble_plan(scene, served, np.zeros((0, 3), np.float32), reason)
    padding = -len(useful) % _BUCKET
    poses = np.pad(pose[useful], ((0, padding), (0, 0)))
    picks = np.pad(pick_time[np.ix_(useful, served)], ((0, padding), (0, 0)), constant_values=np.inf)
    drives = np.pad(first[useful], (0, padding), constant_values=np.inf)
    order, stops = jax.device_get(_solve(robot, poses, picks, drives, scene.table, config))
    return assemble_plan(scene, served[order], poses[stops], reason)


@jax.jit(static_argnames="config")
def _drives_from(
    robot: Robot, start: Float[Array, "3"], poses: Float[Array, "P 3"], table: Table, config: NavigationConfig
) -> Float[Array, " P"]:
    return navigation_time(robot, start, poses, table, config)


@jax.jit(static_argnames="config")
def _solve(
    robot: Robot,
    poses: Float[Array, "P 3"],
    pick_time: Float[Array, "P N"],
    first_drive: Float[Array, " P"],
    table: Table,
    config: NavigationConfig,
) -> tuple[Int[Array, " N"], Int[Array, " N"]]:
    """Objects in the order of the best plan, and the poses that they are picked from."""
    drive = navigation_time(robot, poses[:, None], poses, table, config)
    return best_sequence(pick_time, first_drive, drive)
