"""Work on many things at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
U = TypeVar("U")


def in_threads(work: Callable[[T], U], items: Iterable[T]) -> list[U]:
    """``[work(item) for item in items]``, on all cores this process may use; kernels let others run."""
    chosen = list(items)
    n_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if min(n_cores, len(chosen)) < 2:
        return [work(item) for item in chosen]
    with ThreadPoolExecutor(n_cores) as pool:
        return list(pool.map(work, chosen))
