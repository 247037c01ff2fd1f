"""What each planner can be told: its own options, which other planners don't have."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from basenet_jax.config import AlignedConfig, RefinementConfig
from basenet_jax.settings import Count, NotNegative, Positive, Range, Settings


@dataclass(frozen=True)
class GreedyStopsOptions(Settings):
    """Of greedy-stops."""

    seconds_per_object: Positive = 4.0
    """What serving one more object at a stop is worth; tuned on scenes apart (see benchmarks)."""


@dataclass(frozen=True)
class RefinedOptions(Settings):
    """Of refined."""

    budget_s: NotNegative = 0.0
    """How long to go on for a better plan; the first one is always finished."""
    aligned: AlignedConfig = field(default_factory=AlignedConfig)
    """The proposed stops."""
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    """How they are moved."""


@dataclass(frozen=True)
class LearnedOptions(Settings):
    """Of basenet-paper."""

    weights: Path | None = None
    """File of the policies, as training writes it; None: the one shipped with the package."""
    devices: Count | None = None
    """So many share the scenes of a batch; None: all of this process."""


@dataclass(frozen=True)
class StopsOptions(LearnedOptions):
    """Of basenet."""

    aligned: AlignedConfig = field(default_factory=AlignedConfig)
    """The stops to choose from."""


@dataclass(frozen=True)
class SampleOptions(StopsOptions):
    """Of basenet-sample."""

    samples: Annotated[int, Range(1, 16_384)] = 256
    """Rollouts that are drawn beside the greedy one; the best is taken."""
