"""Parquet tables of a map: what columns they have, and how they are written and read.

| table | one row per | columns |
| --- | --- | --- |
| scans | scan, in time order | scan int32, stamp_ns int64, x, y (m), theta (rad) of the laser |
| tiles | tile of 8 x 8 cells that was seen first, by number | tile, row, col int32, in tiles |
| intervals | interval that ended, by cell, then time | cell, first_scan, span int32, prob float32 |
| open | cell that was seen, with the interval that may go on | as intervals |
| surfaces | cell that was hit | cell, hits int32, five moments float32 |
| members | cell of an object, if its intervals are kept by reference | cell, group int32 |
| timelines | interval that cells of a group share | group, first_scan, span int32, prob float32, cells binary |

A cell's number is ``tile * 64 + (row % 8) * 8 + col % 8``; an interval was first seen by scan `first_scan`
and last by scan ``first_scan + span``. Moments are metres and square metres, from the cell's centre. `cells` has a
bit for each member of the group, in the order of `members`, lowest first: whether the cell has the interval.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from tempog.sensing.tiles import TILE_CELLS

Columns = dict[str, NDArray[Any]]

MOMENTS = ("mean_x", "mean_y", "cov_xx", "cov_xy", "cov_yy")
INTERVALS = {"cell": pa.int32(), "first_scan": pa.int32(), "span": pa.int32(), "prob": pa.float32()}
TABLES = {
    "scans": {
        "scan": pa.int32(),
        "stamp_ns": pa.int64(),
        "x": pa.float64(),
        "y": pa.float64(),
        "theta": pa.float64(),
    },
    "tiles": {"tile": pa.int32(), "row": pa.int32(), "col": pa.int32()},
    "intervals": INTERVALS,
    "open": INTERVALS,
    "surfaces": {"cell": pa.int32(), "hits": pa.int32()} | dict.fromkeys(MOMENTS, pa.float32()),
}
REFERENCES = {
    "members": {"cell": pa.int32(), "group": pa.int32()},
    "timelines": {"group": pa.int32(), "first_scan": pa.int32(), "span": pa.int32(), "prob": pa.float32()},
}
MASKS = "cells"  # the one column that holds no numbers
COUNTED = {"scan", "tile"}  # for other engines: they follow from where a row is, and maps of format 1 lack them
# What repeats between cells that change together compresses best: starts and lengths as bytes apart.
ENCODINGS = {
    "scan": "DELTA_BINARY_PACKED",
    "stamp_ns": "DELTA_BINARY_PACKED",
    "tile": "DELTA_BINARY_PACKED",
    "row": "DELTA_BINARY_PACKED",
    "col": "DELTA_BINARY_PACKED",
    "cell": "DELTA_BINARY_PACKED",
    "hits": "DELTA_BINARY_PACKED",
    "first_scan": "BYTE_STREAM_SPLIT",
    "span": "BYTE_STREAM_SPLIT",
} | dict.fromkeys(MOMENTS, "BYTE_STREAM_SPLIT")
ROWS_PER_GROUP = (
    2**16
)  # a cell's history is read from one or two groups of about 0.1 MB; larger ones are 0.4 % smaller
ZSTD_LEVEL = 9  # 1.5 bytes per interval on a real log against 1.6 at level 3; writing is a small part of mapping
QUICK_ZSTD_LEVEL = 1  # for what is merged with others soon


def write_table(path: Path, columns: Mapping[str, NDArray[Any]], level: int = ZSTD_LEVEL) -> None:
    """Write a table, which is on the disk only after `sync`."""
    table = pa.table(
        {name: values if name == MASKS else np.ascontiguousarray(values) for name, values in columns.items()}
    )
    pq.write_table(
        table,
        path,
        row_group_size=ROWS_PER_GROUP,
        compression="zstd",
        compression_level=level,
        use_dictionary=["prob"] if "prob" in columns else False,
        column_encoding={name: ENCODINGS[name] for name in columns if name in ENCODINGS},
        write_statistics=["cell"] if "cell" in columns else False,
        write_page_checksum=True,
    )


def read_table(path: Path, wanted: Mapping[str, Any], tiles: NDArray[np.int32] | None = None) -> Columns:
    """Columns of a table; of the cells of some tiles, whose numbers ascend, only groups that may hold them.

    Raises
    ------
    OSError, pyarrow.ArrowException, KeyError, ValueError
        The file cannot be read, or holds something else.
    """
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        groups = [g for g in range(file.num_row_groups) if tiles is None or _may_hold(file, g, tiles)]
        table = file.read_row_groups(groups, columns=list(wanted))
        return {name: _numbers(table.column(name), kind) for name, kind in wanted.items()}


def masks_of(packed: NDArray[np.uint8], n_bytes: NDArray[np.int64]) -> Any:
    """Bytes as a column of byte strings, of so many bytes each."""
    offsets = np.append(0, np.cumsum(n_bytes)).astype(np.int32)
    return pa.Array.from_buffers(
        pa.binary(), len(n_bytes), [None, pa.py_buffer(offsets), pa.py_buffer(np.ascontiguousarray(packed))]
    )


def read_masks(path: Path) -> NDArray[np.uint8]:
    """The bytes of a table's byte strings, one after the other; raises what `read_table` raises."""
    column = pq.read_table(path, columns=[MASKS], page_checksum_verification=True).column(MASKS)
    return np.frombuffer(b"".join(column.cast(pa.binary()).to_pylist()), dtype=np.uint8)


def sync(path: Path) -> None:
    """Have the operating system put a file or directory on the disk; OSError if it cannot."""
    if os.name == "nt" and path.is_dir():  # Windows opens no directories
        return
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError:
        if not path.is_dir():  # some file systems cannot sync directories
            raise
    finally:
        os.close(descriptor)


def sync_all(paths: Sequence[Path]) -> None:
    """`sync` files and directories side by side: the operating system makes one write to the disk of many."""
    with ThreadPoolExecutor(len(paths)) as pool:
        list(pool.map(sync, paths))


def hash_file(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file, as hexadecimal text."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _may_hold(file: Any, group: int, tiles: NDArray[np.int32]) -> bool:
    """Whether a row group's statistics allow it to hold a cell of one of the tiles."""
    place = file.schema_arrow.get_field_index("cell")
    statistics = file.metadata.row_group(group).column(place).statistics if place >= 0 else None
    if statistics is None or not statistics.has_min_max:
        return True
    since, until = np.searchsorted(tiles, [statistics.min // TILE_CELLS, statistics.max // TILE_CELLS + 1])
    return bool(since < until)


def _numbers(column: Any, kind: Any) -> NDArray[Any]:
    """A column as an array of the wanted kind; ValueError or ArrowInvalid if it holds something else."""
    if column.null_count or not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        raise ValueError(f"holds {column.type} with {column.null_count} nulls where {kind} was wanted")
    numbers: NDArray[Any] = column.cast(kind).to_numpy()
    return numbers
