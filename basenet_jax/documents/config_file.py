"""Configuration files: settings by their names, nested like the dataclasses; only what differs need be there."""

import dataclasses
import os
from pathlib import Path
from typing import Any, TypeVar

from basenet_jax.documents.fields import DocumentError, describe
from basenet_jax.documents.text_files import read_json, read_yaml
from basenet_jax.settings import SettingError, Settings, checked, hints_of

T = TypeVar("T", bound=Settings)


class ConfigFileError(ValueError):
    """A file that holds no configuration; the message names the file, the field, what was found and what is allowed."""


def load_config(path: str | os.PathLike[str], base: T) -> T:
    """Settings changed by a file, YAML or (by the name's end `.json`) JSON, of at most 64 KiB or 1 MiB.

    Args:
        path: of the file.
        base: what holds where the file says nothing.

    Raises:
        ConfigFileError: the file can't be read, has an unknown key, or a value that isn't allowed.
    """
    return overlay(base, read_config(path), path)


def read_config(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a configuration file says, its fields unchecked.

    Raises:
        ConfigFileError: the file can't be read or isn't a mapping.
    """
    try:
        data = read_json(path) if Path(path).suffix.lower() == ".json" else read_yaml(path)
    except DocumentError as error:
        raise ConfigFileError(f"{path}: {error}") from None
    if not isinstance(data, dict):
        raise ConfigFileError(f"{path}: content: found {describe(data)}, allowed is a mapping of settings")
    return data


def overlay(base: T, data: dict[str, Any], path: str | os.PathLike[str]) -> T:
    """Settings changed by what `read_config` found in a file.

    Raises:
        ConfigFileError: there is an unknown key, or a value that isn't allowed.
    """
    try:
        return _overlay(base, data, "")
    except SettingError as error:
        raise ConfigFileError(f"{path}: {error}") from None


def differences(changed: Settings, base: Settings) -> dict[str, Any]:
    """What a file would have to say to make one of the other; plain values, nested, empty where they are equal."""
    found = {}
    for name in hints_of(type(base)):
        old, new = getattr(base, name), getattr(changed, name)
        if isinstance(old, Settings) and isinstance(new, Settings):
            if inner := differences(new, old):
                found[name] = inner
        elif old != new:
            found[name] = list(new) if isinstance(new, tuple) else new
    return found


def _overlay(base: T, data: dict[str, Any], where: str) -> T:
    hints = hints_of(type(base))
    changes = {}
    for name, value in data.items():
        own = f"{where}{name}"
        if name not in hints:
            raise SettingError(f"{own}: found an unknown key, allowed are {', '.join(hints)}")
        section = getattr(base, name)
        if not isinstance(section, Settings):
            changes[name] = checked(value, hints[name], own, plain=True)
        elif isinstance(value, dict):
            changes[name] = _overlay(section, value, f"{own}.")
        else:
            raise SettingError(f"{own}: found {describe(value)}, allowed is a mapping of its settings")
    try:
        return dataclasses.replace(base, **changes)
    except SettingError as error:  # fields that don't go together
        raise SettingError(where + str(error).removeprefix(f"{type(base).__name__}.")) from None
