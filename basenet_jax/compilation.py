"""JAX's persistent compilation cache, so that a program compiles once per machine and not once per run."""

import os
from pathlib import Path

import jax


def cache_folder() -> Path | None:
    """`basenet_jax` of the user's cache folder; None where `BASENET_JAX_CACHE` is `off`."""
    if os.environ.get("BASENET_JAX_CACHE") == "off":
        return None
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "basenet_jax"


def enable_cache() -> None:
    """Keeps compiled programs in `basenet_jax` of the user's cache folder.

    Nothing is changed where JAX was told of a cache already (`JAX_COMPILATION_CACHE_DIR`), and nothing is cached where
    `BASENET_JAX_CACHE` is `off`.
    """
    folder = cache_folder()
    if getattr(jax.config, "jax_compilation_cache_dir", None) or folder is None:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
