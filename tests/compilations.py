"""Counts what JAX compiles in a run of the tests, in every worker, and says at the end what was dearest.

`--compilations FILE` writes all of it as JSON. Processes that tests start are not counted.
"""

import json
import resource
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import pytest

COMPILED = "/jax/core/compile/backend_compile_duration"
BEFORE = ("/jax/core/compile/jaxpr_trace_duration", "/jax/core/compile/jaxpr_to_mlir_module_duration")
FOUND = "/jax/compilation_cache/cache_hits"
SHOWN = 10


class Compilation(NamedTuple):
    """One program that XLA compiled, or that the persistent cache held."""

    program: str
    file: str  # of the test that asked for it
    wall_s: float
    cpu_s: float
    found: bool  # in the persistent cache


class Compilations:
    """Of one process; of all of them in the one that reports."""

    def __init__(self) -> None:
        self.all: list[Compilation] = []
        self.traced_s = 0.0  # tracing and lowering
        self.most_memory_gb = 0.0  # of one process
        self._file = "collection"
        self._own = threading.local()  # programs are compiled in several threads

    def listen(self) -> None:
        """From now on."""
        jax.monitoring.register_event_listener(self._event)
        jax.monitoring.register_scalar_listener(self._began)
        jax.monitoring.register_event_time_span_listener(self._ended)

    def _event(self, event: str, **_: Any) -> None:
        if event == FOUND:
            self._own.found = True

    def _began(self, event: str, value: float, **_: Any) -> None:
        if event == COMPILED:
            self._own.found, self._own.cpu_s = False, time.process_time()
        elif event in BEFORE:
            self._own.depth = getattr(self._own, "depth", 0) + 1

    def _ended(self, event: str, start_time: float, end_time: float, **about: Any) -> None:
        if event == COMPILED:
            cpu_s = time.process_time() - self._own.cpu_s
            wall_s = end_time - start_time
            self.all.append(Compilation(str(about["fun_name"]), self._file, wall_s, cpu_s, self._own.found))
        elif event in BEFORE:
            self._own.depth -= 1
            if not self._own.depth:  # a function that is traced inside another's is part of that one's time
                self.traced_s += end_time - start_time

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Remembers which file's tests run."""
        self._file = nodeid.partition("::")[0]

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Hands a worker's to the process that reports."""
        unit = 1e9 if sys.platform == "darwin" else 1e6  # bytes there, kilobytes elsewhere
        self.most_memory_gb = max(self.most_memory_gb, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit)
        if (output := getattr(session.config, "workeroutput", None)) is not None:
            output["compilations"] = [tuple(each) for each in self.all], self.traced_s, self.most_memory_gb

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Adds a worker's; one that crashed tells nothing."""
        every, traced_s, memory_gb = getattr(node, "workeroutput", {}).get("compilations", ([], 0.0, 0.0))
        self.all += [Compilation(*each) for each in every]
        self.traced_s += traced_s
        self.most_memory_gb = max(self.most_memory_gb, memory_gb)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
        """Says how much was compiled, and what was dearest."""
        if path := config.getoption("--compilations"):
            with open(path, "w") as file:
                json.dump([each._asdict() for each in self.all], file, indent=1)
        compiled, found = ([each for each in self.all if each.found is kind] for kind in (False, True))
        terminalreporter.section("compilations")
        terminalreporter.line(f"compiled by XLA: {_sum(compiled)}; found in the cache: {_sum(found)}")
        terminalreporter.line(
            f"traced and lowered: {self.traced_s:.0f} s; memory of the largest process: {self.most_memory_gb:.1f} GB"
        )
        alike = defaultdict[tuple[str, str], list[float]](list)
        for each in compiled:
            alike[each.program, each.file].append(each.cpu_s)
        for (program, file), cpu_s in sorted(alike.items(), key=lambda item: -sum(item[1]))[:SHOWN]:
            terminalreporter.line(f"{sum(cpu_s):7.1f} s of CPU, {len(cpu_s):3} times: {program} in {file}")


def _sum(compilations: Iterable[Compilation]) -> str:
    every = list(compilations)
    wall_s, cpu_s = sum(each.wall_s for each in every), sum(each.cpu_s for each in every)
    return f"{len(every)} programs in {wall_s:.0f} s, {cpu_s:.0f} s of CPU"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the file to write to."""
    parser.addoption("--compilations", metavar="FILE", help="write what JAX compiled to this file, as JSON")


def pytest_configure(config: pytest.Config) -> None:
    """Begins to count."""
    compilations = Compilations()
    compilations.listen()
    config.pluginmanager.register(compilations, "compilations of this run")
