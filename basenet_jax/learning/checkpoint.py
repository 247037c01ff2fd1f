"""Checkpoints of a whole training state: written whole or not at all, verified before use, restored bit by bit.

directory/000012/               one checkpoint, named by its step
    description.json            its step, metadata and what each leaf of the state is
    state/                      the leaves, written by Orbax
    manifest.sha256             of all these files; `sha256sum --check` understands it
directory/000013.partial/       left behind by a kill; the next save removes it
"""

import contextlib
import errno
import hashlib
import logging
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import orbax.checkpoint as ocp

from basenet_jax.atomic import sync
from basenet_jax.weights_file import load_weights, save_weights

__all__ = ["CheckpointError", "Restored", "load_weights", "restore_latest", "save", "save_weights"]

_PARTIAL, _MANIFEST = ".partial", "manifest.sha256"


class CheckpointError(Exception):
    """A checkpoint can't be written, or none of those there can be used."""


class Restored(NamedTuple):
    """A restored checkpoint."""

    state: Any  # in the structure of `like`; every leaf is a JAX array
    step: int
    metadata: dict[str, Any]
    notes: list[str]  # which newer checkpoints were passed over and why, for people


class _Leaf(msgspec.Struct, frozen=True):
    """What one leaf of a state is."""

    path: str
    dtype: str
    shape: tuple[int, ...]
    weak: bool  # a weakly typed array promotes differently: restored otherwise, the program would be another
    key: str | None  # the generator of typed PRNG keys, which are stored as their uint32 data

    @property
    def looks(self) -> str:
        """What must agree between what is stored and what is expected."""
        return f"{self.path}: {self.dtype}{list(self.shape)}"


class _Description(msgspec.Struct):
    step: int
    metadata: dict[str, Any]
    leaves: list[_Leaf]


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
    description = _Description(step, metadata, _describe(state))
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
            _write_arrays(partial / "state", leaves)
            (partial / "description.json").write_bytes(msgspec.json.encode(description))
            _write_manifest(partial)
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
        problem = _find_damage(folder)
        if problem is None:
            try:
                description = msgspec.json.decode((folder / "description.json").read_bytes(), type=_Description)
                problem = _misfit(description.leaves, _describe(like))
                if problem is None:
                    state = _read_state(folder / "state", description.leaves, like)
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
        if number == step or (number < step and kept < keep and _find_damage(folder) is None):
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


def _describe(tree: Any) -> list[_Leaf]:
    """What the leaves of a pytree are; of typed keys in an abstract one, the generator stays unknown."""
    leaves = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        array = leaf if isinstance(leaf, jax.ShapeDtypeStruct) else jnp.asarray(leaf)
        key = str(jax.random.key_impl(array)) if isinstance(array, jax.Array) and _is_key(array) else None
        name = jax.tree_util.keystr(path, simple=True, separator="/")
        leaves.append(_Leaf(name, str(array.dtype), array.shape, bool(getattr(array, "weak_type", False)), key))
    return leaves


def _misfit(found: list[_Leaf], wanted: list[_Leaf]) -> str | None:
    """Where a state differs from what is expected, as words to follow its name; weak types may differ."""
    found_looks, wanted_looks = [leaf.looks for leaf in found], [leaf.looks for leaf in wanted]
    if found_looks == wanted_looks:
        return None
    surplus = next((looks for looks in found_looks if looks not in wanted_looks), "nothing more")
    missing = next((looks for looks in wanted_looks if looks not in found_looks), "nothing more")
    return f"is of another state (found {surplus}, needs {missing})"


def _write_arrays(folder: Path, leaves: list[jax.Array]) -> None:
    """Writes the leaves as NumPy arrays, without the empty ones, which Orbax refuses.

    Raises:
        OSError, RuntimeError, ValueError: Orbax can't write it; which of them depends on what failed.
    """
    data = (jax.random.key_data(leaf) if _is_key(leaf) else leaf for leaf in leaves)
    arrays = {f"{index:05d}": np.asarray(leaf) for index, leaf in enumerate(data) if leaf.size}
    absl = logging.getLogger("absl")
    level = absl.level
    absl.setLevel(logging.CRITICAL)  # a full disk is told in one line, not in Orbax's three tracebacks
    try:
        with ocp.Checkpointer(ocp.PyTreeCheckpointHandler()) as checkpointer:
            checkpointer.save(folder.absolute(), args=ocp.args.PyTreeSave(arrays))
    finally:
        absl.setLevel(level)


def _read_state(folder: Path, leaves: list[_Leaf], like: Any) -> Any:
    """Reads a state that was written with these leaves into the structure of `like`.

    Raises:
        OSError, ValueError: it can't be read.
    """
    with ocp.Checkpointer(ocp.PyTreeCheckpointHandler()) as checkpointer:
        arrays = checkpointer.restore(folder.absolute())
    like_leaves, structure = jax.tree.flatten(like)
    restored = (
        _rebuild(leaf, arrays.get(f"{index:05d}"), like_leaf)
        for index, (leaf, like_leaf) in enumerate(zip(leaves, like_leaves, strict=True))
    )
    return jax.tree.unflatten(structure, restored)


def _rebuild(leaf: _Leaf, data: np.ndarray | None, like: Any) -> jax.Array:
    if data is None:
        value = jnp.zeros(leaf.shape, leaf.dtype)
    elif leaf.key is not None:
        value = jax.random.wrap_key_data(jnp.array(data), impl=leaf.key)
    else:
        value = jnp.array(data)  # a copy: the program may give its buffer away
    if leaf.weak:
        blank = jnp.broadcast_to(jnp.asarray(value.dtype.type(0).item()), leaf.shape)  # of a Python number: weak
        if blank.dtype == value.dtype:
            value = blank.at[...].set(value)  # keeps the weak type of what is written to
    return jax.device_put(value, like.sharding) if getattr(like, "committed", False) else value


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _write_manifest(folder: Path) -> None:
    """Lists every file under a folder in its manifest, and waits until all of it is on the disk.

    Raises:
        OSError: a file can't be read or written.
    """
    files = _files(folder)
    lines = [f"{_digest(path)}  {name}\n" for name, path in sorted(files.items())]
    (folder / _MANIFEST).write_text("".join(lines), encoding="utf-8")
    for path in (*folder.rglob("*"), folder):
        sync(path)


def _find_damage(folder: Path) -> str | None:
    """What is wrong with a folder by its manifest, as words to follow its name; None if nothing is."""
    try:
        lines = (folder / _MANIFEST).read_text(encoding="utf-8").splitlines()
        files = _files(folder)
        listed = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
        # Unlisted files count as damage, else a manifest that lost lines would leave files unchecked.
        for name in sorted(listed.keys() | files.keys()):
            if name not in files:
                return f"is damaged ({name or 'a file'} is missing)"
            if name not in listed:
                return f"is damaged ({name} isn't in its manifest)"
            if _digest(files[name]) != listed[name]:
                return f"is damaged ({name} differs from its manifest)"
    except FileNotFoundError:
        return "is incomplete (it has no manifest)"
    except UnicodeDecodeError:
        return "is damaged (its manifest is no text)"
    except OSError as error:
        return f"can't be read ({error})"
    return None if files else "is incomplete (it is empty)"


def _files(folder: Path) -> dict[str, Path]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    files = {path.relative_to(folder).as_posix(): path for path in paths}
    files.pop(_MANIFEST, None)
    return files


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
