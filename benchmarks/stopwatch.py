"""Time spent in functions of tempog while something else is measured."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any


@dataclass
class Lap:
    """Calls of one function so far."""

    n_calls: int = 0
    seconds: float = 0.0
    n: int = 0


class Stopwatch(defaultdict[str, Lap]):
    """A `Lap` per name of a function."""

    def __init__(self) -> None:
        super().__init__(Lap)


@contextmanager
def watched(watch: Stopwatch, owner: Any, name: str, n_of: Callable[[Any], int] | None = None) -> Iterator[None]:
    """Time the function `name` of a module or class while this lasts; `n_of` says what to count of its result."""
    function = getattr(owner, name)

    @wraps(function)
    def timed(*arguments: Any, **named: Any) -> Any:
        start = time.perf_counter()
        result = function(*arguments, **named)
        lap = watch[name]
        lap.seconds += time.perf_counter() - start
        lap.n_calls += 1
        lap.n += n_of(result) if n_of else 0
        return result

    setattr(owner, name, timed)
    try:
        yield
    finally:
        setattr(owner, name, function)
