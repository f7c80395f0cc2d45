"""Three ways to keep a growing table of intervals on disk, one commit at a time.

- `Segments`: Parquet files of our own and a JSON manifest that is replaced by a rename.
- `DeltaTables`: Delta Lake writes both the Parquet files and the log.
- `DeltaLog`: Parquet files of our own, listed in a Delta Lake log.

All keep the same columns in the same encodings, by the same settings as saved maps. `tidy` merges small files.
"""

from __future__ import annotations

import json
import os
import time
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import pyarrow as pa

MANIFEST = "manifest.json"
ROWS_PER_GROUP = 2**18
ZSTD_LEVEL = 9
MERGE_FACTOR = 8  # so many files of one level become one of the next
ENCODINGS = {"cell": "DELTA_BINARY_PACKED", "first_scan": "BYTE_STREAM_SPLIT", "span": "BYTE_STREAM_SPLIT"}
BOUNDED = ("cell", "first_scan")  # columns whose least and greatest value the list of files tells
FORGET_REMOVED = {  # without these, each file that was merged away is carried along in the log for a week
    "delta.deletedFileRetentionDuration": "interval 0 seconds",
    "delta.logRetentionDuration": "interval 0 seconds",
    "delta.checkpointInterval": "16",
}
VACUUM_EVERY = 64  # commits


class Store(Protocol):
    """Somewhere to commit rows to."""

    root: Path

    def commit(self, rows: pa.Table) -> None:
        """Have the rows be there for whoever opens the store from now on."""

    def tidy(self) -> None:
        """Merge what is due, if anything is."""

    def files(self) -> list[Path]:
        """The Parquet files that hold the rows."""

    def log_bytes(self) -> int:
        """Bytes of what lists the files."""


@dataclass(frozen=True)
class Segment:
    """A Parquet file of rows sorted by cell, and what it spans.

    Attributes
    ----------
    file : str
    level : int
        How many merges its rows went through.
    n_rows, n_bytes : int
    bounds : dict
        Least and greatest value of each of BOUNDED.
    """

    file: str
    level: int
    n_rows: int
    n_bytes: int
    bounds: dict[str, list[int]]


class Segments:
    """Parquet files and a manifest that names them all.

    Parameters
    ----------
    root : Path
        Created if it is not there; what the manifest does not name is removed.
    merge : bool
        Whether `tidy` does anything.
    durable : bool
        Whether a commit waits for the disk.
    """

    def __init__(self, root: Path, *, merge: bool = True, durable: bool = True) -> None:
        self.root, self.merge, self.durable = root, merge, durable
        self.folder = root / "segments"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.segments, self.others = open_segments(root) if (root / MANIFEST).is_file() else ([], [])
        self._texts = {segment.file: json.dumps(asdict(segment)) for segment in self.segments}
        self._remove_unnamed()

    def commit(self, rows: pa.Table, others: Mapping[str, pa.Table] | None = None) -> None:
        """One more segment, a file for each of the other tables, then the manifest that names all of them."""
        segment = write_segment(self.folder, rows, 0, self.durable)
        files = [self._write_other(name, table) for name, table in (others or {}).items()]
        self._replace_manifest([*self.segments, segment], [*self.others, *files])

    def tidy(self) -> None:
        """Merge the newest MERGE_FACTOR files while they are of one level."""
        while self.merge and (due := due_for_merge([segment.level for segment in self.segments])):
            parts, level = self.segments[due], self.segments[-1].level + 1
            rows = read_sorted(self.folder / segment.file for segment in parts)
            merged = write_segment(self.folder, rows, level, self.durable)
            self._replace_manifest([*self.segments[: due.start], merged], self.others)
            for segment in parts:
                (self.folder / segment.file).unlink()
                del self._texts[segment.file]

    def files(self) -> list[Path]:
        """As the manifest names them."""
        return [self.folder / segment.file for segment in self.segments]

    def log_bytes(self) -> int:
        """Of the manifest."""
        return (self.root / MANIFEST).stat().st_size

    def _write_other(self, name: str, table: pa.Table) -> str:
        import pyarrow.parquet as pq

        file = f"{name}-{uuid.uuid4().hex}.parquet"
        pq.write_table(table, self.folder / file, compression="zstd", compression_level=ZSTD_LEVEL)
        if self.durable:
            sync(self.folder / file)
        return file

    def _replace_manifest(self, segments: list[Segment], others: list[str]) -> None:
        for segment in segments[-1:]:
            self._texts[segment.file] = json.dumps(asdict(segment))
        texts = ",\n".join(self._texts[segment.file] for segment in segments)
        unfinished = self.root / f"{MANIFEST}.unfinished"
        with unfinished.open("w", encoding="utf-8") as file:
            file.write(f'{{"segments": [{texts}],\n"others": {json.dumps(others)}}}\n')
            file.flush()
            if self.durable:
                os.fsync(file.fileno())
        if self.durable:
            sync(self.folder)
        unfinished.replace(self.root / MANIFEST)
        if self.durable:
            sync(self.root)
        self.segments, self.others = segments, others

    def _remove_unnamed(self) -> None:
        (self.root / f"{MANIFEST}.unfinished").unlink(missing_ok=True)
        named = {*self.others, *(segment.file for segment in self.segments)}
        for path in self.folder.iterdir():
            if path.name not in named:
                path.unlink()


class DeltaTables:
    """A Delta Lake table, told to use our encodings.

    Parameters
    ----------
    root : Path
    tuned : bool
        False: appends only, with the settings a new table has. True: removed files are forgotten at the next
        checkpoint, checkpoints come every 16 commits, and `tidy` compacts in tiers and vacuums.
    """

    def __init__(self, root: Path, *, tuned: bool = True) -> None:
        from deltalake import DeltaTable

        self.root, self.tuned = root, tuned
        self.table = DeltaTable(root) if DeltaTable.is_deltatable(str(root)) else None
        self._n_commits = 0
        self._n_bytes = 0  # of the first commit's file

    def commit(self, rows: pa.Table) -> None:
        """One append, with checkpoints as they come."""
        from deltalake import DeltaTable, write_deltalake

        if self.table is None:
            self.table = DeltaTable.create(
                self.root, schema=rows.schema, configuration=FORGET_REMOVED if self.tuned else None
            )
        write_deltalake(self.table, rows, mode="append", writer_properties=_writer_properties())
        self._n_commits += 1

    def tidy(self) -> None:
        """Compact to files of MERGE_FACTOR commits, their square's every so often, and so on."""
        if self.table is None or not self.tuned or self._n_commits % MERGE_FACTOR:
            return
        self._n_bytes = self._n_bytes or self.files()[0].stat().st_size
        n_merged = MERGE_FACTOR
        while self._n_commits % (n_merged * MERGE_FACTOR) == 0:
            n_merged *= MERGE_FACTOR
        self.table.optimize.compact(target_size=self._n_bytes * n_merged, writer_properties=_writer_properties())
        if self._n_commits % VACUUM_EVERY == 0:
            # Only a full one finds files whose removal is forgotten, or that a killed process left.
            self.table.vacuum(0, dry_run=False, enforce_retention_duration=False, full=True)

    def order_by_cell(self) -> None:
        """Write all rows again, sorted by cell only."""
        assert self.table is not None
        self.table.optimize.z_order(["cell"], writer_properties=_writer_properties())

    def files(self) -> list[Path]:
        """Those the newest version of the table has."""
        return _delta_files(self.root, self.table)

    def log_bytes(self) -> int:
        """Of the commits and checkpoints."""
        return _delta_log_bytes(self.root)


class DeltaLog:
    """Our own Parquet files in a Delta Lake log, merged like `Segments` and with the table settings of `DeltaTables`.

    Parameters
    ----------
    root : Path
    durable : bool
        Whether a commit waits for the disk; we sync the log's file ourselves, as Delta Lake does not.
    """

    def __init__(self, root: Path, *, durable: bool = True) -> None:
        from deltalake import DeltaTable

        self.root, self.durable = root, durable
        self.table = DeltaTable(root) if DeltaTable.is_deltatable(str(root)) else None
        self._segments: list[Segment] = []

    def commit(self, rows: pa.Table) -> None:
        """A file, then one entry in the log."""
        from deltalake import DeltaTable

        if self.table is None:
            self.root.mkdir(parents=True, exist_ok=True)
            self.table = DeltaTable.create(self.root, schema=rows.schema, configuration=FORGET_REMOVED)
        segment = write_segment(self.root, rows, 0, self.durable)
        self._append_to_log([_add(segment, new_rows=True)], rows.schema)
        self._segments.append(segment)

    def tidy(self) -> None:
        """Merge like `Segments`: the files go out of the table and their merger in, in one commit."""
        while due := due_for_merge([segment.level for segment in self._segments]):
            parts, level = self._segments[due], self._segments[-1].level + 1
            rows = read_sorted(self.root / segment.file for segment in parts)
            merged = write_segment(self.root, rows, level, self.durable)
            self._append_to_log([_add(merged, new_rows=False), *map(_remove, parts)], rows.schema)
            self._segments[due] = [merged]
            for segment in parts:
                (self.root / segment.file).unlink()

    def files(self) -> list[Path]:
        """Those the newest version of the table has."""
        return _delta_files(self.root, self.table)

    def log_bytes(self) -> int:
        """Of the commits and checkpoints."""
        return _delta_log_bytes(self.root)

    def _append_to_log(self, actions: list[Any], schema: pa.Schema) -> None:
        assert self.table is not None
        if self.durable:
            sync(self.root)
        self.table.create_write_transaction(actions, "append", schema)
        self.table.update_incremental()
        if self.durable:
            sync(self.root / "_delta_log" / f"{self.table.version():020}.json")
            sync(self.root / "_delta_log")


def _add(segment: Segment, *, new_rows: bool) -> Any:
    from deltalake.transaction import AddAction

    statistics = {
        "numRecords": segment.n_rows,
        "minValues": {name: bounds[0] for name, bounds in segment.bounds.items()},
        "maxValues": {name: bounds[1] for name, bounds in segment.bounds.items()},
        "nullCount": dict.fromkeys(segment.bounds, 0),
    }
    return AddAction(segment.file, segment.n_bytes, {}, 0, new_rows, json.dumps(statistics))


def _remove(segment: Segment) -> Any:
    from deltalake.transaction import RemoveAction

    return RemoveAction(segment.file, data_change=False, deletion_timestamp=time.time_ns() // 10**6)


def _delta_files(root: Path, table: Any) -> list[Path]:
    return [root / Path(uri).name for uri in table.file_uris()] if table else []


def _delta_log_bytes(root: Path) -> int:
    return sum(file.stat().st_size for file in (root / "_delta_log").iterdir())


def open_segments(root: Path) -> tuple[list[Segment], list[str]]:
    """The files and what they span, and the files of the other tables, as the manifest has it."""
    manifest = json.loads((root / MANIFEST).read_text(encoding="utf-8"))
    return [Segment(**entry) for entry in manifest["segments"]], manifest["others"]


def due_for_merge(levels: list[int]) -> slice | None:
    """Where MERGE_FACTOR files of one level stand at the end of the list."""
    newest = levels[-MERGE_FACTOR:]
    if len(newest) == MERGE_FACTOR and len(set(newest)) == 1:
        return slice(len(levels) - MERGE_FACTOR, len(levels))
    return None


def read_sorted(paths: Iterable[Path]) -> pa.Table:
    """The rows of files in time order, by cell, then time."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.concat_tables([pq.read_table(path) for path in paths])
    return table.take(np.argsort(table["cell"].to_numpy(), kind="stable"))


def write_segment(folder: Path, rows: pa.Table, level: int, durable: bool) -> Segment:
    """A file of a name of its own, as saved maps encode theirs."""
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    name = f"{uuid.uuid4().hex}.parquet"
    with (folder / name).open("wb") as file:
        pq.write_table(
            rows,
            file,
            row_group_size=ROWS_PER_GROUP,
            compression="zstd",
            compression_level=ZSTD_LEVEL,
            use_dictionary=["prob"],
            column_encoding=ENCODINGS,
            write_statistics=["cell"],
            write_page_checksum=True,
        )
        file.flush()
        if durable:
            os.fsync(file.fileno())
        n_bytes = file.tell()
    bounds = {column: [*pc.min_max(rows[column]).as_py().values()] for column in BOUNDED}
    return Segment(name, level, rows.num_rows, n_bytes, bounds)


def sync(path: Path) -> None:
    """Wait until a file or directory is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _writer_properties() -> Any:
    """Our encodings, in Delta Lake's words."""
    from deltalake import ColumnProperties, WriterProperties

    encodings: dict[str, Any] = dict(ENCODINGS)  # Delta Lake lists the names it takes as literals
    columns = {
        name: ColumnProperties(
            dictionary_enabled=False,
            encoding=encoding,
            statistics_enabled="CHUNK" if name in BOUNDED else "NONE",
        )
        for name, encoding in encodings.items()
    }
    columns["prob"] = ColumnProperties(dictionary_enabled=True, statistics_enabled="NONE")
    return WriterProperties(
        compression="ZSTD",
        compression_level=ZSTD_LEVEL,
        max_row_group_size=ROWS_PER_GROUP,
        column_properties=columns,
    )
