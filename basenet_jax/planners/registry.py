"""The planners by name."""

from collections.abc import Callable
from functools import partial

from basenet_jax.planners.basenet import BaSeNet
from basenet_jax.planners.dp import Dp
from basenet_jax.planners.mbp import Mbp
from basenet_jax.planners.pbg import Pbg
from basenet_jax.planners.protocol import Planner, PlannerSetup

PLANNERS: dict[str, Callable[[PlannerSetup], Planner]] = {
    "pbg": partial(Pbg, checked=False),
    "pbg-gc": partial(Pbg, checked=True),
    "mbp": partial(Mbp, checked=False),
    "mbp-gc": partial(Mbp, checked=True),
    "dp": Dp,
    "basenet": BaSeNet,
}


def make_planner(name: str, setup: PlannerSetup) -> Planner:
    """The planner of a name.

    Raises:
        ValueError: there is none of that name, or its weights can't be used.
    """
    if name not in PLANNERS:
        raise ValueError(f"planner: found {name!r}, allowed are {', '.join(PLANNERS)}")
    return PLANNERS[name](setup)
