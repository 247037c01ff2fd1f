"""Programs that outlive the process."""

import functools
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache

from basenet_jax import cache_files, compilation
from basenet_jax.compilation import Stored, together

MINIMUM = "jax_persistent_cache_min_compile_time_secs"
X = np.linspace(0.0, 1.0, 5, dtype=np.float32)


def scaled_sine(x, *, factor):
    return {"sine": jnp.sin(factor * x), "sum": jnp.sum(x)}


@pytest.fixture
def folder(tmp_path):
    """JAX's cache in an empty folder."""
    before = {name: getattr(jax.config, name) for name in ("jax_compilation_cache_dir", MINIMUM)}
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    jax.config.update(MINIMUM, 0.0)
    compilation_cache.reset_cache()
    yield tmp_path
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


def new():
    return Stored(scaled_sine, static=("factor",))


def only_stored():
    """As in a new process, which must not compile."""

    def lower(*_, **__):
        raise LookupError

    stored = new()
    stored._jitted = functools.update_wrapper(cast(Any, SimpleNamespace(lower=lower)), scaled_sine)
    return stored


def check(result, factor=2.0):
    np.testing.assert_allclose(result["sine"], np.sin(factor * X), rtol=1e-6)
    assert float(result["sum"]) == pytest.approx(2.5)


def test_a_program_is_stored_once_and_used_by_the_next_process(folder):
    stored = new()
    for _ in range(2):
        check(stored(X, factor=2.0))
    assert stored.count == 1
    assert len(list((folder / "programs").iterdir())) == 1
    check(only_stored()(X, factor=2.0))


def test_a_program_may_be_made_ready_before_it_is_called(folder):
    stored = new()
    together(functools.partial(stored.prepare, X, factor=2.0), functools.partial(stored.prepare, X, factor=3.0))
    assert stored.count == 2
    check(only_stored()(X, factor=3.0), 3.0)


def test_what_jax_had_cached_before_is_stored_whole(folder):
    """XLA's executables lose their code when they are read from JAX's cache and written again."""
    jax.clear_caches()
    jax.jit(scaled_sine, static_argnames="factor").lower(X, factor=2.0).compile()
    assert list(folder.glob("*scaled_sine*cache"))
    jax.clear_caches()
    new()(X, factor=2.0)
    check(only_stored()(X, factor=2.0))
    assert jax.config.values["jax_compilation_cache_dir"] == str(folder)


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-9], lambda data: b"", lambda data: data[:40] + b"x" + data[41:]]
)
def test_a_damaged_program_is_made_again(folder, damage):
    check(new()(X, factor=2.0))
    (file,) = (folder / "programs").iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    with pytest.raises(LookupError):
        only_stored()(X, factor=2.0)
    check(new()(X, factor=2.0))
    check(only_stored()(X, factor=2.0))


def test_another_shape_setting_source_or_processor_is_another_program(folder, monkeypatch):
    check(new()(X, factor=2.0))
    for x, factor in ((X[:4], 2.0), (X, 3.0), (X.astype(np.int32), 2.0)):
        with pytest.raises(LookupError):
            only_stored()(x, factor=factor)
    for what in ("source_digest", "_processor"):
        with monkeypatch.context() as patch:
            patch.setattr(compilation, what, lambda: "another")
            with pytest.raises(LookupError):
                only_stored()(X, factor=2.0)


def test_few_programs_are_kept_those_used_last(folder, monkeypatch):
    monkeypatch.setattr(cache_files, "KEPT", 2)
    stored = new()
    for factor in (1.0, 2.0, 3.0):
        stored(X, factor=factor)
    assert len(list((folder / "programs").iterdir())) == 2
    check(only_stored()(X, factor=3.0), 3.0)


def test_where_nothing_can_be_stored_it_works_without(folder):
    (folder / "programs").write_text("in the way")
    check(new()(X, factor=2.0))


def test_without_a_home_nothing_is_stored(monkeypatch):
    def none():
        raise RuntimeError("Could not determine home directory.")

    for name in ("XDG_CACHE_HOME", "BASENET_JAX_CACHE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", none)
    assert compilation.cache_folder() is None


def test_a_folder_that_can_only_be_read_serves_what_it_has(folder, monkeypatch):
    check(new()(X, factor=2.0))

    def refuse(*_, **__):
        raise PermissionError

    monkeypatch.setattr(cache_files.os, "utime", refuse)
    check(only_stored()(X, factor=2.0))


def test_under_transformations_it_is_the_function_itself():
    stored = new()
    check(jax.jit(lambda x: stored(x, factor=2.0))(X))
    slope = jax.grad(lambda x: stored(x, factor=2.0)["sine"].sum())(jnp.asarray(X))
    np.testing.assert_allclose(slope, 2.0 * np.cos(2.0 * X), rtol=1e-6)
    assert stored.count == 0


def test_what_a_preparation_raises_is_raised():
    def fail():
        raise ValueError("no such scene")

    with pytest.raises(ValueError, match="no such scene"):
        together(lambda: None, fail)
