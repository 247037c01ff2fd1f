"""Settings of JAX for all tests and the processes they start, made before it is imported."""

import os
from pathlib import Path

# Compiling takes most of the time, so nearly nothing is optimised. Tests that compute for long are faster optimised, by
# a factor of up to seven: `XLA_FLAGS= python -m pytest -m slow`.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true --xla_cpu_use_fusion_emitters=false "
    "--xla_cpu_parallel_codegen_split_count=1",
)
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
