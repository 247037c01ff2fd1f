"""The view command: what it refuses before it serves anything, and how it begins and ends."""

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import threading
import urllib.request

import pytest

from basenet_jax import view
from tests.scene_texts import TEXT


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Runs the command in a folder of its own; exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(TEXT)

    def call(*arguments):
        try:
            code = view.main(list(arguments))
        except SystemExit as end:  # tyro ends so on --help and wrong options
            code = end.code
        return code, *capsys.readouterr()

    return call


def test_help_says_what_it_is_for(call):
    code, out, _ = call("--help")
    assert code == 0
    assert all(word in out for word in ("web page", "SCENE", "--host", "127.0.0.1", "--port", "--robot", "Ctrl-C"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.yaml"], "missing.yaml: can't be read"),
        (["scene.yaml", "--planner", "best"], "planner: found 'best', allowed are pbg"),
        (["scene.yaml", "--compare", "worst"], "planner: found 'worst', allowed are pbg"),
        (["scene.yaml", "--robot", "r2d2"], "robot: found 'r2d2', allowed are"),
        (["scene.yaml", "--weights", "none.weights"], "none.weights"),
        (["--objects", "0"], "objects: found 0, allowed are 1 to 50"),
        (["--world", "rooms", "--objects", "0"], "objects: found 0, allowed are 1 to 50"),
        (["--port", "65536"], "--port: found 65536, allowed are 0 to 65535"),
        (["--host", "192.0.2.1"], "--host, --port: found 192.0.2.1 and 0"),
    ],
)
def test_bad_input_is_refused_with_one_message(call, arguments, message):
    code, out, err = call("--port", "0", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"basenet_jax.view: {message}")
    assert err.count("\n") == 1


def test_a_port_in_use_is_refused(call):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        code, _, err = call("--port", port)
    assert code == 2
    assert f"found 127.0.0.1 and {port}, where nothing can be served" in err


def test_without_viser_it_says_what_to_install(call, monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "viser" else find_spec(name))
    assert call() == (2, "", 'basenet_jax.view: viser is not installed: pip install "basenet_jax[viewer]"\n')


@pytest.fixture
def hears_interrupts():
    """A shell's background jobs, and their children, are born deaf to SIGINT: not so in the test of it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_interrupts")
def test_it_serves_until_it_is_interrupted(tmp_path):
    """Also while the planner still compiles."""
    (tmp_path / "scene.yaml").write_text(TEXT)
    process = subprocess.Popen(
        [sys.executable, "-m", "basenet_jax.view", "scene.yaml", "--port", "0", "--planner", "greedy-stops"],
        cwd=tmp_path,
        env=os.environ | {"BASENET_JAX_CACHE": "off"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("basenet_jax.view: http://127.0.0.1:"), process.communicate()
    with urllib.request.urlopen(line.split()[1]) as answer:
        assert b"<html" in answer.read()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert (process.returncode, out, err) == (0, "", "")


class Stub:
    """A viewer that serves nothing."""

    def __init__(self, scene, choices, *, host, port, seed):
        del choices, port, seed
        self.scene = scene
        self.url = f"http://{host}/?token=x"

    def close(self):
        return True


@pytest.mark.parametrize(("host", "warns"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_it_warns_where_others_reach_the_page(call, monkeypatch, host, warns):
    monkeypatch.setattr("basenet_jax.viewer.app.Viewer", Stub)
    monkeypatch.setattr(threading.Event, "wait", interrupt)
    code, out, err = call("scene.yaml", "--planner", "greedy-stops", "--host", host, "--port", "0")
    assert (code, out) == (0, f"basenet_jax.view: http://{host}/?token=x (Ctrl-C ends it)\n")
    assert (f"--host {host}: whoever has this link" in err) is warns


def interrupt(*_):
    raise KeyboardInterrupt
