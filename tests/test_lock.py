"""`uv.lock` is of the dependencies that the package has now, and names no package host but the public one."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]


def described(name, extras, specifier, marker):
    """A requirement in one form, whoever wrote it."""
    return name, tuple(sorted(extras)), SpecifierSet(specifier), " ".join(marker.replace('"', "'").split())


def wanted():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = {None: project["dependencies"], **project["optional-dependencies"]}
    for extra, lines in groups.items():
        for each in map(Requirement, lines):
            marker = str(each.marker or "").replace("python_version", "python_full_version")
            parts = [part for part in (marker, f"extra == '{extra}'" if extra else "") if part]
            yield described(each.name.lower(), each.extras, str(each.specifier), " and ".join(parts))


def test_the_lock_is_of_the_dependencies_that_are_declared():
    packages = tomllib.loads((ROOT / "uv.lock").read_text())["package"]
    [own] = [each["metadata"]["requires-dist"] for each in packages if each["name"] == "basenet-jax"]
    found = [described(x["name"], x.get("extras", ()), x.get("specifier", ""), x.get("marker", "")) for x in own]
    key = str
    assert sorted(found, key=key) == sorted(wanted(), key=key), "pyproject.toml has changed: make lock"


def test_the_lock_names_public_hosts_alone():
    hosts = set(re.findall(r"https?://([^/\"]+)", (ROOT / "uv.lock").read_text()))
    assert hosts == {"pypi.org", "files.pythonhosted.org"}
