"""Checkpoints of a whole training state: written whole or not at all, verified before use, restored bit by bit.

directory/000012/               one checkpoint, named by its step
    description.json            its step, metadata and what each leaf of the state is
    state/                      the leaves, written by Orbax
    manifest.sha256             of all these files; `sha256sum --check` understands it
directory/000013.partial/       left behind by a kill; the next save removes it
"""

import contextlib
import errno
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import msgspec

from basenet_jax.atomic import sync
from basenet_jax.learning.checkpoint_arrays import Leaf, describe, misfit, read_state, write_arrays
from basenet_jax.learning.checkpoint_manifest import find_damage, write_manifest
from basenet_jax.weights_file import load_weights, save_weights

__all__ = ["CheckpointError", "Restored", "load_weights", "restore_latest", "save", "save_weights"]

_PARTIAL = ".partial"


class CheckpointError(Exception):
    """A checkpoint can't be written, or none of those there can be used."""


class Restored(NamedTuple):
    """A restored checkpoint."""

    state: Any  # in the structure of `like`; every leaf is a JAX array
    step: int
    metadata: dict[str, Any]
    notes: list[str]  # which newer checkpoints were passed over and why, for people


class _Description(msgspec.Struct):
    step: int
    metadata: dict[str, Any]
    leaves: list[Leaf]


def save(directory: Path, step: int, state: Any, metadata: dict[str, Any], keep: int = 2) -> Path:
    """Writes a checkpoint and removes all but the newest undamaged `keep` up to it; returns its folder.

    Also removed are what a kill left of earlier saves, and later steps: they are of a course since abandoned.

    Args:
        directory: of the checkpoints of one training; used by one process at a time; created where missing.
        step: names the checkpoint; one of the same step is replaced.
        state: a pytree of arrays, typed PRNG keys and Python numbers.
        metadata: JSON-able.
        keep: how many checkpoints stay, at least 1.

    Raises:
        CheckpointError: the disk is full or can't be written; earlier checkpoints are as they were.
    """
    leaves = [jnp.asarray(leaf) for leaf in jax.tree.leaves(state)]
    description = _Description(step, metadata, describe(state))
    needed = sum(leaf.nbytes for leaf in leaves) + 2048 * len(leaves) + 65536  # of names and folders, about
    final = directory / f"{step:06d}"
    partial = final.with_name(final.name + _PARTIAL)
    with _explained(directory, needed):
        directory.mkdir(parents=True, exist_ok=True)
        for leftover in directory.glob("*" + _PARTIAL):
            shutil.rmtree(leftover)
        if shutil.disk_usage(directory).free < needed:
            raise OSError(errno.ENOSPC, "not enough space")
        try:
            partial.mkdir()
            write_arrays(partial / "state", leaves)
            (partial / "description.json").write_bytes(msgspec.json.encode(description))
            write_manifest(partial)
            if final.exists():
                final.rename(final.with_name(f"{final.name}.replaced{_PARTIAL}"))
            partial.rename(final)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        sync(directory)
        _prune(directory, step, keep)
    return final


def restore_latest(directory: Path, like: Any) -> Restored | None:
    """Restores the newest checkpoint that is whole, undamaged and fits; None where no checkpoint was ever finished.

    Changes nothing on the disk. The restored state is that saved to the bit, weak types included.

    Args:
        directory: as given to `save`.
        like: a pytree with the structure, shapes and dtypes expected: of arrays, or abstract as from
            `jax.eval_shape`. Where its leaves are committed to devices, so are the restored.

    Raises:
        CheckpointError: there are checkpoints, but none can be used; the message says why not.
    """
    problems = []
    for folder in _checkpoints(directory):
        problem = find_damage(folder)
        if problem is None:
            try:
                description = msgspec.json.decode((folder / "description.json").read_bytes(), type=_Description)
                problem = misfit(description.leaves, describe(like))
                if problem is None:
                    state = read_state(folder / "state", description.leaves, like)
                    notes = [f"{problem}; using {folder.name}" for problem in problems]
                    return Restored(state, description.step, description.metadata, notes)
            except Exception as error:  # undamaged and still unreadable, of another version of Orbax, say
                problem = f"can't be read ({error})"
        problems.append(f"checkpoint {folder.name} {problem}")
    if problems:
        raise CheckpointError(f"{directory}: no checkpoint can be used: {'; '.join(problems)}")
    return None


def _checkpoints(directory: Path) -> list[Path]:
    """Folders of finished checkpoints, newest first."""
    folders = [path for path in directory.glob("*") if path.name.isdecimal() and path.is_dir()]
    return sorted(folders, key=lambda path: int(path.name), reverse=True)


def _prune(directory: Path, step: int, keep: int) -> None:
    kept = 0
    for folder in _checkpoints(directory):
        number = int(folder.name)
        # A damaged one must not count, else a run that falls back on an older checkpoint would lose that one too.
        if number == step or (number < step and kept < keep and find_damage(folder) is None):
            kept += 1
        else:
            shutil.rmtree(folder)


@contextlib.contextmanager
def _explained(directory: Path, needed: int) -> Iterator[None]:
    """Turns errors of writing into a `CheckpointError`."""
    try:
        yield
    except (OSError, ValueError, RuntimeError) as error:  # Orbax reports a failed write as one of the latter two
        full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
        if full or "No space left" in str(error) or "quota exceeded" in str(error):
            existing = next(path for path in (directory, *directory.parents) if path.exists())
            free = shutil.disk_usage(existing).free
            message = f"the disk is full: a checkpoint needs up to {needed / 1e6:.1f} MB, {free / 1e6:.1f} MB are free"
        else:
            message = f"a checkpoint can't be written: {error}"
        raise CheckpointError(f"{directory}: {message}; earlier checkpoints are as they were") from error
