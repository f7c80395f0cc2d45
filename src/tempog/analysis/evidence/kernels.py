"""Kernels over time series of cells: smoothed states, and how much evidence there is for what.

Arrays in, arrays out. The periods of series i are at ``offsets[i]:offsets[i + 1]`` of `start_ns`, `stop_ns`, and of
`value` or `state`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

SATURATED = 38.0  # times `worth_s`: a stretch that lasted so long counts for 1, to the last bit


@kernel
def smooth_states(
    offsets: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    value: NDArray[np.float32],
    look_ns: int,
    occupied_above: float,
    for_hit: float,
    for_free: float,
    max_looks: float,
    errors_last_s: float,
    dwell_s: float,
    state: NDArray[np.uint8],
) -> None:
    """The likeliest course of each cell's two-state hidden Markov model (Viterbi 1967), a state per interval.

    for_hit, for_free   log-likelihood ratio, occupied against free, of one look that hits or passes
    max_looks           an interval counts for at most so many independent looks,
    errors_last_s       or for one per so many seconds, if that is more
    dwell_s             mean time that a cell keeps a state
    state (n_periods,)  1 occupied, 0 free   [written]
    """
    n_series = offsets.shape[0] - 1
    longest = 0
    for i in range(n_series):
        longest = max(longest, offsets[i + 1] - offsets[i])
    came_from = np.zeros((longest + 1, 2), dtype=np.uint8)
    for i in range(n_series):
        first, end = offsets[i], offsets[i + 1]
        ahead = 0.0  # by how much the likeliest course that ends occupied is ahead of the one that ends free; log
        for k in range(first, end):
            lasted_ns = stop_ns[k] - start_ns[k]
            looks = min(lasted_ns / look_ns, max(max_looks, lasted_ns * 1e-9 / errors_last_s))
            gain = looks * (for_hit if value[k] > occupied_above else for_free)
            if k > first:
                # The other course can switch: so none is farther ahead than a switch is less likely than staying.
                between_s = (max(start_ns[k] - stop_ns[k - 1], 0) + look_ns) * 1e-9
                kept = math.exp(-2.0 * between_s / dwell_s)
                switch = math.log(max(1.0 - kept, 1e-300) / (1.0 + kept))
                came_from[k - first, 0] = ahead > -switch
                came_from[k - first, 1] = ahead >= switch
                ahead = min(max(ahead, switch), -switch)
            ahead += gain
        best = np.uint8(ahead > 0.0)
        for k in range(end - 1, first - 1, -1):
            state[k] = best
            if k > first:
                best = came_from[k - first, best]


@kernel
def state_evidence(
    offsets: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    state: NDArray[np.uint8],
    worth_s: float,
    evidence: NDArray[np.float64],
    seconds: NDArray[np.float64],
) -> None:
    """For each series, what speaks for its having been free [0] and occupied [1].

    Each stretch of one state, however long the gaps in it, adds ``1 - exp(-observed / worth_s)``.
    evidence, seconds (n_series, 2)   [updated]
    """
    for i in range(offsets.shape[0] - 1):
        current, lasted = -1, 0.0
        for k in range(offsets[i], offsets[i + 1]):
            observed_s = (stop_ns[k] - start_ns[k]) * 1e-9
            seconds[i, state[k]] += observed_s
            if state[k] != current:
                if current >= 0:
                    evidence[i, current] += 1.0 - math.exp(-lasted / worth_s)
                current, lasted = int(state[k]), 0.0
            lasted += observed_s
        if current >= 0:
            evidence[i, current] += 1.0 - math.exp(-lasted / worth_s)


@kernel
def joint_evidence(
    offsets: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    state: NDArray[np.uint8],
    left: NDArray[np.int64],
    right: NDArray[np.int64],
    worth_s: float,
    evidence: NDArray[np.float64],
) -> None:
    """For each pair of series, what speaks for each joint state: both free, right only, left only, both occupied.

    As `state_evidence`, over the time in which both were seen.
    left, right (n_pairs,) which series; evidence (n_pairs, 4)   [updated]
    """
    one = np.uint64(1)
    enough_ns = SATURATED * worth_s * 1e9
    last_ns = np.empty_like(stop_ns)  # when the stretch of one state that a period is part of ends
    for i in range(offsets.shape[0] - 1):
        for k in range(offsets[i + 1] - 1, offsets[i] - 1, -1):
            goes_on = k + 1 < offsets[i + 1] and state[k + 1] == state[k]
            last_ns[k] = last_ns[k + 1] if goes_on else stop_ns[k]
    for pair in range(left.shape[0]):
        # Unsigned: an index that may be negative costs a check, in the loop where most time goes.
        a, a_end = np.uint64(offsets[left[pair]]), np.uint64(offsets[left[pair] + 1])
        b, b_end = np.uint64(offsets[right[pair]]), np.uint64(offsets[right[pair] + 1])
        current, lasted_ns = -1, 0
        while a < a_end and b < b_end:
            common_ns = min(stop_ns[a], stop_ns[b]) - max(start_ns[a], start_ns[b])
            if common_ns > 0:
                joint = 2 * int(state[a]) + int(state[b])
                if joint != current:
                    if current >= 0:
                        evidence[pair, current] += 1.0 - math.exp(-1e-9 * lasted_ns / worth_s)
                    current, lasted_ns = joint, 0
                lasted_ns += common_ns
                if lasted_ns > enough_ns:
                    end_ns = min(last_ns[a], last_ns[b])
                    while a < a_end and stop_ns[a] <= end_ns:
                        a += one
                    while b < b_end and stop_ns[b] <= end_ns:
                        b += one
                    continue
            first = np.uint64(stop_ns[a] <= stop_ns[b])
            a += first
            b += one - first
        if current >= 0:
            evidence[pair, current] += 1.0 - math.exp(-1e-9 * lasted_ns / worth_s)


@kernel
def joint_stretches(
    start_a_ns: NDArray[np.int64],
    stop_a_ns: NDArray[np.int64],
    state_a: NDArray[np.uint8],
    start_b_ns: NDArray[np.int64],
    stop_b_ns: NDArray[np.int64],
    state_b: NDArray[np.uint8],
    worth_s: float,
    one_at_a_time: bool,
    evidence: NDArray[np.float64],
) -> None:
    """Evidence for the joint states of two places from their periods; for the rules see `joint_periods`.

    evidence (2, 2)   [updated]
    """
    n_a, n_b = start_a_ns.shape[0], start_b_ns.shape[0]
    a, b, left, right, lasted_ns = 0, 0, -1, -1, np.int64(0)
    if n_a == 0 or n_b == 0:
        return
    since = min(start_a_ns[0], start_b_ns[0])
    while a < n_a and b < n_b:
        seen_a, seen_b = start_a_ns[a] <= since, start_b_ns[b] <= since
        until = min(stop_a_ns[a] if seen_a else start_a_ns[a], stop_b_ns[b] if seen_b else start_b_ns[b])
        known_a = seen_a or (a > 0 and state_a[a - 1] == state_a[a])
        known_b = seen_b or (b > 0 and state_b[b - 1] == state_b[b])
        against = state_a[a] + state_b[b] == 2 if one_at_a_time else state_a[a] != state_b[b]
        if known_a and known_b and ((seen_a and seen_b) or not against):
            if state_a[a] != left or state_b[b] != right:
                if lasted_ns > 0:
                    evidence[left, right] += 1.0 - math.exp(-1e-9 * lasted_ns / worth_s)
                left, right, lasted_ns = int(state_a[a]), int(state_b[b]), np.int64(0)
            lasted_ns += until - since
        since = until
        a += int(stop_a_ns[a] <= since)
        b += int(stop_b_ns[b] <= since)
    if lasted_ns > 0:
        evidence[left, right] += 1.0 - math.exp(-1e-9 * lasted_ns / worth_s)


@kernel
def sweep_group(
    order: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    state: NDArray[np.uint8],
    least_seen: float,
    periods: NDArray[np.int64],
    stays: NDArray[np.int64],
    seconds: NDArray[np.float64],
) -> tuple[int, int]:
    """The course of a group: what most of its cells say while enough of them are seen; returns how many of each.

    order (2 n,)                   sorts the n starts of periods of any of the cells, followed by their n stops
    least_seen                     so many cells are enough
    periods (3, capacity)          start, stop, state, without a gap in any   [written]
    stays (3, capacity)            the same of stretches of one state, gaps and all   [written]
    seconds (2, capacity)          for how long each stay was seen, and that times the share of cells that agreed
    """
    n = start_ns.shape[0]
    seen, hit, n_periods, n_stays, since = 0, 0, 0, 0, np.int64(0)
    for i in range(order.shape[0]):
        starts = order[i] < n
        k = order[i] if starts else order[i] - n
        at = start_ns[k] if starts else stop_ns[k]
        if at > since and seen >= least_seen:
            occupied = np.int64(2 * hit > seen)
            touches = n_periods > 0 and periods[1, n_periods - 1] == since
            if not touches or periods[2, n_periods - 1] != occupied:
                periods[0, n_periods], periods[2, n_periods] = since, occupied
                n_periods += 1
            periods[1, n_periods - 1] = at
            if n_stays == 0 or stays[2, n_stays - 1] != occupied:
                stays[0, n_stays], stays[2, n_stays] = since, occupied
                seconds[0, n_stays] = seconds[1, n_stays] = 0.0
                n_stays += 1
            stays[1, n_stays - 1] = at
            lasted_s = (at - since) * 1e-9
            seconds[0, n_stays - 1] += lasted_s
            seconds[1, n_stays - 1] += lasted_s * (hit if occupied else seen - hit) / seen
        since = at
        change = 1 if starts else -1
        seen += change
        hit += change * state[k]
    return n_periods, n_stays


@kernel
def seconds_during(
    offsets: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    state: NDArray[np.uint8],
    which: NDArray[np.int64],
    since_ns: NDArray[np.int64],
    until_ns: NDArray[np.int64],
    seconds: NDArray[np.float64],
) -> None:
    """For how long each of some series was free, and occupied, within some spells.

    which (n,) series; since_ns, until_ns (n_spells,) in time order, without overlap; seconds (n, 2)   [updated]
    """
    for i in range(which.shape[0]):
        spell = 0
        k = offsets[which[i]]
        while k < offsets[which[i] + 1] and spell < since_ns.shape[0]:
            common = min(stop_ns[k], until_ns[spell]) - max(start_ns[k], since_ns[spell])
            if common > 0:
                seconds[i, state[k]] += common * 1e-9
            if stop_ns[k] <= until_ns[spell]:
                k += 1
            else:
                spell += 1


@kernel
def copy_periods(
    offsets: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    hit: NDArray[np.uint8],
    state: NDArray[np.uint8],
    which: NDArray[np.int64],
    to: NDArray[np.int64],
    out_offsets: NDArray[np.int64],
    out_start_ns: NDArray[np.int64],
    out_stop_ns: NDArray[np.int64],
    out_hit: NDArray[np.uint8],
    out_state: NDArray[np.uint8],
) -> None:
    """Copy the periods of series ``which[i]`` to the place that `out_offsets` has for series ``to[i]``."""
    for i in range(which.shape[0]):
        place = out_offsets[to[i]]
        for k in range(offsets[which[i]], offsets[which[i] + 1]):
            out_start_ns[place], out_stop_ns[place] = start_ns[k], stop_ns[k]
            out_hit[place], out_state[place] = hit[k], state[k]
            place += 1


@kernel
def find_within(
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    row_min: int,
    row_max: int,
    col_min: int,
    col_max: int,
    found: NDArray[np.int64],
) -> int:
    """Which of some cells, sorted by row and col, lie in a rectangle; returns how many.

    found (capacity,)   their indices, rising; those beyond its capacity are only counted   [written]
    """
    n, n_found = rows.shape[0], 0
    at, row = 0, row_min
    while row <= row_max:
        low, high = at, n  # the first cell of the row, or of a later one, that is not left of the rectangle
        while low < high:
            middle = (low + high) >> 1
            if rows[middle] < row or (rows[middle] == row and cols[middle] < col_min):
                low = middle + 1
            else:
                high = middle
        at = low
        while at < n and rows[at] == row and cols[at] <= col_max:
            if n_found < found.shape[0]:
                found[n_found] = at
            n_found += 1
            at += 1
        if at == n:
            break
        row = max(row + 1, rows[at])  # rows without cells cost nothing
    return n_found


@kernel
def add_content(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value_bits: NDArray[np.uint32],
    since: int,
    until: int,
    stamps_ns: NDArray[np.int64],
    before: NDArray[np.uint64],
    after: NDArray[np.uint64],
    content: NDArray[np.uint64],
) -> None:
    """Mix what the scans since..until saw of each cell into its 64 bits: when intervals began and ended, and values.

    before, after (n_scans,)   sums over the scans before each scan, and up to it: of when and where from they were
    content (n_cells,)         by cell number   [updated]
    """
    for i in range(cells.shape[0]):
        mixed = content[cells[i]]
        for k in range(offsets[i], offsets[i + 1]):
            if first[k] <= until and last[k] >= since:
                start, stop = stamps_ns[max(first[k], since)], stamps_ns[min(last[k], until)]
                mixed = (mixed ^ np.uint64(start)) * np.uint64(0x9E3779B97F4A7C15)
                mixed ^= mixed >> np.uint64(32)
                mixed = (mixed ^ np.uint64(stop)) * np.uint64(0xC2B2AE3D27D4EB4F)
                mixed ^= mixed >> np.uint64(29)
                mixed = (mixed ^ np.uint64(value_bits[k])) * np.uint64(0xD6E8FEB86659FD93)
                mixed ^= mixed >> np.uint64(32)
                meanwhile = after[min(last[k], until)] - before[max(first[k], since)]
                mixed = (mixed ^ meanwhile) * np.uint64(0x9FB21C651E98DF25)
                mixed ^= mixed >> np.uint64(28)
        content[cells[i]] = mixed


@kernel
def count_views(
    offsets: NDArray[np.int64],
    start_ns: NDArray[np.int64],
    stop_ns: NDArray[np.int64],
    state: NDArray[np.uint8],
    which: NDArray[np.int64],
    points_map: NDArray[np.float64],
    stamps_ns: NDArray[np.int64],
    poses: NDArray[np.float64],
    look_ns: int,
    every: int,
    same_pass_ns: int,
    visits: NDArray[np.int64],
    steps: NDArray[np.int64],
) -> None:
    """For some series, in how many visits from each direction the cell was free, and occupied, for the most part.

    which (n,) series; points_map (n, 2) where their cells are
    stamps_ns (n_scans,), poses (n_scans, 3)   of the laser; each `every`-th scan of a period is looked at
    look_ns                                    periods last so much longer than to their last scan
    same_pass_ns                               a visit ends with another direction, or when unseen for longer
    visits (n, n_directions, 2)   [updated]
    steps (n, 2, 2)               from the state in one visit to that in the next   [updated]
    """
    n_directions = visits.shape[1]
    borders = np.arange(n_directions + 1) * (2 * math.pi / n_directions) - math.pi
    border_x, border_y = np.cos(borders), np.sin(borders)
    for i in range(which.shape[0]):
        x, y = points_map[i, 0], points_map[i, 1]
        direction, before = -1, -1
        n_free, n_occupied = 0, 0
        seen_ns = np.int64(0)
        for k in range(offsets[which[i]], offsets[which[i] + 1]):
            last_ns = max(start_ns[k], stop_ns[k] - look_ns)
            scan = np.searchsorted(stamps_ns, start_ns[k])
            while scan < stamps_ns.shape[0] and stamps_ns[scan] <= last_ns:
                dx, dy = poses[scan, 0] - x, poses[scan, 1] - y
                towards = direction
                if not (  # mostly it is the one before; without this the kernel takes half as long again
                    direction >= 0
                    and border_x[direction] * dy >= border_y[direction] * dx
                    and border_y[direction + 1] * dx > border_x[direction + 1] * dy
                ):
                    share = (math.atan2(dy, dx) + math.pi) / (2 * math.pi)
                    towards = min(int(share * n_directions), n_directions - 1)
                if towards != direction or stamps_ns[scan] - seen_ns > same_pass_ns:
                    if direction >= 0:
                        now = int(n_occupied > n_free)
                        visits[i, direction, now] += 1
                        if before >= 0:
                            steps[i, before, now] += 1
                        before = now
                    direction, n_free, n_occupied = towards, 0, 0
                if state[k]:
                    n_occupied += 1
                else:
                    n_free += 1
                seen_ns = stamps_ns[scan]
                scan += every
        if direction >= 0:
            now = int(n_occupied > n_free)
            visits[i, direction, now] += 1
            if before >= 0:
                steps[i, before, now] += 1
