"""The planners by name, each with its own options."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from basenet_jax.planners.options import (
    GreedyStopsOptions,
    LearnedOptions,
    RefinedOptions,
    SampleOptions,
    StopsOptions,
)
from basenet_jax.settings import Settings, hints_of

if TYPE_CHECKING:  # so that the names are known without JAX
    from basenet_jax.planners.protocol import Planner, PlannerSetup


@dataclass(frozen=True)
class PlannerKind:
    """What makes the planners of a name."""

    make: Callable[..., "Planner"]  # of a `PlannerSetup`, and of the options where there are some
    options: type[Settings] | None = None
    robust: bool = True  # whether it can choose among reliable picks alone

    @property
    def option_names(self) -> tuple[str, ...]:
        """Names of its options."""
        return () if self.options is None else tuple(hints_of(self.options))

    def make_options(self, given: Mapping[str, Any]) -> Settings | None:
        """Its options, those that aren't given at their defaults; None if it has none.

        Raises:
            SettingError: an option hasn't such a value.
        """
        return self.options(**given) if self.options else None

    def make_planner(self, setup: "PlannerSetup", options: Settings | None = None) -> "Planner":
        """The planner of a setup, which refuses scenes in another room; options of None are its defaults.

        Raises:
            ValueError: its weights can't be used, or the robot's arm would touch something before and after a pick.
        """
        from basenet_jax.planners.in_its_room import check_rest, hold_to  # the names are known without JAX

        check_rest(setup)
        return hold_to(setup, self.make(setup) if options is None else self.make(setup, options))


def _later(module: str, name: str, **fixed: Any) -> Callable[..., "Planner"]:
    """Imports the module when a planner is made: SciPy's solver alone takes a second, and few runs need it."""

    def make(*given: Any) -> "Planner":
        return getattr(importlib.import_module(f"basenet_jax.planners.{module}"), name)(*given, **fixed)

    return make


PLANNERS: dict[str, PlannerKind] = {
    "pbg": PlannerKind(_later("pbg", "Pbg", checked=False), robust=False),
    "pbg-gc": PlannerKind(_later("pbg", "Pbg", checked=True)),
    "mbp": PlannerKind(_later("mbp", "Mbp", checked=False), robust=False),
    "mbp-gc": PlannerKind(_later("mbp", "Mbp", checked=True)),
    "dp": PlannerKind(_later("dp", "Dp")),
    "greedy-stops": PlannerKind(_later("greedy_stops", "GreedyStops"), GreedyStopsOptions),
    "refined": PlannerKind(_later("refined", "Refined"), RefinedOptions),
    "basenet-paper": PlannerKind(_later("basenet_paper", "BaSeNetPaper"), LearnedOptions, robust=False),
    "basenet": PlannerKind(_later("basenet", "BaSeNet"), StopsOptions),
    "basenet-sample": PlannerKind(_later("basenet", "BaSeNet"), SampleOptions),
}


def find_planner(name: str) -> PlannerKind:
    """The planner of a name.

    Raises:
        ValueError: there is none of that name.
    """
    if name not in PLANNERS:
        raise ValueError(f"planner: found {name!r}, allowed are {', '.join(PLANNERS)}")
    return PLANNERS[name]


def make_options(name: str, given: Mapping[str, Any]) -> Settings | None:
    """The options of a planner, those that aren't given at their defaults; None if it has none.

    Raises:
        ValueError: there is no planner of that name, or it has no such option, or not with such a value.
    """
    kind = find_planner(name)
    if unknown := [each for each in given if each not in kind.option_names]:
        allowed = f"are {', '.join(kind.option_names)}" if kind.option_names else "is none"
        raise ValueError(f"options of the planner {name}: found {unknown[0]}, allowed {allowed}")
    return kind.make_options(given)


def shared_options(names: Sequence[str], given: Mapping[str, Any]) -> dict[str, Settings | None]:
    """The options of several planners, each with those of the given ones that it has.

    Raises:
        ValueError: there is no planner of a name, or none of them has an option, or not with such a value.
    """
    kinds = {name: find_planner(name) for name in names}
    for option in given:
        if not any(option in kind.option_names for kind in kinds.values()):
            raise ValueError(f"option {option}: found, but none of the planners {', '.join(names)} has it")
    return {
        name: kind.make_options({key: value for key, value in given.items() if key in kind.option_names})
        for name, kind in kinds.items()
    }


def make_planner(name: str, setup: "PlannerSetup", options: Settings | None = None) -> "Planner":
    """The planner of a name for a robot, a table and a world.

    Args:
        name: of the planner.
        setup: what it is made for.
        options: of `make_options`; None: its defaults.

    Raises:
        ValueError: there is none of that name, or see `PlannerKind.make_planner`.
    """
    kind = find_planner(name)
    if setup.chance is not None and not kind.robust:
        allowed = ", ".join(name for name, each in PLANNERS.items() if each.robust)
        raise ValueError(f"planner: found {name!r}, which can't plan for errors, allowed with these are {allowed}")
    return kind.make_planner(setup, options)
