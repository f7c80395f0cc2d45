"""Several histories of one cell as one, scan number by scan number, slow and obvious.

An interval is ``(first, last, value)``; a part is the list of its intervals, which do not overlap.
"""

from __future__ import annotations

from collections.abc import Sequence

Interval = tuple[int, int, float]


def latest_begun(parts: Sequence[Sequence[Interval]], *scans: int) -> Interval | None:
    """Of the intervals that cover all of some scans, the one that began latest; of those, that of the later part."""
    covering = [
        (first, number, (first, last, value))
        for number, part in enumerate(parts)
        for first, last, value in part
        if all(first <= scan <= last for scan in scans)
    ]
    return max(covering)[2] if covering else None


def is_joined(parts: Sequence[Sequence[Interval]], scan: int) -> bool:
    """Whether the state of a cell at one scan goes on at the next.

    It does if what is believed stays the same, and so would be if nothing new were said at the next scan.
    """
    here, both, there = (latest_begun(parts, *scans) for scans in ((scan,), (scan, scan + 1), (scan + 1,)))
    return both is not None and here[2] == both[2] == there[2]


def overlay(parts: Sequence[Sequence[Interval]]) -> list[Interval]:
    """The cell's intervals, in time order."""
    end = max((last for part in parts for _, last, _ in part), default=-1) + 1
    result: list[list] = []
    for scan in range(end):
        state = latest_begun(parts, scan)
        if state is None:
            continue
        if scan and is_joined(parts, scan - 1):
            result[-1][1] = scan
        else:
            result.append([scan, scan, state[2]])
    return [tuple(interval) for interval in result]
