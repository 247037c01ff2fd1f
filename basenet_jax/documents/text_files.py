"""Text files of plain data, YAML or JSON, read within bounds: no file, whoever wrote it, does harm."""

import json
import math
import os
import re
from pathlib import Path
from typing import Any

import msgspec

from basenet_jax.documents.fields import DocumentError, describe, field_error
from basenet_jax.documents.yaml_text import MAX_DEPTH, Pairs, parse_yaml, read_integer, too_deep

MAX_YAML_BYTES = 64 * 1024  # the parser takes up to ten seconds per MiB
MAX_JSON_BYTES = 1024 * 1024
_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,63}")


def read_yaml(path: str | os.PathLike[str]) -> Any:
    """The content of a YAML file of up to 64 KiB, by the rules of `yaml_text`.

    Returns:
        Dictionaries, lists, texts, finite numbers, truth values and nulls.

    Raises:
        DocumentError: the file can't be read, is too large, no UTF-8, no YAML, nested deeper than 16 levels, or has a
            key twice, an odd key, or an infinite number.
    """
    return _plain(parse_yaml(_read_text(Path(path), MAX_YAML_BYTES)), "", 0)


def read_json(path: str | os.PathLike[str], limit: int = MAX_JSON_BYTES) -> Any:
    """The content of a JSON file of up to so many bytes (1 MiB); else like `read_yaml`."""
    text = _read_text(Path(path), limit)
    try:
        return _plain(json.loads(text, object_pairs_hook=Pairs, parse_int=read_integer), "", 0)
    except json.JSONDecodeError as error:
        raise DocumentError(f"line {error.lineno}: no JSON: {error.msg}") from None
    except RecursionError:
        raise too_deep("content") from None


def to_json(data: Any) -> bytes:
    """Plain data or a msgspec struct as JSON, a list of numbers on one line."""
    text = msgspec.json.format(msgspec.json.encode(data))
    # In JSON no text holds a line break, so these are lists indeed.
    lists = re.compile(rb"\[\n([-+.\deE,\s]+)\n\s*\]")
    return lists.sub(lambda match: b"[" + re.sub(rb"\s+", b" ", match[1].strip()) + b"]", text) + b"\n"


def inside(path: Path, folder: Path) -> Path | None:
    """The file a path leads to, links followed, if it is a file in the folder (which is resolved) or below."""
    try:
        found = path.resolve()
        return found if found.is_relative_to(folder) and found.is_file() else None
    except (OSError, ValueError, RuntimeError):  # a loop of links, or a name that no file system takes
        return None


def find_file(name: str, start: Path, folder: Path, field: str) -> Path:
    """The file that a field of a document names.

    Args:
        name: as it stands there.
        start: that it is relative to.
        folder: resolved, which it must be in, or below.
        field: for the message.

    Raises:
        DocumentError: there is no such file in the folder or below.
    """
    found = inside(start / name, folder) if name.isprintable() and not Path(name).is_absolute() else None
    if found is None:
        raise field_error(field, describe(name), "are files in the scene file's folder or below, links followed")
    return found


def read_bytes(path: Path, limit: int) -> bytes:
    """The content of a file of up to `limit` bytes.

    Raises:
        DocumentError: the file can't be read, or is larger.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(limit + 1)
    except OSError as error:
        raise DocumentError(f"can't be read: {error.strerror}") from None
    except ValueError as error:  # a name that no file system takes
        raise DocumentError(f"can't be read: {error}") from None
    if len(data) > limit:
        raise field_error("", f"more than {limit} bytes", f"are up to {limit}")
    return data


def _read_text(path: Path, limit: int) -> str:
    data = read_bytes(path, limit)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise field_error("", f"the byte 0x{data[error.start]:02x} at offset {error.start}", "is UTF-8 text") from None
    if not text.strip():
        raise field_error("", "an empty file", "is YAML or JSON")
    return text


def _plain(tree: Any, path: str, depth: int) -> Any:
    """The parsed tree with dictionaries for `Pairs`, checked."""
    if depth > MAX_DEPTH:
        raise too_deep("content")
    if isinstance(tree, Pairs):
        return _dictionary(tree, path, depth)
    if isinstance(tree, list):
        return [_plain(item, f"{path}[{index}]", depth + 1) for index, item in enumerate(tree)]
    if isinstance(tree, float) and not math.isfinite(tree):
        raise field_error(path, str(tree), "are finite numbers")
    if isinstance(tree, str) and re.search(r"[\ud800-\udfff]", tree):  # half a character, which UTF-8 can't hold
        raise field_error(path, describe(tree), "is Unicode text")
    return tree


def _dictionary(pairs: Pairs, path: str, depth: int) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if not isinstance(key, str) or not _KEY.fullmatch(key):
            raise field_error(path, f"the key {describe(key)}", "are keys of letters, digits and _")
        own = f"{path}.{key}" if path else key
        if key in result:
            raise field_error(own, "the key twice", "is once")
        result[key] = _plain(value, own, depth + 1)
    return result
