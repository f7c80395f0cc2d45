"""A process of its own for the questions to large maps: python storage_child.py JSON prints JSON.

`who` answers is tempog from disk, a grid in memory, DuckDB with the map's files, or a database that holds the same.
"""

from __future__ import annotations

import gc
import json
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from measure import median
from memory import peak_bytes
from queries import HELD_SQLITE

from tempog import open_map
from tempog.grid.history import CellPiece, History
from tempog.grid.segments import Runs, join
from tempog.sensing.tiles import TILE, TILE_CELLS
from tempog.store.saved_map import SavedMap
from tempog.store.strand import Strand

N_AGAIN = 5
TILE_NUMBER = 1000
COLUMNS = "cell, first_scan AS start, first_scan + span AS stop, prob AS value"
HELD = [
    "SELECT cell, arg_max(value, start) FROM intervals WHERE start <= {until} GROUP BY cell",
    "SELECT cell, last(value ORDER BY start) FROM intervals WHERE start <= {until} GROUP BY cell",
]
NOT_HELD = ["SELECT cell, any_value(value) FROM intervals WHERE start <= {until} AND stop >= {since} GROUP BY cell"]
NOT_HELD_SQLITE = ["SELECT cell, value FROM intervals WHERE start <= {until} AND stop >= {since}"]
OF_TILE = [
    "SELECT cell, start, max(value) FROM intervals WHERE cell >= {cell} AND cell < {end_cell} GROUP BY cell, start"
]
OF_TILE_SQLITE = ["SELECT cell, start, value FROM intervals WHERE cell >= {cell} AND cell < {end_cell}"]
ROWS_AT_ONCE = 10**6


class Held(History):
    """A map's intervals in memory, in two sets as a grid holds them after a question."""

    def __init__(self, saved: SavedMap) -> None:
        self.config, self.tiles = saved.config, saved.tiles
        self._stamps_ns, self._poses = saved.stamps_ns, saved.poses
        *sealed, going_on = saved.runs()
        self._sets = [join(sealed), going_on]

    @property
    def stamps_ns(self) -> Any:
        """Stamp of each scan."""
        return self._stamps_ns

    @property
    def poses(self) -> Any:
        """Pose at each scan."""
        return self._poses

    def runs(self) -> Iterator[Runs]:
        """All intervals."""
        yield from self._sets

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        """Those of one cell."""
        pieces = [(runs, runs.of_cell(cell)) for runs in self._sets]
        return [(runs.first[where], runs.last[where], runs.value[where]) for runs, where in pieces]


def main(arguments: dict[str, Any]) -> dict[str, Any]:
    """Answer one question: cold, and again."""
    who, question = arguments["who"], arguments["question"]
    if question == "fill":
        return _fill(arguments)
    if who in ("tempog", "grid"):
        return _ours(arguments)
    parameters = _parameters(open_map(arguments["map"]), arguments["moment"])
    ways = _ways(who, question)
    return _theirs(arguments, ways[arguments["way"]].format(**parameters)) | {"n_ways": len(ways)}


def _ours(arguments: dict[str, Any]) -> dict[str, Any]:
    question = arguments["question"]
    if question != "open":
        _question(open_map(arguments["tiny"]), question, arguments["moment"])()  # loads what is loaded once
    gc.collect()
    _forget_peak()
    before, before_cpu = time.perf_counter(), time.process_time()
    saved: SavedMap | Held = open_map(arguments["map"])
    opened_s = time.perf_counter() - before
    if question == "open":
        return {"cold_s": opened_s, "peak_bytes": peak_bytes()}
    if arguments["who"] == "grid":
        saved = Held(open_map(arguments["map"]))
        before, before_cpu = time.perf_counter(), time.process_time()
    ask = _question(saved, question, arguments["moment"])
    n, total = ask()
    cold = {"cold_s": time.perf_counter() - before, "cold_cpu_s": time.process_time() - before_cpu}
    cold |= {"peak_bytes": peak_bytes(), "n": n, "total": total, "warm_s": _again(ask)}
    elsewhere = _question(saved, question, arguments["moment"] - 0.2)
    before = time.perf_counter()
    elsewhere()
    return cold | {"other_s": time.perf_counter() - before}


def _question(history: History, question: str, moment: float) -> Callable[[], tuple[int, float]]:
    """Asks once; returns how many values came, and their sum."""
    if question == "tile":
        return lambda: _ask_tile(history)
    stamps_ns = history.stamps_ns
    at = np.datetime64(int(stamps_ns[_scan(history, moment)]), "ns")
    hold = np.inf if question == "inf" else None

    def ask() -> tuple[int, float]:
        value = history.at(at, hold).value
        return int(np.count_nonzero(~np.isnan(value))), float(np.nansum(value, dtype=np.float64))

    return ask


def _ask_tile(history: History) -> tuple[int, float]:
    tiles = history.tiles
    number = min(TILE_NUMBER, tiles.n_tiles - 1)
    side_m = TILE * tiles.spec.resolution_m
    x, y = (tiles.tile_cols[number] + 0.5) * side_m, (tiles.tile_rows[number] + 0.5) * side_m
    runs = history.area(float(x), float(x), float(y), float(y)).all_runs()
    return runs.n_intervals, float(runs.value.sum(dtype=np.float64))


def _scan(history: History, moment: float) -> int:
    return int(moment * (len(history.stamps_ns) - 1))


def _parameters(saved: SavedMap, moment: float) -> dict[str, int]:
    scan = _scan(saved, moment)
    stamps_ns = saved.stamps_ns
    cell = min(TILE_NUMBER, saved.tiles.n_tiles - 1) * TILE_CELLS
    return {
        "until": int(np.searchsorted(stamps_ns, stamps_ns[scan], side="right")) - 1,
        "since": int(np.searchsorted(stamps_ns, stamps_ns[scan], side="left")),
        "cell": cell,
        "end_cell": cell + TILE_CELLS,
    }


def _ways(who: str, question: str) -> list[str]:
    if who == "sqlite":
        return {"inf": HELD_SQLITE_WAYS, "none": NOT_HELD_SQLITE, "tile": OF_TILE_SQLITE}[question]
    return {"inf": HELD, "none": NOT_HELD, "tile": OF_TILE}[question]


HELD_SQLITE_WAYS = [way.replace("$1", "{until}") for way in HELD_SQLITE]


def _theirs(arguments: dict[str, Any], query: str) -> dict[str, Any]:
    if arguments["who"] != "sqlite":
        import duckdb  # noqa: F401  # not to be timed
    _forget_peak()
    start = time.perf_counter()
    ask = _asker(arguments)
    n, total = ask(query)
    cold_s = time.perf_counter() - start
    return {
        "cold_s": cold_s,
        "n": n,
        "total": total,
        "warm_s": _again(lambda: ask(query)),
        "peak_bytes": peak_bytes(),
    }


def _asker(arguments: dict[str, Any]) -> Callable[[str], tuple[int, float]]:
    if arguments["who"] == "sqlite":
        connection = sqlite3.connect(arguments["database"])

        def ask_rows(query: str) -> tuple[int, float]:
            rows = connection.execute(query).fetchall()
            return len(rows), float(sum(row[-1] for row in rows))

        return ask_rows
    import duckdb

    if arguments["who"] == "duckdb":
        database = duckdb.connect(arguments["database"], read_only=True)
    else:
        database = duckdb.connect()
        files = _files(arguments)
        database.execute(f"CREATE VIEW intervals AS SELECT {COLUMNS} FROM read_parquet({files})")

    def ask(query: str) -> tuple[int, float]:
        values = np.asarray(list(database.execute(query).fetchnumpy().values())[-1])
        return len(values), float(values.sum(dtype=np.float64))

    return ask


def _files(arguments: dict[str, Any]) -> list[str]:
    """The files of intervals: of the whole map, or of the segment that holds the moment."""
    saved = open_map(arguments["map"])
    segments = saved.segments
    full = max(k for k, segment in enumerate(segments) if segment.full)
    chosen, going_on = segments, segments[full:]
    if arguments["who"] == "two-files":
        strand = saved._history
        assert isinstance(strand, Strand)
        scan = _scan(saved, arguments["moment"])
        since, until = strand.segments_within(scan, scan)
        full = max(k for k in range(until) if segments[k].full)
        chosen, going_on = segments[since:until], segments[full:until]
    files = [saved.path / segment.name / "intervals.parquet" for segment in chosen]
    files += [saved.path / segment.name / "open.parquet" for segment in going_on]
    return [str(file) for file in files]


def _fill(arguments: dict[str, Any]) -> dict[str, Any]:
    """A database with all intervals of the map."""
    start = time.perf_counter()
    if arguments["who"] == "duckdb":
        import duckdb

        database = duckdb.connect(arguments["database"])
        files = _files(arguments | {"who": "parquet"})
        database.execute(f"CREATE TABLE intervals AS SELECT {COLUMNS} FROM read_parquet({files})")
        database.close()
    else:
        runs = open_map(arguments["map"]).all_runs()
        connection = sqlite3.connect(arguments["database"])
        connection.executescript("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;")
        connection.execute("CREATE TABLE intervals (cell INTEGER, start INTEGER, stop INTEGER, value REAL)")
        columns = runs.cell, runs.first, runs.last, runs.value
        for k in range(0, runs.n_intervals, ROWS_AT_ONCE):
            rows = zip(*(column[k : k + ROWS_AT_ONCE].tolist() for column in columns), strict=True)
            connection.executemany("INSERT INTO intervals VALUES (?, ?, ?, ?)", rows)
        connection.execute("CREATE INDEX by_cell ON intervals (cell, start)")
        connection.execute("CREATE TABLE cells AS SELECT DISTINCT cell FROM intervals")
        connection.execute("ANALYZE")
        connection.commit()
    return {"fill_s": time.perf_counter() - start}


def _again(ask: Callable[[], object]) -> float:
    seconds = []
    for _ in range(N_AGAIN):
        start = time.perf_counter()
        ask()
        seconds.append(time.perf_counter() - start)
        if sum(seconds) > 10.0:
            break
    return median(seconds)


def _forget_peak() -> None:
    """Let the peak be what is held now."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


if __name__ == "__main__":
    print(json.dumps(main(json.loads(sys.argv[1]))))
