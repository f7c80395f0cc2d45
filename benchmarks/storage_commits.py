"""What commits cost: as they come, after ten thousand of them, and for the robot that maps meanwhile."""

from __future__ import annotations

import shutil
import time
from itertools import count
from pathlib import Path
from typing import NamedTuple

import logs
import numpy as np
from logs import BenchLog
from numpy.typing import NDArray
from report import Row, Section, at_most
from stopwatch import Stopwatch, watched

from tempog import LiveMap, Scan, TemporalGrid
from tempog.simulation import corridor, simulate
from tempog.store import committer
from tempog.store.journal import JournalWriter
from tempog.store.session_writer import SessionWriter

N_COMMITS, N_COMMITS_QUICK = 10_000, 400
LONGEST_S = 420.0  # a slow disk gets fewer commits
BREAK_NS = 10**9  # between two laps
PERCENTILES = (50, 99, 100)
PAUSE_S = 0.004  # between scans; robots make 5 to 40 a second


class Lives(NamedTuple):
    """Seconds of each commit, and what the map came to."""

    seconds: NDArray[np.float64]
    total_s: float
    merging_s: float
    n_merges: int
    n_files: int
    manifest_bytes: int


def commit_sections(quick: bool, folder: Path) -> list[Section]:
    """Commits of one scan each."""
    lives = _commit_often(N_COMMITS_QUICK if quick else N_COMMITS, folder / "often")
    n = len(lives.seconds)
    part = max(1, n // 10)
    first, last = lives.seconds[:part], lives.seconds[-part:]
    section = Section(f"Storage: {n} commits of one scan each, the simulated corridor")
    for word, of in (("median", np.median), ("99th percentile", lambda part: np.quantile(part, 0.99))):
        section.rows.append(
            Row(
                f"{word}, last {part} over first {part}",
                f"{1e3 * of(last):.2f} ms",
                f"{1e3 * of(first):.2f} ms",
                float(of(last) / of(first)),
                at_most(1.2) if word == "median" else None,
            )
        )
    section.rows += [
        Row("time in merges", f"{lives.n_merges} merges", "", 100 * lives.merging_s / lives.total_s, unit="% of all"),
        Row("files in the end", "", "", lives.n_files, unit="files"),
        Row("map.json in the end", "", "", lives.manifest_bytes / 1e3, unit="kB"),
        Row("fsync of a small file meanwhile", "", "", 1e3 * _fsync_s(folder), unit="ms"),
    ]
    section.notes.append(
        "integrate() is not counted; flush() waits for the disk and for the merge that may follow a commit. Segments"
        " that were merged stay for readers, 600 s or until there are 128."
    )
    if n < N_COMMITS and not quick:
        section.notes.append(f"{N_COMMITS} were wanted, and {LONGEST_S:g} s were enough for these.")
    return [section]


def _commit_often(n_commits: int, path: Path) -> Lives:
    scans = simulate(corridor()).scans
    config = BenchLog("", scans).config("surface")
    seconds, watch = [], Stopwatch()
    start = time.perf_counter()
    with watched(watch, committer, "merge_segments"), LiveMap(path, config, flush_s=1e9) as live:
        for number in count():
            if number == n_commits or time.perf_counter() - start > LONGEST_S:
                break
            live.integrate(lapped(scans, number))
            before = time.perf_counter()
            live.flush()
            seconds.append(time.perf_counter() - before)
        total_s = time.perf_counter() - start
    n_files = sum(1 for file in path.rglob("*") if file.is_file())
    merged = watch["merge_segments"]
    n_bytes = (path / "map.json").stat().st_size
    shutil.rmtree(path)
    return Lives(np.array(seconds), total_s, merged.seconds, merged.n_calls, n_files, n_bytes)


def lapped(scans: list[Scan], number: int) -> Scan:
    """Scan `number` of a drive that is repeated for ever."""
    lap, k = divmod(number, len(scans))
    lap_ns = scans[-1].stamp_ns - scans[0].stamp_ns + BREAK_NS
    return logs.at_time(scans[k], scans[k].stamp_ns + lap * lap_ns)


def _fsync_s(folder: Path) -> float:
    import os

    seconds = []
    for k in range(20):
        with (folder / f"synced-{k}").open("wb") as file:
            file.write(b"0" * 1000)
            file.flush()
            start = time.perf_counter()
            os.fsync(file.fileno())
            seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def live_section(name: str, n_scans: int | None, folder: Path) -> Section:
    """integrate() while commits and merges run in their thread, against a grid in memory."""
    log = logs.load(name, n_scans)
    section = Section(f"Storage: integrate() of a live map, {log.name}, literal, {1e3 * PAUSE_S:g} ms between scans")
    grid_us = _costs_us(TemporalGrid(log.config("literal")), log)
    section.rows += _cost_rows("grid in memory", grid_us, None)
    for flush_s in (30.0, 5.0):
        watch = Stopwatch()
        with (
            watched(watch, committer, "merge_segments"),
            watched(watch, committer, "write_segment"),
            watched(watch, SessionWriter, "_submit"),
            watched(watch, JournalWriter, "append"),
            LiveMap(folder / "live", log.config("literal"), flush_s=flush_s) as live,
        ):
            live_us = _costs_us(live, log)
        shutil.rmtree(folder / "live")
        what = f"live, a commit each {flush_s:g} s"
        section.rows += _cost_rows(what, live_us, grid_us)
        for part, name in (("commits", "_submit"), ("the journal", "append")):
            seconds, total_s = watch[name].seconds, 1e-6 * live_us.sum()
            section.rows.append(
                Row(f"{what}, {part}", f"{seconds:.2f} s of {total_s:.2f} s", "", 100 * seconds / total_s, unit="%")
            )
        off = f"{watch['write_segment'].seconds:.2f} s, {watch['merge_segments'].seconds:.2f} s of it for merges"
        section.rows.append(Row(f"{what}, off the hot path", off))
    section.notes.append(
        f"The {log.duration_s:.0f} s of the log pass in a fraction of the time, so commits are as much more frequent."
    )
    return section


def _costs_us(target: TemporalGrid | LiveMap, log: BenchLog) -> NDArray[np.float64]:
    seconds = np.empty(len(log.scans))
    for k, scan in enumerate(log.scans):
        start = time.perf_counter()
        target.integrate(scan)
        seconds[k] = time.perf_counter() - start
        time.sleep(PAUSE_S)
    return 1e6 * seconds


def _cost_rows(what: str, costs_us: NDArray[np.float64], peer_us: NDArray[np.float64] | None) -> list[Row]:
    rows = []
    for percentile in PERCENTILES:
        ours = float(np.percentile(costs_us, percentile))
        peer = float(np.percentile(peer_us, percentile)) if peer_us is not None else float("nan")
        word = {50: "median", 100: "slowest"}.get(percentile, f"{percentile}th percentile")
        theirs = f"{peer:.0f} us in memory" if peer_us is not None else ""
        rows.append(Row(f"{what}, {word}", f"{ours:.0f} us", theirs, ours / peer))
    return rows
