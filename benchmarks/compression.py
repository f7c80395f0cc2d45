"""What intervals take on disk in other orders and encodings, and as references to objects (paper, V.A)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import logs
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from ingest import integrate
from interval_rows import BLOCK_BITS, DICTIONARY, ENCODINGS, from_rows, to_rows
from measure import interleave, median, timed
from numpy.typing import NDArray
from report import Row, Section

from tempog import build_grid, find_objects
from tempog.grid.segments import Runs
from tempog.sensing.tiles import TILE_CELLS
from tempog.simulation import load_world, simulate
from tempog.store.references import Encoded, decode, encode

WORLDS = (("hallway", 0), ("hallway", 20), ("office", 0), ("office", 20))  # and how many people
DRIVE_S, DRIVE_S_QUICK = 900.0, 120.0
SEED = 3
ROWS_PER_GROUP = 2**18
ZSTD_LEVEL, ZSTD_LEVEL_HIGH = 9, 15
TILE_BITS = TILE_CELLS.bit_length() - 1
DELTAS, BYTES = "DELTA_BINARY_PACKED", "BYTE_STREAM_SPLIT"

Columns = dict[str, NDArray[np.generic]]


class Sample(NamedTuple):
    """A map's intervals, and the cells of each place of its objects."""

    name: str
    runs: Runs
    places: list[NDArray[np.int32]]


@dataclass(frozen=True)
class Table:
    """A Parquet file: its columns and how they are encoded."""

    columns: Columns
    encodings: dict[str, str]
    dictionary: tuple[str, ...] = ()

    def n_bytes(self, zstd_level: int = ZSTD_LEVEL) -> int:
        """Its size, as a saved map's tables are written."""
        file = pa.BufferOutputStream()
        pq.write_table(
            pa.table({name: np.ascontiguousarray(column) for name, column in self.columns.items()}),
            file,
            row_group_size=ROWS_PER_GROUP,
            compression="zstd",
            compression_level=zstd_level,
            use_dictionary=list(self.dictionary) or False,
            column_encoding=self.encodings,
            write_statistics=["cell"] if "cell" in self.columns else False,
            write_page_checksum=True,
        )
        return int(file.getvalue().size)


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """One section per log, and per simulated drive."""
    return [_measure(sample, n_repetitions) for sample in _samples(names, n_scans)]


def _samples(names: list[str], n_scans: int | None) -> Iterator[Sample]:
    grids = (((log := logs.load(name, n_scans)).name, integrate(log, "surface")) for name in names)
    duration_s = DRIVE_S if n_scans is None else DRIVE_S_QUICK
    drives = (
        (
            f"{world}, {people} people, {duration_s:g} s",
            build_grid(simulate(load_world(world, SEED), duration_s, seed=SEED, people=people).scans),
        )
        for world, people in WORLDS
    )
    for some in (grids, drives):
        for name, grid in some:
            places = [
                grid.tiles.cell_numbers(*np.ascontiguousarray(place.cells.T))
                for place in find_objects(grid).configurations
            ]
            yield Sample(name, grid.all_runs(), places)


def _measure(sample: Sample, n_repetitions: int) -> Section:
    runs, places = sample.runs, sample.places
    n = runs.n_intervals
    section = Section(f"Compression: {sample.name}")
    by_cell, in_blocks = _by_cell(runs).n_bytes(), _rows(runs).n_bytes()

    def add(what: str, n_bytes: int, peer: int = by_cell) -> None:
        sizes = (f"{n_bytes / n:.3f} bytes", f"{peer / n:.3f} bytes")
        section.rows.append(Row(what, *sizes, 100 * (n_bytes / peer - 1), unit="%"))

    for what, table in _plain_tables(runs).items():
        add(what, table.n_bytes())
    add(f"by cell, zstd {ZSTD_LEVEL_HIGH}", _by_cell(runs).n_bytes(ZSTD_LEVEL_HIGH))
    add(
        f"blocks of {1 << BLOCK_BITS} cells by last scan, zstd {ZSTD_LEVEL_HIGH}",
        _rows(runs).n_bytes(ZSTD_LEVEL_HIGH),
    )

    in_places = np.isin(runs.cells, np.concatenate([np.empty(0, np.int32), *places]))
    others = _of_cells(runs, ~in_places)
    add("by cell, objects' cells for nothing: no reference can save more", _by_cell(others).n_bytes())
    tiles = np.split(runs.cells, np.flatnonzero(np.diff(runs.cells >> TILE_BITS)) + 1)
    for what, groups in {"objects": places, "tiles": tiles}.items():
        encoded = encode(runs, groups)
        _require_identical(decode(encoded), runs)
        rest, side = _rest(encoded), sum(table.n_bytes() for table in _side_tables(encoded))
        add(f"references to {what}, the rest by cell", _by_cell(rest).n_bytes() + side)
        add(f"references to {what}, the rest in blocks, against blocks", _rows(rest).n_bytes() + side, in_blocks)
    section.notes += [
        f"{n} intervals, {n - others.n_intervals} in {np.count_nonzero(in_places)} cells of {len(places)} places.",
        "Bytes per interval, and how much more than the peer's: by cell, first and span byte-split, zstd 9.",
        f"Against blocks: of {1 << BLOCK_BITS} cells by last scan, zstd 9.",
        _seconds(runs, n_repetitions),
    ]
    return section


def _by_cell(runs: Runs) -> Table:
    columns: Columns = {"cell": _cell(runs), "first": runs.first, "span": runs.last - runs.first, "prob": runs.value}
    return Table(columns, {"cell": DELTAS, "first": BYTES, "span": BYTES}, ("prob",))


def _rows(runs: Runs) -> Table:
    return Table(to_rows(runs)._asdict(), ENCODINGS, tuple(DICTIONARY))


def _plain_tables(runs: Runs) -> dict[str, Table]:
    cell, first, last, prob = _cell(runs), runs.first, runs.last, runs.value
    span = last - first
    since_last = np.diff(last, prepend=np.int32(0)) - span
    since_last[runs.offsets[:-1]] = first[runs.offsets[:-1]]
    own: Columns = {"cell": cell, "first": first, "span": span, "prob": prob}
    packed = {"cell": DELTAS}
    deltas, split = packed | {"first": DELTAS, "span": DELTAS}, packed | {"first": BYTES, "last": BYTES}
    with_last: Columns = {"cell": cell, "first": first, "last": last, "prob": prob}
    with_gap: Columns = {"cell": cell, "gap": since_last, "span": span, "prob": prob}
    tables = {
        "by cell, first and span as bit-packed deltas": Table(own, deltas, ("prob",)),
        "by cell, first and span as dictionaries": Table(own, packed, ("prob", "first", "span")),
        "by cell, first and last": Table(with_last, split, ("prob",)),
        "by cell, gap to the look before in place of first": Table(
            with_gap, packed | {"gap": BYTES, "span": BYTES}, ("prob",)
        ),
    }
    in_order = {"cell": BYTES, "first": DELTAS, "last": DELTAS, "span": BYTES}
    for name, times in (("first", first), ("last", last)):
        for bits in (TILE_BITS, TILE_BITS + 1, BLOCK_BITS, BLOCK_BITS + 1):
            order = np.lexsort((times, cell >> bits))
            columns: Columns = {"cell": cell, name: times, "span": span, "prob": prob}
            tables[f"blocks of {1 << bits} cells by {name} scan"] = Table(
                {column: values[order] for column, values in columns.items()},
                {column: in_order[column] for column in ("cell", name, "span")},
                ("prob",),
            )
    return tables


def _side_tables(encoded: Encoded) -> list[Table]:
    timelines: Columns = {
        "group": encoded.entry_group,
        "first": encoded.entry_first,
        "span": encoded.entry_last - encoded.entry_first,
        "prob": encoded.entry_value,
    }
    return [
        Table({"member": encoded.member, "group": encoded.member_group}, {"member": DELTAS, "group": DELTAS}),
        Table(timelines, {"group": DELTAS, "first": BYTES, "span": BYTES}, ("prob",)),
        Table({"members": encoded.entry_members}, {}),
    ]


def _rest(encoded: Encoded) -> Runs:
    cells, starts = np.unique(encoded.cell, return_index=True)
    return Runs(cells, np.append(starts, len(encoded.cell)), encoded.first, encoded.last, encoded.value)


def _of_cells(runs: Runs, wanted: NDArray[np.bool_]) -> Runs:
    counts = np.diff(runs.offsets)
    kept = np.repeat(wanted, counts)
    offsets = np.append(0, counts[wanted].cumsum())
    return Runs(runs.cells[wanted], offsets, runs.first[kept], runs.last[kept], runs.value[kept])


def _cell(runs: Runs) -> NDArray[np.int32]:
    return np.repeat(runs.cells, np.diff(runs.offsets))


def _seconds(runs: Runs, n_repetitions: int) -> str:
    rows, n_cells = to_rows(runs), int(runs.cells[-1]) + 1
    _require_identical(from_rows(rows, n_cells), runs)  # also compiles
    tasks = {"to": timed(lambda: to_rows(runs)), "from": timed(lambda: from_rows(rows, n_cells))}
    seconds = interleave(tasks, n_repetitions)
    return (
        f"Into blocks by last scan takes {1e3 * median(seconds['to']):.0f} ms,"
        f" back {1e3 * median(seconds['from']):.0f} ms; both without reading or writing."
    )


def _require_identical(found: Runs, wanted: Runs) -> None:
    for name in Runs._fields:
        if getattr(found, name).tobytes() != getattr(wanted, name).tobytes():
            raise AssertionError(f"{name} was not restored")
