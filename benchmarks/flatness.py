"""Does a scan cost more the longer the history is? The same log, over and over."""

from __future__ import annotations

import math
import time

import logs
import numpy as np
from logs import BenchLog
from measure import median
from numpy.typing import NDArray
from report import Row, Section, at_most

from tempog import Scan, TemporalGrid
from tempog.config import Evidence

N_LAPS = 10
N_LAPS_QUICK = 4
BREAK_S = 1.0  # between two laps


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """The first log only, with either evidence, which take turns."""
    log = logs.load(names[0], n_scans)
    n_laps = N_LAPS if n_scans is None else N_LAPS_QUICK
    evidences: tuple[Evidence, ...] = ("literal", "surface")
    costs: dict[Evidence, list[NDArray[np.float64]]] = {evidence: [] for evidence in evidences}
    _lap_costs(BenchLog(log.name, log.scans[:100]), "surface", 1)  # warm-up
    n_intervals = {}
    for _ in range(max(1, n_repetitions // 2)):
        for evidence in evidences:
            seconds, n_intervals[evidence] = _lap_costs(log, evidence, n_laps)
            costs[evidence].append(seconds)
    section = Section(f"Flatness: {log.name}, {n_laps} times {len(log.scans)} scans, cost of a scan")
    for evidence in evidences:
        _add_rows(section, evidence, costs[evidence], n_laps)
        section.notes.append(f"{evidence}: {n_intervals[evidence] / 1e6:.1f} M intervals at the end.")
    section.notes.append("Means hold the sorting and merging of finished intervals, which comes in lumps.")
    return [section]


def _lap_costs(log: BenchLog, evidence: Evidence, n_laps: int) -> tuple[NDArray[np.float64], int]:
    """``(n_laps, n_scans)`` seconds of each integrate(), and how many intervals there are in the end."""
    grid = TemporalGrid(log.config(evidence))
    seconds = np.empty((n_laps, len(log.scans)))
    lap_ns = round((log.duration_s + BREAK_S) * 1e9)
    for lap in range(n_laps):
        for k, scan in enumerate(log.scans):
            seconds[lap, k] = _cost(grid, logs.at_time(scan, scan.stamp_ns + lap * lap_ns))
    return seconds, grid.n_intervals


def _cost(grid: TemporalGrid, scan: Scan) -> float:
    start = time.perf_counter()
    grid.integrate(scan)
    return time.perf_counter() - start


def _add_rows(section: Section, evidence: str, runs: list[NDArray[np.float64]], n_laps: int) -> None:
    for word, typical in (("median", np.median), ("mean", np.mean)):
        laps = np.array([typical(seconds, axis=1) for seconds in runs])  # (n_runs, n_laps)
        for earlier in (1, 0):
            if earlier >= n_laps - 1:
                continue
            ratio = median(list(laps[:, -1] / laps[:, earlier]))
            last, other = (1e6 * float(np.median(laps[:, k])) for k in (-1, earlier))
            section.rows.append(
                Row(
                    f"{evidence}, {word} of lap {n_laps} over lap {earlier + 1}",
                    f"{last:.0f} us",
                    f"{other:.0f} us",
                    ratio if math.isfinite(ratio) else math.nan,
                    at_most(1.2),
                )
            )
    slowest = max(float(seconds.max()) for seconds in runs)
    section.rows.append(Row(f"{evidence}, slowest scan", f"{1e3 * slowest:.1f} ms"))
