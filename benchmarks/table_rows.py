"""The rows that the benchmarks of storage commit: a log's intervals in the order they ended, again and again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import logs
import numpy as np
from ingest import integrate

if TYPE_CHECKING:
    import pyarrow as pa


class Rows:
    """Endless intervals: the map of a log, then the same drive again with later scan numbers.

    Attributes
    ----------
    name : str
        Of the log.
    """

    def __init__(self, name: str, n_scans: int | None) -> None:
        log = logs.load(name, n_scans)
        grid = integrate(log, "surface")
        runs = grid.all_runs()
        self.name, self.n_scans, self.duration_s = log.name, grid.n_scans, log.duration_s
        by_end = np.argsort(runs.last, kind="stable")
        self._columns = {
            "cell": np.repeat(runs.cells, np.diff(runs.offsets))[by_end],
            "first_scan": runs.first[by_end],
            "span": (runs.last - runs.first)[by_end],
            "prob": runs.value[by_end],
        }

    @property
    def n_per_drive(self) -> int:
        """Intervals of the log."""
        return len(self._columns["cell"])

    def batches(self, n_rows: int) -> Iterator[pa.Table]:
        """What one commit after the other has to write: `n_rows` finished intervals, by cell, then time."""
        import pyarrow as pa

        start = 0
        while True:
            number = np.arange(start, start + n_rows)
            drive, place = np.divmod(number, self.n_per_drive)
            columns = {name: values[place] for name, values in self._columns.items()}
            columns["first_scan"] = columns["first_scan"] + (drive * self.n_scans).astype(np.int32)
            order = np.lexsort((columns["first_scan"], columns["cell"]))
            yield pa.table({name: values[order] for name, values in columns.items()})
            start += n_rows
