"""map.json: which segments a map is made of, and who mapped them. A map changes when this file is replaced."""

from __future__ import annotations

import dataclasses
import json
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar, get_origin, get_type_hints

try:
    import fcntl
except ImportError:  # Windows: no locks there
    fcntl = None  # type: ignore[assignment]

from tempog._version import __version__
from tempog.config import MapConfig
from tempog.errors import ConfigError, MapError
from tempog.store.tables import sync

FORMAT = "tempog-map"
FORMAT_VERSION = 2
MANIFEST = "map.json"
SEGMENTS = "segments"
JOURNAL = "journal"


@dataclass(frozen=True)
class Segment:
    """What a run of scans added to the history: a folder of five tables.

    Attributes
    ----------
    name : str
        Of its folder, below that of the map.
    first_scan, n_scans : int
        Numbers of its scans within its strand.
    start_ns, stop_ns : int
        Stamps of its first and last scan.
    n_intervals : int
        Intervals that ended.
    n_cells : int
        Cells of the strand that were seen by the end of the segment: each has one interval that may go on.
    full : bool
        Whether the tables `open` and `surfaces` hold all cells, not only those that changed.
    n_bytes : int
        Of its files.
    """

    name: str
    first_scan: int
    n_scans: int
    start_ns: int
    stop_ns: int
    n_intervals: int
    n_cells: int
    full: bool
    n_bytes: int

    @property
    def end_scan(self) -> int:
        """Number of the scan after its last."""
        return self.first_scan + self.n_scans


@dataclass(frozen=True)
class Session:
    """One run of one robot: a log, or the time between the start and the end of live mapping.

    Attributes
    ----------
    id : str
    robot : str
        Empty if nobody said.
    strand, first_scan, n_scans : int
        Where its scans are.
    start_ns, stop_ns : int
        Stamps of its first and last scan.
    config : dict
        The `MapConfig` it was mapped with.
    sources : list of dict
        Files it came from: path, sha256, format, n_scans, n_skipped, notes.
    content : str
        A hash of the stamps, poses and readings of all its scans, where they are known to be all.
    """

    id: str
    robot: str
    strand: int
    first_scan: int
    n_scans: int
    start_ns: int
    stop_ns: int
    config: dict[str, Any]
    sources: list[dict[str, Any]] = field(default_factory=list)
    content: str = ""

    @property
    def end_scan(self) -> int:
        """Number of the scan after its last."""
        return self.first_scan + self.n_scans


@dataclass
class Manifest:
    """What map.json says.

    Attributes
    ----------
    config : dict
        The `MapConfig` of the map.
    strands : list of lists of Segment
        Segments of one strand follow each other in time; strands may overlap.
    sessions : list of Session
        In the order they were added.
    pruned : list of dict
        What was deleted, when, and how much it was.
    retired : dict of str to float
        Segments that were replaced, which readers may still hold, and when, in Unix seconds.
    id : str
        Of the map that was once made, so that no journal is taken for that of a map which replaced it.
    """

    config: dict[str, Any]
    strands: list[list[Segment]] = field(default_factory=list)
    sessions: list[Session] = field(default_factory=list)
    pruned: list[dict[str, Any]] = field(default_factory=list)
    retired: dict[str, float] = field(default_factory=dict)
    id: str = field(default_factory=lambda: uuid.uuid4().hex)

    @property
    def segments(self) -> list[Segment]:
        """Those of all strands."""
        return [segment for strand in self.strands for segment in strand]

    @property
    def n_scans(self) -> int:
        """Scans of all strands."""
        return sum(segment.n_scans for segment in self.segments)

    @property
    def n_intervals(self) -> int:
        """Intervals of all strands, those that may go on too."""
        return sum(s.n_intervals for s in self.segments) + sum(s[-1].n_cells for s in self.strands if s)

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it; the totals are for people."""
        start = [strand[0].start_ns for strand in self.strands if strand]
        stop = [strand[-1].stop_ns for strand in self.strands if strand]
        return {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "tempog_version": __version__,
            "id": self.id,
            "n_scans": self.n_scans,
            "n_intervals": self.n_intervals,
            "start_ns": min(start, default=None),
            "stop_ns": max(stop, default=None),
            "config": self.config,
            "sessions": [dataclasses.asdict(session) for session in self.sessions],
            "strands": [[dataclasses.asdict(segment) for segment in strand] for strand in self.strands],
            "pruned": self.pruned,
            "retired": self.retired,
        }


def read_manifest(root: Path) -> Manifest:
    """What the map at `root` is made of.

    Raises
    ------
    MapError
        There is no map, its map.json is damaged, or a newer tempog wrote it.
    """
    document = read_document(root)
    version = document.get("format_version")
    if not isinstance(version, int) or not 1 <= version <= FORMAT_VERSION:
        raise MapError(
            f"{root} has map format {version!r}, written by tempog {document.get('tempog_version')};"
            f" this is tempog {__version__}, which reads formats 1 to {FORMAT_VERSION}. Upgrade tempog."
        )
    try:
        manifest = _from_format_1(root, document) if version == 1 else _from_dict(document)
        _complete(manifest)
    except (KeyError, TypeError, AttributeError, ValueError, ConfigError) as error:
        what = f"no usable {error}" if isinstance(error, KeyError) else str(error)
        raise damaged(root, f"map.json: {what}") from error
    for name in (*(segment.name for segment in manifest.segments), *manifest.retired):
        folder = Path(name)
        if not is_format_1(name) and (len(folder.parts) != 2 or folder.parts[0] != SEGMENTS or ".." in folder.parts):
            raise damaged(root, f"map.json names {name!r} as a segment")
    return manifest


def read_document(root: Path) -> dict[str, Any]:
    """What map.json says, of any version; MapError if it is not that of a map."""
    try:
        document = json.loads((root / MANIFEST).read_text(encoding="utf-8"))
    except FileNotFoundError:
        what = "it holds no map.json" if root.is_dir() else "there is no such directory"
        raise MapError(f"{root} is not a tempog map: {what}. Make one with: tempog map LOG -o {root}") from None
    except NotADirectoryError:
        raise MapError(f"{root} is a file, not a tempog map; make a map of a log with: tempog map LOG") from None
    except (OSError, ValueError) as error:
        raise MapError(f"{root}: map.json cannot be read: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise MapError(f"{root}: map.json is not that of a tempog map; it stays as it is")
    return document


def write_manifest(root: Path, manifest: Manifest) -> None:
    """The moment a change counts: one rename; OSError if it does not count."""
    unfinished = root / f"{MANIFEST}.unfinished"
    try:
        unfinished.write_text(json.dumps(manifest.to_dict(), indent=1) + "\n", encoding="utf-8")
        sync(unfinished)
        unfinished.replace(root / MANIFEST)
    except OSError:
        with suppress(OSError):
            unfinished.unlink()
        raise
    with suppress(OSError):  # it counts already
        sync(root)


def with_room(config: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Settings of a map that may reach as far as `other` settings allow, too."""
    max_cells = max(each["grid"]["max_cells"] for each in (config, other))
    return config | {"grid": config["grid"] | {"max_cells": max_cells}}


def damaged(root: Path, what: str) -> MapError:
    """The error for a map whose files do not fit together."""
    return MapError(f"{root}: the map is damaged: {what}. Map the logs again, or restore a copy.")


Lock = int
"""Of the one process that may change a map: a file descriptor, or NO_LOCK where the system has no locks."""
NO_LOCK: Lock = -1


@contextmanager
def only_writer(root: Path) -> Iterator[None]:
    """Keep other processes from changing the map meanwhile; MapError if another one is changing it."""
    lock = require_lock(root)
    try:
        yield
    finally:
        unlock_map(lock)


def require_lock(root: Path) -> Lock:
    """The lock of writers, which goes with the process that holds it; MapError if another one has it."""
    lock = try_lock(root)
    if lock is None:
        raise MapError(f"{root} is being written by another process; try again when it is done")
    return lock


def try_lock(root: Path) -> Lock | None:
    """The lock of writers, or None if another process has it."""
    if fcntl is None:
        return NO_LOCK
    try:
        descriptor = os.open(root, os.O_RDONLY)
    except OSError as error:
        raise MapError(f"{root}: the map cannot be kept from being written by others: {error}") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def unlock_map(lock: Lock) -> None:
    """Give the lock back."""
    if lock != NO_LOCK:
        os.close(lock)


def _from_dict(document: dict[str, Any]) -> Manifest:
    return Manifest(
        _entry(document, "config", dict),
        [[_made(Segment, segment) for segment in strand] for strand in _entry(document, "strands", list)],
        [_made(Session, session) for session in _entry(document, "sessions", list)],
        _entry(document, "pruned", list),
        _entry(document, "retired", dict),
        _entry(document, "id", str),
    )


def _complete(manifest: Manifest) -> None:
    """Check what entries say of each other; settings that are not given are the default ones."""
    manifest.config = MapConfig.from_dict(manifest.config).to_dict()
    manifest.sessions = [replace(one, config=MapConfig.from_dict(one.config).to_dict()) for one in manifest.sessions]
    for session in manifest.sessions:
        if not 0 <= session.strand < len(manifest.strands):
            raise ValueError(f"session {session.id!r} is in strand {session.strand}, which does not exist")
    if not all(isinstance(when, int | float) for when in manifest.retired.values()):
        raise KeyError("retired")


def _from_format_1(root: Path, document: dict[str, Any]) -> Manifest:
    """A map of one folder whose table of intervals holds those that may go on, too."""
    name, n_cells = _entry(document, "data", str), _entry(document, "n_cells", int)
    config, n_scans = _entry(document, "config", dict), _entry(document, "n_scans", int)
    sources, n_intervals = _entry(document, "sources", list), _entry(document, "n_intervals", int)
    if not n_scans:
        return Manifest(config, id=name)  # its tables are empty, and may have been removed
    if not is_format_1(name) or not (root / name).is_dir():
        raise ValueError(f"it names {name!r} as its data folder")
    n_bytes = sum(file.stat().st_size for file in (root / name).iterdir())
    period = (_entry(document, "start_ns", int), _entry(document, "stop_ns", int))
    segment = Segment(name, 0, n_scans, *period, n_intervals - n_cells, n_cells, True, n_bytes)
    return Manifest(config, [[segment]], [Session("1", "", 0, 0, n_scans, *period, config, sources)], id=name)


def is_format_1(name: str) -> bool:
    """Whether a segment is the data folder of a map of format 1."""
    return name.startswith("data-") and Path(name).name == name


T = TypeVar("T")


def _entry(values: dict[str, Any], name: str, kind: type[T]) -> T:
    value = values[name]
    if not isinstance(value, kind):
        raise KeyError(name)
    return value


def _made(kind: type[T], values: dict[str, Any]) -> T:
    hints = get_type_hints(kind)
    checked = {name: _entry(values, name, get_origin(hint) or hint) for name, hint in hints.items()}
    return kind(**checked)
