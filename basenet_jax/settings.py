"""Settings that check themselves: frozen dataclasses whose annotations say which values mean something."""

import functools
import math
import numbers
import types
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")


class SettingError(ValueError):
    """A setting that means nothing; the message names the field, what was found and what is allowed."""


@dataclass(frozen=True)
class Range:
    """The numbers that a field may hold, as part of its annotation: `Annotated[float, Range(0, 1)]`."""

    low: float
    high: float
    above: bool = False  # the low end itself isn't allowed

    def holds(self, number: float) -> bool:
        """Whether a number is in it; none that isn't finite is."""
        high_enough = number > self.low if self.above else number >= self.low
        return math.isfinite(number) and high_enough and number <= self.high

    def __str__(self) -> str:
        low, high = f"{self.low:.10g}", f"{self.high:.10g}"
        return f"above {low}, up to {high}" if self.above else f"{low} to {high}"


_MOST = 1e9  # far beyond anything of use, and far within float32 and int32
Positive = Annotated[float, Range(0, _MOST, above=True)]
NotNegative = Annotated[float, Range(0, _MOST)]
Finite = Annotated[float, Range(-_MOST, _MOST)]
Share = Annotated[float, Range(0, 1)]
Count = Annotated[int, Range(1, _MOST)]
Natural = Annotated[int, Range(0, _MOST)]
Seed = Annotated[int, Range(0, 2**32 - 1)]


@dataclass(frozen=True)
class Settings:
    """Base of the frozen dataclasses of settings: each is checked when it is made, in Python as from a file.

    Raises:
        SettingError: a field has another type than its annotation, isn't finite or is out of its `Range`, or fields
            don't go together.
    """

    def __post_init__(self) -> None:
        for name, hint in hints_of(type(self)).items():
            value = checked(getattr(self, name), hint, f"{type(self).__name__}.{name}")
            object.__setattr__(self, name, value)  # 1 has become 1.0 where that is meant: equal settings read alike
        self._check_together()

    def _check_together(self) -> None:
        """What fields must be to each other; see `_require`."""

    def _require(self, holds: bool, name: str, allowed: str) -> None:
        """Refuses the value of a field unless something holds.

        Raises:
            SettingError: it doesn't.
        """
        if not holds:
            raise setting_error(f"{type(self).__name__}.{name}", getattr(self, name), allowed)


def setting_error(path: str, found: Any, allowed: str) -> SettingError:
    """The error of one field; `allowed` begins with "is" or "are"."""
    text = repr(found)
    return SettingError(f"{path}: found {text if len(text) <= 60 else f'{text[:57]}...'}, allowed {allowed}")


@functools.cache
def hints_of(kind: type) -> dict[str, Any]:
    """The annotations of a dataclass's fields by name, ranges included."""
    return get_type_hints(kind, include_extras=True)


def checked(value: Any, hint: Any, path: str, *, plain: bool = False) -> Any:
    """A value that its annotation allows, numbers as Python's own of the annotated type.

    Args:
        value: found.
        hint: an annotation of a field of `Settings`: bool, int, float, str, a Literal, a tuple or a dataclass,
            possibly with a `Range` or None.
        path: of the field, for messages.
        plain: it comes from a file: lists stand for tuples.

    Raises:
        SettingError: it doesn't; the message names the field, what was found and what is allowed.
    """
    bounds, hint = _without_range(hint)
    if get_origin(hint) in (Union, types.UnionType):
        if value is None:
            return None
        (hint,) = (each for each in get_args(hint) if each is not types.NoneType)
        return checked(value, hint, path, plain=plain)
    if get_origin(hint) is tuple:
        return _checked_tuple(value, get_args(hint), path, plain)
    if hint is float and isinstance(value, numbers.Real) and not isinstance(value, bool) and bounds.holds(float(value)):
        return float(value)
    if hint is int and isinstance(value, numbers.Integral) and not isinstance(value, bool) and bounds.holds(int(value)):
        return int(value)
    if get_origin(hint) is Literal and isinstance(value, str) and value in get_args(hint):
        return value
    if isinstance(hint, type) and hint not in (int, float) and isinstance(value, hint):
        return value
    raise setting_error(path, value, _allowed(hint, bounds))


def _checked_tuple(value: Any, items: tuple[Any, ...], path: str, plain: bool) -> tuple[Any, ...]:
    kinds: Sequence[Any] = items
    if not isinstance(value, list if plain else tuple):
        raise setting_error(path, value, f"is a {'list' if plain else 'tuple'}")
    if items[-1] is Ellipsis:
        kinds = items[:1] * len(value)
    elif len(items) != len(value):
        raise setting_error(path, value, f"are {len(items)} of them")
    return tuple(
        checked(item, kind, f"{path}[{index}]", plain=plain)
        for index, (item, kind) in enumerate(zip(value, kinds, strict=True))
    )


def _without_range(hint: Any) -> tuple[Range, Any]:
    """An annotation's range, by default `Finite`'s, and the rest."""
    kind, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    return next((each for each in extras if isinstance(each, Range)), Range(-_MOST, _MOST)), kind


def _allowed(hint: Any, bounds: Range) -> str:
    if hint is bool:
        return "are true and false"
    if hint is float:
        return f"are numbers, {bounds}"
    if hint is int:
        return f"are whole numbers, {bounds}"
    if get_origin(hint) is Literal:
        return f"are {', '.join(get_args(hint))}"
    return "is a text" if hint is str else f"is a {hint.__name__}"
