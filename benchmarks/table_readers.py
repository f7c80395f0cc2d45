"""Who else can read the stores: DuckDB and Polars, and how long the history of one cell takes them."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from measure import interleave, median, timed
from report import Row, Section
from table_stores import Store

CELL = 20_000


def reader_section(stores: dict[str, Store], n_repetitions: int) -> Section:
    """The intervals of one cell, read from each store by each reader."""
    section = Section("Storage: the history of one cell, by other readers")
    questions: dict[str, Callable[[], int]] = {}
    for name, store in stores.items():
        if name.endswith("no fsync"):
            continue
        files = store.files()
        questions[f"{name}, {len(files)} files: DuckDB, list of files"] = partial(_duckdb, files)
        if importlib.util.find_spec("polars") is None:
            continue
        questions[f"{name}, {len(files)} files: Polars, list of files"] = partial(_polars, files)
        if (store.root / "_delta_log").is_dir():
            questions[f"{name}, {len(files)} files: Polars, scan_delta"] = partial(_polars_delta, store.root)
    found = {what: question() for what, question in questions.items()}
    seconds = interleave({what: timed(question) for what, question in questions.items()}, n_repetitions)
    for what in questions:
        section.rows.append(Row(what, f"{found[what]} intervals", "", median(seconds[what]) * 1e3, unit="ms"))
    section.rows.append(Row("DuckDB, delta_scan", "", _delta_extension()))
    if importlib.util.find_spec("polars") is None:
        section.rows.append(Row("Polars", "", "absent"))
    section.notes.append("Opening the table or list is part of it; imports are not.")
    return section


def _duckdb(files: list[Path]) -> int:
    import duckdb

    connection = duckdb.connect()
    query = f"select count(*) from read_parquet(?) where cell = {CELL}"
    (count,) = connection.execute(query, [[str(file) for file in files]]).fetchall()[0]
    return int(count)


def _polars(files: list[Path]) -> int:
    import polars

    return _n_found(polars.scan_parquet(files))


def _polars_delta(root: Path) -> int:
    import polars

    return _n_found(polars.scan_delta(str(root)))


def _n_found(frame: Any) -> int:
    import polars

    return int(frame.filter(polars.col("cell") == CELL).collect().height)


def _delta_extension() -> str:
    """Whether DuckDB's extension for Delta Lake can be had; it is downloaded at the first use."""
    import duckdb

    start = time.perf_counter()
    try:
        duckdb.connect().execute("install delta")
    except duckdb.Error as error:
        return f"not measured: {str(error).splitlines()[0].partition(' at URL')[0]}"
    return f"installed in {time.perf_counter() - start:.1f} s"
