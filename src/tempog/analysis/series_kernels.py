"""Kernels over the time series of chosen cells: merges of sorted lists of intervals that do not overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel


@kernel
def pair_distances(
    offsets: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    value: NDArray[np.float32],
    left: NDArray[np.int64],
    right: NDArray[np.int64],
    p: float,
    occupied_above: float,
    integral: NDArray[np.float64],
    common_ns: NDArray[np.int64],
    either_ns: NDArray[np.int64],
) -> None:
    """For each pair of series: the integral of |difference|**p over the time both were seen, and that time.

    left, right (n_pairs,) which series; intervals of series i are at ``offsets[i]:offsets[i + 1]``
    integral (n_pairs,) seconds   [written]
    common_ns, either_ns (n_pairs,) time both were seen; that of it in which either was occupied   [written]
    """
    for k in range(left.shape[0]):
        a, a_end = offsets[left[k]], offsets[left[k] + 1]
        b, b_end = offsets[right[k]], offsets[right[k] + 1]
        total = 0.0
        common = 0
        either = 0
        while a < a_end and b < b_end:
            lasted = min(stop_ns[a], stop_ns[b]) - max(start_ns[a], start_ns[b])
            if lasted > 0:
                common += lasted
                if max(value[a], value[b]) > occupied_above:
                    either += lasted
                total += abs(np.float64(value[a]) - np.float64(value[b])) ** p * (lasted * 1e-9)
            if stop_ns[a] <= stop_ns[b]:
                a += 1
            else:
                b += 1
        integral[k] = total
        common_ns[k] = common
        either_ns[k] = either


@kernel
def connect(left: NDArray[np.int64], right: NDArray[np.int64], parent: NDArray[np.int64]) -> None:
    """Union-find: afterwards ``parent[i]`` is the smallest member of the component that i belongs to.

    parent (n,) 0, 1, 2, ...   [updated]
    """
    for k in range(left.shape[0]):
        a, b = left[k], right[k]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        while parent[b] != b:
            parent[b] = parent[parent[b]]
            b = parent[b]
        if a < b:
            parent[b] = a
        else:
            parent[a] = b
    for i in range(parent.shape[0]):  # a parent comes before its children, so it is settled already
        parent[i] = parent[parent[i]]


@kernel
def intersect(
    a_start: NDArray[np.int64],
    a_stop: NDArray[np.int64],
    a_state: NDArray[np.int64],
    b_start: NDArray[np.int64],
    b_stop: NDArray[np.int64],
    b_state: NDArray[np.int64],
    start: NDArray[np.int64],
    stop: NDArray[np.int64],
    state: NDArray[np.int64],
) -> int:
    """Where both series were seen, with the bits of both states; returns how many periods that are.

    start, stop, state (capacity,)   [written]; capacity >= len(a) + len(b)
    """
    i, j, n = 0, 0, 0
    while i < a_start.shape[0] and j < b_start.shape[0]:
        since, until = max(a_start[i], b_start[j]), min(a_stop[i], b_stop[j])
        if since < until:
            start[n], stop[n], state[n] = since, until, a_state[i] | b_state[j]
            n += 1
        if a_stop[i] <= b_stop[j]:
            i += 1
        else:
            j += 1
    return n


@kernel
def count_periods(
    at: NDArray[np.int64],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    since: int,
    until: int,
    n_periods: NDArray[np.int64],
) -> None:
    """Add how many intervals of each chosen cell were seen by the scans since..until.

    at (n,)          which of one set's cells each chosen cell is, or -1
    n_periods (n,)   [updated]
    """
    for i in range(at.shape[0]):
        if at[i] >= 0:
            for k in range(offsets[at[i]], offsets[at[i] + 1]):
                n_periods[i] += first[k] <= until and last[k] >= since


@kernel
def append_periods(
    at: NDArray[np.int64],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    since: int,
    until: int,
    stamps_ns: NDArray[np.int64],
    look_ns: int,
    begin: NDArray[np.int64],
    next_place: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    out_value: NDArray[np.float32],
) -> None:
    """Write the intervals that `count_periods` counted as periods, clipped to the scans since..until.

    A period lasts until `look_ns` after the last look, or until the cell's next one begins.
    begin, next_place (n,) where each cell's periods begin; where its next one goes   [next_place updated]
    start_ns, stop_ns, out_value (n_periods,)   [written]
    """
    for i in range(at.shape[0]):
        if at[i] < 0:
            continue
        place = next_place[i]
        for k in range(offsets[at[i]], offsets[at[i] + 1]):
            if first[k] <= until and last[k] >= since:
                start_ns[place] = stamps_ns[max(first[k], since)]
                stop_ns[place] = stamps_ns[min(last[k], until)] + look_ns
                out_value[place] = value[k]
                if place > begin[i]:
                    stop_ns[place - 1] = min(stop_ns[place - 1], start_ns[place])
                place += 1
        next_place[i] = place


@kernel
def cut_out(
    at: NDArray[np.int64],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    since: int,
    until: int,
    stamps_ns: NDArray[np.int64],
    chunk_bits: int,
    out_offsets: NDArray[np.int64],
    out_first: NDArray[np.int32],
    out_last: NDArray[np.int32],
    out_value: NDArray[np.float32],
    steps: NDArray[np.int32],
) -> None:
    """Copy the intervals that `count_periods` counted, clipped to the scans since..until; note which scans they need.

    out_offsets (n + 1,)   where each cell's intervals go; all counted
    steps (n_chunks + 1,)  of chunks of ``2**chunk_bits`` scans: its running sum is how many intervals need each one,
                           for a scan they hold or another of the same stamp   [updated]
    """
    for i in range(at.shape[0]):
        if at[i] < 0:
            continue
        place = out_offsets[i]
        for k in range(offsets[at[i]], offsets[at[i] + 1]):
            if first[k] <= until and last[k] >= since:
                begin, end = max(first[k], since), min(last[k], until)
                out_first[place], out_last[place], out_value[place] = begin, end, value[k]
                place += 1
                while begin > 0 and stamps_ns[begin - 1] == stamps_ns[begin]:
                    begin -= 1
                while end + 1 < stamps_ns.shape[0] and stamps_ns[end + 1] == stamps_ns[end]:
                    end += 1
                steps[begin >> chunk_bits] += 1
                steps[(end >> chunk_bits) + 1] -= 1
