"""The package's face: every public name loads, and importing the package loads nothing heavy."""

import subprocess
import sys

import pytest

import basenet_jax
from basenet_jax import api


@pytest.mark.parametrize("name", basenet_jax.__all__)
def test_every_public_name_is_there_and_documented(name):
    assert getattr(basenet_jax, name).__doc__
    assert name in dir(basenet_jax)


def test_the_table_of_modules_has_every_public_name():
    assert sorted(basenet_jax._MODULES) == sorted(basenet_jax.__all__)


def test_the_front_door_is_the_short_one():
    """`execute` and `plot_plan` take scene and plan; what takes the robot too stays in its module."""
    assert basenet_jax.execute is api.execute
    assert basenet_jax.plot_plan is api.plot_plan
    assert basenet_jax.make_plan is api.make_plan


@pytest.mark.parametrize("command", ["train", "evaluate", "plan", "generate"])
def test_no_public_name_is_a_command(command):
    assert command not in basenet_jax.__all__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'plan_everything'"):
        _ = basenet_jax.plan_everything


def test_importing_the_package_imports_no_jax():
    code = "import sys, basenet_jax; sys.exit(any(name in sys.modules for name in ('jax', 'mujoco', 'brax')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
