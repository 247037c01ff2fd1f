"""A small valid room as a user writes it: the documentation's example."""

from pathlib import Path

import yaml

TEXT = (Path(__file__).parents[1] / "docs" / "examples" / "room.yaml").read_text()


class _Loader(yaml.SafeLoader):
    """`on` is a text, as in YAML 1.2."""


_Loader.yaml_implicit_resolvers = {
    first: [pair for pair in pairs if pair[0] != "tag:yaml.org,2002:bool" or first in "tTfF"]
    for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def rules(scene):
    """By which drives are judged in a room, and whether clutter counts."""
    assert scene.furniture is not None
    return scene.furniture.drives, scene.furniture.clutter


def content():
    """A copy to change."""
    return yaml.load(TEXT, _Loader)
