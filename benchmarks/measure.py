"""Timing: tasks take turns, so that whatever else the machine does hits all of them."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Mapping

Task = Callable[[], float]
"""Does its work once and returns how many seconds of it count."""


def timed(work: Callable[[], object]) -> Task:
    """All of `work` counts."""

    def task() -> float:
        start = time.perf_counter()
        work()
        return time.perf_counter() - start

    return task


def interleave(tasks: Mapping[str, Task], n_repetitions: int) -> dict[str, list[float]]:
    """Run A B C A B C ...; seconds of each task in each round."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(n_repetitions):
        for name, task in tasks.items():
            gc.collect()
            seconds[name].append(task())
    return seconds


def median(values: list[float]) -> float:
    """Median; shorter than the module's name everywhere."""
    return statistics.median(values)


def ratio(numerator: list[float], denominator: list[float]) -> float:
    """Median over the rounds of one time over the other: drift of the machine cancels within a round."""
    return statistics.median(a / b for a, b in zip(numerator, denominator, strict=True))
