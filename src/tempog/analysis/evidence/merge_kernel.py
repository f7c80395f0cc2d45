"""The kernel that merges groups of cells, with a heap of pairs of groups and a table that finds a pair's sum."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

NOBODY = -1


@kernel
def slot_of(table_a: NDArray[np.int64], table_b: NDArray[np.int64], a: int, b: int) -> int:
    """Where a pair is in the table, or would go: open addressing, with the smaller of the two first.

    table_a, table_b (2 ** k,)   the pair in each slot; NOBODY in empty ones
    """
    low, high = min(a, b), max(a, b)
    mask = table_a.shape[0] - 1
    mixed = low * 2654435761 + high * 40503  # below 2 ** 63 for less than 2 ** 31 groups
    slot: int = (mixed ^ (mixed >> 17)) & mask
    while table_a[slot] != NOBODY and (table_a[slot] != low or table_b[slot] != high):
        slot = (slot + 1) & mask
    return slot


@kernel
def merge_groups(
    left: NDArray[np.int64],
    right: NDArray[np.int64],
    weight: NDArray[np.float64],
    above: float,
    label: NDArray[np.int64],
) -> None:
    """Merge groups, the two with the largest mean weight across first, while that is larger than `above`.

    left, right (n_pairs,) of 0..n - 1, no pair twice; weight (n_pairs,)
    label (n,)   smallest member of each one's group   [written]
    """
    n, n_pairs = label.shape[0], left.shape[0]
    ends = np.empty((n_pairs, 2), dtype=np.int64)  # of each pair of groups that is left; pairs are only ever joined
    total, count = weight.copy(), np.ones(n_pairs)
    alive = np.ones(n_pairs, dtype=np.bool_)
    # Each group's pairs are a chain of halves: half 2 e + side belongs to the group at that side of pair e.
    head = np.full(n, NOBODY, dtype=np.int64)
    following = np.empty(2 * n_pairs, dtype=np.int64)
    n_across = np.zeros(n, dtype=np.int64)
    size = 16
    while size < 4 * n_pairs:
        size *= 2
    table_a, table_b = np.full(size, NOBODY, dtype=np.int64), np.empty(size, dtype=np.int64)
    table_pair = np.empty(size, dtype=np.int64)
    n_filled = n_pairs
    waiting = [(0.0, 0, 0, 1.0) for _ in range(0)]
    for e in range(n_pairs):
        a, b = int(left[e]), int(right[e])
        ends[e, 0], ends[e, 1] = a, b
        following[2 * e], head[a] = head[a], 2 * e
        following[2 * e + 1], head[b] = head[b], 2 * e + 1
        n_across[a] += 1
        n_across[b] += 1
        slot = slot_of(table_a, table_b, a, b)
        table_a[slot], table_b[slot], table_pair[slot] = min(a, b), max(a, b), e
        if weight[e] > above:
            waiting.append((-weight[e], a, b, 1.0))
    heapq.heapify(waiting)
    parent = np.arange(n)
    while len(waiting) > 0:
        _, a, b, n_then = heapq.heappop(waiting)
        if parent[a] != a or parent[b] != b:
            continue
        slot = slot_of(table_a, table_b, a, b)
        pair = table_pair[slot]
        if count[pair] != n_then:
            continue  # there are more pairs across by now
        if n_across[a] < n_across[b]:
            a, b = b, a
        parent[b] = a
        alive[pair] = False
        n_across[a] -= 1
        half = head[b]
        while half != NOBODY:
            after, e, side = following[half], half >> 1, half & 1
            if alive[e]:
                c = int(ends[e, 1 - side])
                slot = slot_of(table_a, table_b, a, c)
                if table_a[slot] == NOBODY:
                    table_a[slot], table_b[slot], table_pair[slot] = min(a, c), max(a, c), e
                    n_filled += 1
                    ends[e, side] = a
                    following[half], head[a] = head[a], half
                    n_across[a] += 1
                    known = e
                else:
                    known = table_pair[slot]
                    total[known] += total[e]
                    count[known] += count[e]
                    alive[e] = False
                    n_across[c] -= 1
                if total[known] / count[known] > above:
                    heapq.heappush(waiting, (-total[known] / count[known], a, c, count[known]))
            half = after
        if 2 * n_filled > size:  # the pairs of groups that are gone are still in the table
            table_a[:] = NOBODY
            n_filled = 0
            for e in range(n_pairs):
                if alive[e]:
                    slot = slot_of(table_a, table_b, int(ends[e, 0]), int(ends[e, 1]))
                    table_a[slot], table_b[slot] = min(ends[e, 0], ends[e, 1]), max(ends[e, 0], ends[e, 1])
                    table_pair[slot] = e
                    n_filled += 1
    smallest = np.arange(n)
    for i in range(n):
        root = i
        while parent[root] != root:
            parent[root] = parent[parent[root]]
            root = parent[root]
        parent[i] = root
        smallest[root] = min(smallest[root], i)
    for i in range(n):
        label[i] = smallest[parent[i]]
