"""A planner in 30 lines: drive to the nearest base pose that serves anything, pick all that it serves, and so on."""

import jax
import numpy as np
from jax import Array

from basenet_jax.planners.candidates import check_candidates, grid_poses
from basenet_jax.planners.protocol import PlannerSetup, assemble_plan
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene


class NearestStop:
    """Made once for a robot and a table; called for every scene."""

    def __init__(self, setup: PlannerSetup):
        self.robot, self.world = setup.robot, setup.world
        self.stops = grid_poses(setup.robot, setup.room, setup.grid, setup.world.pick)
        self.drive = jax.jit(navigation_time, static_argnames="config")

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """Orders the objects and says where to park for each; the judge says what that costs."""
        candidates = check_candidates(self.robot, scene, self.stops, world=self.world)  # every pose with every object
        serves, config = np.array(candidates.serves & scene.mask), self.world.navigation
        pose, order, poses = scene.robot_start, [], []
        while serves.any():
            drives = np.asarray(self.drive(self.robot, pose, candidates.base_pose, scene.room, config=config))
            drives = np.where(serves.any(axis=1), drives, np.inf)
            nearest = np.argmin(drives)
            if np.isinf(drives[nearest]):  # what is left can't be driven to
                break
            pose = candidates.base_pose[nearest]
            served = np.flatnonzero(serves[nearest])
            order += served.tolist()
            poses += [np.asarray(pose)] * len(served)
            serves[:, served] = False
        reason = np.where(serves.any(axis=0), Reason.UNREACHABLE, candidates.reason)
        return assemble_plan(scene, np.array(order, int), np.reshape(poses, (-1, 3)), reason)
