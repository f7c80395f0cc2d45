"""Where the time of integrate() goes, kernel by kernel."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import logs
from ingest import integrate
from logs import BenchLog
from report import Row, Section

from tempog.config import Evidence
from tempog.grid import segments, temporal_grid
from tempog.sensing import evidence, raycast

MODULES = (raycast, evidence, temporal_grid, segments)  # where integrate() finds its kernels


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """One section per evidence, for the first log."""
    log = logs.load(names[0], n_scans)
    evidences: tuple[Evidence, ...] = ("literal", "surface")
    return [_section(log, evidence, n_repetitions) for evidence in evidences]


def _section(log: BenchLog, evidence: Evidence, n_repetitions: int) -> Section:
    integrate(log, evidence)  # warm-up
    runs = [_kernel_seconds(log, evidence) for _ in range(n_repetitions)]
    total, seconds = sorted(runs, key=lambda run: run[0])[len(runs) // 2]
    section = Section(f"Where the time goes: {log.name}, {evidence}")
    per_scan = 1e6 / len(log.scans)
    for name, spent in sorted(seconds.items(), key=lambda item: -item[1]):
        share = 100 * spent / total
        section.rows.append(Row(name, f"{spent * per_scan:.1f} us/scan", value=share, unit="%"))
    rest = total - sum(seconds.values())
    ours = f"{rest * per_scan:.1f} us/scan"
    section.rows.append(Row("Python and NumPy between kernels", ours, value=100 * rest / total, unit="%"))
    section.notes.append("The median run; taking the time of each kernel costs about a microsecond of the rest.")
    return section


def _kernel_seconds(log: BenchLog, evidence: Evidence) -> tuple[float, dict[str, float]]:
    """Seconds of a whole run, and of each kernel in it."""
    seconds: dict[str, float] = defaultdict(float)
    with _timed_kernels(seconds):
        start = time.perf_counter()
        integrate(log, evidence)
        return time.perf_counter() - start, seconds


@contextmanager
def _timed_kernels(seconds: dict[str, float]) -> Iterator[None]:
    originals = {
        (module, name): value
        for module in MODULES
        for name, value in vars(module).items()
        if hasattr(value, "py_func")  # compiled by Numba
    }
    try:
        for (module, name), original in originals.items():
            setattr(module, name, _timed(original, name, seconds))
        yield
    finally:
        for (module, name), original in originals.items():
            setattr(module, name, original)


def _timed(kernel: Callable[..., Any], name: str, seconds: dict[str, float]) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        start = time.perf_counter()
        answer = kernel(*arguments)
        seconds[name] += time.perf_counter() - start
        return answer

    return call
