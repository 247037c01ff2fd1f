"""Every number of the learners, and the presets, in frozen dataclasses.

Sources: the BaSeNet paper (arXiv 2406.08653) where it says so; the rest are choices of this project.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from basenet_jax.config import MAX_OBJECTS, WorldConfig
from basenet_jax.settings import Count, Finite, Natural, NotNegative, Positive, Range, Seed, Settings, Share

_Objects = Annotated[int, Range(1, MAX_OBJECTS)]
_Rate = Annotated[float, Range(0, 1, above=True)]


@dataclass(frozen=True)
class BasePoseRewardConfig(Settings):
    """The base-pose policy's reward, the paper's gamma 1 to 4 divided by 1e6.

    The division changes neither the optimal policy nor, with the temperature learned, the trade-off with entropy;
    it keeps the critics' values near 1.
    """

    collision: Finite = -0.2
    """For a base that collides."""
    success: Finite = 1.0
    """For an object that is grasped."""
    navigation: Finite = 0.5
    """For a short drive."""
    grasping: Finite = 0.5
    """For a short pick cycle."""


@dataclass(frozen=True)
class SacConfig(Settings):
    """Soft Actor-Critic for the base pose; one iteration is a batch of fresh episodes and some updates."""

    frame: Literal["object", "table"] = "object"
    """In which base poses are predicted."""
    own_class_share: Share = 0.5
    """Of training objects with random size and grasp."""
    hidden: tuple[Count, ...] = (256, 256, 256)
    """Widths of the hidden layers (paper)."""
    learning_rate: _Rate = 3e-4
    """Of all networks (paper)."""
    final_learning_rate_share: Share = 0.1
    """Of the rate, reached at the last update, on a cosine."""
    reward: BasePoseRewardConfig = field(default_factory=BasePoseRewardConfig)
    reward_scale: Positive = 10.0
    """Of rewards as the critics see them."""
    target_entropy: Finite = -4.0
    """In nats, of the four action components."""
    final_target_entropy: Finite = -8.0
    """Reached at the last iteration, in a straight line."""
    initial_alpha: Positive = 0.1
    """The temperature at the start."""
    guessed_iterations: Natural = 0
    """The first ones, whose episodes park where the arm might reach: see BasePoseEnv.guess."""
    episodes_per_iteration: Count = 512
    """Drawn fresh in each iteration."""
    updates_per_iteration: Count = 8
    """Gradient steps of each network in an iteration."""
    batch_size: Count = 512
    """Of an update, from the replay buffer."""
    replay_size: Count = 262_144
    """Episodes that the replay buffer holds."""
    iterations_per_interval: Count = 50
    """Between two evaluations."""
    intervals: Count = 20
    """How long to train."""
    evaluation_problems: Count = 4_096
    """Fixed ones, planned after every interval."""
    evaluation_seed: Seed = 1_000_003
    """Of the fixed problems."""

    def _check_together(self) -> None:
        self._require(bool(self.hidden), "hidden", "are one width and more")
        enough = self.replay_size >= self.episodes_per_iteration
        self._require(enough, "replay_size", f"are episodes_per_iteration, {self.episodes_per_iteration}, and more")

    @property
    def batches(self) -> dict[str, int]:
        """Sizes of what several devices share."""
        return _settings(self, "episodes_per_iteration", "batch_size", "evaluation_problems")


@dataclass(frozen=True)
class ReinforceConfig(Settings):
    """REINFORCE with a greedy-rollout baseline for the grasp sequence."""

    objects: _Objects = 10
    """Training draws 1 to this many."""
    own_class_share: Share = 0.25
    """Of training objects with random size and grasp."""
    features: Count = 64
    """Of every node (paper)."""
    layers: Count = 5
    """Of graph attention (paper)."""
    attention: bool = True
    """Attention coefficients; without, a plain sum over the other objects."""
    baseline: bool = True
    """Subtract the time of the baseline's greedy rollout."""
    learning_rate: _Rate = 1e-3
    """Of the network (paper)."""
    final_learning_rate_share: Share = 0.1
    """Of the rate, reached at the last update, on a cosine."""
    navigation_weight: Positive = 1e3
    """The paper's gamma 5."""
    failure_time_s: NotNegative = 15.0
    """Counted for every object not driven to."""
    episodes_per_update: Count = 512
    """Sampled for each gradient step."""
    updates_per_interval: Count = 50
    """Between two evaluations."""
    intervals: Count = 20
    """How long to train."""
    test_episodes: Annotated[int, Range(2, 1e9)] = 2_048
    """For the paired t-test of the baseline."""
    significance: Share = 0.05
    """Of that test."""
    evaluation_scenes: Count = 1_024
    """Fixed ones, planned after every interval."""
    evaluation_seed: Seed = 1_000_033
    """Of the fixed scenes."""

    @property
    def batches(self) -> dict[str, int]:
        """Sizes of what several devices share."""
        return _settings(self, "episodes_per_update", "test_episodes", "evaluation_scenes")


@dataclass(frozen=True)
class StopLearningConfig(Settings):
    """Imitation, then REINFORCE, of the stop policy."""

    objects: _Objects = 15
    """Training draws 1 to this many."""
    own_class_share: Share = 0.25
    """Of training objects with random size and grasp."""
    features: Count = 48
    """Of every node."""
    layers: Count = 2
    """Of graph attention."""
    library_objects: Count = 2_048
    """Whose picks are timed once for all examples; each once more turned by pi."""
    examples: Count = 8_192
    """Searched plans to imitate, each also turned by pi."""
    search_iterations: Count = 60
    """Of the search for each example."""
    imitation_intervals: Natural = 30
    """The first so many; the others are REINFORCE's."""
    imitations_per_update: Count = 128
    """Examples of a gradient step."""
    problems_per_update: Count = 16
    """Of a gradient step of REINFORCE."""
    samples: Annotated[int, Range(2, 1e9)] = 8
    """Episodes of each problem, whose mean is each other's baseline."""
    learning_rate: _Rate = 2e-3
    """Of the network."""
    final_learning_rate_share: Share = 0.02
    """Of the rate, reached at the last update, on a cosine."""
    largest_gradient: Positive = 1.0
    """Longer ones are shortened to this norm."""
    updates_per_interval: Count = 50
    """Between two evaluations."""
    intervals: Count = 36
    """How long to train."""
    evaluation_problems: Count = 256
    """Fixed ones, planned after every interval."""
    evaluation_seed: Seed = 1_000_037
    """Of the fixed problems."""

    @property
    def batches(self) -> dict[str, int]:
        """Sizes of what several devices share."""
        return _settings(self, "examples", "imitations_per_update", "problems_per_update", "evaluation_problems")


Preset = Literal["quick", "default", "paper"]


@dataclass(frozen=True)
class TrainConfig(Settings):
    """Everything that determines a training's result."""

    preset: Preset = "default"
    seed: Seed = 0
    robot: str = "ur5e_mobile"  # its name
    robot_digest: str | None = None  # of one that isn't packaged: a run goes on only with the robot it began with
    world: WorldConfig = field(default_factory=WorldConfig)
    sac: SacConfig = field(default_factory=SacConfig)
    reinforce: ReinforceConfig = field(default_factory=ReinforceConfig)
    stops: StopLearningConfig = field(default_factory=StopLearningConfig)
    evaluation_objects: tuple[_Objects, ...] = (5, 10)
    evaluation_scenes: Count = 50

    def _check_together(self) -> None:
        self._require(bool(self.evaluation_objects), "evaluation_objects", "are one number and more")


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


@dataclass(frozen=True)
class AblationConfig(Settings):
    """Everything that determines an ablation's result, but the base-pose policy under the sequence's studies."""

    preset: Preset = "quick"
    seed: Seed = 0
    seeds: Annotated[int, Range(1, 32)] = 5  # trained side by side
    robot: str = "ur5e_mobile"
    world: WorldConfig = field(default_factory=WorldConfig)
    sac: SacConfig = field(default_factory=SacConfig)
    reinforce: ReinforceConfig = field(default_factory=ReinforceConfig)
    base_pose_weights: str = ""  # SHA-256 of the file


def make_ablation(preset: Preset, *, objects: int, seed: int, seeds: int, base_pose_weights: str) -> AblationConfig:
    """The configuration of a preset, see `make_preset`, but base poses are learned at the paper's rate, from chance."""
    config, papers = make_preset(preset, objects=objects, seed=seed), SacConfig()
    sac = dataclasses.replace(config.sac, learning_rate=papers.learning_rate, guessed_iterations=0)
    return AblationConfig(preset, seed, seeds, config.robot, config.world, sac, config.reinforce, base_pose_weights)


def _settings(config: Any, *names: str) -> dict[str, int]:
    return {name: getattr(config, name) for name in names}
