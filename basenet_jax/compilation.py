"""Compiled programs that outlive the process: JAX's cache of what XLA compiled, and whole programs of our own.

JAX's cache spares a new process compiling, but not tracing and lowering, which take as long again. `Stored` spares all
of it for the few programs that a user waits for at every start.
"""

import concurrent.futures
import functools
import hashlib
import os
import pickle
import platform
import threading
import zlib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from jax.core import Tracer

from basenet_jax.cache_files import keep, read_kept

_SETTINGS = ("enable_x64", "default_matmul_precision", "threefry_partitionable")  # of JAX, that programs depend on
_COMPILED = "/jax/core/compile/backend_compile_duration"  # JAX's event for a program compiled, or found in its cache


def programs_of_this_thread() -> int:
    """How many programs this thread has had to compile or to load so far: two counts tell whether a call had to."""
    return getattr(_thread, "programs", 0)


_thread = threading.local()


def _count_program(event: str = _COMPILED, *_: Any, **__: Any) -> None:
    if event == _COMPILED:
        _thread.programs = programs_of_this_thread() + 1


jax.monitoring.register_event_duration_secs_listener(_count_program)


def cache_folder() -> Path | None:
    """`basenet_jax` of the user's cache folder; None where `BASENET_JAX_CACHE` is `off`, or the user has no home."""
    if os.environ.get("BASENET_JAX_CACHE") == "off":
        return None
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "basenet_jax"
    except RuntimeError:  # in a container, say: neither HOME nor an entry in the list of users
        return None


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


class Stored:
    """A jitted function of arrays on one device, whose programs are kept in memory and in the folder of JAX's cache.

    Called under a transformation, or where there are several devices, it is the jitted function itself. A stored
    program is used only by the very source, versions, kind of device and settings that it was made by; what is damaged
    or doesn't load is made again. Like JAX's own cache, the folder is trusted: it is the user's.
    """

    def __init__(self, function: Callable[..., Any], *, static: tuple[str, ...] = ()):
        """Of a function of pytrees of arrays, and of hashable settings whose `repr` says all about them.

        Args:
            function: pure.
            static: the names of its parameters that are settings; they are passed by name.
        """
        functools.update_wrapper(self, function)
        self._jitted: Any = jax.jit(function, static_argnames=static)
        self._programs: dict[Any, Callable[..., Any]] = {}
        self._lock = threading.Lock()

    def __call__(self, *arrays: Any, **settings: Any) -> Any:
        """The function's result."""
        leaves, structure = jax.tree.flatten(arrays)
        if jax.device_count() > 1 or any(isinstance(leaf, Tracer) for leaf in leaves):
            return self._jitted(*arrays, **settings)
        return self._program(arrays, settings, leaves, structure)(*arrays)

    def prepare(self, *arrays: Any, **settings: Any) -> None:
        """Has the program for arrays like these ready, without running it."""
        leaves, structure = jax.tree.flatten(arrays)
        self._program(arrays, settings, leaves, structure)

    @property
    def count(self) -> int:
        """How many programs it has in memory: one for each shape and setting that it was called with."""
        return len(self._programs)

    def _program(self, arrays: tuple, settings: dict[str, Any], leaves: list, structure: Any) -> Callable[..., Any]:
        shapes = [(leaf.shape, leaf.dtype) for leaf in leaves]
        key = (structure, *shapes, *settings.items(), _setting("enable_x64"))
        program = self._programs.get(key)
        if program is None:
            with self._lock:
                program = self._programs.get(key) or self._load_or_compile(arrays, settings, f"{structure} {shapes}")
                self._programs[key] = program
        return program

    def _load_or_compile(self, arrays: tuple, settings: dict[str, Any], shapes: str) -> Callable[..., Any]:
        from jax.experimental import serialize_executable  # most of what compiles is not stored

        path = self._path(settings, shapes)
        stored = None if path is None else _read(path)
        if stored is not None:
            _count_program()
            try:
                return serialize_executable.deserialize_and_load(*stored)
            except (RuntimeError, ValueError, TypeError, pickle.UnpicklingError):
                pass  # of a compiler that can't read it
        lowered = self._jitted.lower(*arrays, **settings)
        if path is None:
            return lowered.compile()
        with _anew:
            compiled = lowered.compile()
        _write(path, serialize_executable.serialize(compiled))
        return compiled

    def _path(self, settings: dict[str, Any], shapes: str) -> Path | None:
        folder = _anew.folder
        if not folder:
            return None
        what = (_circumstances(), self._jitted.__module__, self._jitted.__qualname__, repr(settings), shapes)
        name = hashlib.sha256("\n".join(what).encode()).hexdigest()
        return Path(folder) / "programs" / f"{self._jitted.__name__}-{name}"


class _Anew:
    """While anybody is inside, JAX's cache is off: what XLA has read from it loses its code when it is written again.

    What else compiles meanwhile isn't cached then, which does no harm.
    """

    def __init__(self):
        self._lock, self._inside, self._folder = threading.Lock(), 0, None

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._folder = _setting("compilation_cache_dir")
                self._switch(None)
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._switch(self._folder)

    @property
    def folder(self) -> str | None:
        """That of JAX's cache, if it has one."""
        with self._lock:
            return self._folder if self._inside else _setting("compilation_cache_dir")

    @staticmethod
    def _switch(folder: str | None) -> None:
        from jax.experimental.compilation_cache import compilation_cache

        jax.config.update("jax_compilation_cache_dir", folder)
        compilation_cache.reset_cache()


_anew = _Anew()


def together(*preparations: Callable[[], object]) -> None:
    """Runs preparations side by side: XLA compiles each on a core of its own."""
    with concurrent.futures.ThreadPoolExecutor(max(len(preparations), 1)) as pool:
        for done in [pool.submit(each) for each in preparations]:
            done.result()


def _setting(name: str) -> Any:
    return getattr(jax.config, f"jax_{name}")


def _circumstances() -> str:
    """All that compiled code depends on beside its function and arguments."""
    device = jax.devices()[0]
    settings = [_setting(name) for name in _SETTINGS]
    own = [source_digest(), jax.__version__, version("jaxlib"), device.platform, device.device_kind, jax.device_count()]
    return repr([*own, *settings, os.environ.get("XLA_FLAGS"), _processor()])


@functools.cache
def source_digest() -> str:
    """A digest of the package's source."""
    digest, root = hashlib.sha256(), Path(__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


@functools.cache
def _processor() -> str:
    """The processor, with what its instruction set has, where the system says."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text().splitlines() if facts.exists() else []
    told = sorted({line for line in lines if line.startswith(("flags", "Features", "model name"))})
    return "\n".join([platform.machine(), platform.processor(), *told])


def _read(path: Path) -> tuple[Any, Any, Any] | None:
    """What was stored; None where nothing is, or where it is damaged."""
    packed = read_kept(path)
    return None if packed is None else pickle.loads(zlib.decompress(packed))


def _write(path: Path, program: tuple[Any, Any, Any]) -> None:
    keep(path, zlib.compress(pickle.dumps(program), level=1))
