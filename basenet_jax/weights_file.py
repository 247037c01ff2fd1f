"""Network weights in one portable file: a format line, a checksum line, then MessagePack.

The content is names, numbers and shapes only: reading a file, whoever wrote it, runs no code of it. This module is
near the ground, so that planners load weights without the machinery of training.
"""

import hashlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import msgspec
import numpy as np

from basenet_jax.atomic import write_atomically

FORMAT = "basenet-weights/1"
MAX_BYTES = 256 * 1024 * 1024
_LARGEST = 1e12  # of a number: far more than any that was learned, and its products are still finite
_SHORT = 60  # characters of what a file holds, in messages

Params = TypeVar("Params")


class _Array(msgspec.Struct, forbid_unknown_fields=True):
    dtype: str
    shape: tuple[int, ...]
    data: bytes  # C order, little-endian


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    metadata: dict[str, Any]
    arrays: dict[str, _Array]  # by path in the pytree


def save_weights(path: str | os.PathLike[str], params: Any, metadata: dict[str, Any]) -> None:
    """Writes a pytree of arrays and a JSON-able dictionary, whole or not at all. Equal content, equal bytes.

    Raises:
        OSError: the file can't be written.
    """
    arrays = {name: _encode(jnp.asarray(leaf)) for name, leaf in _named_leaves(params)}
    body = msgspec.msgpack.encode(_Content(metadata, arrays))
    write_atomically(path, f"{FORMAT}\n{hashlib.sha256(body).hexdigest()}\n".encode() + body)


def load_weights(
    path: str | os.PathLike[str], like: Params, *, part: str | None = None
) -> tuple[Params, dict[str, Any]]:
    """Reads what `save_weights` wrote: the weights as JAX arrays in the structure of `like`, and the metadata.

    Args:
        path: of the file.
        like: a pytree with the expected names, shapes and dtypes: of arrays, or abstract as from `jax.eval_shape`.
        part: the field of what was saved that `like` is like; the others are passed by. By default all of it.

    Raises:
        ValueError: the file is missing, damaged, of another format, or its weights are not like `like`; the message
            names the file and what is wrong.
    """
    return load_described(path, lambda _: like, part=part)


def load_described(
    path: str | os.PathLike[str],
    like_of: Callable[[dict[str, Any]], Params],
    *,
    part: str | None = None,
    or_alone: bool = False,
) -> tuple[Params, dict[str, Any]]:
    """`load_weights` of a network that the file's own metadata describe.

    Args:
        path: of the file.
        like_of: makes of the metadata what the weights are like; a ValueError of it is raised with the file's name.
        part: as for `load_weights`.
        or_alone: a file that holds no such part is taken to be this part alone.

    Raises:
        ValueError: as for `load_weights`, or the metadata describe no network.
    """
    try:
        content = _read(Path(path))
        like = like_of(content.metadata)
        beginning = "" if part is None else f"{part}/"
        if or_alone and not any(name.startswith(beginning) for name in content.arrays):
            beginning = ""
        wanted = [(beginning + name, leaf) for name, leaf in _named_leaves(like)]
        _check_names({name for name, _ in wanted}, {name for name in content.arrays if name.startswith(beginning)})
        leaves = [_decode(name, content.arrays[name], leaf) for name, leaf in wanted]
    except OSError as error:
        raise ValueError(f"{path}: can't be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return jax.tree.unflatten(jax.tree.structure(like), leaves), content.metadata


def _named_leaves(tree: Any) -> list[tuple[str, Any]]:
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return [(jax.tree_util.keystr(path, simple=True, separator="/"), leaf) for path, leaf in leaves]


def _encode(leaf: jax.Array) -> _Array:
    values = np.asarray(leaf)
    return _Array(str(leaf.dtype), leaf.shape, values.astype(values.dtype.newbyteorder("<")).tobytes())


def _decode(name: str, array: _Array, like: Any) -> jax.Array:
    dtype = jnp.dtype(like.dtype)
    if array.dtype != str(dtype) or array.shape != tuple(like.shape):
        found = _short(f"{array.dtype} of shape {array.shape}")
        raise ValueError(f"{name}: found {found}, needs {dtype} of {tuple(like.shape)}")
    if len(array.data) != dtype.itemsize * math.prod(array.shape):
        raise ValueError(f"{name}: found {len(array.data)} bytes for {array.dtype} of shape {array.shape}")
    values = np.frombuffer(array.data, dtype.newbyteorder("<")).reshape(array.shape)
    if jnp.issubdtype(dtype, jnp.floating) and not np.all(np.abs(numbers := values.astype(np.float64)) <= _LARGEST):
        wrong = numbers[~(np.abs(numbers) <= _LARGEST)][0]
        raise ValueError(f"{name}: found {wrong:g}, allowed are finite numbers up to {_LARGEST:g}")
    return jax.device_put(values.astype(dtype))  # not jnp.array: that compiles a copy for every shape


def _read(path: Path) -> _Content:
    with path.open("rb") as stream:
        format_line = stream.readline(len(FORMAT) + 2).removesuffix(b"\n")
        if format_line != FORMAT.encode():
            raise ValueError(f"format: found {format_line[:40].decode(errors='replace')!r}, needs {FORMAT!r}")
        rest = stream.read(MAX_BYTES + 1)
    if len(rest) > MAX_BYTES:
        raise ValueError(f"found more than {MAX_BYTES} bytes, allowed are up to {MAX_BYTES}")
    checksum, _, body = rest.partition(b"\n")
    if hashlib.sha256(body).hexdigest().encode() != checksum:
        raise ValueError("the file is damaged or cut short: its content doesn't fit its checksum")
    try:
        return msgspec.msgpack.decode(body, type=_Content)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        what = "nested too deep" if isinstance(error, RecursionError) else _short(str(error))
        raise ValueError(f"the content is not that of {FORMAT}: {what}") from None


def _short(text: str) -> str:
    return text if len(text) <= _SHORT else f"{text[: _SHORT - 3]}..."


def _check_names(wanted: set[str], found: set[str]) -> None:
    if missing := sorted(wanted - found):
        raise ValueError(f"{missing[0]}: missing ({len(missing)} of {len(wanted)} arrays are)")
    if unknown := sorted(found - wanted):
        raise ValueError(f"{_short(unknown[0])}: unknown, the network has no such array")
