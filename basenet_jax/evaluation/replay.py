"""The second opinion: executed picks replayed in MuJoCo, in float64 and with MuJoCo's own kinematics and contacts.

The judge (`task.plan.execute`) is compiled kernels in float32. Here every pick that it found feasible is tried again
by other means; a pick that MuJoCo finds impossible is a disagreement, and counts as not grasped.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import dataclasses
from collections.abc import Hashable

import jax
import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import TOOL_SITE
from basenet_jax.task.arm_solutions import heights
from basenet_jax.task.pick_search import Reason, Rules, checked_fractions
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.boxes import Room, fingerprint
from basenet_jax.world.grasps import Grasps
from basenet_jax.world.mujoco_scene import ROBOT, MujocoChecker, state_addresses
from basenet_jax.world.scene import Scene


class PickReplay:
    """Replays picks in one room: rules 1, 2 and 4 as MuJoCo sees them, and 5 to 7 where they hold.

    Args:
        robot: the robot.
        room: one concrete room.
        config: heights, clearances and tolerances of the pick cycle.
        scene: unbatched and concrete, whose objects are in the room; None: rules 5 and 6 aren't looked at.
    """

    def __init__(self, robot: Robot, room: Room, config: PickConfig = PickConfig(), *, scene: Scene | None = None):
        self._rules = Rules.of(config, room)
        self._checker = MujocoChecker(robot, room, config, scene=scene)
        self._config = config
        self._home, self._stow = np.asarray(robot.home, float), np.asarray(robot.stow, float)
        self._addresses = state_addresses(robot, self._checker.model)
        self._joint_names = robot.joint_names
        self._site = self._checker.model.site(ROBOT + TOOL_SITE).id

    def broken_rule(
        self,
        base_pose: Float[np.ndarray, "3"],
        joints: Float[np.ndarray, "waypoints dof"],
        grasp: Grasps,
        standing: Bool[np.ndarray, " M"] | None = None,
    ) -> Reason:
        """The first rule that a pick breaks in MuJoCo; `Reason.NONE` where it breaks none.

        Args:
            base_pose: of the base, (x, y, heading) in W.
            joints: rad, at pre-grasp, the waypoints in between, and grasp.
            grasp: the one in W that it is picked by, without an axis.
            standing: which other objects of the scene still stand; needed where there is a scene.
        """
        joints = np.asarray(joints, float)
        if self._checker.base_touches(np.asarray(base_pose, float)[None])[0]:
            return Reason.BASE_COLLIDES
        if not self._reaches(base_pose, joints, grasp):
            return Reason.OUT_OF_REACH
        states = self._swept_states(joints)
        poses = np.broadcast_to(np.asarray(base_pose, float), (len(states), 3))
        if standing is not None:
            self._checker.stand(standing)
        _, arm, objects, itself = np.min(self._checker.distances(poses, states), axis=0) <= 0.0
        broken = (
            (Reason.ARM_COLLIDES, arm),
            (Reason.OBJECT_IN_THE_WAY, self._rules.object_in_the_way and objects),
            (Reason.ARM_HITS_ITSELF, self._rules.arm_hits_itself and itself),
            (Reason.NEAR_SINGULAR, self._rules.near_singular and self._is_near_singular(base_pose, joints)),
        )
        return next((rule for rule, is_broken in broken if is_broken), Reason.NONE)

    def _is_near_singular(self, base_pose: np.ndarray, joints: np.ndarray) -> bool:
        """By the Jacobian of MuJoCo, at all waypoints."""
        model, data = self._checker.model, self._checker.data
        columns = model.jnt_dofadr[[model.joint(ROBOT + name).id for name in self._joint_names]]
        least = np.inf
        for state in joints:
            data.qpos[self._addresses] = [*base_pose, *state]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            jacobian = np.zeros((6, model.nv))
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._site)
            least = min(least, np.linalg.svd(jacobian[:, columns], compute_uv=False)[-1])
        return bool(least < self._config.least_singular_value)

    def _reaches(self, base_pose: np.ndarray, joints: np.ndarray, grasp: Grasps) -> bool:
        """Whether tool0 is where it should be at every waypoint, held in one of the allowed ways throughout."""
        position, rotation = self._tool_poses(base_pose, joints)
        held = Rotation.from_euler("ZYX", np.asarray(grasp.pose, float)[:2:-1]).as_matrix()
        back = heights(self._config)
        if grasp.approach > 0:
            back = back * (float(grasp.approach) / back[0])
        target = np.asarray(grasp.pose[:3], float) - np.outer(back, held[:, 2])
        near = np.linalg.norm(position - target, axis=1) <= self._config.position_tolerance_m
        turns = (0.0, np.pi) if self._config.gripper_symmetric and grasp.symmetric else (0.0,)
        ways = [held @ Rotation.from_euler("Z", turn).as_matrix() for turn in turns]
        turned = [_angles(rotation, way).max() <= self._config.orientation_tolerance_rad for way in ways]
        return bool(near.all() and any(turned))

    def _tool_poses(self, base_pose: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """tool0's positions (m) and rotation matrices in W."""
        model, data = self._checker.model, self._checker.data
        position, rotation = np.empty((len(joints), 3)), np.empty((len(joints), 3, 3))
        for index, state in enumerate(joints):
            data.qpos[self._addresses] = [*base_pose, *state]
            mujoco.mj_kinematics(model, data)
            position[index] = data.site_xpos[self._site]
            rotation[index] = data.site_xmat[self._site].reshape(3, 3)
        return position, rotation

    def _swept_states(self, joints: np.ndarray) -> np.ndarray:
        """Rule 4's joint states: the waypoints and the points inside the moves home to pre-grasp to stow."""
        fractions = checked_fractions(self._config)[:, None]
        coming = self._home + fractions * (joints[0] - self._home)
        going = joints[0] + fractions * (self._stow - joints[0])
        return np.concatenate([joints, coming, going])


def replay(
    robot: Robot, scenes: Scene, plans: Plan, outcomes: Outcome, config: WorldConfig = WorldConfig()
) -> Int[np.ndarray, "B M"]:
    """Replays every executed, feasible pick of a batch of plans; about 0.5 ms each.

    Args:
        robot: the robot.
        scenes: a batch of B scenes.
        plans: of these scenes.
        outcomes: of executing the plans.
        config: of the pick cycle.

    Returns:
        For every step a `Reason`: the first rule that MuJoCo finds broken where the judge found none; else `NONE`.
    """
    scenes, plans, outcomes = jax.device_get((scenes, plans, outcomes))
    grasps = jax.device_get(scenes.grasps)
    replays: dict[Hashable, PickReplay] = {}
    broken = np.full(outcomes.feasible.shape, Reason.NONE, np.int32)
    for row, step in np.argwhere(outcomes.feasible):
        scene = jax.tree.map(lambda x, row=row: x[row], scenes)
        rules = Rules.of(config.pick, scene.room)
        cluttered = rules.object_in_the_way or rules.arm_hits_itself
        key = (fingerprint(scene.room), row if cluttered else None)
        if key not in replays:
            replays[key] = PickReplay(robot, scene.room, config.pick, scene=scene if cluttered else None)
        slot = plans.object_index[row, step]
        pose, joints = np.asarray(plans.base_pose[row, step]), np.asarray(outcomes.joints[row, step])
        standing = None
        if cluttered:
            before = outcomes.feasible[row, : step + 1]  # and this one
            standing = np.array(scene.mask)
            standing[plans.object_index[row, : step + 1][before]] = False
        grasp = grasps[row, slot, outcomes.grasp[row, step]]
        broken[row, step] = replays[key].broken_rule(pose, joints, grasp, standing)
    return broken


def confirmed(outcomes: Outcome, broken: Int[np.ndarray, "B M"]) -> Outcome:
    """The outcomes with every pick that `replay` found impossible counted as not grasped; its pick time is 0."""
    agreed, least = np.asarray(broken) == Reason.NONE, outcomes.least_singular_value
    return dataclasses.replace(
        outcomes,
        feasible=outcomes.feasible & agreed,
        reason=np.where(agreed, outcomes.reason, broken),
        pick_time=np.where(agreed, outcomes.pick_time, 0.0),
        least_singular_value=None if least is None else np.where(agreed, least, 0.0),
    )


def _angles(rotation: Float[np.ndarray, "N 3 3"], target: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " N"]:
    """Angles (rad) between rotations and one of them."""
    # |A - B|_F = 2 sqrt(2) sin(angle / 2), which unlike the trace keeps its digits at small angles.
    chord = np.linalg.norm(rotation - target, axis=(1, 2)) / (2 * np.sqrt(2))
    return 2 * np.arcsin(np.minimum(chord, 1.0))
