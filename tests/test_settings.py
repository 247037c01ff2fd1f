"""Every configuration refuses values that mean nothing, by name, when it is made."""

import dataclasses
import inspect
import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
import pytest

from basenet_jax import config
from basenet_jax.config import GridConfig, PickConfig, SceneConfig, TableConfig, WorldConfig
from basenet_jax.learning import config as learning
from basenet_jax.learning.config import (
    AblationConfig,
    ReinforceConfig,
    SacConfig,
    StopLearningConfig,
    TrainConfig,
    make_preset,
)
from basenet_jax.planners import options
from basenet_jax.settings import Range, SettingError, Settings, checked, hints_of

KINDS = sorted(
    {
        each
        for module in (config, learning, options)
        for each in vars(module).values()
        if isinstance(each, type) and issubclass(each, Settings) and each is not Settings
    },
    key=lambda kind: kind.__name__,
)
FIELDS = [pytest.param(kind, name, id=f"{kind.__name__}.{name}") for kind in KINDS for name in hints_of(kind)]


@dataclass(frozen=True)
class Inner(Settings):
    """Settings inside others."""

    length_m: Annotated[float, Range(0, 2, above=True)] = 1.0


@dataclass(frozen=True)
class Outer(Settings):
    """One field of every kind."""

    flag: bool = False
    count: Annotated[int, Range(1, 3)] = 1
    free: float = 0.0
    name: str = "a"
    choice: Literal["x", "y"] = "x"
    pair: tuple[float, Annotated[float, Range(0, 1)]] = (5.0, 1.0)
    many: tuple[Annotated[int, Range(0, 9)], ...] = ()
    maybe: Annotated[float, Range(0, 1)] | None = None
    inner: Inner = field(default_factory=Inner)


def test_there_are_configurations_to_test():
    assert len(KINDS) >= 15


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_says_on_the_command_line_what_it_is(kind):
    """The text below a field is its help; sections have their class's."""
    parts = [each for each in kind.__mro__ if each not in (Settings, object)]
    lines = [line.strip() for part in parts for line in inspect.getsource(part).splitlines()]
    for name, hint in hints_of(kind).items():
        if (isinstance(hint, type) and issubclass(hint, Settings)) or kind in (TrainConfig, AblationConfig):
            continue
        (at,) = (index for index, line in enumerate(lines) if line.startswith(f"{name}: "))
        assert lines[at + 1].startswith('"""'), name


@pytest.mark.parametrize(("kind", "name"), FIELDS)
def test_what_is_no_value_of_a_field_is_refused_by_its_name(kind, name):
    for wrong in (math.nan, math.inf, -1e30, 1e30, 10**30, [1], object(), "much"):
        if hints_of(kind)[name] in (str, str | None) and isinstance(wrong, str):
            continue
        with pytest.raises(SettingError, match=rf"^{kind.__name__}\.{name}: found .*, allowed (is|are) "):
            kind(**{name: wrong})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"flag": 1}, "flag: found 1, allowed are true and false"),
        ({"count": True}, "count: found True, allowed are whole numbers, 1 to 3"),
        ({"count": 2.0}, "count: found 2.0, allowed are whole numbers"),
        ({"count": 0}, "count: found 0,"),
        ({"count": 4}, "count: found 4,"),
        ({"free": "1"}, "free: found '1', allowed are numbers, -1000000000 to 1000000000"),
        ({"name": 1}, "name: found 1, allowed is a text"),
        ({"choice": "z"}, "choice: found 'z', allowed are x, y"),
        ({"pair": (1.0,)}, r"pair: found \(1.0,\), allowed are 2 of them"),
        ({"pair": [1.0, 1.0]}, r"pair: found \[1.0, 1.0\], allowed is a tuple"),
        ({"pair": (1.0, 1.5)}, r"pair\[1\]: found 1.5, allowed are numbers, 0 to 1"),
        ({"many": (1, 2, 10)}, r"many\[2\]: found 10, allowed are whole numbers, 0 to 9"),
        ({"maybe": 2}, "maybe: found 2, allowed are numbers, 0 to 1"),
        ({"inner": {"length_m": 1.0}}, "inner: found {'length_m': 1.0}, allowed is a Inner"),
    ],
)
def test_wrong_values_are_refused_with_what_is_allowed(values, message):
    with pytest.raises(SettingError, match=rf"^Outer\.{message}"):
        Outer(**values)


@pytest.mark.parametrize("length", [0.0, 2.1, -1.0])
def test_the_ends_of_a_range(length):
    assert Inner(2.0).length_m == 2.0
    with pytest.raises(SettingError, match=r"^Inner.length_m: found .*, allowed are numbers, above 0, up to 2$"):
        Inner(length)


def test_right_values_are_kept_as_they_are():
    values = {"flag": True, "count": 3, "free": -2, "choice": "y", "pair": (0.1, 0), "many": (0, 9), "maybe": 1.0}
    made = Outer(**values)
    assert {name: getattr(made, name) for name in values} == values
    numpys: dict[str, Any] = {"count": np.int32(2), "free": np.float32(0.5)}
    assert Outer(**numpys) == Outer(count=2, free=0.5)


def test_a_changed_copy_is_checked_too():
    with pytest.raises(SettingError, match="samples: found 1, allowed are whole numbers, 2 to"):
        dataclasses.replace(StopLearningConfig(), samples=1)


def test_values_of_files_become_those_of_the_field():
    assert checked([1, 0], hints_of(Outer)["pair"], "pair", plain=True) == (1.0, 0.0)
    assert isinstance(checked(1, float, "free", plain=True), float)
    assert checked([], hints_of(Outer)["many"], "many", plain=True) == ()
    with pytest.raises(SettingError, match=r"^pair: found 1, allowed is a list"):
        checked(1, hints_of(Outer)["pair"], "pair", plain=True)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: PickConfig(descent_heights_m=(0.1,)),
            r"PickConfig.descent_heights_m: found \(0.1,\), allowed are",
        ),
        (lambda: PickConfig(descent_heights_m=(0.02, 0.03)), "PickConfig.descent_heights_m"),
        (lambda: PickConfig(pregrasp_height_m=0.06), "PickConfig.descent_heights_m: .* below pregrasp_height_m, 0.06"),
        (lambda: SceneConfig(start_distance_m=(3.0, 2.5)), "SceneConfig.start_distance_m: .* the lesser one first"),
        (lambda: SceneConfig(tries=100), "SceneConfig.tries: found 100, allowed are multiples of 32"),
        (lambda: GridConfig(step_m=0.005), "GridConfig.step_m: .* up to 1000000 poses, not 881 x 641 places x 8 turns"),
        (lambda: WorldConfig(table=TableConfig(width_m=0.15)), "WorldConfig.scene.edge_margin_m: found 0.08, .* 0.075"),
        (
            lambda: WorldConfig(scene=SceneConfig(start_distance_m=(1.0, 3.0))),
            r"WorldConfig.scene.start_distance_m: found \(1.0, 3.0\), allowed are .* beyond the table's corners, 1.077",
        ),
        (lambda: SacConfig(hidden=()), r"SacConfig.hidden: found \(\)"),
        (lambda: SacConfig(replay_size=100), "SacConfig.replay_size: found 100, .* episodes_per_iteration, 512"),
        (lambda: ReinforceConfig(test_episodes=1), "ReinforceConfig.test_episodes: found 1"),
        (lambda: TrainConfig(evaluation_objects=()), "TrainConfig.evaluation_objects"),
        (lambda: make_preset("default", objects=51, seed=0), "objects: found 51, allowed are whole numbers, 1 to 50"),
    ],
)
def test_fields_that_do_not_go_together_are_refused(make, message):
    with pytest.raises(SettingError, match=message):
        make()


@pytest.mark.parametrize("preset", ["quick", "default", "paper"])
def test_the_presets_are_valid(preset):
    assert make_preset(preset, objects=50, seed=2**32 - 1).preset == preset


def test_places_are_tried_in_whole_rounds():
    assert SceneConfig(tries=config.PLACES_AT_ONCE).tries == 32
