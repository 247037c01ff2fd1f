"""From plain data to typed structs, with errors that name the field, what was found and what is allowed."""

import json
import re
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec
import numpy as np

T = TypeVar("T")


class DocumentError(ValueError):
    """What is wrong with a file: where in it, what was found, what is allowed."""


def field_error(path: str, found: str, allowed: str) -> DocumentError:
    """The error of one field.

    Args:
        path: of the field, such as `objects[3].pose[1]`; empty for the whole content.
        found: what is there.
        allowed: begins with "is" or "are".
    """
    return DocumentError(f"{path or 'content'}: found {found}, allowed {allowed}")


def describe(value: Any) -> str:
    """A value in at most 60 characters, for messages."""
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    text = repr(value)
    if isinstance(value, list | dict) and len(text) > 60:
        return f"a {'list' if isinstance(value, list) else 'mapping'} of {len(value)}"
    return text if len(text) <= 60 else f"{text[:57]}..."


def shortest(value: Any) -> Any:
    """A number or an array of them as Python numbers: the shortest decimals that give back the same float32.

    Raises:
        ValueError: a value is infinite or no number, which JSON can't hold.
    """
    values = np.asarray(value)
    if not np.all(np.isfinite(values)):
        raise ValueError(f"found {describe(values.tolist())}, allowed are finite numbers")
    if values.ndim:
        return [shortest(item) for item in values]
    return float(str(values)) if np.issubdtype(values.dtype, np.floating) else values.item()


def convert(data: Any, kind: type[T], *, format_name: str | None, allowed: Mapping[str, str]) -> T:
    """A document as a msgspec struct.

    Args:
        data: of `read_yaml` or `read_json`.
        kind: the struct; all mappings in it are structs, and none holds a `Literal` (whose errors would quote the
            file).
        format_name: what the document's `format` must be; None for documents of others' making, which have none.
        allowed: what each field may be, as in `field_error`, by its path with `[]` for any index; a field that isn't
            listed has its parent's.

    Raises:
        DocumentError: the data is not of that kind.
    """
    if not isinstance(data, dict):
        raise field_error("", describe(data), f"is a mapping with {', '.join(_children('', allowed))}")
    if format_name is not None and data.get("format") != format_name:
        found = describe(data["format"]) if "format" in data else "nothing"
        raise field_error("format", found, allowed["format"])
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        raise _translate(str(error), data, allowed) from None


_MESSAGE = re.compile(r"(?P<what>.*?)(?: - at `\$\.?(?P<path>[^`]*)`)?", re.DOTALL)
_FIELD = re.compile(r"Object (?P<how>missing required|contains unknown) field `(?P<name>[^`]*)`")


def _translate(message: str, data: Any, allowed: Mapping[str, str]) -> DocumentError:
    """msgspec's message says where; what is there is looked up, and what is allowed is in the table."""
    match = _MESSAGE.fullmatch(message)
    assert match is not None
    path = match["path"] or ""
    if field := _FIELD.fullmatch(match["what"]):
        own = f"{path}.{field['name']}" if path else field["name"]
        if field["how"] == "contains unknown":
            return field_error(own, "an unknown key", f"are {', '.join(_children(path, allowed))}")
        return field_error(own, "nothing", _look_up(own, allowed))
    value = data
    for index, key in re.findall(r"\[(\d+)\]|([^.\[\]]+)", path):
        value = value[int(index)] if index else value[key]
    return field_error(path, describe(value), _look_up(path, allowed))


def _general(path: str) -> str:
    return re.sub(r"\[\d+\]", "[]", path)


def _look_up(path: str, allowed: Mapping[str, str]) -> str:
    general = _general(path)
    while general not in allowed:
        general = re.sub(r"(\[\]|\.?[^.\[\]]+)$", "", general)
    return allowed[general]


def _children(path: str, allowed: Mapping[str, str]) -> list[str]:
    """The keys that a mapping may have."""
    prefix = f"{_general(path)}." if path else ""
    rest = (name.removeprefix(prefix) for name in allowed if name.startswith(prefix))
    return [name for name in rest if re.fullmatch(r"[^.\[\]]+", name)]
