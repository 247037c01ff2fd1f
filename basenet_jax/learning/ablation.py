"""The paper's ablations: each choice of its design with and without, several seeds in one vectorised program."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Literal

import jax
from jax import Array

from basenet_jax.learning.base_pose_env import BasePoseEnv
from basenet_jax.learning.config import AblationConfig
from basenet_jax.learning.reinforce import Reinforce
from basenet_jax.learning.run_directory import RunDirectory
from basenet_jax.learning.sac import Sac
from basenet_jax.learning.training_loop import run_intervals
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.progress import Reporter
from basenet_jax.robot.model import Robot

Study = Literal["base-frame", "baseline", "attention"]
STUDIES: tuple[Study, ...] = ("base-frame", "baseline", "attention")

# By study, its variants: the paper's choice first, then what it is compared with.
VARIANTS: dict[Study, tuple[str, str]] = {
    "base-frame": ("object frame", "table frame"),
    "baseline": ("greedy-rollout baseline", "no baseline"),
    "attention": ("attention coefficients", "plain sum"),
}
PAPERS_SEQUENCE = "paper's sequence"  # the run that is the paper's choice of both studies of the sequence policy


class Ablation:
    """Trains variants of the learners, all seeds of one variant in one program."""

    def __init__(self, config: AblationConfig, robot: Robot, base_pose: BasePosePolicy):
        """Compiles nothing yet.

        Args:
            config: of the variants, but for what is varied.
            robot: the robot.
            base_pose: under the sequence policies.
        """
        self.config, self._robot, self._base_pose = config, robot, base_pose

    def train(
        self, studies: Sequence[Study], run: RunDirectory, reporter: Reporter, *, resume: bool = False
    ) -> dict[str, Any]:
        """Trains the variants of some studies, each once: the two studies of the sequence policy share the paper's.

        Returns:
            By layer (see `layer_of`), the learner's last states with the seeds along the leading axis. The curves are
            in the run directory: `metrics.jsonl` has a figure per seed, `NAME/SEED`.

        Raises:
            CheckpointError, Interrupted, TrainingDiverged: see `run_intervals`.
        """
        learners = {
            layer_of(study, variant): self._learner(study, variant) for study in studies for variant in VARIANTS[study]
        }
        return {layer: self._train(layer, learner, run, reporter, resume) for layer, learner in learners.items()}

    def sac(self, variant: str) -> Sac:
        """The learner of a variant of the study of frames."""
        config = dataclasses.replace(self.config.sac, frame="object" if variant == "object frame" else "table")
        env = BasePoseEnv(
            self._robot,
            frame=config.frame,
            own_class_share=config.own_class_share,
            reward=config.reward,
            world=self.config.world,
        )
        return Sac(env, config)

    def _learner(self, study: Study, variant: str) -> Sac | Reinforce:
        if study == "base-frame":
            return self.sac(variant)
        config = self.config.reinforce
        if variant == "no baseline":
            config = dataclasses.replace(config, baseline=False)
        elif variant == "plain sum":
            config = dataclasses.replace(config, attention=False)
        return Reinforce(self._robot, self._base_pose, config, self.config.world)

    def _train(self, layer: str, learner: Any, run: RunDirectory, reporter: Reporter, resume: bool) -> Any:
        several = Several(learner, self.config.seeds)
        return run_intervals(
            name=layer,
            init=several.init,
            interval=jax.jit(several.interval, donate_argnums=0),
            intervals=learner.config.intervals,
            run=run,
            reporter=reporter,
            key=jax.random.key(self.config.seed),
            resume=resume,
            figures=[f"{name}/0" for name in ("success", "navigation_time")],
        )


def layer_of(study: Study, variant: str) -> str:
    """The name in the run directory of a variant's training."""
    name = variant if study == "base-frame" or variant != VARIANTS[study][0] else PAPERS_SEQUENCE
    return name.replace(" ", "-").replace("'", "")


class Several:
    """A learner of several seeds at once: its `init` and `interval` under vmap, and metrics named `NAME/SEED`."""

    def __init__(self, learner: Any, seeds: int):
        self._init: Callable[[Array], Any] = jax.vmap(learner.init)
        self._interval: Callable[[Any], tuple[Any, dict[str, Array]]] = jax.vmap(learner.interval)
        self._seeds = seeds

    def init(self, key: Array) -> Any:
        """The first states, each of a key of its own; the key is consumed."""
        return self._init(jax.random.split(key, self._seeds))

    def interval(self, states: Any) -> tuple[Any, dict[str, Array]]:
        """One interval of all."""
        states, metrics = self._interval(states)
        flat = {f"{name}/{seed}": values[seed] for name, values in metrics.items() for seed in range(self._seeds)}
        return states, flat
