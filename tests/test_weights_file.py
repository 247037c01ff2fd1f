import hashlib
import pickle
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

from basenet_jax.weights_file import load_weights, save_weights

PARAMS = {
    "layer_0": {"kernel": jnp.arange(6.0).reshape(2, 3), "bias": jnp.array([1.5, -0.0, 3.0], jnp.bfloat16)},
    "heads": [jnp.int32(4), jnp.zeros((0, 2))],
}


def test_weights_and_metadata_come_back_to_the_bit(tmp_path: Path) -> None:
    file = tmp_path / "weights.bin"
    save_weights(file, PARAMS, {"robot": "ur5e_mobile", "seed": 3})
    for like in (PARAMS, jax.eval_shape(lambda: PARAMS)):
        params, metadata = load_weights(file, like)
        assert metadata == {"robot": "ur5e_mobile", "seed": 3}
        assert jax.tree.structure(params) == jax.tree.structure(PARAMS)
        for leaf, expected in zip(jax.tree.leaves(params), jax.tree.leaves(PARAMS), strict=True):
            assert leaf.dtype == expected.dtype
            assert leaf.shape == expected.shape
            assert np.asarray(leaf).tobytes() == np.asarray(expected).tobytes()


def test_one_part_is_read_of_a_file_of_several(tmp_path: Path) -> None:
    own, other = {"kernel": jnp.arange(3.0)}, {"kernel": jnp.arange(4.0)}
    save_weights(tmp_path / "both.weights", {"stop": own, "stops": other}, {"robot": "mine"})
    read, metadata = load_weights(tmp_path / "both.weights", own, part="stop")
    np.testing.assert_array_equal(read["kernel"], own["kernel"])
    assert metadata == {"robot": "mine"}
    with pytest.raises(ValueError, match=r"both\.weights: stops/kernel: found float32 of shape \(4,\)"):
        load_weights(tmp_path / "both.weights", own, part="stops")
    with pytest.raises(ValueError, match=r"both\.weights: sequence/kernel: missing"):
        load_weights(tmp_path / "both.weights", own, part="sequence")


def test_equal_weights_make_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        save_weights(tmp_path / name, PARAMS, {"seed": 3})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_every_flipped_byte_is_found(tmp_path: Path) -> None:
    file = tmp_path / "weights.bin"
    save_weights(file, {"w": jnp.ones(2)}, {})
    whole = file.read_bytes()
    for place in range(len(whole)):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(ValueError, match=r"weights\.bin: (format: found|the file is damaged)"):
            load_weights(file, {"w": jnp.ones(2)})


@pytest.mark.parametrize("length", [0, 5, 20, 60, 100, -1])
def test_a_file_cut_short_is_found(tmp_path: Path, length: int) -> None:
    file = tmp_path / "weights.bin"
    save_weights(file, PARAMS, {})
    file.write_bytes(file.read_bytes()[:length])
    with pytest.raises(ValueError, match=r"weights\.bin: (format: found|the file is damaged or cut short)"):
        load_weights(file, PARAMS)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"weights\.bin: can't be read: No such file or directory"):
        load_weights(tmp_path / "weights.bin", PARAMS)


def test_another_format_is_named(tmp_path: Path) -> None:
    file = tmp_path / "weights.bin"
    save_weights(file, PARAMS, {})
    file.write_bytes(file.read_bytes().replace(b"basenet-weights/1", b"basenet-weights/2", 1))
    with pytest.raises(ValueError, match="format: found 'basenet-weights/2', needs 'basenet-weights/1'"):
        load_weights(file, PARAMS)


@pytest.mark.parametrize(
    ("like", "message"),
    [
        ({"a": jnp.zeros(3), "b": jnp.zeros(1)}, r"a: found float32 of shape \(2,\), needs float32 of \(3,\)"),
        ({"a": jnp.zeros(2, jnp.int32), "b": jnp.zeros(1)}, r"a: found float32 of shape \(2,\), needs int32"),
        ({"a": jnp.zeros(2), "c": jnp.zeros(1)}, r"c: missing \(1 of 2 arrays are\)"),
        ({"a": jnp.zeros(2)}, "b: unknown, the network has no such array"),
    ],
)
def test_weights_of_another_network_are_told_apart(tmp_path: Path, like: Any, message: str) -> None:
    file = tmp_path / "weights.bin"
    save_weights(file, {"a": jnp.zeros(2), "b": jnp.zeros(1)}, {})
    with pytest.raises(ValueError, match=rf"weights\.bin: {message}"):
        load_weights(file, like)


class Bomb:
    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


def forge(file: Path, body: bytes) -> None:
    file.write_bytes(b"basenet-weights/1\n" + hashlib.sha256(body).hexdigest().encode() + b"\n" + body)


def test_reading_a_forged_file_runs_no_code_and_says_what_is_wrong(tmp_path: Path) -> None:
    file, mark = tmp_path / "weights.bin", tmp_path / "mark"
    bomb = pickle.dumps(Bomb(mark))
    array = {"dtype": "float32", "shape": [2], "data": b"too short"}
    for arrays, message in (
        (bomb, "the content is not that of basenet-weights/1: "),
        ({"a": bomb}, "the content is not that of basenet-weights/1: "),
        ({"a": array | {"dtype": "O"}}, "a: found O of shape"),
        ({"a": array | {"shape": [-2]}}, "a: found float32 of shape"),
        ({"a": array}, "a: found 9 bytes for float32 of shape"),
    ):
        forge(file, msgspec.msgpack.encode({"metadata": {}, "arrays": arrays}))
        with pytest.raises(ValueError, match=rf"weights\.bin: {message}"):
            load_weights(file, {"a": jnp.zeros(2)})
    forge(file, bomb)
    with pytest.raises(ValueError, match="the content is not that of"):
        load_weights(file, {"a": jnp.zeros(2)})
    assert not mark.exists()
    pickle.loads(bomb)
    assert mark.exists()  # the bomb was a real one


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e38, -1e13])
def test_numbers_that_no_training_makes_are_refused(tmp_path: Path, number: float) -> None:
    file = tmp_path / "weights.bin"
    save_weights(file, {"w": jnp.array([1.0, number])}, {})
    with pytest.raises(ValueError, match=r"weights\.bin: w: found .*, allowed are finite numbers up to 1e\+12"):
        load_weights(file, {"w": jnp.ones(2)})


def _write(file: Path, body: bytes) -> Path:
    file.write_bytes(f"basenet-weights/1\n{hashlib.sha256(body).hexdigest()}\n".encode() + body)
    return file


DEEP = b"\x82\xa8metadata\x81\xa1a" + b"\x91" * 200_000 + b"\x01\xa6arrays\x80"
BODIES = {
    "deep": (DEEP, "nested too deep"),
    "no text": (b"\x82\xa8metadata\x81\xa1a\xa1\xff\xa6arrays\x80", "the content is not that of basenet-weights/1: "),
    "a long name": (
        b"\x82\xa8metadata\x80\xa6arrays\x81\xdb\x00\x01\x86\xa0" + b"x" * 100_000 + b"\x80",
        "is not that of",
    ),
}


@pytest.mark.parametrize("what", BODIES)
def test_contents_of_another_kind_are_refused_in_a_line(tmp_path: Path, what: str) -> None:
    body, message = BODIES[what]
    with pytest.raises(ValueError, match=message) as caught:
        load_weights(_write(tmp_path / "weights.bin", body), {"w": jnp.ones(2)})
    assert len(str(caught.value)) < 400


def test_an_unknown_name_is_cut_short(tmp_path: Path) -> None:
    save_weights(tmp_path / "long", {"w": jnp.ones(2), "x" * 100_000: jnp.ones(2)}, {})
    with pytest.raises(ValueError, match=r"x\.\.\.: unknown, the network has no such array") as caught:
        load_weights(tmp_path / "long", {"w": jnp.ones(2)})
    assert len(str(caught.value)) < 400


def test_an_endless_file_is_left_after_its_first_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="zero: format: found"):
        load_weights("/dev/zero", {"w": jnp.ones(2)})
