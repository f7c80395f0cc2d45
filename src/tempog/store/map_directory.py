"""A saved map: a directory with a small JSON and Parquet tables that any Parquet reader can open.

| file | what | columns |
| --- | --- | --- |
| map.json | format version, settings, sources, and the name of the data folder | |
| data-*/scans.parquet | one row per scan, in time order | stamp_ns int64, x, y (m), theta (rad) of the laser |
| data-*/tiles.parquet | one row per tile of 8 x 8 cells, in the order of their numbers | row, col int32, in tiles |
| data-*/intervals.parquet | one row per interval, by cell, then time | cell, first_scan, span int32, prob float32 |
| data-*/surfaces.parquet | one row per cell that was ever hit | cell, hits int32, five moments float32 |

A cell's number is ``tile * 64 + (row % 8) * 8 + col % 8``; an interval was first seen by scan `first_scan`
and last by scan ``first_scan + span``. Moments are metres and square metres, from the cell's centre.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

try:
    import fcntl
except ImportError:  # Windows: no locks there
    fcntl = None  # type: ignore[assignment]

from tempog._version import __version__
from tempog.config import MapConfig
from tempog.errors import ConfigError, ExtentError, MapError
from tempog.grid.history import History
from tempog.grid.segments import Runs
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.scan import ScanLog
from tempog.sensing.grid_spec import GridSpec
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex

FORMAT = "tempog-map"
FORMAT_VERSION = 1
MANIFEST = "map.json"
ROWS_PER_GROUP = 2**18  # a cell's history is read from one or two groups of about 0.4 MB
ZSTD_LEVEL = 9  # 1.5 bytes per interval on a real log against 1.6 at level 3; writing is a small part of mapping

MOMENTS = ("mean_x", "mean_y", "cov_xx", "cov_xy", "cov_yy")
TABLES = {
    "scans": {"stamp_ns": pa.int64(), "x": pa.float64(), "y": pa.float64(), "theta": pa.float64()},
    "tiles": {"row": pa.int32(), "col": pa.int32()},
    "intervals": {"cell": pa.int32(), "first_scan": pa.int32(), "span": pa.int32(), "prob": pa.float32()},
    "surfaces": {"cell": pa.int32(), "hits": pa.int32()} | dict.fromkeys(MOMENTS, pa.float32()),
}


def save_map(
    grid: TemporalGrid | SavedMap,
    path: str | os.PathLike[str],
    *,
    sources: Iterable[ScanLog] = (),
    force: bool = False,
) -> Path:
    """Write a map to a directory, all of it or nothing.

    Parameters
    ----------
    grid : TemporalGrid or SavedMap
    path : path
        The directory to make.
    sources : iterable of ScanLog
        Where the scans came from; paths, hashes and notes are kept with the map.
    force : bool
        Replace a map that is there. It stays whole and readable until the new one is complete.

    Raises
    ------
    MapError
        `path` exists and `force` is not set, or it is something other than a map, or cannot be written.
    """
    root = Path(path)
    with _only_writer(root):
        return _save(grid, root, sources, force)


def _save(grid: TemporalGrid | SavedMap, root: Path, sources: Iterable[ScanLog], force: bool) -> Path:
    replaces = check_target(root, force)
    folder = root if replaces else root.with_name(f".{root.name}.{uuid.uuid4().hex[:8]}.unfinished")
    data = folder / f"data-{uuid.uuid4().hex[:8]}"
    try:
        data.mkdir(parents=True)
        _write_tables(grid, data)
        _write_manifest(folder, _manifest(grid, data.name, sources))
        if not replaces:
            folder.rename(root)
        _sync(root.parent)
    except (OSError, pa.ArrowException) as error:
        raise MapError(f"{root}: the map could not be written: {error}") from error
    finally:
        if replaces:
            _clear_debris(root)
        else:
            shutil.rmtree(folder, ignore_errors=True)  # there only if it was not moved into place
    return root


@contextmanager
def _only_writer(root: Path) -> Iterator[None]:
    """Keep other processes from replacing the map meanwhile; the lock goes with the process that holds it.

    Two that make a new map of one name need no lock: the second cannot move its own into place.
    """
    if fcntl is None or not root.is_dir():
        yield
        return
    descriptor = os.open(root, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise MapError(f"{root} is being written by another process; try again when it is done") from error
        yield
    finally:
        os.close(descriptor)


def _clear_debris(root: Path) -> None:
    """Remove what map.json does not name: the data it replaced, or the data that was not completed."""
    named = _read_manifest(root, any_version=True)["data"]
    (root / f"{MANIFEST}.unfinished").unlink(missing_ok=True)
    for folder in root.glob("data-*"):
        if folder.name != named:
            shutil.rmtree(folder, ignore_errors=True)


def open_map(path: str | os.PathLike[str]) -> SavedMap:
    """Open a saved map; intervals are read when a question needs them.

    Raises
    ------
    MapError
        There is no map at `path`, it is damaged, or a newer tempog wrote it.
    """
    return SavedMap(path)


class SavedMap(History):
    """A map on disk; answers what a `TemporalGrid` answers.

    Attributes
    ----------
    path : Path
    manifest : dict
        What map.json says.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.manifest = _read_manifest(self.path)
        self._data = self.path / self.manifest["data"]
        for name in TABLES:
            if not (self._data / f"{name}.parquet").is_file():
                raise self._damaged(f"{name}.parquet is missing")
        scans = self._read("scans")
        self._stamps_ns: NDArray[np.int64] = scans["stamp_ns"]
        self._poses: NDArray[np.float64] = np.stack([scans["x"], scans["y"], scans["theta"]], axis=-1)
        tiles = self._read("tiles")
        try:
            self.config = MapConfig.from_dict(self.manifest["config"])
            spec = GridSpec(self.config.grid.resolution_m)
            self.tiles = TileIndex.from_tiles(spec, self.config.grid.max_cells, tiles["row"], tiles["col"])
        except (ConfigError, ExtentError) as error:
            raise self._damaged(str(error)) from error
        if np.any(np.diff(self._stamps_ns) < 0):
            raise self._damaged("the stamps of its scans are out of order")

    @property
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""
        return self._poses

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""
        return self._stamps_ns

    @property
    def bytes_on_disk(self) -> int:
        """Bytes of all files of the map."""
        files = [self.path / MANIFEST, *self._data.iterdir()]
        return sum(file.stat().st_size for file in files)

    def runs(self) -> Iterator[Runs]:
        """All intervals, sorted by cell; read at the first call and kept."""
        yield self._all_runs

    def runs_of_cell(self, cell: int) -> list[tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]]:
        """First scans, last scans and values of one cell's intervals; reads only the row groups that hold them."""
        known = "_all_runs" in self.__dict__
        runs = self._all_runs if known else self._to_runs(self._read("intervals", cell))
        where = runs.of_cell(cell)
        return [(runs.first[where], runs.last[where], runs.value[where])]

    @cached_property
    def surfaces(self) -> SurfaceMemory:
        """Where inside each cell the hits fell; read when first asked for."""
        columns = self._read("surfaces")
        surfaces = SurfaceMemory()
        surfaces.reserve(self.tiles.n_cells, 0)
        surfaces.n_slots = len(columns["cell"])
        surfaces.cell_of_slot = columns["cell"]
        surfaces.hit_count = columns["hits"]
        surfaces.moments = np.stack([columns[name] for name in MOMENTS], axis=-1)
        self._check_within(columns["cell"], self.tiles.n_cells, "surfaces.parquet")
        surfaces.slot_of_cell[columns["cell"]] = np.arange(surfaces.n_slots, dtype=np.int32)
        return surfaces

    @cached_property
    def _all_runs(self) -> Runs:
        return self._to_runs(self._read("intervals"))

    def _to_runs(self, columns: dict[str, NDArray[Any]]) -> Runs:
        cell, first, span = columns["cell"], columns["first_scan"], columns["span"]
        self._check_within(cell, self.tiles.n_cells, "intervals.parquet")
        self._check_within(first, self.n_scans, "intervals.parquet")
        self._check_within(span, self.n_scans, "intervals.parquet")
        last = first + span
        self._check_within(last, self.n_scans, "intervals.parquet")
        steps = np.diff(cell)
        if np.any(steps < 0):
            raise self._damaged("intervals.parquet is not sorted by cell")
        starts = np.flatnonzero(steps) + 1
        offsets = np.concatenate([[0], starts, [len(cell)]] if len(cell) else [[0]]).astype(np.int64)
        return Runs(cell[offsets[:-1]], offsets, first, last, columns["prob"])

    def _read(self, name: str, cell: int | None = None) -> dict[str, NDArray[Any]]:
        """Columns of a table; of one cell, only the row groups that may hold it."""
        try:
            with pq.ParquetFile(self._data / f"{name}.parquet", page_checksum_verification=True) as file:
                groups = [g for g in range(file.num_row_groups) if cell is None or _may_hold(file, g, cell)]
                table = file.read_row_groups(groups, columns=list(TABLES[name]))
                return {column: _numbers(table.column(column), kind) for column, kind in TABLES[name].items()}
        except (OSError, pa.ArrowException, KeyError, ValueError) as error:
            raise self._damaged(f"{name}.parquet: {error}") from error

    def _check_within(self, values: NDArray[np.int32], count: int, file: str) -> None:
        if len(values) and not 0 <= values.min() <= values.max() < count:
            raise self._damaged(f"{file} points at cells or scans that do not exist")

    def _damaged(self, what: str) -> MapError:
        if not self._data.is_dir():
            with suppress(MapError):
                if _read_manifest(self.path, any_version=True)["data"] != self.manifest["data"]:
                    return MapError(f"{self.path}: the map was replaced since it was opened; open it again")
        return MapError(f"{self.path}: the map is damaged: {what}. Map the logs again, or restore a copy.")


def hash_file(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file, as hexadecimal text."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_target(root: Path, force: bool) -> bool:
    """Whether there is a map at `root` to replace; MapError where none may be written."""
    if not root.name:
        raise MapError(f"{root}: a map needs a directory of its own; name one that does not exist yet")
    if not root.exists():
        return False
    if not (root / MANIFEST).is_file():
        raise MapError(f"{root} exists and is not a tempog map, so it stays as it is; choose another name")
    if not force:
        raise MapError(f"{root} exists already; use --force (force=True) to replace it, or choose another name")
    _read_manifest(root, any_version=True)
    return True


def _write_tables(grid: TemporalGrid | SavedMap, data: Path) -> None:
    tiles, surfaces = grid.tiles, grid.surfaces
    poses = grid.poses
    _write(
        data / "scans.parquet",
        {"stamp_ns": grid.stamps_ns, "x": poses[:, 0], "y": poses[:, 1], "theta": poses[:, 2]},
        {"stamp_ns": "DELTA_BINARY_PACKED"},
    )
    _write(
        data / "tiles.parquet",
        {"row": tiles.tile_rows[: tiles.n_tiles], "col": tiles.tile_cols[: tiles.n_tiles]},
        {"row": "DELTA_BINARY_PACKED", "col": "DELTA_BINARY_PACKED"},
    )
    runs = grid.all_runs()
    # What repeats between cells that change together compresses best: starts and lengths as bytes apart.
    _write(
        data / "intervals.parquet",
        {
            "cell": np.repeat(runs.cells, np.diff(runs.offsets)),
            "first_scan": runs.first,
            "span": runs.last - runs.first,
            "prob": runs.value,
        },
        {"cell": "DELTA_BINARY_PACKED", "first_scan": "BYTE_STREAM_SPLIT", "span": "BYTE_STREAM_SPLIT"},
        dictionary=["prob"],
    )
    used = slice(0, surfaces.n_slots)
    moments = {name: surfaces.moments[used, k] for k, name in enumerate(MOMENTS)}
    _write(
        data / "surfaces.parquet",
        {"cell": surfaces.cell_of_slot[used], "hits": surfaces.hit_count[used], **moments},
        {"cell": "DELTA_BINARY_PACKED", "hits": "DELTA_BINARY_PACKED"} | dict.fromkeys(MOMENTS, "BYTE_STREAM_SPLIT"),
    )


def _write(
    path: Path,
    columns: dict[str, NDArray[Any]],
    encodings: dict[str, str],
    dictionary: list[str] | None = None,
) -> None:
    table = pa.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    pq.write_table(
        table,
        path,
        row_group_size=ROWS_PER_GROUP,
        compression="zstd",
        compression_level=ZSTD_LEVEL,
        use_dictionary=dictionary or False,
        column_encoding=encodings,
        write_statistics=["cell"] if "cell" in columns else False,
        write_page_checksum=True,
    )
    _sync(path)


def _manifest(grid: TemporalGrid | SavedMap, data: str, sources: Iterable[ScanLog]) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "tempog_version": __version__,
        "data": data,
        "config": grid.config.to_dict(),
        "n_scans": grid.n_scans,
        "n_intervals": grid.n_intervals,
        "n_cells": grid.n_cells if grid.n_scans else 0,
        "start_ns": int(grid.stamps_ns[0]) if grid.n_scans else None,
        "stop_ns": int(grid.stamps_ns[-1]) if grid.n_scans else None,
        "sources": [
            {
                "path": log.source,
                "sha256": hash_file(log.source) if log.source else None,
                "format": log.format,
                "n_scans": len(log),
                "n_skipped": log.n_skipped,
                "notes": list(log.notes),
            }
            for log in sources
        ],
    }


def _write_manifest(folder: Path, manifest: dict[str, Any]) -> None:
    """The moment the new data counts: one rename."""
    unfinished = folder / f"{MANIFEST}.unfinished"
    unfinished.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    _sync(unfinished)
    _sync(folder / manifest["data"])
    unfinished.replace(folder / MANIFEST)
    _sync(folder)


def _read_manifest(root: Path, any_version: bool = False) -> dict[str, Any]:
    try:
        manifest = json.loads((root / MANIFEST).read_text(encoding="utf-8"))
    except FileNotFoundError:
        what = "it holds no map.json" if root.is_dir() else "there is no such directory"
        raise MapError(f"{root} is not a tempog map: {what}. Make one with: tempog map LOG -o {root}") from None
    except NotADirectoryError:
        raise MapError(f"{root} is a file, not a tempog map; make a map of a log with: tempog map LOG") from None
    except (OSError, ValueError) as error:
        raise MapError(f"{root}: map.json cannot be read: {error}") from error
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise MapError(f"{root}: map.json is not that of a tempog map; it stays as it is")
    version = manifest.get("format_version")
    if not any_version and version != FORMAT_VERSION:
        raise MapError(
            f"{root} has map format {version!r}, written by tempog {manifest.get('tempog_version')};"
            f" this is tempog {__version__}, which reads format {FORMAT_VERSION}. Upgrade tempog."
        )
    keys = {"data": str, "config": dict, "n_scans": int, "n_intervals": int, "n_cells": int, "sources": list}
    for key, kind in keys.items():
        if not isinstance(manifest.get(key), kind):
            raise MapError(f"{root}: the map is damaged: map.json has no usable {key!r}")
    if not manifest["data"].startswith("data-") or Path(manifest["data"]).name != manifest["data"]:
        raise MapError(f"{root}: the map is damaged: map.json names {manifest['data']!r} as its data folder")
    return manifest


def _may_hold(file: Any, group: int, cell: int) -> bool:
    """Whether a row group's statistics allow it to hold the cell."""
    place = file.schema_arrow.get_field_index("cell")
    statistics = file.metadata.row_group(group).column(place).statistics if place >= 0 else None
    return statistics is None or not statistics.has_min_max or statistics.min <= cell <= statistics.max


def _numbers(column: Any, kind: Any) -> NDArray[Any]:
    """A column as an array of the wanted kind; ValueError or ArrowInvalid if it holds something else."""
    if column.null_count or not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        raise ValueError(f"holds {column.type} with {column.null_count} nulls where {kind} was wanted")
    numbers: NDArray[Any] = column.cast(kind).to_numpy()
    return numbers


def _sync(path: Path) -> None:
    """Have the operating system put a file or directory on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError:  # some file systems cannot sync directories
        pass
    finally:
        os.close(descriptor)
