"""Where a map's intervals could be kept: Parquet files of our own with a manifest, against Delta Lake."""

from __future__ import annotations

import importlib.util
import itertools
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import journals
import numpy as np
import table_safety
from measure import median
from report import Row, Section, at_most
from table_child import ROWS_PER_COMMIT
from table_readers import reader_section
from table_rows import Rows
from table_stores import DeltaLog, DeltaTables, Segments, Store, read_sorted, write_segment

if TYPE_CHECKING:
    import pyarrow as pa

N_COMMITS = 10_000
N_COMMITS_QUICK = 1000
N_LARGE = 100
N_LARGE_QUICK = 16
ROWS_PER_LARGE = 100_000
BUDGET_S = 180.0  # for the commits of Delta Lake as it comes, which take longer each time
OTHERS = {"scans": 1200, "tiles": 100, "open intervals": 20_000}  # rows of what goes with the intervals
CHILD = Path(__file__).with_name("table_child.py")

OURS = "segments"
UNMERGED = "segments, never merged"
NOT_DURABLE = "segments, no fsync"
DELTA = "Delta Lake, as it comes"
TUNED = "Delta Lake, tuned"
LOG = "segments in a Delta Lake log"


@dataclass
class Course:
    """How one store's commits went.

    Attributes
    ----------
    store : Store
    commit_s, tidy_s : list of float
        Seconds of each commit, and of what was merged after it.
    """

    store: Store
    commit_s: list[float] = field(default_factory=list)
    tidy_s: list[float] = field(default_factory=list)

    def add(self, rows: pa.Table) -> None:
        """One commit, and what comes after it."""
        start = time.perf_counter()
        self.store.commit(rows)
        committed = time.perf_counter()
        self.store.tidy()
        self.commit_s.append(committed - start)
        self.tidy_s.append(time.perf_counter() - committed)

    def describe(self, commits: slice) -> str:
        """Median and 99th percentile of some commits, in milliseconds."""
        values = np.array(self.commit_s[commits]) * 1e3
        return f"{np.median(values):.2f} ms, p99 {np.percentile(values, 99):.1f}"

    @property
    def bytes_per_row(self) -> float:
        """Of the Parquet files alone, by the rows of their footers."""
        import pyarrow.parquet as pq

        files = self.store.files()
        n_rows = sum(pq.read_metadata(file).num_rows for file in files)
        return float(sum(file.stat().st_size for file in files) / n_rows)


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """Small commits, large ones, what a killed process leaves, readers, and the journal of scans."""
    missing = [name for name in ("deltalake", "mcap") if importlib.util.find_spec(name) is None]
    if missing:
        return [Section(f"Storage: not measured, {' and '.join(missing)} absent (pip install 'tempog[bench]')")]
    quick = n_scans is not None
    rows = Rows(names[0], n_scans)
    with tempfile.TemporaryDirectory(prefix="tempog-tables-") as folder:
        root = Path(folder)
        n_commits = N_COMMITS_QUICK if quick else N_COMMITS
        courses, ours_beside_delta = _commit_small(root, rows, n_commits)
        sections = [_small_section(courses, ours_beside_delta, rows), _open_section(courses, n_repetitions)]
        sections.append(reader_section({name: course.store for name, course in courses.items()}, n_repetitions))
    with tempfile.TemporaryDirectory(prefix="tempog-tables-") as folder:
        sections.append(_large_section(Path(folder), rows, N_LARGE_QUICK if quick else N_LARGE))
    sections.append(table_safety.section(CHILD, quick))
    return [*sections, *journals.sections(quick)]


def _commit_small(root: Path, rows: Rows, n_commits: int) -> tuple[dict[str, Course], Course]:
    """What stays quick, then Delta Lake as it comes beside new segments, until its time is used up."""
    stores: dict[str, Store] = {
        OURS: Segments(root / "segments"),
        UNMERGED: Segments(root / "unmerged", merge=False),
        NOT_DURABLE: Segments(root / "no-fsync", durable=False),
        TUNED: DeltaTables(root / "tuned"),
        LOG: DeltaLog(root / "log"),
    }
    courses = {name: Course(store) for name, store in stores.items()}
    for batch in itertools.islice(rows.batches(ROWS_PER_COMMIT), n_commits):
        for course in courses.values():
            course.add(batch)
    ours, delta = Course(Segments(root / "beside-delta")), Course(DeltaTables(root / "delta", tuned=False))
    used_s = 0.0
    for batch in itertools.islice(rows.batches(ROWS_PER_COMMIT), n_commits):
        ours.add(batch)
        delta.add(batch)
        used_s += delta.commit_s[-1]
        if used_s > BUDGET_S:
            break
    return {**courses, DELTA: delta}, ours


def _small_section(courses: dict[str, Course], ours_beside_delta: Course, rows: Rows) -> Section:
    ours, delta, tuned = courses[OURS], courses[DELTA], courses[TUNED]
    n_commits = len(ours.commit_s)
    window = min(1000, n_commits // 5)
    first, last = slice(0, window), slice(-window, None)
    section = Section(f"Storage: {n_commits} commits of {ROWS_PER_COMMIT} intervals, {rows.name} again and again")
    for name, course in courses.items():
        growth = median(course.commit_s[last]) / median(course.commit_s[first])
        n_done = len(course.commit_s)
        stopped = "" if n_done == n_commits else f", stopped after {n_done}"
        flat = f"{name}{stopped}: last {window} over first"
        shown = (course.describe(last), course.describe(first))
        section.rows.append(Row(flat, *shown, growth, at_most(1.5) if course is ours else None))
    for what, one, other in (
        (f"last {window}, time over {TUNED}", ours, tuned),
        (f"last {window}, time over {LOG}", ours, courses[LOG]),
        (f"last {window}, no fsync on either side, time over {TUNED}", courses[NOT_DURABLE], tuned),
        (f"up to commit {len(delta.commit_s)}, time over {DELTA}", ours_beside_delta, delta),
    ):
        value = median(one.commit_s[last]) / median(other.commit_s[last])
        section.rows.append(Row(what, one.describe(last), other.describe(last), value, at_most(1.0)))
    for name in (OURS, TUNED, LOG):
        course = courses[name]
        value = sum(course.tidy_s) / sum(ours.tidy_s)
        what, longest = f"merging, off the clock: {name}", f"longest {max(course.tidy_s):.2f} s"
        section.rows.append(Row(what, f"{sum(course.tidy_s):.1f} s in all", longest, value))
    section.rows += [_size_row(name, course) for name, course in courses.items()]
    section.notes += [
        "All take turns at each commit, with the same rows in the same encodings; Delta Lake as it comes after the"
        " others, beside new segments. First column: the last commits, or ours; second: the first, or the peer's.",
        f"{DELTA} stops once its commits took {BUDGET_S:g} s. Tuned: removed files forgotten at once, a checkpoint"
        " every 16 commits (100 is the default), compaction in tiers of 8, a full vacuum every 64 commits.",
        "Delta Lake does not sync; segments, and segments in a Delta Lake log, wait for the disk at each commit.",
    ]
    return section


def _size_row(name: str, course: Course) -> Row:
    n_commits = len(course.commit_s)
    files, log = course.store.files(), course.store.log_bytes()
    return Row(
        f"bytes per interval: {name}",
        f"{len(files)} files",
        f"log {log / 1e3:.1f} kB, {log / n_commits:.0f} a commit",
        course.bytes_per_row,
        unit="bytes",
    )


def _open_section(courses: dict[str, Course], n_repetitions: int) -> Section:
    """Until the list of files and what they span is known, in a process each."""
    section = Section("Storage: time to open after all those commits, a process each")
    commands = {OURS: "segments", UNMERGED: "segments", DELTA: "delta", TUNED: "delta", LOG: "delta log"}
    times: dict[str, list[dict[str, float]]] = {name: [] for name in commands}
    for _ in range(n_repetitions):
        for name, kind in commands.items():
            command = [sys.executable, str(CHILD), "open", kind, str(courses[name].store.root)]
            answer = subprocess.run(command, capture_output=True, text=True, check=True)
            times[name].append(json.loads(answer.stdout))
    opened = {name: median([run["open_s"] for run in runs]) for name, runs in times.items()}
    for name, runs in times.items():
        imported = median([run["import_s"] for run in runs])
        what = f"{name}: {len(courses[name].commit_s)} commits, {runs[0]['n_files']:.0f} files"
        shown = (f"open {opened[name] * 1e3:.1f} ms", f"import {imported * 1e3:.0f} ms")
        section.rows.append(Row(what, *shown, (opened[name] + imported) * 1e3, unit="ms"))
    whole = {name: opened[name] + median([run["import_s"] for run in times[name]]) for name in times}
    for what, seconds in (("open", opened), ("import and open", whole)):
        shown = (f"{seconds[OURS] * 1e3:.2f} ms", f"{seconds[TUNED] * 1e3:.1f} ms")
        ratio = seconds[OURS] / seconds[TUNED]
        section.rows.append(Row(f"{what}, time over {TUNED}", *shown, ratio, at_most(1.0)))
    section.notes.append(
        "Ours imports pyarrow.parquet, which reading rows takes; Delta Lake reads them by itself, as Arrow arrays."
    )
    return section


def _large_section(root: Path, rows: Rows, n_commits: int) -> Section:
    stores: dict[str, Store] = {
        OURS: Segments(root / "segments"),
        NOT_DURABLE: Segments(root / "no-fsync", durable=False),
        DELTA: DeltaTables(root / "delta", tuned=False),
        TUNED: DeltaTables(root / "tuned"),
    }
    courses = {name: Course(store) for name, store in stores.items()}
    whole, beside = (
        Segments(root / "whole"),
        {name: DeltaTables(root / f"whole-{name}") for name in ("rows", *OTHERS)},
    )
    whole_s: list[float] = []
    beside_s: list[float] = []
    batches = itertools.islice(rows.batches(ROWS_PER_LARGE), n_commits)
    for batch, others in zip(batches, _other_tables(), strict=False):
        for course in courses.values():
            course.add(batch)
        start = time.perf_counter()
        whole.commit(batch, others)
        middle = time.perf_counter()
        for name, table in {"rows": batch, **others}.items():
            beside[name].commit(table)
        beside_s.append(time.perf_counter() - middle)
        whole_s.append(middle - start)
        whole.tidy()
        for table_store in beside.values():
            table_store.tidy()
    n_rows = n_commits * ROWS_PER_LARGE
    section = Section(f"Storage: {n_commits} commits of {ROWS_PER_LARGE} intervals, {n_rows / 1e6:g} M in all")
    everything, ours = slice(0, None), courses[OURS]
    for name in (DELTA, TUNED):
        value = median(ours.commit_s) / median(courses[name].commit_s)
        shown = (ours.describe(everything), courses[name].describe(everything))
        section.rows.append(Row(f"commit, time over {name}", *shown, value, at_most(1.0)))
    value = median(courses[NOT_DURABLE].commit_s) / median(courses[TUNED].commit_s)
    shown = (courses[NOT_DURABLE].describe(everything), courses[TUNED].describe(everything))
    section.rows.append(Row(f"no fsync on either side, time over {TUNED}", *shown, value, at_most(1.0)))
    value = median(whole_s) / median(beside_s)
    shown = (f"{median(whole_s) * 1e3:.1f} ms, all at once", f"{median(beside_s) * 1e3:.1f} ms, one by one")
    section.rows.append(Row(f"four tables, time over {TUNED}", *shown, value, at_most(1.0)))
    section.rows += [_size_row(name, course) for name, course in courses.items()]
    ours_per_row, tuned_per_row = ours.bytes_per_row, courses[TUNED].bytes_per_row
    shown = (f"{ours_per_row:.3f} bytes", f"{tuned_per_row:.3f} bytes")
    section.rows.append(Row(f"merged, bytes over {TUNED}", *shown, ours_per_row / tuned_per_row, at_most(1.0)))
    section.rows += _rewritten_rows(root, courses)
    section.notes.append(
        f"Four tables: the intervals and {', '.join(f'{n} {name}' for name, n in OTHERS.items())}. Delta Lake commits"
        " each table by itself: a process that dies in between leaves some of them ahead of the others."
    )
    return section


def _rewritten_rows(root: Path, courses: dict[str, Course]) -> Iterator[Row]:
    """All rows in one file, by cell."""
    start = time.perf_counter()
    segment = write_segment(root, read_sorted(courses[OURS].store.files()), 0, durable=True)
    shown = (f"{time.perf_counter() - start:.1f} s", "")
    yield Row("bytes per interval: one segment", *shown, segment.n_bytes / segment.n_rows, unit="bytes")
    tuned = courses[TUNED].store
    assert isinstance(tuned, DeltaTables)
    start = time.perf_counter()
    tuned.order_by_cell()
    shown = ("", f"{time.perf_counter() - start:.1f} s")
    yield Row("bytes per interval: Delta Lake, z_order by cell", *shown, courses[TUNED].bytes_per_row, unit="bytes")


def _other_tables() -> Iterator[dict[str, pa.Table]]:
    """What a commit has to write beside the finished intervals."""
    import pyarrow as pa

    rng = np.random.default_rng(0)
    n_scans, n_tiles, n_open = OTHERS["scans"], OTHERS["tiles"], OTHERS["open intervals"]
    for k in itertools.count():
        stamps = np.arange(n_scans, dtype=np.int64) * 25_000_000 + k * 30_000_000_000
        pose = {name: rng.normal(size=n_scans) for name in ("x", "y", "theta")}
        corner = {name: rng.integers(-500, 500, n_tiles).astype(np.int32) for name in ("row", "col")}
        cell = np.sort(rng.choice(200_000, n_open, replace=False)).astype(np.int32)
        seen = {name: rng.integers(0, n_scans * (k + 1), n_open).astype(np.int32) for name in ("first_scan", "span")}
        yield {
            "scans": pa.table({"stamp_ns": stamps, **pose}),
            "tiles": pa.table(corner),
            "open intervals": pa.table(
                {"cell": cell, **seen, "prob": rng.choice(np.array([0.1, 0.9], np.float32), n_open)}
            ),
        }
