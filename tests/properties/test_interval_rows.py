"""Intervals in the order of a file become the same intervals again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from same_runs import assert_identical
from strategies import runs_of_cells
from tempog.grid.segments import Runs
from tempog.store.interval_rows import BLOCK_BITS, DICTIONARY, ENCODINGS, IntervalRows, from_rows, to_rows


@settings(deadline=None)
@given(runs_of_cells(), st.integers(0, 300))
def test_rows_of_a_file_become_the_same_intervals(runs: Runs, n_unseen: int) -> None:
    n_cells = int(runs.cells.max(initial=-1)) + 1 + n_unseen
    assert_identical(from_rows(to_rows(runs), n_cells), runs)


@settings(deadline=None)
@given(runs_of_cells())
def test_a_block_of_cells_is_kept_in_the_order_of_last_looks(runs: Runs) -> None:
    rows = to_rows(runs)
    keys = list(zip((rows.cell >> BLOCK_BITS).tolist(), rows.last_scan.tolist(), rows.cell.tolist(), strict=True))
    assert keys == sorted(keys)


@settings(deadline=None)
@given(runs_of_cells())
def test_rows_survive_parquet_as_they_are_encoded(runs: Runs) -> None:
    read = IntervalRows(**through_parquet(to_rows(runs)._asdict(), ENCODINGS, DICTIONARY))
    assert_identical(from_rows(read, int(runs.cells.max(initial=-1)) + 1), runs)


def test_duckdb_reads_the_rows_as_plain_columns(tmp_path: Path) -> None:
    duckdb = pytest.importorskip("duckdb")
    random = np.random.default_rng(0)
    cells = np.arange(0, 2000, 3, dtype=np.int32)
    counts = random.integers(1, 6, len(cells))
    offsets = np.append(0, counts.cumsum())
    first = np.concatenate([10 * np.arange(n) for n in counts]).astype(np.int32)
    value = random.choice(np.array([0.1, 0.9], np.float32), offsets[-1])
    runs = Runs(cells, offsets, first, (first + random.integers(0, 9, offsets[-1])).astype(np.int32), value)
    path = tmp_path / "intervals.parquet"
    write(to_rows(runs)._asdict(), path, ENCODINGS, DICTIONARY)

    found = duckdb.sql(
        "SELECT cell, last_scan - span AS first, last_scan AS last, prob"
        f" FROM read_parquet('{path}') ORDER BY cell, first"
    ).fetchnumpy()

    assert np.array_equal(found["cell"], np.repeat(runs.cells, counts))
    assert np.array_equal(found["first"], runs.first)
    assert np.array_equal(found["last"], runs.last)
    assert np.array_equal(found["prob"], runs.value)


def through_parquet(
    columns: dict[str, NDArray], encodings: dict[str, str] | None, dictionary: list[str]
) -> dict[str, NDArray]:
    file = pa.BufferOutputStream()
    write(columns, file, encodings, dictionary)
    table = pq.read_table(pa.BufferReader(file.getvalue()))
    return {name: table[name].to_numpy() for name in columns}


def write(columns: dict[str, NDArray], file: object, encodings: dict[str, str] | None, dictionary: list[str]) -> None:
    pq.write_table(
        pa.table(columns), file, compression="zstd", use_dictionary=dictionary or False, column_encoding=encodings
    )
