"""The planners by name."""

import importlib
from collections.abc import Callable
from typing import Any

from basenet_jax.planners.protocol import Planner, PlannerSetup

MakePlanner = Callable[[PlannerSetup], Planner]


def _later(module: str, name: str, **options: Any) -> MakePlanner:
    """Imports the module when a planner is made: SciPy's solver alone takes a second, and few runs need it."""

    def make(setup: PlannerSetup) -> Planner:
        return getattr(importlib.import_module(f"basenet_jax.planners.{module}"), name)(setup, **options)

    return make


PLANNERS: dict[str, MakePlanner] = {
    "pbg": _later("pbg", "Pbg", checked=False),
    "pbg-gc": _later("pbg", "Pbg", checked=True),
    "mbp": _later("mbp", "Mbp", checked=False),
    "mbp-gc": _later("mbp", "Mbp", checked=True),
    "dp": _later("dp", "Dp"),
    "greedy-stops": _later("greedy_stops", "GreedyStops"),
    "refined": _later("refined", "Refined"),
    "basenet-paper": _later("basenet_paper", "BaSeNetPaper"),
    "basenet": _later("basenet", "BaSeNet"),
    "basenet-sample": _later("basenet", "BaSeNet", sampled=True),
}


def make_planner(name: str, setup: PlannerSetup) -> Planner:
    """The planner of a name.

    Raises:
        ValueError: there is none of that name, or its weights can't be used.
    """
    if name not in PLANNERS:
        raise ValueError(f"planner: found {name!r}, allowed are {', '.join(PLANNERS)}")
    return PLANNERS[name](setup)
