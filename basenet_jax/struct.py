"""Frozen dataclasses that are pytrees, by JAX's own registration: plans without a network then need no network library.

Used as `flax.struct` is: `@struct.dataclass`, and `struct.field(pytree_node=False)` for what is static.
"""

import dataclasses
from typing import Any, TypeVar, dataclass_transform

import jax

_Class = TypeVar("_Class")


def field(*, pytree_node: bool = True, **options: Any) -> Any:
    """A field of `dataclass`; one that is no pytree node is static: hashable, a part of what programs are made for."""
    return dataclasses.field(metadata={"static": not pytree_node}, **options)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def dataclass(cls: type[_Class]) -> type[_Class]:
    """Makes a class a frozen dataclass and a pytree of its fields, with `dataclasses.replace` as a method."""
    made: Any = dataclasses.dataclass(frozen=True)(cls)
    made.replace = dataclasses.replace
    fields: tuple[dataclasses.Field[Any], ...] = dataclasses.fields(made)
    static = {each.name: each.metadata.get("static", False) for each in fields}
    data, meta = ([name for name, is_static in static.items() if is_static == wanted] for wanted in (False, True))
    return jax.tree_util.register_dataclass(made, data_fields=data, meta_fields=meta)
