"""A backend is chosen before MuJoCo is imported: the user's, or the first that draws."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from basenet_jax import offscreen
from basenet_jax.offscreen import RenderError, choose_backend


@pytest.fixture
def working(monkeypatch):
    """Backends that draw here; MuJoCo is not imported yet, on Linux."""
    names = set()

    def run(command, env, **_):
        return SimpleNamespace(returncode=env["MUJOCO_GL"] not in names)

    monkeypatch.setattr(offscreen.subprocess, "run", run)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.setenv("MUJOCO_GL", "")
    return names


@pytest.mark.parametrize(("these", "chosen"), [({"egl", "osmesa"}, "egl"), ({"osmesa"}, "osmesa")])
def test_the_first_that_draws_is_taken(working, these, chosen):
    working |= these
    choose_backend()
    assert os.environ["MUJOCO_GL"] == chosen


def test_the_users_choice_goes_first(working, monkeypatch):
    working |= {"egl", "osmesa"}
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    choose_backend()
    assert os.environ["MUJOCO_GL"] == "osmesa"


def test_a_choice_that_does_not_draw_is_named(working, monkeypatch):
    working |= {"osmesa"}
    monkeypatch.setenv("MUJOCO_GL", "glx")
    with pytest.raises(RenderError, match="can't draw with MUJOCO_GL=glx"):
        choose_backend()


def test_without_any_the_message_says_what_to_install(working):
    with pytest.raises(RenderError, match="libegl1 or libosmesa6"):
        choose_backend()
    assert os.environ["MUJOCO_GL"] == ""


def test_it_is_too_late_once_mujoco_is_there(working, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    choose_backend()
    assert os.environ["MUJOCO_GL"] == ""


def test_a_real_probe_notices_a_backend_that_is_none():
    code = "from basenet_jax.offscreen import choose_backend\nchoose_backend()"
    environment = os.environ | {"MUJOCO_GL": "disable"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "can't draw with MUJOCO_GL=disable" in done.stderr
