"""The one place that sets how kernels are compiled. Importing it imports Numba, which takes about a second."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile a loop over arrays: releases the GIL, and is cached on disk between runs.

    Kernels that call each other share a file: Numba's cache notices edits only in the file it compiles.
    """
    return cast(F, numba.njit(nogil=True, cache=True, error_model="numpy")(function))
