import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from basenet_jax.trigonometry import atan2, sin_cos, wrap_angle

# The bounds that the docstrings promise.
SIN_COS, ATAN2 = 2e-7, 4e-7


def test_sine_and_cosine_in_float32():
    angle = np.concatenate(
        [np.linspace(-100.0, 100.0, 400_001), np.arange(-60, 61) * np.pi / 2, np.arange(-60, 61) * np.pi / 4]
    ).astype(np.float32)
    sine, cosine = jax.jit(sin_cos)(angle)
    assert sine.dtype == cosine.dtype == jnp.float32
    assert np.max(np.abs(sine - np.sin(angle.astype(float)))) < SIN_COS
    assert np.max(np.abs(cosine - np.cos(angle.astype(float)))) < SIN_COS


def test_small_angles_keep_their_relative_accuracy():
    angle = np.geomspace(1e-30, 1e-2, 1000).astype(np.float32)
    sine, _ = sin_cos(angle)
    np.testing.assert_allclose(sine, np.sin(angle.astype(float)), rtol=2e-7)


def test_arctangent_in_float32():
    rng = np.random.default_rng(0)
    direction = rng.uniform(-np.pi, np.pi, 400_000)
    length = 10.0 ** rng.uniform(-15, 15, direction.size)
    y, x = (length * np.sin(direction)).astype(np.float32), (length * np.cos(direction)).astype(np.float32)
    angle = jax.jit(atan2)(y, x)
    assert angle.dtype == jnp.float32
    assert np.max(np.abs(angle - np.arctan2(y.astype(float), x.astype(float)))) < ATAN2


@pytest.mark.parametrize("length", [1e-30, 1.0, 1e30])
def test_arctangent_along_axes_and_diagonals(length):
    y, x = (np.array(v, np.float32) * np.float32(length) for v in ([0, 1, 1, 1, 0, -1, -1, -1], [1, 1, 0, -1] * 2))
    x = np.where(np.arange(8) < 4, x, -x)
    np.testing.assert_allclose(atan2(y, x), np.arctan2(y.astype(float), x), atol=ATAN2)


def test_arctangent_of_nothing_is_zero():
    assert atan2(jnp.float32(0.0), jnp.float32(0.0)) == 0.0


def test_double_precision_passes_through():
    with jax.enable_x64(True):
        angle = jnp.linspace(-50.0, 50.0, 1001)
        assert angle.dtype == jnp.float64
        sine, cosine = sin_cos(angle)
        # One rounding of float64 each: libraries may differ in the last bit.
        np.testing.assert_allclose(sine, np.sin(angle), atol=3e-16)
        np.testing.assert_allclose(cosine, np.cos(angle), atol=3e-16)
        np.testing.assert_allclose(atan2(sine, cosine), np.arctan2(np.sin(angle), np.cos(angle)), atol=1e-15)
        # 100 rad is known to 1.4e-14; the split constant of wrap_angle, made for float32, must not lose more.
        wrapped = wrap_angle(angle)
        np.testing.assert_allclose(np.exp(1j * np.asarray(wrapped)), np.exp(1j * np.asarray(angle)), atol=3e-14)


@given(angle=st.floats(-100.0, 100.0, width=32))
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = float(wrap_angle(jnp.float32(angle)))
    assert abs(wrapped) <= np.pi + 1e-6
    # 16 turns of float32's pi.
    assert abs(np.exp(1j * wrapped) - np.exp(1j * angle)) < 2e-6


def test_derivatives_are_those_of_the_functions():
    """Policies are trained through them: polynomials of float32 accuracy have derivatives of about 1e-6."""
    angle = jnp.linspace(-7.0, 7.0, 500)
    slope = jax.vmap(jax.grad(lambda a: sin_cos(a)[0]))(angle)
    np.testing.assert_allclose(slope, np.cos(angle), atol=3e-6)
    slope = jax.vmap(jax.grad(lambda a: atan2(jnp.sin(a), jnp.cos(a))))(angle)
    np.testing.assert_allclose(slope, 1.0, atol=1e-5)
