"""The layered learning of the paper: the base-pose policy first, then the grasp sequence with it frozen."""

from typing import Any, Literal

import jax

from basenet_jax.config import TrainConfig
from basenet_jax.learning.base_pose_env import BasePoseEnv
from basenet_jax.learning.progress import Reporter
from basenet_jax.learning.reinforce import Reinforce
from basenet_jax.learning.run_directory import RunDirectory
from basenet_jax.learning.sac import Sac
from basenet_jax.learning.training_loop import run_intervals
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.trained import Weights
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.weights_file import load_weights, save_weights

Layer = Literal["base-pose", "sequence", "all"]

BASE_POSE_WEIGHTS = "base_pose.weights"
WEIGHTS = "basenet.weights"


class Training:
    """One training: its configuration, and the learners made from it."""

    def __init__(self, config: TrainConfig):
        """Loads the robot; compiles nothing yet."""
        self.config = config
        self.robot: Robot = jax.device_put(load_robot(config.robot))
        self.base_pose_key, self.sequence_key = jax.random.split(jax.random.key(config.seed))
        env = BasePoseEnv(
            self.robot,
            frame=config.sac.frame,
            own_class_share=config.sac.own_class_share,
            reward=config.sac.reward,
            world=config.world,
        )
        self.sac = Sac(env, config.sac)

    def reinforce(self, base_pose: BasePosePolicy) -> Reinforce:
        """The sequence learner for a frozen base-pose policy."""
        return Reinforce(self.robot, base_pose, self.config.reinforce, self.config.world)

    def train(self, run: RunDirectory, reporter: Reporter, *, layer: Layer = "all", resume: bool = False) -> Weights:
        """Trains the layers asked for, and writes their weights into the run directory.

        With `layer="sequence"` the base-pose weights of the run directory are used.

        Raises:
            ValueError: there are no such weights.
            CheckpointError, Interrupted, TrainingDiverged: see `run_intervals`.
        """
        base_pose = self._base_pose(run, reporter, layer, resume)
        learner = self.reinforce(base_pose)
        if layer == "base-pose":
            return Weights(base_pose, None)
        config = self.config.reinforce
        state = run_intervals(
            name="sequence",
            init=learner.init,
            interval=jax.jit(learner.interval, donate_argnums=0),
            intervals=config.intervals,
            run=run,
            reporter=reporter,
            key=self.sequence_key,
            resume=resume,
            unit="episodes",
            work=config.updates_per_interval * config.episodes_per_update,
            figures=("navigation_time", "nearest_navigation_time", "driven_to"),
        )
        weights = Weights(base_pose, state.params)
        save_weights(run.weights / WEIGHTS, weights, self._metadata())
        return weights

    def _base_pose(self, run: RunDirectory, reporter: Reporter, layer: Layer, resume: bool) -> BasePosePolicy:
        file = run.weights / BASE_POSE_WEIGHTS
        if layer == "sequence" or (resume and file.exists()):
            policy, metadata = load_weights(
                file, jax.eval_shape(lambda key: self.sac.policy(self.sac.init(key)), jax.random.key(0))
            )
            if metadata.get("config") == run.config_hash:
                return policy
            if layer == "sequence":
                raise ValueError(f"{file}: made with another configuration than this run's")
        config = self.config.sac
        state = run_intervals(
            name="base-pose",
            init=self.sac.init,
            interval=jax.jit(self.sac.interval, donate_argnums=0),
            intervals=config.intervals,
            run=run,
            reporter=reporter,
            key=self.base_pose_key,
            resume=resume,
            unit="episodes",
            work=config.iterations_per_interval * config.episodes_per_iteration,
            figures=("success", "collision", "navigation_time", "pick_time"),
        )
        policy = self.sac.policy(state)
        save_weights(file, policy, self._metadata() | {"config": run.config_hash})
        return policy

    def _metadata(self) -> dict[str, Any]:
        config = self.config
        return {
            "preset": config.preset,
            "seed": config.seed,
            "objects": config.reinforce.objects,
            "robot": config.robot,
        }
