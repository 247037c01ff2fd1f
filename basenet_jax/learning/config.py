"""Every number of the learners, and the presets, in frozen dataclasses.

Sources: the BaSeNet paper (arXiv 2406.08653) where it says so; the rest are choices of this project.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from basenet_jax.config import WorldConfig


@dataclass(frozen=True)
class BasePoseRewardConfig:
    """The base-pose policy's reward, the paper's gamma 1 to 4 divided by 1e6.

    The division changes neither the optimal policy nor, with the temperature learned, the trade-off with entropy;
    it keeps the critics' values near 1.
    """

    collision: float = -0.2
    success: float = 1.0
    navigation: float = 0.5
    grasping: float = 0.5


@dataclass(frozen=True)
class SacConfig:
    """Soft Actor-Critic for the base pose; one iteration is a batch of fresh episodes and some updates."""

    frame: Literal["object", "table"] = "object"
    own_class_share: float = 0.5  # of training objects with random size and grasp
    hidden: tuple[int, ...] = (256, 256, 256)  # paper
    learning_rate: float = 3e-4  # paper
    final_learning_rate_share: float = 0.1  # reached at the last update, on a cosine
    reward: BasePoseRewardConfig = field(default_factory=BasePoseRewardConfig)
    reward_scale: float = 10.0
    target_entropy: float = -4.0  # nats, of the four action components
    final_target_entropy: float = -8.0  # reached at the last iteration, in a straight line
    initial_alpha: float = 0.1
    guessed_iterations: int = 0  # the first ones, whose episodes park where the arm might reach: see BasePoseEnv.guess
    episodes_per_iteration: int = 512
    updates_per_iteration: int = 8
    batch_size: int = 512
    replay_size: int = 262_144
    iterations_per_interval: int = 50
    intervals: int = 20
    evaluation_problems: int = 4_096
    evaluation_seed: int = 1_000_003  # of the fixed problems

    @property
    def batches(self) -> dict[str, int]:
        """Sizes of what several devices share."""
        return _settings(self, "episodes_per_iteration", "batch_size", "evaluation_problems")


@dataclass(frozen=True)
class ReinforceConfig:
    """REINFORCE with a greedy-rollout baseline for the grasp sequence."""

    objects: int = 10  # training draws 1 to this many
    own_class_share: float = 0.25  # of training objects with random size and grasp
    features: int = 64  # paper
    layers: int = 5  # paper
    attention: bool = True
    baseline: bool = True
    learning_rate: float = 1e-3  # paper
    final_learning_rate_share: float = 0.1  # reached at the last update, on a cosine
    navigation_weight: float = 1e3  # the paper's gamma 5
    failure_time_s: float = 15.0  # counted for every object not driven to
    episodes_per_update: int = 512
    updates_per_interval: int = 50
    intervals: int = 20
    test_episodes: int = 2_048  # for the paired t-test of the baseline
    significance: float = 0.05
    evaluation_scenes: int = 1_024
    evaluation_seed: int = 1_000_033

    @property
    def batches(self) -> dict[str, int]:
        """Sizes of what several devices share."""
        return _settings(self, "episodes_per_update", "test_episodes", "evaluation_scenes")


@dataclass(frozen=True)
class StopLearningConfig:
    """Imitation, then REINFORCE, of the stop policy."""

    objects: int = 15  # training draws 1 to this many
    own_class_share: float = 0.25  # of training objects with random size and grasp
    features: int = 48
    layers: int = 2
    library_objects: int = 2_048  # each once more turned by pi
    examples: int = 8_192  # searched plans to imitate, each also turned by pi
    search_iterations: int = 60
    imitation_intervals: int = 30  # the first so many
    imitations_per_update: int = 128
    problems_per_update: int = 16
    samples: int = 8  # episodes of each problem
    learning_rate: float = 2e-3
    final_learning_rate_share: float = 0.02  # reached at the last update, on a cosine
    largest_gradient: float = 1.0  # longer ones are shortened to this norm
    updates_per_interval: int = 50
    intervals: int = 36
    evaluation_problems: int = 256
    evaluation_seed: int = 1_000_037

    @property
    def batches(self) -> dict[str, int]:
        """Sizes of what several devices share."""
        return _settings(self, "examples", "imitations_per_update", "problems_per_update", "evaluation_problems")


Preset = Literal["quick", "default", "paper"]


@dataclass(frozen=True)
class TrainConfig:
    """Everything that determines a training's result."""

    preset: Preset = "default"
    seed: int = 0
    robot: str = "ur5e_mobile"  # its name
    robot_digest: str | None = None  # of one that isn't packaged: a run goes on only with the robot it began with
    world: WorldConfig = field(default_factory=WorldConfig)
    sac: SacConfig = field(default_factory=SacConfig)
    reinforce: ReinforceConfig = field(default_factory=ReinforceConfig)
    stops: StopLearningConfig = field(default_factory=StopLearningConfig)
    evaluation_objects: tuple[int, ...] = (5, 10)
    evaluation_scenes: int = 50


def make_preset(
    preset: Preset, *, objects: int, seed: int, robot: str = "ur5e_mobile", robot_digest: str | None = None
) -> TrainConfig:
    """The configuration of a preset.

    quick: all layers in a few minutes on two CPU cores; as few episodes have to do, its rate is higher than the paper's
    and the first of them park where the arm might reach (`SacConfig.guessed_iterations`).
    default: good policies in about 20 minutes there.
    paper: the paper's training distribution (its five classes only), networks, rewards and rates for its two layers.

    What differs from the paper even there. Forced by float32 and Brax: rewards are divided by 1e6 (the temperature is
    learned, so the trade-off with entropy is the same), and SAC's loop is built from Brax's parts. Left open by the
    paper and chosen here: numbers of episodes and updates, batch sizes, replay, the target entropy (-4, Brax's), the
    heading as a direction, observations relative to the grasp, GATv2 for the attention (Brody et al. 2021), objects of
    one episode from 1 to the number asked for. Of this world: drives go round the table and turn at both ends, contacts
    are closed-form kernels, and one policy sees the grasp pose instead of one policy for each class.

    Args:
        preset: its name.
        objects: training draws 1 to this many.
        seed: of everything random.
        robot: its name.
        robot_digest: see `TrainConfig`.
    """
    stops = StopLearningConfig(objects=objects)
    if preset == "quick":
        sac = SacConfig(intervals=12, guessed_iterations=25, learning_rate=1e-3)
        reinforce = ReinforceConfig(objects=objects, intervals=3, updates_per_interval=25)
        stops = dataclasses.replace(stops, library_objects=512, examples=1_024, imitation_intervals=5, intervals=5)
    elif preset == "default":
        sac, reinforce = SacConfig(intervals=100), ReinforceConfig(objects=objects, intervals=20)
    else:
        sac = SacConfig(own_class_share=0.0, final_learning_rate_share=1.0, final_target_entropy=-4.0, intervals=120)
        reinforce = ReinforceConfig(objects=objects, own_class_share=0.0, final_learning_rate_share=1.0)
    return TrainConfig(
        preset=preset, seed=seed, robot=robot, robot_digest=robot_digest, sac=sac, reinforce=reinforce, stops=stops
    )


def _settings(config: Any, *names: str) -> dict[str, int]:
    return {name: getattr(config, name) for name in names}
