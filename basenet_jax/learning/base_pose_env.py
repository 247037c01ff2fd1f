"""Learning to park: one grasp, one base pose, one reward."""

import dataclasses

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax import struct
from basenet_jax.config import WorldConfig
from basenet_jax.learning._brax import Env, State
from basenet_jax.learning.config import BasePoseRewardConfig
from basenet_jax.planners.candidates import within_reach
from basenet_jax.policies.base_pose import ACTION_SIZE, OBSERVATION_SIZE, BaseFrame, base_pose_from_action, observe
from basenet_jax.robot.model import Robot
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.picking import ArmCheck, Reason, pick
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import base_collides, capsules_touch
from basenet_jax.world.generate import draw_problem
from basenet_jax.world.grasps import top_down

_GUESSES = 64  # of which nearly always one makes sense


@struct.dataclass
class Trial:
    """What parking at a base pose for a grasp comes to."""

    reward: Float[Array, "*batch"]
    success: Bool[Array, "*batch"]  # the object is picked
    collision: Bool[Array, "*batch"]  # of the base with the table
    navigation_time: Float[Array, "*batch"]  # s; 0 on collision
    pick_time: Float[Array, "*batch"]  # s; 0 without success


def try_base_pose(
    robot: Robot,
    room: Room,
    grasp: Float[Array, "*batch 4"],
    robot_pose: Float[Array, "*batch 3"],
    base_pose: Float[Array, "*batch 3"],
    reward: BasePoseRewardConfig,
    world: WorldConfig,
    arm_check: ArmCheck = capsules_touch,
) -> Trial:
    """The paper's reward: g1 on collision; on success g2 + g3 / (1 + t_nav) + g4 / (1 + t_grasp); else 0.

    An unreachable base pose counts as a collision.
    """
    picks = pick(robot, base_pose, top_down(grasp), room, world.pick, arm_check)
    drive = navigation_time(robot, robot_pose, base_pose, room, world.navigation)
    collision = (picks.reason == Reason.BASE_COLLIDES) | ~jnp.isfinite(drive)
    success = picks.feasible & ~collision
    drive = jnp.where(collision, 0.0, drive)
    gain = reward.success + reward.navigation / (1.0 + drive) + reward.grasping / (1.0 + picks.time)
    value = jnp.where(success, gain, 0.0) + jnp.where(collision, reward.collision, 0.0)
    return Trial(value, success, collision, drive, jnp.where(success, picks.time, 0.0))


class BasePoseEnv(Env):
    """A Brax environment of one-step episodes, with a fresh scene at each reset.

    Observations are `policies.base_pose.observe`'s, actions `base_pose_from_action`'s. An episode ends with its only
    step (`done` is 1), so critics never bootstrap. Brax's auto-reset wrapper would repeat an environment's first
    scene for ever; reset anew with fresh keys instead.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        frame: BaseFrame = "object",
        own_class_share: float = 0.0,
        reward: BasePoseRewardConfig = BasePoseRewardConfig(),
        world: WorldConfig = WorldConfig(),
        backend: str = "kernels",
    ):
        """Makes the environment.

        Args:
            robot: the robot.
            frame: in which base poses are predicted.
            own_class_share: share of objects with random size and grasp.
            reward: the reward's weights.
            world: table, navigation, pick cycle.
            backend: of the arm's contact checks: "kernels", or "mjx" (slow on CPUs).

        Raises:
            ValueError: unknown backend.
        """
        self.robot, self.own_class_share = robot, own_class_share
        self.frame: BaseFrame = frame
        self.reward, self.world = reward, world
        self.room = Room.from_config(world.table)
        self._backend, self.arm_check = backend, _arm_check(backend, robot, world)

    def reset(self, rng: Array) -> State:
        """A fresh problem: a grasp and where the robot is."""
        grasp, robot_pose = draw_problem(
            rng, self.robot, self.room, own_class_share=self.own_class_share, config=self.world.scene
        )
        zero = jnp.zeros(())
        metrics: dict[str, Array] = dict.fromkeys(("success", "collision", "navigation_time", "pick_time"), zero)
        info = {"grasp": grasp, "robot_pose": robot_pose, "truncation": zero}
        return State(None, observe(grasp, robot_pose), zero, zero, metrics, info)

    def step(self, state: State, action: Array) -> State:
        """Parks the base and tries the pick; the only step of the episode. Takes batches too, without vmap."""
        trial = self.park(state, base_pose_from_action(action, state.info["grasp"], self.frame))
        measured = {
            "success": trial.success,
            "collision": trial.collision,
            "navigation_time": trial.navigation_time,
            "pick_time": trial.pick_time,
        }
        metrics = {**state.metrics, **{name: value.astype(trial.reward.dtype) for name, value in measured.items()}}
        return dataclasses.replace(state, reward=trial.reward, done=jnp.ones_like(trial.reward), metrics=metrics)

    def guess(self, state: State, key: Array) -> Float[Array, "*batch action"]:
        """A random action that makes sense: its base is clear of the table, and the grasp within the arm's sphere.

        Of uniformly random actions 3.5 in a hundred succeed (`ur5e_mobile`; `panda_mobile`: 1.6), of these about 30.

        Args:
            state: of a batch of episodes.
            key: consumed.

        Returns:
            The first of many that makes sense; where none does, the last one.
        """
        grasp = state.info["grasp"]
        actions = jax.random.uniform(key, (_GUESSES, *grasp.shape[:-1], ACTION_SIZE), minval=-1.0, maxval=1.0)
        base_pose = base_pose_from_action(actions, grasp, self.frame)
        pick = self.world.pick
        clear = ~base_collides(self.robot, base_pose, self.room, pick.base_clearance_m, pick.touching_m)
        sensible = (clear & within_reach(self.robot, base_pose, grasp[..., :3])).at[-1].set(True)
        first = jnp.argmax(sensible, axis=0)
        return jnp.take_along_axis(actions, first[None, ..., None], axis=0)[0]

    def park(self, state: State, base_pose: Float[Array, "*batch 3"]) -> Trial:
        """What parking at a base pose comes to in an episode."""
        grasp, robot_pose = state.info["grasp"], state.info["robot_pose"]
        return try_base_pose(
            self.robot, self.room, grasp, robot_pose, base_pose, self.reward, self.world, self.arm_check
        )

    @property
    def observation_size(self) -> int:
        """Length of an observation."""
        return OBSERVATION_SIZE

    @property
    def action_size(self) -> int:
        """Length of an action."""
        return ACTION_SIZE

    @property
    def backend(self) -> str:
        """What checks contacts."""
        return self._backend


def _arm_check(backend: str, robot: Robot, world: WorldConfig) -> ArmCheck:
    if backend == "kernels":
        return capsules_touch
    if backend == "mjx":
        from basenet_jax.world import mjx  # slow to import, and wanted only here

        return mjx.arm_touches
    raise ValueError(f"backend: found {backend!r}, allowed are 'kernels' and 'mjx'")
