"""Where a result was measured: machine, versions, commit and command, without any absolute path."""

import contextlib
import hashlib
import os
import platform
import shlex
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import jax

from basenet_jax.evaluation.provenance import cpu_model

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("jax", "jaxlib", "mujoco", "mujoco-mjx", "brax", "flax", "optax", "numpy", "scipy")
PEERS = ("eaik", "ur-analytic-ik", "mink", "pyvrp", "torch", "viser")  # where they are installed


def hardware() -> dict[str, Any]:
    """CPU, cores this process may use, memory, and the accelerator; starts JAX's backend."""
    device = jax.devices()[0]
    affinity = getattr(os, "sched_getaffinity", None)  # not on macOS
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "cores_usable": len(affinity(0)) if affinity else os.cpu_count(),
        "memory_gib": _memory_gib(),
        "accelerator": None if device.platform == "cpu" else device.device_kind,
        "devices": jax.device_count(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def versions() -> dict[str, str]:
    """Of Python and the packages that results depend on."""
    found = {"python": platform.python_version()} | {name: metadata.version(name) for name in PACKAGES}
    for name in PEERS:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def command(module: str, arguments: list[str]) -> str:
    """The command line, to be typed in the repository's root."""
    return shlex.join(["python", "-m", module, *map(portable_argument, arguments)])


def portable(path: str | os.PathLike[str]) -> str:
    """A path without the machine's part: relative to the repository where it lies inside, else its last two names."""
    given = Path(path)
    if not given.is_absolute():
        return given.as_posix()
    resolved = given.resolve()
    if resolved.is_relative_to(ROOT):
        return resolved.relative_to(ROOT).as_posix()
    return Path(*resolved.parts[-2:] if len(resolved.parts) > 2 else resolved.parts[-1:]).as_posix()


def portable_argument(argument: str) -> str:
    """An argument of a command line (`--name`, `value` or `--name=value`) with any absolute path made portable."""
    name, separator, value = argument.rpartition("=")
    return f"{name}{separator}{portable(value)}" if Path(value).is_absolute() else argument


def fingerprint(path: Path) -> dict[str, str]:
    """What identifies a file of weights: its portable path and its SHA-256."""
    return {"file": portable(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def peak_memory_gib() -> float | None:
    """The largest resident set that this process has had; None where that can't be known (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30


def _memory_gib() -> float | None:
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30, 1)
    except (AttributeError, ValueError, OSError):
        return None
