"""How fast intervals are written, and how many bytes they take."""

from __future__ import annotations

import shutil
from pathlib import Path

import logs
from ingest import integrate
from logs import BenchLog
from measure import interleave, median, timed
from report import Row, Section, at_least, at_most
from stopwatch import Stopwatch, watched

from tempog import LiveMap, TemporalGrid, open_map, save_map
from tempog.config import Evidence
from tempog.store import committer
from tempog.store.upkeep import compact

EVIDENCES: tuple[Evidence, ...] = ("literal", "surface")
WANTED_RATE = at_least(1e6, "intervals/s")
WANTED_BYTES = at_most(2.2, "bytes")  # of freiburg-079 by surface evidence


def write_section(name: str, n_scans: int | None, n_repetitions: int, folder: Path) -> Section:
    """A grid that is saved, and the same log as it is mapped live."""
    log = logs.load(name, n_scans)
    grid = integrate(log, "literal")
    n = grid.n_intervals
    section = Section(f"Storage: written per second, {log.name}, literal, {n} intervals")
    save = timed(lambda: save_map(grid, folder / "saved", force=True))
    save()
    seconds = median(interleave({"save": save}, n_repetitions)["save"])
    section.rows.append(Row("save_map", f"{seconds:.2f} s", "", n / seconds, WANTED_RATE))
    for flush_s in (30.0, 5.0):
        _add_live_rows(section, log, flush_s, folder / "live")
    section.notes.append("Until fsync has returned. Merging reads, sorts and writes again.")
    return section


def _add_live_rows(section: Section, log: BenchLog, flush_s: float, path: Path) -> None:
    watch = Stopwatch()
    with (
        watched(watch, committer, "write_segment", n_of=lambda made: made.n_intervals),
        watched(watch, committer, "merge_segments", n_of=lambda made: made.n_intervals),
        LiveMap(path, log.config("literal"), flush_s=flush_s) as live,
    ):
        live.integrate_many(log.scans)
    shutil.rmtree(path)
    written, merged = watch["write_segment"], watch["merge_segments"]
    what = f"live, a commit each {flush_s:g} s"
    section.rows += [
        Row(
            f"{what}: writing, in a thread of its own",
            f"{written.seconds:.2f} s in {written.n_calls} commits",
            "",
            written.n / written.seconds,
            WANTED_RATE,
        ),
        Row(
            f"{what}: merging, in the same thread",
            f"{merged.seconds:.2f} s in {merged.n_calls} merges",
            "",
            merged.n / max(merged.seconds, 1e-9),
            unit="intervals/s",
        ),
    ]


def size_section(names: list[str], n_scans: int | None, folder: Path) -> Section:
    """Bytes per interval of whole map directories."""
    section = Section("Storage: bytes per interval, all files of the map")
    for name in names:
        log = logs.load(name, n_scans)
        for evidence in EVIDENCES:
            target = WANTED_BYTES if (name, evidence) == (names[0], "surface") else None
            grid = integrate(log, evidence)
            save_map(grid, folder / "saved", force=True)
            what = f"{log.name}, {evidence}"
            section.rows.append(_size_row(f"{what}, saved", folder / "saved", grid))
            with LiveMap(folder / "live", log.config(evidence), flush_s=10.0) as live:
                live.integrate_many(log.scans)
            section.rows.append(_size_row(f"{what}, mapped live", folder / "live", grid))
            compact(folder / "live")
            row = _size_row(f"{what}, mapped live, compacted", folder / "live", grid)
            section.rows += [row if target is None else Row(row.what, row.ours, row.peer, row.value, target)]
            shutil.rmtree(folder / "live")
    section.notes.append(
        "Tables of cells seen and hit, scans and map.json are counted, too. What was replaced waits for readers for"
        " up to 600 s, or for compact."
    )
    return section


def _size_row(what: str, path: Path, grid: TemporalGrid) -> Row:
    saved = open_map(path)
    assert saved.n_intervals == grid.n_intervals
    held = f"{saved.n_intervals} intervals, {len(saved.segments)} segments"
    n_bytes = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    left = f"and {(n_bytes - saved.bytes_on_disk) / 1e6:.1f} MB that were replaced" if saved.manifest.retired else ""
    return Row(what, held, left, saved.bytes_on_disk / saved.n_intervals, unit="bytes")
