"""What the commands' options have in common: the world, planners' options, and configuration files.

What is given on the command line comes before what a file says, and that before the defaults.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

import tyro

from basenet_jax.config import (
    MAX_OBJECTS,
    AlignedConfig,
    GridConfig,
    NavigationConfig,
    PickConfig,
    RefinementConfig,
    SceneConfig,
    TableConfig,
    UncertaintyConfig,
    WorldConfig,
)
from basenet_jax.documents.config_file import load_config, overlay, read_config
from basenet_jax.learning.config import Preset, TrainConfig
from basenet_jax.settings import Settings

T = TypeVar("T")
C = TypeVar("C", bound=Settings)


@dataclass(frozen=True)
class DrivesAndPicks:
    """Of the world what a scene file leaves open: how long drives and picks take, and which are possible."""

    navigation: NavigationConfig = field(default_factory=NavigationConfig)
    pick: PickConfig = field(default_factory=PickConfig)


@dataclass(frozen=True)
class TablesAndScenes:
    """Of the world what random scenes are drawn from."""

    table: TableConfig = field(default_factory=TableConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)


@dataclass(frozen=True, kw_only=True)
class PlannerArguments:
    """Options of planners; those that aren't given are at the planner's own defaults."""

    weights: Path | None = None
    """Of basenet, basenet-sample and basenet-paper: the policies, as training writes them. Default: those packaged."""
    budget: float | None = None
    """Of refined: seconds that it goes on for a better plan; its first one it always finishes. Default: 0."""
    samples: int | None = None
    """Of basenet-sample: rollouts that it draws and takes the best of. Default: 256."""
    seconds_per_object: float | None = None
    """Of greedy-stops: what serving one more object at a stop is worth. Default: 4."""
    grid: GridConfig = field(default_factory=GridConfig)
    """The grid of base poses that the classical planners choose from (paper: 10 cm, 45 degrees); others fall back on
    it."""
    aligned: AlignedConfig = field(default_factory=AlignedConfig)
    """Of refined, basenet and basenet-sample: stops in line with the table's sides."""
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    """Of refined: rounds of continuous refinement, and the alternatives drawn for every stop in each."""

    def given_options(self) -> dict[str, Any]:
        """Planners' own options that differ from the defaults, by their names in Python."""
        values = {
            "weights": self.weights,
            "budget_s": self.budget,
            "samples": self.samples,
            "seconds_per_object": self.seconds_per_object,
            "aligned": None if self.aligned == AlignedConfig() else self.aligned,
            "refinement": None if self.refinement == RefinementConfig() else self.refinement,
        }
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class UncertaintyArguments:
    """Options of errors that the robot parks with."""

    uncertainty: Annotated[str | None, tyro.conf.arg(metavar="SD_XY,SD_HEADING")] = None
    """The robot parks with normal errors of these standard deviations (m, degrees), such as 0.02,1: every pick is to be
    possible all the same. Two more numbers are of where objects are seen. Default: it parks without error."""
    reliability: float = 0.95
    """With --uncertainty: in at least this share of the errors that are drawn; where that can't be had, as often as can
    be."""
    errors: UncertaintyConfig = field(default_factory=UncertaintyConfig)
    """With --uncertainty: the errors in full; what it says itself comes first."""

    def given_uncertainty(self) -> UncertaintyConfig | None:
        """The errors, or None without `--uncertainty`.

        Raises:
            ValueError: they, or the reliability, are none.
        """
        if not 0.0 <= self.reliability <= 1.0:
            raise ValueError(f"--reliability: found {self.reliability}, allowed are 0 to 1")
        return None if self.uncertainty is None else _uncertainty(self.uncertainty, self.errors)


def _uncertainty(text: str, base: UncertaintyConfig) -> UncertaintyConfig:
    parts = text.split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 4):
        allowed = "are 2 or 4 numbers with commas between them, m and degrees: 0.02,1 or 0.02,1,0.005,2"
        raise ValueError(f"--uncertainty: found {text!r}, allowed {allowed}")
    names = ("sd_xy_m", "sd_heading_rad", "sd_object_m", "sd_object_rad")
    given = {name: math.radians(x) if name.endswith("rad") else x for name, x in zip(names, numbers, strict=False)}
    try:
        return dataclasses.replace(base, **given)
    except ValueError as error:
        raise ValueError(f"--uncertainty {text}: {error}") from None


def parse(kind: type[T], arguments: Sequence[str], prog: str, defaults: Mapping[str, Any]) -> T:
    """A command's options.

    Args:
        kind: a dataclass of them.
        arguments: of the command line.
        prog: how the command is called.
        defaults: of some of its fields, instead of the dataclass's.
    """
    required = {
        each.name: tyro.MISSING
        for each in dataclasses.fields(kind)  # pyright: ignore[reportArgumentType]
        if each.default is dataclasses.MISSING and each.default_factory is dataclasses.MISSING
    }
    return tyro.cli(kind, args=arguments, prog=prog, default=kind(**required | dict(defaults)))


def peek(arguments: Sequence[str], option: str) -> str | None:
    """The value of an option that others' defaults depend on, before all are parsed; None if it isn't there."""
    found = None
    for index, argument in enumerate(arguments):
        name, equals, value = argument.partition("=")
        if name.replace("_", "-") == option:
            found = value if equals else next(iter(arguments[index + 1 : index + 2]), None)
    return found


def base_config(
    arguments: Sequence[str], make_preset: Callable[..., C], file: str | None, default: Preset = "default"
) -> C:
    """A preset changed by a file, before the command line has its say.

    Args:
        arguments: of the command line, whose --preset and --objects come before the file's.
        make_preset: the configuration of a preset, `objects` and `seed`.
        file: of settings, or None.
        default: the preset if neither names one.

    Raises:
        ConfigFileError: the file is refused.
    """
    data = {} if file is None else read_config(file)
    preset, objects = peek(arguments, "--preset") or data.get("preset"), peek(arguments, "--objects")
    # What isn't allowed here is refused once all is parsed.
    count = {str(number): number for number in range(1, MAX_OBJECTS + 1)}.get(objects or "")
    config = make_preset(preset if preset in get_args(Preset) else default, objects=count or 10, seed=0)
    if file is None:
        return config
    config = overlay(config, data, file)
    learners = {name: getattr(config, name) for name in ("reinforce", "stops") if hasattr(config, name)}
    drawn = {name: dataclasses.replace(each, objects=count) for name, each in learners.items()} if count else {}
    return dataclasses.replace(config, **drawn)


def world_of_file(arguments: Sequence[str]) -> WorldConfig:
    """The world of the file that `--config` names, a training's or a part of one; without, the default one.

    Raises:
        ConfigFileError: the file is refused.
    """
    file = peek(arguments, "--config")
    return WorldConfig() if file is None else load_config(file, TrainConfig()).world
