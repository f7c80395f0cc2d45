"""What an interval takes in memory and on disk, and what a cell takes before it has any."""

from __future__ import annotations

import tempfile
from pathlib import Path

import logs
from ingest import integrate
from report import Row, Section, at_most

from tempog import TemporalGrid, open_map, save_map
from tempog.config import Evidence


def run(names: list[str], n_scans: int | None, _n_repetitions: int) -> list[Section]:
    """One section per log."""
    evidences: tuple[Evidence, ...] = ("literal", "surface")
    sections = []
    for name in names:
        log = logs.load(name, n_scans)
        section = Section(f"Sizes: {log.name}")
        for evidence in evidences:
            _add_rows(section, evidence, integrate(log, evidence))
        section.notes.append(
            "The three arrays of an open interval are 12 bytes a cell; up to a quarter more is allocated for growth."
        )
        sections.append(section)
    return sections


def _add_rows(section: Section, evidence: Evidence, grid: TemporalGrid) -> None:
    n = grid.n_intervals  # also sorts what is left to sort
    segments = grid._segments
    in_all = grid.memory_bytes / n
    sealed = segments.nbytes / max(segments.n_intervals, 1)
    intervals, everything = _bytes_on_disk(grid)
    n_intervals, n_bytes = f"{n} intervals", "bytes"
    section.rows += [
        Row(
            f"{evidence}, memory per sealed interval",
            f"{segments.n_intervals} intervals",
            "",
            sealed,
            at_most(18, n_bytes),
        ),
        Row(f"{evidence}, all memory, cells too, per interval", n_intervals, "", in_all, unit="bytes"),
        Row(f"{evidence}, intervals.parquet per interval", n_intervals, "", intervals / n, at_most(3, n_bytes)),
        Row(f"{evidence}, whole map directory per interval", n_intervals, "", everything / n, at_most(3, n_bytes)),
    ]
    _add_cell_rows(section, evidence, grid)


def _add_cell_rows(section: Section, evidence: Evidence, grid: TemporalGrid) -> None:
    n_cells, n_bytes = grid.tiles.n_cells, "bytes"
    held = f"{n_cells} cells, {grid.n_cells} seen"
    records = grid._mapper.first.nbytes + grid._mapper.last.nbytes + grid._mapper.value.nbytes
    per_cell = (records + grid.surfaces.slot_of_cell.nbytes + grid.tiles.nbytes) / n_cells
    in_use = (
        sum(
            array.itemsize
            for array in (grid._mapper.first, grid._mapper.last, grid._mapper.value, grid.surfaces.slot_of_cell)
        )
        + (grid.tiles.tile_rows.itemsize + grid.tiles.tile_cols.itemsize) / 64
        + grid.tiles.directory.nbytes / n_cells
    )
    hits = grid.surfaces
    of_slots = (hits.nbytes - hits.slot_of_cell.nbytes) / max(hits.n_slots, 1)
    section.rows += [
        Row(f"{evidence}, per allocated cell, growth included", held, "", per_cell, unit=n_bytes),
        Row(f"{evidence}, per allocated cell, in use", held, "", in_use, at_most(16, n_bytes)),
        Row(f"{evidence}, hit points per hit cell", f"{hits.n_slots} cells", "", of_slots, unit=n_bytes),
    ]


def _bytes_on_disk(grid: TemporalGrid) -> tuple[int, int]:
    """Bytes of intervals.parquet, and of all files."""
    with tempfile.TemporaryDirectory() as folder:
        root = save_map(grid, Path(folder, "map"))
        intervals = sum(file.stat().st_size for file in root.glob("data-*/intervals.parquet"))
        return intervals, open_map(root).bytes_on_disk
