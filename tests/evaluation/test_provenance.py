"""What is recorded of a run names no machine and no absolute path."""

import hashlib
import platform

import pytest

from basenet_jax.evaluation.provenance import command, hardware, versions, weights_fingerprint


def test_a_command_keeps_only_the_names_of_absolute_paths(tmp_path):
    out = tmp_path / "results"
    arguments = ["--out", str(out), f"--weights={out}/a.weights", "--planners", "dp", "--scene-dir", "scenes/ten"]
    text = command("basenet_jax.evaluate", arguments)
    expected = "--out results --weights=a.weights --planners dp --scene-dir scenes/ten"
    assert text == f"python -m basenet_jax.evaluate {expected}"


def test_hardware_and_versions_are_there_and_the_host_is_not():
    assert {"cpu", "cores", "accelerator", "system"} == set(hardware())
    assert {"python", "jax", "mujoco", "basenet_jax"} <= set(versions())
    if len(node := platform.node()) > 4:
        assert node not in str(hardware())


def test_weights_are_known_by_name_and_hash(tmp_path):
    file = tmp_path / "mine.weights"
    file.write_bytes(b"numbers")
    assert weights_fingerprint(file) == {"file": "mine.weights", "sha256": hashlib.sha256(b"numbers").hexdigest()}
    assert weights_fingerprint(None)["file"] == "packaged default.weights"
    with pytest.raises(ValueError, match=r"none\.weights: can't be read: No such file"):
        weights_fingerprint(tmp_path / "none.weights")
