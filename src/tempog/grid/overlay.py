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
    out_cell: NDArray[np.int32],
    out_first: NDArray[np.int32],
    out_last: NDArray[np.int32],
    out_value: NDArray[np.float32],
) -> int:
    """Where intervals of a cell overlap, the one that began later counts while it lasts; returns how many come out.

    One that is interrupted so goes on afterwards, as an interval of its own. Where one takes over from another that
    says the same while either still lasts, both are one interval. So what comes out of a period depends only on the
    intervals that reach into it.

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
        going_on = False
        while (k < n and cell[k] == of) or going_on:
            begins = first[k] if k < n and cell[k] == of else np.int32(NEVER_AGAIN)
            while going_on and until < begins:
                while depth > 0 and waiting_last[depth - 1] <= until:
                    depth -= 1
                going_on = depth > 0
                if not going_on or waiting_value[depth - 1] != state:
                    out_cell[n_out], out_first[n_out], out_last[n_out], out_value[n_out] = of, since, until, state
                    n_out += 1
                    since = until + np.int32(1)
                if going_on:
                    depth -= 1
                    until, state = waiting_last[depth], waiting_value[depth]
            if begins == NEVER_AGAIN:
                break
            went_on, before = going_on, state
            while k < n and cell[k] == of and first[k] == begins:
                if going_on and value[k] == state:
                    until = max(until, last[k])
                else:
                    if going_on and until > last[k]:
                        if depth == waiting_last.shape[0]:
                            longer_last = np.empty(2 * depth, dtype=np.int32)
                            longer_value = np.empty(2 * depth, dtype=np.float32)
                            longer_last[:depth], longer_value[:depth] = waiting_last, waiting_value
                            waiting_last, waiting_value = longer_last, longer_value
                        waiting_last[depth], waiting_value[depth] = until, state
                        depth += 1
                    until, state, going_on = last[k], value[k], True
                k += 1
            if went_on and state != before and begins > since:
                out_cell[n_out], out_first[n_out], out_last[n_out] = of, since, begins - np.int32(1)
                out_value[n_out] = before
                n_out += 1
            if not went_on or state != before:
                since = begins
    return n_out
