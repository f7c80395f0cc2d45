"""Any history as segments."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tempog.grid.history import History
from tempog.grid.segments import Runs
from tempog.sensing.surfaces import SurfaceMemory
from tempog.store.committer import SEGMENT_INTERVALS
from tempog.store.manifest import Segment
from tempog.store.segment_files import NO_HITS, Content, hits_of, write_segment

NO_SUCCESSOR = 2**31 - 1
NO_TILES = np.empty(0, dtype=np.int32)


def write_history(root: Path, history: History) -> list[Segment]:
    """Write all of a history to new segments below `root`, which count once map.json names them.

    Raises
    ------
    OSError, pyarrow.ArrowException
        They could not be written.
    """
    return [write_segment(root, content, n_cells=n_cells) for content, n_cells in contents_of(history)]


def contents_of(history: History, most_intervals: int = 2 * SEGMENT_INTERVALS) -> Iterator[tuple[Content, int]]:
    """A history cut into segments of at most so many intervals, with the number of cells seen by the end of each."""
    if not len(history.stamps_ns):
        return
    runs, stamps_ns, poses = history.all_runs(), history.stamps_ns, history.poses
    ended_at = successors(runs)
    cell = runs.cell
    begin, n_changed = 0, 0
    for end in _cuts(ended_at, len(stamps_ns), most_intervals):
        ended = (ended_at >= begin) & (ended_at < end)
        going_on = (runs.first < end) & (ended_at >= end)
        n_cells = int(np.count_nonzero(going_on))
        changed = going_on & (runs.first >= begin)
        n_changed += int(np.count_nonzero(changed))
        is_last = end == len(stamps_ns)
        full = is_last or n_changed >= n_cells
        n_changed = 0 if full else n_changed
        yield (
            Content(
                begin,
                stamps_ns[begin:end],
                poses[begin:end],
                0,
                *(_tiles_of(history) if begin == 0 else (NO_TILES, NO_TILES)),
                chosen(runs, cell, ended),
                chosen(runs, cell, going_on if full else changed),
                hits_of(_surfaces_of(history)) if is_last else NO_HITS,
                full,
            ),
            n_cells,
        )
        begin = end


def successors(runs: Runs) -> NDArray[np.int32]:
    """For each interval the scan that began the cell's next one."""
    ended_at = np.full(runs.n_intervals, NO_SUCCESSOR, dtype=np.int32)
    ended_at[:-1] = runs.first[1:]
    ended_at[runs.offsets[1:] - 1] = NO_SUCCESSOR
    return ended_at


def _cuts(ended_at: NDArray[np.int32], n_scans: int, most_intervals: int) -> list[int]:
    """After which scans to cut, so that between two cuts about `most_intervals` end; the last is `n_scans`."""
    until = np.cumsum(np.bincount(ended_at[ended_at != NO_SUCCESSOR], minlength=n_scans))
    n_parts = max(1, -(-int(until[-1]) // most_intervals))
    wanted = until[-1] * np.arange(1, n_parts) / n_parts
    cuts = np.searchsorted(until, wanted, side="left") + 1
    return sorted({*cuts[cuts < n_scans].tolist(), n_scans})


def chosen(runs: Runs, cell: NDArray[np.int32], which: NDArray[np.bool_]) -> Runs:
    """Some intervals of a set, given with the cell of each."""
    return Runs.of(cell[which], runs.first[which], runs.last[which], runs.value[which])


def _tiles_of(history: History) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    used = slice(0, history.tiles.n_tiles)
    return history.tiles.tile_rows[used], history.tiles.tile_cols[used]


def _surfaces_of(history: History) -> SurfaceMemory:
    memory = getattr(history, "surfaces", None)
    return memory if isinstance(memory, SurfaceMemory) else SurfaceMemory()
