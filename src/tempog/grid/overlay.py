"""Kernel that makes one history of a cell out of several that overlap in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

NEVER_AGAIN = 2**31 - 1


@kernel
def overlay(
    cell: NDArray[np.int32],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    tolerance: np.float32,
    out_cell: NDArray[np.int32],
    out_first: NDArray[np.int32],
    out_last: NDArray[np.int32],
    out_value: NDArray[np.float32],
) -> int:
    """Where intervals of a cell overlap, the one that began later counts while it lasts; returns how many come out.

    One that is interrupted so goes on afterwards, as an interval of its own. Those that overlap and agree to within
    `tolerance` become one, of the value of the earlier.

    cell, first, last, value (n,)   sorted by cell, then first; of those that begin together, the last one wins
    out_* (2 n,)                    [written]
    """
    n, n_out = cell.shape[0], 0
    waiting_last = np.empty(64, dtype=np.int32)
    waiting_value = np.empty(64, dtype=np.float32)
    k = 0
    while k < n:
        of = cell[k]
        since, until, state = first[k], last[k], value[k]
        depth = 0
        k += 1
        going_on = True
        while going_on:
            begins = first[k] if k < n and cell[k] == of else np.int32(NEVER_AGAIN)
            while going_on and until < begins:
                out_cell[n_out], out_first[n_out], out_last[n_out], out_value[n_out] = of, since, until, state
                n_out += 1
                since = until + np.int32(1)
                while depth > 0 and waiting_last[depth - 1] < since:
                    depth -= 1
                going_on = depth > 0
                if going_on:
                    depth -= 1
                    until, state = waiting_last[depth], waiting_value[depth]
            if begins == NEVER_AGAIN:
                break
            if not going_on:
                since, until, state = first[k], last[k], value[k]
                going_on = True
            elif abs(value[k] - state) <= tolerance:
                until = max(until, last[k])
            else:
                if begins > since:
                    out_cell[n_out], out_first[n_out], out_last[n_out] = of, since, begins - np.int32(1)
                    out_value[n_out] = state
                    n_out += 1
                if until > last[k]:
                    if depth == waiting_last.shape[0]:
                        longer_last = np.empty(2 * depth, dtype=np.int32)
                        longer_value = np.empty(2 * depth, dtype=np.float32)
                        longer_last[:depth], longer_value[:depth] = waiting_last, waiting_value
                        waiting_last, waiting_value = longer_last, longer_value
                    waiting_last[depth], waiting_value[depth] = until, state
                    depth += 1
                since, until, state = begins, last[k], value[k]
            k += 1
    return n_out
