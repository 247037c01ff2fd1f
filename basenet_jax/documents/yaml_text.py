"""YAML as plain data: the core schema of YAML 1.2, the one that agrees with JSON.

So `1e-3` is a number, while `no`, `1:30` and dates are text. Anchors, aliases and tags are refused.
"""

import re
from typing import Any, ClassVar

import yaml

from basenet_jax.documents.fields import DocumentError

MAX_DEPTH = 16


class Pairs(list):
    """A mapping as a list of its keys and values, in which repeated keys are still to be seen."""


def read_integer(text: str) -> int | float:
    """Long integers become floats: Python takes quadratic time for them, and refuses very long ones."""
    return int(text) if len(text) <= 16 else float(text)


def too_deep(where: str) -> DocumentError:
    """The error of a document that is nested too deeply."""
    return DocumentError(f"{where}: found more than {MAX_DEPTH} levels of nesting, allowed are up to {MAX_DEPTH}")


def parse_yaml(text: str) -> Any:
    """The text's lists, `Pairs`, texts, numbers, truth values and nulls.

    Raises:
        DocumentError: the text is no YAML, or YAML beyond plain data; the message names the line.
    """
    try:
        return _node_value(_Loader(text).get_single_node())
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}" if mark else "content"
        raise DocumentError(f"{where}: no YAML: {error.problem or error.context}") from None
    except yaml.reader.ReaderError as error:
        found = f"the character 0x{error.character:02x} at offset {error.position}"
        raise DocumentError(f"content: found {found}, allowed is text") from None


def to_yaml(data: dict[str, Any]) -> bytes:
    """Plain data as YAML that `parse_yaml` reads back."""
    return yaml.dump(
        data, Dumper=_Dumper, encoding="utf-8", sort_keys=False, allow_unicode=True, width=1000, default_flow_style=None
    )


class _Loader(yaml.SafeLoader):
    """Composes nested sequences and mappings, and nothing of what else YAML offers."""

    yaml_implicit_resolvers: ClassVar = {}
    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event: Any = self.peek_event()
        line = event.start_mark.line + 1
        if event.anchor is not None:
            raise DocumentError(f"line {line}: found the anchor or alias {event.anchor!r}, allowed is YAML without")
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise too_deep(f"line {line}")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


class _Dumper(yaml.SafeDumper):
    """Quotes every text that YAML 1.1 or 1.2 would take for something else, and writes no anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True


_SCHEMA = (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+", list("-+0123456789")),
    ("float", r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ("float", r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", list("-+.")),
)
for _name, _pattern, _first in _SCHEMA:
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_name}", re.compile(f"(?:{_pattern})$"), _first)

_READERS = {
    "null": lambda text: None,
    "bool": lambda text: {"true": True, "false": False}[text.lower()],
    "int": read_integer,
    "float": lambda text: float(text.lower().replace(".inf", "inf").replace(".nan", "nan")),
    "str": str,
}


def _node_value(node: Any) -> Any:
    if node is None:
        return None
    kind = node.tag.removeprefix("tag:yaml.org,2002:")
    if isinstance(node, yaml.SequenceNode) and kind == "seq":
        return [_node_value(child) for child in node.value]
    if isinstance(node, yaml.MappingNode) and kind == "map":
        return Pairs((_node_value(key), _node_value(value)) for key, value in node.value)
    line = node.start_mark.line + 1
    if not isinstance(node, yaml.ScalarNode) or kind not in _READERS:
        raise DocumentError(f"line {line}: found the tag {node.tag[:60]!r}, allowed is YAML without tags")
    try:
        return _READERS[kind](node.value)
    except (ValueError, KeyError):
        found = f"{node.value[:60]!r} tagged as {kind}"
        raise DocumentError(f"line {line}: found {found}, allowed is YAML without tags") from None
