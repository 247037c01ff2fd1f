"""Packages that the benchmarks set beside ours (extra `benchmarks`), and what is said where one isn't installed."""

import importlib.util
import sys

_INSTALL = 'pip install "basenet_jax[benchmarks]"'
_WHY_MISSING = {
    "eaik": f"EAIK: {_INSTALL}",
    "ur_analytic_ik": f"ur-analytic-ik: {_INSTALL} (its wheels are for Python 3.11 only)",
    "mink": f"mink: {_INSTALL}",
    "pyvrp": f"PyVRP: {_INSTALL}",
    "torch": f"PyTorch: {_INSTALL} (a wheel for CPUs will do)",
}


def installed(module: str, *, asked_by: str) -> bool:
    """Whether a peer can be imported; if not, says on standard error what is left out and how to get it."""
    if importlib.util.find_spec(module) is not None:
        return True
    print(f"{asked_by}: left out, not installed: {_WHY_MISSING[module]}", file=sys.stderr)
    return False


def why_missing(module: str | None) -> str | None:
    """What to install for a module that an import didn't find; None if it is no peer's."""
    return _WHY_MISSING.get(module or "")
