"""Sharing out work, on the one device that tests have: it does nothing; and wrong wishes are refused."""

import jax.numpy as jnp
import pytest

from basenet_jax.devices import ONE_DEVICE, Devices, use_devices


def test_one_device_needs_no_mesh():
    assert use_devices(1) == ONE_DEVICE
    assert ONE_DEVICE.count == 1


def test_on_one_device_it_does_nothing():
    batch = {"a": jnp.arange(4.0)}
    assert ONE_DEVICE.split(batch) is batch
    assert ONE_DEVICE.everywhere(batch) is batch

    def double(x):
        return 2 * x

    assert ONE_DEVICE.apart(double) is double


@pytest.mark.parametrize("count", [0, -1, 4097])
def test_there_must_be_so_many(count):
    with pytest.raises(ValueError, match=f"devices: found {count}, allowed are 1 to"):
        use_devices(count)


def test_batches_must_be_shared_equally():
    class Six(Devices):
        count = 6  # type: ignore[assignment]

    Six().check({"scenes": 12})
    with pytest.raises(ValueError, match="found 6, which don't divide scenes of 8; up to there, 1, 2, 4 do"):
        Six().check({"examples": 12, "scenes": 8})
