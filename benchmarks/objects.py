"""How method ``evidence`` scales: with time, with the map, and with what was added since the last analysis."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import memory
import numpy as np
from measure import interleave, median, timed
from numpy.typing import NDArray
from report import Row, Section, at_most

from tempog import EvidenceAnalysis, EvidenceConfig, History, build_grid, find_objects
from tempog.analysis.evidence.blocks import cell_states
from tempog.analysis.series import ever_occupied
from tempog.config import MapConfig
from tempog.grid.segments import Runs
from tempog.grid.temporal_grid import TemporalGrid
from tempog.sensing.grid_spec import GridSpec
from tempog.sensing.tiles import TILE, TileIndex
from tempog.simulation import load_world, simulate

SPAN_S, N_SPANS = 900.0, 10
WORLDS = (("hallway", 60), ("office", 20), ("rooms", 20), ("random", 20))  # and how many people
SCAN_NS = 100_000_000
ADDED_SCANS = 600  # a minute
BIG = (1_000_000, 100_000_000)  # cells and intervals
SMALL = (500_000, 10_000_000)  # ... of a quick run, and for comparison
HIT = np.float32(0.9)
GIGABYTE = 2.0**30


class Town(History):
    """Simulated drives side by side, each repeated so many times, as intervals of one history.

    Parameters
    ----------
    drives : sequence of TemporalGrid
        One after the other is laid beside those before, the first again after the last.
    n_cells, n_intervals : int
        So many observed cells and intervals there are at least.
    crowded : bool
        Somebody stood in every cell at some time: each square of 0.4 m is taken during one interval of its cells.
    """

    def __init__(self, drives: Sequence[TemporalGrid], n_cells: int, n_intervals: int, crowded: bool = False) -> None:
        self.config = MapConfig()
        counts = [(drive.n_cells, drive.n_intervals) for drive in drives]
        n_copies = 1
        while sum(counts[k % len(drives)][0] for k in range(n_copies)) < n_cells:
            n_copies += 1
        self.n_scans_of_lap = max(len(drive.stamps_ns) for drive in drives)
        self._drives = [drives[k % len(drives)] for k in range(n_copies)]
        self.n_laps = math.ceil(n_intervals / sum(counts[k % len(drives)][1] for k in range(n_copies)))
        self.tiles = self._laid_out()
        self._sets = [self._repeated([drive.all_runs() for drive in self._drives], self.n_laps)]
        self._n_scans = self.n_laps * self.n_scans_of_lap
        if crowded:
            (runs,) = self._sets
            when = np.random.default_rng(0).random(self.tiles.n_tiles)[runs.cells // TILE**2]
            runs.value[runs.offsets[:-1] + (when * np.diff(runs.offsets)).astype(np.int64)] = HIT

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Ten scans a second."""
        return np.arange(self._n_scans, dtype=np.int64) * SCAN_NS

    @property
    def poses(self) -> NDArray[np.float64]:
        """Of the longest drive, lap after lap; what other drives saw counts as seen from there, too."""
        longest = max(self._drives, key=lambda drive: len(drive.stamps_ns))
        return np.resize(longest.poses, (self._n_scans, 3))

    def runs(self) -> Iterator[Runs]:
        """All laps, then what was added."""
        yield from self._sets

    def runs_of_cell(self, cell: int) -> list[tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]]:
        """Of one cell."""
        wheres = [(runs, runs.of_cell(cell)) for runs in self._sets]
        return [(runs.first[where], runs.last[where], runs.value[where]) for runs, where in wheres]

    def drive_on(self) -> None:
        """Add the first minute of the first drive once more; nothing else is seen meanwhile."""
        runs = self._drives[0].all_runs()
        kept = runs.last < ADDED_SCANS
        owner = np.repeat(np.arange(len(runs.cells)), np.diff(runs.offsets))[kept]
        cells, n_intervals = np.unique(owner, return_counts=True)
        offsets = np.append(0, np.cumsum(n_intervals))
        first, last = (scans[kept] + np.int32(self._n_scans) for scans in (runs.first, runs.last))
        self._sets.append(Runs(runs.cells[cells], offsets, first, last, runs.value[kept]))
        self._n_scans += ADDED_SCANS

    def _laid_out(self) -> TileIndex:
        side = 2 + max(max(drive.extent.shape) for drive in self._drives) // 8
        per_row = math.ceil(math.sqrt(len(self._drives)))
        rows, cols = [], []
        for k, drive in enumerate(self._drives):
            n = drive.tiles.n_tiles
            rows.append(drive.tiles.tile_rows[:n] - drive.extent.row0 // 8 + k // per_row * side)
            cols.append(drive.tiles.tile_cols[:n] - drive.extent.col0 // 8 + k % per_row * side)
        return TileIndex.from_tiles(GridSpec(0.05), 10**9, np.concatenate(rows), np.concatenate(cols))

    def _repeated(self, drives: Sequence[Runs], n_laps: int) -> Runs:
        n_intervals = n_laps * sum(runs.n_intervals for runs in drives)
        first, last = np.empty((2, n_intervals), dtype=np.int32)
        value = np.empty(n_intervals, dtype=np.float32)
        cells, offsets, n_before, n_done = [], [np.zeros(1, np.int64)], 0, 0
        for drive, runs in zip(self._drives, drives, strict=True):
            n_each = np.diff(runs.offsets)
            place = np.arange(runs.n_intervals) + np.repeat(runs.offsets[:-1] * (n_laps - 1), n_each) + n_done
            for lap in range(n_laps):
                here = place + np.repeat(lap * n_each, n_each)
                first[here] = runs.first + lap * self.n_scans_of_lap
                last[here] = runs.last + lap * self.n_scans_of_lap
                value[here] = runs.value
            cells.append(runs.cells + n_before)
            offsets.append(runs.offsets[1:] * n_laps + n_done)
            n_before += drive.tiles.n_cells
            n_done += runs.n_intervals * n_laps
        return Runs(np.concatenate(cells).astype(np.int32), np.concatenate(offsets), first, last, value)


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """Needs no log."""
    sizes = [SMALL] if n_scans else [SMALL, BIG]
    return [_spans(n_repetitions), _towns(sizes), _crowded(sizes[-1])]


def _spans(n_repetitions: int) -> Section:
    """The same hallway for a quarter of an hour and for ten of them, on one core."""
    section = Section(f"Objects: the hallway with 20 people, {SPAN_S:g} s and {N_SPANS} times that, one core")
    short, long = (_drive("hallway", 20, spans * SPAN_S) for spans in (1, N_SPANS))
    maps: dict[str, History] = {
        f"{SPAN_S:g} s": short,
        f"the same drive {N_SPANS} times over": Town([short], 1, N_SPANS * short.n_intervals),
        f"a drive of {N_SPANS} times the span": long,
    }
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    for one in maps.values():
        find_objects(one)  # compiles, and sorts what was mapped
    seconds = interleave({name: timed(partial(find_objects, one)) for name, one in maps.items()}, n_repetitions)
    os.sched_setaffinity(0, cores)
    first, *others = ((name, median(taken)) for name, taken in seconds.items())
    section.rows.append(Row(first[0], f"{first[1]:.2f} s", "", first[1], at_most(5.0, "s")))
    for name, taken in others:
        section.rows.append(Row(name, f"{taken:.2f} s", f"{first[1]:.2f} s", taken / first[1], at_most(11.0)))
    for name, one in maps.items():
        states = cell_states(one, EvidenceConfig())
        changing = np.count_nonzero((states.evidence >= EvidenceConfig.least_evidence).all(axis=1))
        section.notes.append(
            f"{name}: {one.n_cells} cells, {one.n_intervals} intervals; {len(states.rows)} cells were ever hit,"
            f" {changing} of them changed, in {len(states.alike.left)} pairs."
        )
    return section


def _towns(sizes: Sequence[tuple[int, int]]) -> Section:
    section = Section("Objects: drives through four worlds, side by side and over and over, two cores")
    for size in sizes:
        answer = _in_its_own_process(size)
        name = f"{answer['n_cells'] / 1e6:.2f} M cells, {answer['n_intervals'] / 1e6:.0f} M intervals"
        minutes, gigabytes = answer["seconds"] / 60, answer["peak_bytes"] / GIGABYTE
        limit = size == BIG
        section.rows += [
            Row(name, f"{answer['seconds']:.1f} s", "", minutes, at_most(10.0, "min") if limit else None, "min"),
            Row(f"{name}, peak of the process", "", "", gigabytes, at_most(12.0, "GB") if limit else None, "GB"),
            Row(
                f"{name}, again after a minute in one corner",
                f"{answer['again_seconds']:.1f} s",
                f"{answer['first_seconds']:.1f} s",
                answer["again_seconds"] / answer["first_seconds"],
            ),
        ]
        section.notes.append(
            f"{name}: {answer['n_places']} places, {answer['n_objects']} objects;"
            f" the map itself takes {answer['map_bytes'] / GIGABYTE:.2f} GB."
        )
    section.notes.append("Again: EvidenceAnalysis, against its own first analysis, which keeps what it finds.")
    return section


def _crowded(size: tuple[int, int]) -> Section:
    """The worst that a map of this size can be for the method: no cell was always free."""
    section = Section("Objects: the same where somebody stood in every cell at some time, two cores")
    answer = _in_its_own_process(size, "crowded")
    name = f"{answer['n_cells'] / 1e6:.2f} M cells, {answer['n_intervals'] / 1e6:.0f} M intervals"
    minutes, gigabytes = answer["seconds"] / 60, answer["peak_bytes"] / GIGABYTE
    section.rows += [
        Row(name, f"{answer['seconds']:.1f} s", "", minutes, at_most(10.0, "min"), "min"),
        Row(f"{name}, peak of the process", "", "", gigabytes, at_most(12.0, "GB"), "GB"),
    ]
    section.notes.append(
        f"{answer['n_hit']} cells were ever hit; {answer['n_places']} places, {answer['n_objects']} objects;"
        f" the map itself takes {answer['map_bytes'] / GIGABYTE:.2f} GB."
    )
    return section


def _in_its_own_process(size: tuple[int, int], *how: str) -> dict[str, Any]:
    command = [sys.executable, str(Path(__file__)), *map(str, size), *how]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(answer.stdout)
    return found


def _drive(world: str, people: int, duration_s: float | None) -> TemporalGrid:
    grid = build_grid(simulate(load_world(world, 3), duration_s, seed=3, people=people).scans)
    assert isinstance(grid, TemporalGrid)
    return grid


def _measure_crowded(n_cells: int, n_intervals: int) -> dict[str, Any]:
    drives = [_drive(world, people, SPAN_S) for world, people in WORLDS]
    find_objects(drives[0])  # compiles
    town = Town(drives, n_cells, n_intervals, crowded=True)
    start = time.perf_counter()
    found = find_objects(town)
    seconds = time.perf_counter() - start
    return {
        "n_cells": sum(drive.n_cells for drive in town._drives),
        "n_intervals": sum(runs.n_intervals for runs in town._sets),
        "map_bytes": sum(runs.nbytes for runs in town._sets),
        "n_hit": int(np.count_nonzero(ever_occupied(town))),
        "n_places": len(found.configurations),
        "n_objects": len(found.objects),
        "seconds": seconds,
        "peak_bytes": memory.peak_bytes(),
    }


def _measure_town(n_cells: int, n_intervals: int) -> dict[str, Any]:
    drives = [_drive(world, people, SPAN_S) for world, people in WORLDS]
    find_objects(drives[0])  # compiles
    town = Town(drives, n_cells, n_intervals)
    start = time.perf_counter()
    found = find_objects(town)
    seconds = time.perf_counter() - start
    analysis = EvidenceAnalysis()
    times = []
    for _ in range(2):
        start = time.perf_counter()
        analysis.update(town)
        times.append(time.perf_counter() - start)
        town.drive_on()
    return {
        "n_cells": sum(drive.n_cells for drive in town._drives),
        "n_intervals": sum(runs.n_intervals for runs in town._sets[:1]),
        "map_bytes": sum(runs.nbytes for runs in town._sets[:1]),
        "n_places": len(found.configurations),
        "n_objects": len(found.objects),
        "seconds": seconds,
        "first_seconds": times[0],
        "again_seconds": times[1],
        "peak_bytes": memory.peak_bytes(),
    }


if __name__ == "__main__":
    measure = _measure_crowded if "crowded" in sys.argv else _measure_town
    print(json.dumps(measure(int(sys.argv[1]), int(sys.argv[2]))))
