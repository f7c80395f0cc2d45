"""Parts of cells' series replaced by references to what a group of cells shares (paper, V.A).

Cells that one object covers are mostly seen, taken and left together. Such a group keeps one timeline: the intervals
that several of its cells have to the scan. Each entry says by one bit a cell which cells have it. What a cell has of
its own stays as it is: looks that began or ended earlier because a person stood in the way, and all the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.grid.segments import Runs

LEAST_SHARED = 3  # cells; on two real and four simulated maps no number from 2 to 6 was smaller on most of them


class Encoded(NamedTuple):
    """Intervals of many cells, with those that cells of a group share kept once.

    Attributes
    ----------
    cell, first, last : (n_rest,) int32
        Intervals that no timeline holds, by cell, then time.
    value : (n_rest,) float32
        Their P(occupied).
    member : (n_members,) int32
        Cells that refer to a timeline, group by group.
    member_group : (n_members,) int32
        The group each of them refers to, ascending.
    entry_group, entry_first, entry_last : (n_entries,) int32
        Timelines: intervals that cells of a group share, by group, then time.
    entry_value : (n_entries,) float32
        Their P(occupied).
    entry_members : (n_bytes,) uint8
        For each entry one bit per member of its group, lowest first, filled up to whole bytes: which of them have it.
    """

    cell: NDArray[np.int32]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    value: NDArray[np.float32]
    member: NDArray[np.int32]
    member_group: NDArray[np.int32]
    entry_group: NDArray[np.int32]
    entry_first: NDArray[np.int32]
    entry_last: NDArray[np.int32]
    entry_value: NDArray[np.float32]
    entry_members: NDArray[np.uint8]


def encode(runs: Runs, groups: Sequence[NDArray[np.int32]], least_shared: int = LEAST_SHARED) -> Encoded:
    """Replace what cells of a group share by references to the group's timeline.

    Parameters
    ----------
    runs : Runs
        Each cell has an interval, and its intervals follow each other in time.
    groups : sequence of (n,) int32
        Cell numbers, for example of each configuration. A cell in several groups refers to the first of them; cells
        without intervals are left out.
    least_shared : int
        An interval enters a timeline if so many cells of the group have it.

    Returns
    -------
    Encoded
        `decode` gives `runs` again, to the last bit.

    Examples
    --------
    Three cells of a door leaf are taken from scan 5 to 9; the third was seen a scan longer before that.

    >>> import numpy as np
    >>> door = Runs(
    ...     cells=np.array([7, 8, 9], np.int32),
    ...     offsets=np.array([0, 2, 4, 6]),
    ...     first=np.array([0, 5, 0, 5, 0, 5], np.int32),
    ...     last=np.array([3, 9, 3, 9, 4, 9], np.int32),
    ...     value=np.array([0.1, 0.9] * 3, np.float32),
    ... )
    >>> encoded = encode(door, [np.array([7, 8, 9], np.int32)], least_shared=2)
    >>> encoded.entry_first, encoded.entry_last, [f"{bits:03b}" for bits in encoded.entry_members]
    (array([0, 5], dtype=int32), array([3, 9], dtype=int32), ['011', '111'])
    >>> encoded.cell, encoded.first, encoded.last
    (array([9], dtype=int32), array([0], dtype=int32), array([4], dtype=int32))
    >>> all(np.array_equal(a, b) for a, b in zip(decode(encoded), door))
    True
    """
    cell = np.repeat(runs.cells, np.diff(runs.offsets))
    member, member_group = _first_of_each(groups, runs.cells)
    begins, sizes = _group_sizes(member_group)
    by_cell = np.argsort(member, kind="stable")
    referring = np.flatnonzero(np.isin(cell, member))
    of = by_cell[np.searchsorted(member, cell[referring], sorter=by_cell)]  # the member that each is an interval of
    columns = [member_group[of], runs.first[referring], runs.last[referring], runs.value[referring].view(np.int32)]
    order = np.lexsort(columns[::-1])
    referring, of = referring[order], of[order]
    sorted_columns = np.stack([column[order] for column in columns])
    differs = np.any(sorted_columns[:, 1:] != sorted_columns[:, :-1], axis=0)
    alike = np.append(0, differs.cumsum())[: len(order)]  # equal intervals of one group have one number
    shared = np.bincount(alike)[alike] >= least_shared
    referring, of, alike = referring[shared], of[shared], alike[shared]
    is_next = np.diff(alike, prepend=-1) > 0
    entry = is_next.cumsum() - 1
    one_each = referring[is_next]
    entry_group = member_group[of[is_next]]
    n_bytes = -(-sizes[entry_group] // 8)
    bits = np.zeros(8 * n_bytes.sum(), dtype=np.bool_)
    bits[8 * (n_bytes.cumsum() - n_bytes)[entry] + of - begins[entry_group[entry]]] = True
    rest = np.ones(len(cell), dtype=np.bool_)
    rest[referring] = False
    return Encoded(
        cell[rest],
        runs.first[rest],
        runs.last[rest],
        runs.value[rest],
        member,
        member_group,
        entry_group,
        runs.first[one_each],
        runs.last[one_each],
        runs.value[one_each],
        np.packbits(bits, bitorder="little"),
    )


def decode(encoded: Encoded) -> Runs:
    """The intervals that were encoded, sorted by cell and time, to the last bit.

    Parameters
    ----------
    encoded : Encoded
        As `encode` made it.
    """
    begins, sizes = _group_sizes(encoded.member_group)
    n_bits = 8 * -(-sizes[encoded.entry_group] // 8)
    bit = np.flatnonzero(np.unpackbits(encoded.entry_members, bitorder="little"))
    ends = n_bits.cumsum()
    entry = np.searchsorted(ends, bit, side="right")
    of = begins[encoded.entry_group[entry]] + bit - (ends - n_bits)[entry]
    cell = np.concatenate([encoded.cell, encoded.member[of]])
    first = np.concatenate([encoded.first, encoded.entry_first[entry]])
    last = np.concatenate([encoded.last, encoded.entry_last[entry]])
    value = np.concatenate([encoded.value, encoded.entry_value[entry]])
    order = np.lexsort((first, cell))
    cells, starts = np.unique(cell[order], return_index=True)
    return Runs(cells, np.append(starts, len(cell)), first[order], last[order], value[order])


def _first_of_each(
    groups: Sequence[NDArray[np.int32]], cells: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Which of `cells` are in a group, and the first group that each of them is in; by group, then cell."""
    listed = np.concatenate([np.empty(0, np.int32), *groups]).astype(np.int32)
    group = np.repeat(np.arange(len(groups), dtype=np.int32), [len(each) for each in groups])
    member, where = np.unique(listed, return_index=True)
    seen = np.isin(member, cells)
    member, group = member[seen], group[where[seen]]
    order = np.argsort(group, kind="stable")
    return member[order], group[order]


def _group_sizes(member_group: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each group's members begin, and how many there are."""
    sizes = np.bincount(member_group)
    return sizes.cumsum() - sizes, sizes
