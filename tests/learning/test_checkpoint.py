import shutil
import subprocess
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.learning import checkpoint
from basenet_jax.learning.checkpoint import Restored
from tests.learning import toy_training
from tests.learning.toy_training import bits

SMALL = {"w": jnp.arange(6.0).reshape(2, 3), "n": jnp.int32(7)}


def steps(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def restore(directory: Path, like: Any) -> Restored:
    restored = checkpoint.restore_latest(directory, like)
    assert restored is not None
    return restored


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_a_restored_state_is_the_saved_one_to_the_bit(tmp_path: Path, toy_state: toy_training.State) -> None:
    checkpoint.save(tmp_path, 3, toy_state, {"layer": "toy", "interval": 3})
    for like in (toy_state, jax.eval_shape(toy_training.init, jax.random.key(1))):
        restored = restore(tmp_path, like)
        assert bits(restored.state) == bits(toy_state)
        assert restored[1:] == (3, {"layer": "toy", "interval": 3}, [])


def test_a_restored_state_runs_the_program_compiled_before(tmp_path: Path, toy_state: toy_training.State) -> None:
    traces = []

    def program(state: toy_training.State) -> toy_training.State:
        traces.append(1)
        return jax.tree.map(lambda leaf: leaf, state)

    step = jax.jit(program, donate_argnums=0)
    checkpoint.save(tmp_path, 3, toy_state, {})
    step(jax.tree.map(jnp.copy, toy_state))
    for _ in range(2):
        result = step(restore(tmp_path, toy_state).state)  # its buffers are the program's to take
        assert bits(result) == bits(toy_state)
    assert len(traces) == 1


def test_every_kind_of_leaf_comes_back(tmp_path: Path) -> None:
    odd = np.array([np.nan, -0.0, np.inf, 1e-42, np.uint32(0x7FC01234).view(np.float32)], np.float32)
    state = {
        "odd": jnp.array(odd),
        "bool": jnp.array([[True], [False]]),
        "int8": jnp.int8(-3),
        "bfloat16": jnp.array([1.5, -2.0], jnp.bfloat16),
        "empty": jnp.zeros((0, 3), jnp.int32),
        "weak": jnp.broadcast_to(jnp.asarray(2.5), (2,)),
        "keys": jax.random.split(jax.random.key(1, impl="rbg"), (2, 3)),
        "number": 5,
        "nothing": None,
    }
    checkpoint.save(tmp_path, 0, state, {})
    expected = jax.tree.map(jnp.asarray, state)
    restored = restore(tmp_path, state).state
    assert bits(restored) == bits(expected)
    assert restored["keys"].dtype == state["keys"].dtype


def test_devices_are_kept_where_the_expected_state_is_committed(tmp_path: Path) -> None:
    device = jax.devices()[0]
    committed = jax.device_put(SMALL, device)
    checkpoint.save(tmp_path, 0, SMALL, {})
    assert restore(tmp_path, committed).state["w"].committed
    assert not restore(tmp_path, SMALL).state["w"].committed


def test_only_the_newest_stay(tmp_path: Path) -> None:
    for step in range(1, 5):
        assert checkpoint.save(tmp_path, step, SMALL, {}) == tmp_path / f"{step:06d}"
    assert steps(tmp_path) == ["000003", "000004"]
    checkpoint.save(tmp_path, 5, SMALL, {}, keep=1)
    assert steps(tmp_path) == ["000005"]


def test_an_earlier_step_removes_the_later(tmp_path: Path) -> None:
    for step in (1, 9, 5):
        checkpoint.save(tmp_path, step, SMALL, {"step": step})
    assert steps(tmp_path) == ["000001", "000005"]
    assert restore(tmp_path, SMALL).step == 5


def test_the_same_step_is_replaced(tmp_path: Path) -> None:
    checkpoint.save(tmp_path, 1, SMALL, {"try": 1})
    checkpoint.save(tmp_path, 1, SMALL, {"try": 2})
    assert restore(tmp_path, SMALL).metadata == {"try": 2}


def test_leftovers_are_ignored_and_then_removed(tmp_path: Path) -> None:
    checkpoint.save(tmp_path, 1, SMALL, {})
    shutil.copytree(tmp_path / "000001", tmp_path / "000002.partial")
    assert restore(tmp_path, SMALL)[1:] == (1, {}, [])
    checkpoint.save(tmp_path, 2, SMALL, {})
    assert steps(tmp_path) == ["000001", "000002"]


def test_without_checkpoints_there_is_nothing_to_restore(tmp_path: Path) -> None:
    assert checkpoint.restore_latest(tmp_path / "missing", SMALL) is None
    (tmp_path / "000001.partial").mkdir()
    assert checkpoint.restore_latest(tmp_path, SMALL) is None


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs sha256sum")
def test_the_manifest_is_understood_by_sha256sum(tmp_path: Path) -> None:
    folder = checkpoint.save(tmp_path, 1, SMALL, {})
    command = ["sha256sum", "--check", "--strict", "manifest.sha256"]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    assert result.stdout.count(": OK") == len(files_of(folder)) - 1
