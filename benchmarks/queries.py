"""Questions to the history, against the same intervals in DuckDB and in SQLite, both in memory.

Everything that could be argued about is settled for the databases: they get scan numbers of four bytes
instead of stamps, are not asked for the age of a state nor to lay the cells out as an image, and of several
ways to put a question their fastest counts, even one that relies on the table's order being kept.
"""

from __future__ import annotations

import importlib.util
import math
import sqlite3
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import logs
import numpy as np
from ingest import integrate
from measure import Task, interleave, median, ratio, timed
from numpy.typing import NDArray
from report import Row, Section, Target, at_least

from tempog import TemporalGrid, map_dynamics

N_MOMENTS = 10
N_CELLS = 200
N_TRIES = 2  # runs of each way to put a question before the fastest is taken

CREATE = "CREATE TABLE intervals (cell INTEGER, start INTEGER, stop INTEGER, value REAL)"
# The parameters of a snapshot: the last scan up to t, and the first scan from t on.
SNAPSHOT = ["SELECT cell, value FROM intervals WHERE start <= $1 AND stop >= $2"]
HELD_DUCKDB = [
    "SELECT cell, arg_max(value, start) FROM intervals WHERE start <= $1 GROUP BY cell",
    "SELECT cell, last(value) FROM intervals WHERE start <= $1 GROUP BY cell",
    "SELECT c.cell, i.value FROM cells c ASOF JOIN (SELECT * FROM intervals WHERE start <= $1) i"
    " ON c.cell = i.cell AND c.latest >= i.start",
]
HELD_SQLITE = [
    "SELECT cell, value FROM (SELECT cell, value, max(start) FROM intervals WHERE start <= $1 GROUP BY cell)",
    "SELECT i.cell, i.value FROM cells c JOIN intervals i ON i.cell = c.cell"
    " AND i.start = (SELECT max(start) FROM intervals WHERE cell = c.cell AND start <= $1)",
]
DYNAMICS = [
    "WITH means AS (SELECT cell, avg(value) AS mean FROM intervals GROUP BY cell)"
    " SELECT cell, avg(abs(value - mean)) FROM intervals JOIN means USING (cell) GROUP BY cell",
    "SELECT cell, avg(abs(value - mean)) FROM"
    " (SELECT cell, value, avg(value) OVER (PARTITION BY cell) AS mean FROM intervals) GROUP BY cell",
]
HISTORY = ["SELECT start, value FROM intervals WHERE cell = $1 ORDER BY start"]

Parameters = tuple[int, ...]
Ask = Callable[[str, Parameters], Any]
"""Puts one question and returns all rows: arrays from DuckDB, tuples from SQLite."""


class Answer(NamedTuple):
    """What a question's answers, over all parameters, must have in common."""

    n_values: int
    total: float

    def agrees(self, other: Answer) -> bool:
        """Sums are of float32 values in any order."""
        return self.n_values == other.n_values and math.isclose(self.total, other.total, rel_tol=1e-4)


class Columns(NamedTuple):
    """All intervals, sorted by cell, then start; times are scan numbers."""

    cell: NDArray[np.int32]
    start: NDArray[np.int32]
    stop: NDArray[np.int32]
    value: NDArray[np.float32]


class Question(NamedTuple):
    """A question, as we and the databases are asked it.

    Attributes
    ----------
    what : str
    ours : callable
        Answers for all parameters; arrays whose NaN do not count.
    parameters : list of tuple
        One per query.
    duckdb, sqlite : list of str
        Ways to put it; the value is the last column.
    faster_than_duckdb, faster_than_sqlite : Target, optional
    """

    what: str
    ours: Callable[[], list[NDArray[Any]]]
    parameters: Sequence[Parameters]
    duckdb: list[str]
    sqlite: list[str]
    faster_than_duckdb: Target | None = None
    faster_than_sqlite: Target | None = None


class Peer(NamedTuple):
    """A database with the intervals in it."""

    name: str
    ask: Ask
    answer: Callable[[Any], Answer]


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """The first log only; literal evidence, which makes the most intervals."""
    log = logs.load(names[0], n_scans)
    grid = integrate(log, "literal")
    peers = _peers(_columns(grid))
    section = Section(f"Queries: {log.name}, literal, {grid.n_intervals} intervals, {grid.n_cells} cells")
    if len(peers) == 1:
        section.notes.append("DuckDB is absent.")
    for question in _questions(grid):
        _add_rows(section, question, peers, n_repetitions)
    section.notes += [
        f"Snapshots at {N_MOMENTS} moments; histories of {N_CELLS} cells; milliseconds per question.",
        "tempog gives a snapshot as images of value and age; the databases give cell and value only.",
    ]
    return [section]


def _columns(grid: TemporalGrid) -> Columns:
    runs = grid.all_runs()
    return Columns(np.repeat(runs.cells, np.diff(runs.offsets)), runs.first, runs.last, runs.value)


def _questions(grid: TemporalGrid) -> list[Question]:
    stamps = grid.stamps_ns
    moments = [int(stamps[k]) for k in np.linspace(0, len(stamps) - 1, N_MOMENTS + 2, dtype=int)[1:-1]]
    until = [int(np.searchsorted(stamps, t, side="right")) - 1 for t in moments]
    since = [int(np.searchsorted(stamps, t, side="left")) for t in moments]
    cells = np.random.default_rng(0).choice(grid.all_runs().cells, N_CELLS)
    centres = grid.tiles.spec.centres(*grid.tiles.rows_cols(cells))

    def at(hold: float | None) -> list[NDArray[Any]]:
        return [grid.at(np.datetime64(t, "ns"), hold=hold).value for t in moments]

    def histories() -> list[NDArray[Any]]:
        return [grid.history(float(x), float(y)).value for x, y in centres]

    duckdb, sqlite = at_least(4), at_least(50)
    return [
        Question(
            "snapshot", partial(at, None), list(zip(until, since, strict=True)), SNAPSHOT, SNAPSHOT, duckdb, sqlite
        ),
        Question(
            "snapshot, hold=inf",
            partial(at, math.inf),
            [(k,) for k in until],
            HELD_DUCKDB,
            HELD_SQLITE,
            duckdb,
            sqlite,
        ),
        Question(
            "dynamics of all cells",
            lambda: [map_dynamics(grid, weight="interval")],
            [()],
            DYNAMICS,
            DYNAMICS,
            at_least(1),
            at_least(1),
        ),
        Question(
            "history of a cell",
            histories,
            [(int(cell),) for cell in cells],
            HISTORY,
            HISTORY,
            at_least(1),
            at_least(1),
        ),
    ]


def _add_rows(section: Section, question: Question, peers: list[Peer], n_repetitions: int) -> None:
    ways = {"DuckDB": question.duckdb, "SQLite": question.sqlite}
    targets = {"DuckDB": question.faster_than_duckdb, "SQLite": question.faster_than_sqlite}
    ours = _sum_up(question.ours())
    tasks: dict[str, Task] = {"tempog": timed(question.ours)}
    agreeing = []
    for peer in peers:
        fastest = _fastest(peer, ways[peer.name.split(",")[0]], question.parameters)
        tasks[peer.name] = timed(partial(_ask_all, peer, fastest, question.parameters))
        parts = [peer.answer(rows) for rows in _ask_all(peer, fastest, question.parameters)]
        theirs = Answer(sum(part.n_values for part in parts), sum(part.total for part in parts))
        agreeing.append(theirs.agrees(ours))
        if not theirs.agrees(ours):
            section.notes.append(f"DISAGREE, {question.what}: tempog {ours}, {peer.name} {theirs}.")
    seconds = interleave(tasks, n_repetitions)
    scale = 1e3 / len(question.parameters)
    for peer in peers:
        section.rows.append(
            Row(
                f"{question.what}, faster than {peer.name}",
                f"{scale * median(seconds['tempog']):.3g} ms",
                f"{scale * median(seconds[peer.name]):.3g} ms",
                ratio(seconds[peer.name], seconds["tempog"]),
                targets[peer.name.split(",")[0]],
            )
        )
    if all(agreeing):
        section.notes.append(f"All agree, {question.what}: {ours.n_values} values, sum {ours.total:.6g}.")


def _ask_all(peer: Peer, query: str, parameters: Sequence[Parameters]) -> list[Any]:
    return [peer.ask(query, values) for values in parameters]


def _fastest(peer: Peer, queries: list[str], parameters: Sequence[Parameters]) -> str:
    if len(queries) == 1:
        return queries[0]
    some = parameters[:: max(1, len(parameters) // 3)]
    tries = interleave({query: timed(partial(_ask_all, peer, query, some)) for query in queries}, N_TRIES)
    return min(queries, key=lambda query: min(tries[query]))


def _sum_up(arrays: list[NDArray[Any]]) -> Answer:
    known = [array[~np.isnan(array)] for array in arrays]
    return Answer(sum(len(array) for array in known), float(sum(array.sum(dtype=np.float64) for array in known)))


def _peers(columns: Columns) -> list[Peer]:
    peers = []
    if importlib.util.find_spec("duckdb"):
        peers = [_duckdb(columns, n_threads) for n_threads in (1, 2)]
    return [*peers, _sqlite(columns)]


def _duckdb(columns: Columns, n_threads: int) -> Peer:
    import duckdb
    import pyarrow as pa

    connection = duckdb.connect(":memory:", config={"threads": n_threads})
    connection.register("columns", pa.table(columns._asdict()))
    connection.execute(CREATE)
    connection.execute("INSERT INTO intervals SELECT cell, start, stop, value FROM columns")
    latest = len(columns.start)  # no scan number is as large
    connection.execute(f"CREATE TABLE cells AS SELECT DISTINCT cell, {latest} AS latest FROM intervals ORDER BY cell")

    def ask(query: str, parameters: Parameters) -> Any:
        return connection.execute(query, parameters).fetchnumpy()

    def answer(rows: Any) -> Answer:
        values = np.asarray(list(rows.values())[-1])
        return Answer(len(values), float(values.sum(dtype=np.float64)))

    return Peer(f"DuckDB, {n_threads} thread{'s' if n_threads > 1 else ''}", ask, answer)


def _sqlite(columns: Columns) -> Peer:
    connection = sqlite3.connect(":memory:")
    connection.execute(CREATE)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    connection.executemany("INSERT INTO intervals VALUES (?, ?, ?, ?)", rows)
    connection.execute("CREATE INDEX by_cell ON intervals (cell, start)")
    connection.execute("CREATE TABLE cells AS SELECT DISTINCT cell FROM intervals")
    connection.execute("ANALYZE")

    def ask(query: str, parameters: Parameters) -> Any:
        return connection.execute(query, parameters).fetchall()

    def answer(rows: Any) -> Answer:
        return Answer(len(rows), math.fsum(row[-1] for row in rows))

    return Peer("SQLite", ask, answer)
