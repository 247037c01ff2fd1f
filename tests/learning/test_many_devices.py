"""Learning and planning on many devices, or in two processes, come to what one device comes to."""

import functools
import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PROGRAM = Path(__file__).with_name("many_devices.py")
# Sums over a batch are taken in another order.
RELATIVE, ABSOLUTE = 1e-4, 1e-5
LEARNERS = ("sac", *(pytest.param(name, marks=pytest.mark.slow) for name in ("reinforce", "stops")))
PLANNERS = ("basenet-paper", pytest.param("basenet", marks=pytest.mark.slow))


def start(count: int | str, *names: str, devices: int) -> subprocess.Popen[str]:
    """The program, in a process that has so many devices."""
    flags = re.sub(r"--xla_force_host_platform_device_count=\d+", "", os.environ.get("XLA_FLAGS", ""))
    flags += f" --xla_force_host_platform_device_count={devices}"
    environment = os.environ | {"XLA_FLAGS": flags.strip()}
    command = [sys.executable, str(PROGRAM), str(count), *names]
    return subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def result(process: subprocess.Popen[str], name: str) -> Any:
    """What the program printed, once it has ended well."""
    out, error = process.communicate()
    assert process.returncode == 0, error
    return json.loads(out.splitlines()[-1])[name]


@functools.cache
def one_device(name: str) -> Any:
    """What one device comes to."""
    return result(start(1, name, devices=1), name)


@pytest.mark.parametrize("learner", LEARNERS)
def test_eight_devices_learn_what_one_does(learner):
    eight, expected = start(8, learner, devices=8), one_device(learner)
    found = result(eight, learner)
    assert (found["on"], expected["on"]) == (8, 1)
    assert_close(found, expected)


@pytest.mark.parametrize("planner", PLANNERS)
def test_eight_devices_plan_what_one_does(planner):
    eight, plans = start(8, planner, devices=8), one_device(planner)
    for found, expected in zip(result(eight, planner), plans, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("learner", ["sac", "reinforce", "stops"])
def test_two_processes_learn_what_one_does(learner):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    both = [start(f"{port}:{index}", learner, devices=4) for index in (0, 1)]
    first, second = (result(process, learner) for process in both)
    assert first == second
    assert first["on"] == 8
    assert_close(first, one_device(learner))


def assert_close(found: dict[str, Any], expected: dict[str, Any]) -> None:
    assert found["whole copies"]
    assert found["metrics"].keys() == expected["metrics"].keys()
    for name, value in expected["metrics"].items():
        np.testing.assert_allclose(found["metrics"][name], value, RELATIVE, ABSOLUTE, err_msg=name)
    for leaf, other in zip(found["learned"], expected["learned"], strict=True):
        np.testing.assert_allclose(leaf, other, RELATIVE, ABSOLUTE)
