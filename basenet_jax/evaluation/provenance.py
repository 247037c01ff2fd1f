"""What a result was made with: command, versions, hardware and weights, without any absolute path or machine's name."""

import hashlib
import os
import platform
import shlex
import subprocess
from importlib import metadata
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import jax

from basenet_jax.policies.trained import PACKAGED

PACKAGES = ("basenet_jax", "jax", "jaxlib", "mujoco", "flax", "numpy", "scipy")


def hardware() -> dict[str, Any]:
    """CPU, the cores that this process may use, and the accelerator."""
    device = jax.devices()[0]
    affinity = getattr(os, "sched_getaffinity", None)  # not on macOS
    return {
        "cpu": cpu_model(),
        "cores": len(affinity(0)) if affinity else os.cpu_count(),
        "accelerator": None if device.platform == "cpu" else device.device_kind,
        "system": f"{platform.system()} {platform.machine()}",
    }


def versions() -> dict[str, str]:
    """Of Python and the packages that results depend on."""
    return {"python": platform.python_version()} | {name: metadata.version(name) for name in PACKAGES}


def command(module: str, arguments: list[str]) -> str:
    """The command line; of absolute paths only the last part is kept."""
    return shlex.join(["python", "-m", module, *map(_portable, arguments)])


def commit() -> dict[str, Any]:
    """The checkout's hash, and whether anything but benchmark results differs from it; nulls outside a checkout."""
    head = _git("rev-parse", "HEAD")
    changes = _git("status", "--porcelain", "--", ".", ":(exclude)benchmarks/results")
    return {"hash": head, "dirty": None if changes is None else bool(changes)}


def weights_fingerprint(path: Path | None) -> dict[str, str]:
    """Name and SHA-256 of a weights file; None: the one shipped with the package.

    Raises:
        ValueError: it can't be read.
    """
    try:
        if path is not None:
            return {"file": _portable(str(path)), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
        with as_file(files("basenet_jax.policies") / "weights" / PACKAGED) as packaged:
            return {"file": f"packaged {PACKAGED}", "sha256": hashlib.sha256(packaged.read_bytes()).hexdigest()}
    except OSError as error:
        raise ValueError(f"{path or PACKAGED}: can't be read: {error.strerror}") from error


def _git(*arguments: str) -> str | None:
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():  # installed, perhaps into somebody else's checkout
        return None
    try:
        result = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return result.stdout.strip() if result.returncode == 0 else None


def _portable(argument: str) -> str:
    """An argument (`--name`, `value` or `--name=value`) with an absolute path cut to its last part."""
    name, separator, value = argument.rpartition("=")
    return f"{name}{separator}{Path(value).name}" if Path(value).is_absolute() else argument


def cpu_model() -> str:
    """The CPU as it calls itself."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())
