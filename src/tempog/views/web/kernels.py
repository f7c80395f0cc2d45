"""Kernels of the tiles: a block's intervals in pixels' order, four pixels made one, and states looked up in them.

A block is a square of 256 x 256 pixels. Its pixels are numbered along the Z-order curve: bits of row and col in turn.
So the four pixels that become one at the next zoom have numbers 4 i to 4 i + 3, and a block of the next zoom is
its four quarters one after the other. Lists of intervals belong to pixels as in `Runs`: those of pixel i are at
``offsets[i]:offsets[i + 1]``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

NOTHING, FREE, OCCUPIED = 0, 1, 2  # states of a pixel; of several, the largest counts
NEVER = -1  # instead of a scan


@kernel
def count_intervals(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    tiles: NDArray[np.int32],
    pixels: NDArray[np.int32],
    places: NDArray[np.int64],
) -> None:
    """Add the intervals of each cell of some tiles to ``places[pixel + 1]``.

    tiles (n,)        numbers of the block's tiles, ascending
    pixels (n, 64)    number of the pixel of each of their cells
    """
    n = cells.shape[0]
    for j in range(tiles.shape[0]):
        low, high = 0, n
        wanted = tiles[j] << 6
        while low < high:
            middle = (low + high) >> 1
            if cells[middle] < wanted:
                low = middle + 1
            else:
                high = middle
        while low < n and cells[low] >> 6 == tiles[j]:
            places[pixels[j, cells[low] & 63] + 1] += offsets[low + 1] - offsets[low]
            low += 1


@kernel
def take_intervals(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    tiles: NDArray[np.int32],
    pixels: NDArray[np.int32],
    occupied_above: float,
    places: NDArray[np.int64],
    out_first: NDArray[np.int32],
    out_last: NDArray[np.int32],
    out_state: NDArray[np.uint8],
) -> None:
    """Copy the intervals of some tiles to ``places[pixel]``, and move these on   [all written].

    tiles, pixels     as in `count_intervals`
    """
    n = cells.shape[0]
    for j in range(tiles.shape[0]):
        low, high = 0, n
        wanted = tiles[j] << 6
        while low < high:
            middle = (low + high) >> 1
            if cells[middle] < wanted:
                low = middle + 1
            else:
                high = middle
        while low < n and cells[low] >> 6 == tiles[j]:
            pixel = pixels[j, cells[low] & 63]
            to = places[pixel]
            for k in range(offsets[low], offsets[low + 1]):
                out_first[to], out_last[to] = first[k], last[k]
                out_state[to] = OCCUPIED if value[k] > occupied_above else FREE
                to += 1
            places[pixel] = to
            low += 1


@kernel
def pool_largest(
    offsets: NDArray[np.int32],
    since: NDArray[np.int32],
    value: NDArray[Any],
    least: int,
    out_offsets: NDArray[np.int32],
    out_since: NDArray[np.int32],
    out_value: NDArray[Any],
) -> int:
    """Of each four pixels' values the largest, as a list of changes; returns how many there are.

    least             the value of a pixel before its first change: NOTHING of states, NEVER of scans
    out_offsets (n / 4 + 1,), out_since and out_value of room for all changes   [written]
    """
    n_out = 0
    at = np.empty(4, dtype=np.int64)
    now = np.empty(4, dtype=value.dtype)
    out_offsets[0] = 0
    for i in range(out_offsets.shape[0] - 1):
        for q in range(4):
            at[q], now[q] = offsets[4 * i + q], least
        before = least
        while True:
            scan = 2**31 - 1
            for q in range(4):
                if at[q] < offsets[4 * i + q + 1] and since[at[q]] < scan:
                    scan = since[at[q]]
            if scan == 2**31 - 1:
                break
            most = least
            for q in range(4):
                while at[q] < offsets[4 * i + q + 1] and since[at[q]] == scan:
                    now[q] = value[at[q]]
                    at[q] += 1
                most = max(most, now[q])
            if most != before:
                out_since[n_out], out_value[n_out] = scan, most
                n_out += 1
                before = most
        out_offsets[i + 1] = n_out
    return n_out


@kernel
def pool_looks(
    offsets: NDArray[np.int32],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    out_offsets: NDArray[np.int32],
    out_first: NDArray[np.int32],
    out_last: NDArray[np.int32],
) -> int:
    """The periods in which any of each four pixels was seen; returns how many there are.

    out_offsets (n / 4 + 1,), out_first and out_last of room for all periods   [written]
    """
    n_out = 0
    at = np.empty(4, dtype=np.int64)
    out_offsets[0] = 0
    for i in range(out_offsets.shape[0] - 1):
        for q in range(4):
            at[q] = offsets[4 * i + q]
        begin = n_out
        while True:
            scan, which = 2**31 - 1, -1
            for q in range(4):
                if at[q] < offsets[4 * i + q + 1] and first[at[q]] < scan:
                    scan, which = first[at[q]], q
            if which == -1:
                break
            until = last[at[which]]
            at[which] += 1
            if n_out > begin and scan <= out_last[n_out - 1]:
                out_last[n_out - 1] = max(out_last[n_out - 1], until)
            else:
                out_first[n_out], out_last[n_out] = scan, until
                n_out += 1
        out_offsets[i + 1] = n_out
    return n_out


@kernel
def last_looks_while_occupied(
    offsets: NDArray[np.int32],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    state: NDArray[np.uint8],
    out_offsets: NDArray[np.int32],
    out_since: NDArray[np.int32],
    out_last: NDArray[np.int32],
) -> int:
    """From which scan on each pixel was seen occupied last at which scan, or NEVER; returns how many there are.

    out_offsets (n + 1,), out_since and out_last of room for all intervals   [written]
    """
    n_out = 0
    out_offsets[0] = 0
    for i in range(out_offsets.shape[0] - 1):
        before = NEVER
        for k in range(offsets[i], offsets[i + 1]):
            now = last[k] if state[k] == OCCUPIED else NEVER
            if now != before:
                out_since[n_out], out_last[n_out] = first[k], now
                n_out += 1
                before = now
        out_offsets[i + 1] = n_out
    return n_out


@kernel
def mark_occupied(
    offsets: NDArray[np.int32],
    since: NDArray[np.int32],
    last: NDArray[np.int32],
    until: int,
    oldest: int,
    places: NDArray[np.int32],
    out: NDArray[np.uint8],
) -> None:
    """OCCUPIED for each pixel that is so at scan `until`, and was seen so since scan `oldest`   [written]."""
    for i in range(offsets.shape[0] - 1):
        begin = offsets[i]
        low, high = begin, offsets[i + 1]
        while low < high:
            middle = (low + high) >> 1
            if since[np.uint64(middle)] <= until:
                low = middle + 1
            else:
                high = middle
        if low > begin and last[np.uint64(low - 1)] >= oldest:
            out[places[i]] = OCCUPIED


@kernel
def states_at(
    offsets: NDArray[np.int32],
    since: NDArray[np.int32],
    state: NDArray[np.uint8],
    until: int,
    places: NDArray[np.int32],
    out: NDArray[np.uint8],
) -> None:
    """Each pixel's last known state at scan `until`, at its place in `out`   [written where there is one]."""
    for i in range(offsets.shape[0] - 1):
        begin = offsets[i]
        low, high = begin, offsets[i + 1]
        while low < high:
            middle = (low + high) >> 1
            if since[np.uint64(middle)] <= until:
                low = middle + 1
            else:
                high = middle
        if low > begin:
            out[places[i]] = state[np.uint64(low - 1)]


@kernel
def held_states_at(
    offsets: NDArray[np.int32],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    state: NDArray[np.uint8],
    until: int,
    oldest: int,
    places: NDArray[np.int32],
    out: NDArray[np.uint8],
) -> None:
    """Each pixel's state at scan `until` if it was seen since scan `oldest`, at its place in `out`   [written]."""
    for i in range(offsets.shape[0] - 1):
        begin = offsets[i]
        low, high = begin, offsets[i + 1]
        while low < high:
            middle = (low + high) >> 1
            if first[np.uint64(middle)] <= until:
                low = middle + 1
            else:
                high = middle
        if low > begin and last[np.uint64(low - 1)] >= oldest:
            out[places[i]] = state[np.uint64(low - 1)]


@kernel
def ages_at(
    offsets: NDArray[np.int32],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    until: int,
    oldest: int,
    since: NDArray[np.int32],
    places: NDArray[np.int32],
    out: NDArray[np.uint8],
) -> None:
    """The class of each pixel's age at scan `until`, from 1 on, at its place in `out`   [written where it was seen].

    oldest            what was seen last before this scan stays as it is
    since (n,)        scans, descending: a pixel seen last at scan `since[k]` or later is of class k + 1 at most
    """
    n_classes = since.shape[0]
    for i in range(offsets.shape[0] - 1):
        begin = offsets[i]
        low, high = begin, offsets[i + 1]
        while low < high:
            middle = (low + high) >> 1
            if first[np.uint64(middle)] <= until:
                low = middle + 1
            else:
                high = middle
        if low > begin:
            seen = last[np.uint64(low - 1)]
            if seen >= oldest:
                k, top = 0, n_classes
                while k < top:
                    middle = (k + top) >> 1
                    if since[middle] > seen:
                        k = middle + 1
                    else:
                        top = middle
                out[places[i]] = k + 1


@kernel
def packed(codes: NDArray[np.uint8], bits: int, out: NDArray[np.uint8]) -> None:
    """Rows of pixels as a PNG has them: a byte that says "not filtered", then several pixels to a byte   [written].

    codes (n_rows, n_cols), out (n_rows, 1 + n_cols * bits / 8)
    """
    per_byte = 8 // bits
    for row in range(codes.shape[0]):
        out[row, 0] = 0
        for k in range(out.shape[1] - 1):
            byte = 0
            for q in range(per_byte):
                byte = byte << bits | codes[row, k * per_byte + q]
            out[row, 1 + k] = byte


@kernel
def newest_looks(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    last: NDArray[np.int32],
    block_of_tile: NDArray[np.int32],
    newest: NDArray[np.int32],
) -> None:
    """The latest scan that saw any cell of each block   [updated]."""
    for i in range(cells.shape[0]):
        block = block_of_tile[cells[i] >> 6]
        seen = last[offsets[i + 1] - 1]
        if seen > newest[block]:
            newest[block] = seen


@kernel
def count_changes(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    value: NDArray[np.float32],
    occupied_above: float,
    state: NDArray[np.uint8],
    counts: NDArray[np.int64],
) -> None:
    """How many cells were found in another state than before, at each scan   [updated, as is each cell's state]."""
    for i in range(cells.shape[0]):
        before = state[cells[i]]
        for k in range(offsets[i], offsets[i + 1]):
            now = OCCUPIED if value[k] > occupied_above else FREE
            if before != NOTHING and now != before:
                counts[first[k]] += 1
            before = now
        state[cells[i]] = before
