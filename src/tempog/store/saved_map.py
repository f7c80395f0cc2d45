"""Maps on disk: opened, and written whole."""

from __future__ import annotations

import hashlib
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from tempog.config import MapConfig
from tempog.errors import MapError
from tempog.grid.delegate import Delegate
from tempog.grid.history import History
from tempog.grid.merged import Merged
from tempog.scans.scan import Scan, ScanLog
from tempog.sensing.surfaces import SurfaceMemory
from tempog.store.journal import read_journals
from tempog.store.manifest import (
    JOURNAL,
    MANIFEST,
    SEGMENTS,
    Manifest,
    Segment,
    Session,
    only_writer,
    read_document,
    read_manifest,
    write_manifest,
)
from tempog.store.repair import AnyStrands, open_strands
from tempog.store.rewrite import write_history
from tempog.store.strand import as_one
from tempog.store.tables import hash_file, sync


def open_map(
    path: str | os.PathLike[str], *, sessions: Iterable[str] | None = None, robots: Iterable[str] | None = None
) -> SavedMap:
    """Open a saved map; intervals are read when a question needs them.

    Parameters
    ----------
    path : path
    sessions, robots : iterable of str, optional
        Only what these sessions saw, by their names or those of their robots. Default: all.

    Raises
    ------
    MapError
        There is no map at `path`, it is damaged, a newer tempog wrote it, or it has no such session.
    """
    return SavedMap(path, sessions=sessions, robots=robots)


class SavedMap(Delegate):
    """A map on disk, as it was when it was opened; answers what a `TemporalGrid` answers. See `open_map`.

    Attributes
    ----------
    path : Path
    manifest : Manifest
        What map.json says.
    sessions : list of Session
        Those that were asked for.
    repaired : list of str
        What a crash had left, and what was done about it.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        sessions: Iterable[str] | None = None,
        robots: Iterable[str] | None = None,
    ) -> None:
        self.path = Path(path)
        self.manifest, strands, self.repaired = open_strands(self.path)
        self.config = MapConfig.from_dict(self.manifest.config)
        self.sessions = self.manifest.sessions
        if sessions is None and robots is None:
            self._history = as_one(self.path, self.manifest, strands)
        else:
            self._history = self._chosen(strands, sessions, robots)
        _ = self.tiles  # a map that cannot be used is refused when it is opened

    @property
    def _whole(self) -> History:
        return self._history

    @cached_property
    def surfaces(self) -> SurfaceMemory:
        """Where inside each cell the hits fell; read when first asked for."""
        memory: SurfaceMemory = self._history.surfaces  # type: ignore[attr-defined]
        return memory

    @property
    def segments(self) -> list[Segment]:
        """What the map is made of, from oldest to newest in each strand."""
        return self.manifest.segments

    @property
    def n_strands(self) -> int:
        """Number of strands, see docs/storage.md: groups of sessions that follow each other in time."""
        return len(self.manifest.strands)

    @property
    def bytes_on_disk(self) -> int:
        """Bytes of all files of the map."""
        return (self.path / MANIFEST).stat().st_size + sum(segment.n_bytes for segment in self.segments)

    def files(self, table: str, strand: int | None = None) -> list[Path]:
        """The Parquet files of a table, for other engines.

        Parameters
        ----------
        table : str
            "scans", "tiles", "intervals", "open" or "surfaces".
        strand : int, optional
            Number of a strand, 0 to `n_strands` - 1. Only a map of one strand needs none.

        Raises
        ------
        MapError
            There are several strands, and none was named: each numbers its scans and cells on its own, so that
            their files must not be mixed. Or there is no such strand.
        """
        strands = self.manifest.strands
        if strand is None and len(strands) > 1:
            raise MapError(
                f"{self.path} has {len(strands)} strands, and each numbers its scans and cells on its own; name one:"
                f" files({table!r}, strand=0), up to {len(strands) - 1}"
            )
        if strand is not None and not 0 <= strand < len(strands):
            raise MapError(f"{self.path} has no strand {strand}; it has {len(strands)}, counted from 0")
        segments = self.segments if strand is None else strands[strand]
        return [self.path / segment.name / f"{table}.parquet" for segment in segments]

    def _chosen(self, strands: AnyStrands, sessions: Iterable[str] | None, robots: Iterable[str] | None) -> History:
        """What some sessions saw; they are noted."""
        known = self.manifest.sessions
        ids = self._named(sessions, {session.id for session in known}, "session")
        of_robots = self._named(robots, {session.robot for session in known}, "robot")
        self.sessions = [session for session in known if session.id in ids and session.robot in of_robots]
        kept = [np.zeros(len(strand.stamps_ns), dtype=np.bool_) for strand in strands]
        for session in self.sessions:
            base = strands[session.strand].base
            kept[session.strand][max(session.first_scan - base, 0) : max(session.end_scan - base, 0)] = True
        chosen = [k for k in range(len(strands)) if kept[k].any()]
        if not chosen:
            raise MapError(f"{self.path}: what was asked for has no scans: no session of these names by these robots")
        return Merged([strands[k] for k in chosen], [kept[k] for k in chosen])

    def _named(self, wanted: Iterable[str] | None, known: set[str], what: str) -> set[str]:
        chosen = known if wanted is None else set(wanted)
        for name in sorted(chosen - known):
            raise MapError(f"{self.path} has no {what} {name!r}; it has {', '.join(sorted(known)) or 'none'}")
        return chosen


def save_map(
    history: History,
    path: str | os.PathLike[str],
    *,
    sources: Iterable[ScanLog] = (),
    sessions: Iterable[Session] | None = None,
    force: bool = False,
) -> Path:
    """Write a map to a directory, all of it or nothing.

    Parameters
    ----------
    history : TemporalGrid, SavedMap or LiveMap
        The whole of it.
    path : path
        The directory to make.
    sources : iterable of ScanLog
        Where the scans came from; paths, hashes and notes are kept with the map.
    sessions : iterable of Session, optional
        Default: those of `history` if it is a `SavedMap` of one strand, else one session of all scans.
    force : bool
        Replace a map that is there. It stays whole and readable until the new one is complete.

    Raises
    ------
    MapError
        `path` exists and `force` is not set, or it is something other than a map, or cannot be written.
    """
    root = Path(path)
    with new_map(root, force) as folder:
        try:
            segments = write_history(folder, history)
            manifest = Manifest(history.config.to_dict())
            if segments:
                manifest.strands = [segments]
                manifest.sessions = list(sessions) if sessions is not None else _sessions_of(history, sources)
            write_manifest(folder, manifest)
        except (OSError, pa.ArrowException) as error:
            raise MapError(f"{root}: the map could not be written: {error}") from error
    return root


@contextmanager
def new_map(root: Path, force: bool) -> Iterator[Path]:
    """A folder beside `root` to make a map in, which takes the place of `root` if nothing is raised.

    Raises
    ------
    MapError
        See `save_map`.
    """
    replaces = check_target(root, force)
    folder = root.with_name(f".{root.name}.{uuid.uuid4().hex[:8]}.unfinished")
    with only_writer(root) if replaces else nullcontext():
        try:
            _make_folder(folder, root)
            yield folder
            _put_in_place(folder, root, replaces)
        finally:
            shutil.rmtree(folder, ignore_errors=True)  # there only if it was not moved into place
            if replaces:
                clear_other_files(root)


def _make_folder(folder: Path, root: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise MapError(f"{root}: the map could not be written: {error}") from error


def _put_in_place(folder: Path, root: Path, replaces: bool) -> None:
    try:
        if not replaces:
            folder.rename(root)
        else:  # the rename of map.json is what counts
            (root / SEGMENTS).mkdir(exist_ok=True)
            for segment in folder.glob(f"{SEGMENTS}/*"):
                segment.rename(root / SEGMENTS / segment.name)
            sync(root / SEGMENTS)
            write_manifest(root, read_manifest(folder))
        sync(root.parent)
    except OSError as error:
        raise MapError(f"{root}: the map could not be written: {error}") from error


def _sessions_of(history: History, sources: Iterable[ScanLog]) -> list[Session]:
    stamps_ns = history.stamps_ns
    if isinstance(history, SavedMap) and len(history.manifest.strands) == 1:
        sessions, end = [], len(stamps_ns)  # they follow each other; what pruning left of others is before them
        for session in reversed(history.sessions):
            end -= session.n_scans
            sessions.append(replace(session, first_scan=end))
        return sessions[::-1]
    period = (int(stamps_ns[0]), int(stamps_ns[-1]))
    config = history.config.to_dict()
    return [Session("1", "", 0, 0, len(stamps_ns), *period, config, [source_of(log) for log in sources])]


def source_of(log: ScanLog) -> dict[str, Any]:
    """What is kept of a log that was mapped."""
    return {
        "path": log.source,
        "sha256": _hash_files(log),
        "format": log.format,
        "n_scans": len(log),
        "n_skipped": log.n_skipped,
        "notes": list(log.notes),
    }


def _hash_files(log: ScanLog) -> str | None:
    """Of the one file of a log, or of the hashes of its files one after the other."""
    if not log.files:
        return hash_file(log.source) if log.source else None
    hashes = [hash_file(file) for file in log.files]
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()


def refuse_known(path: str | os.PathLike[str], sources: Iterable[dict[str, Any]], scans: Iterable[Scan]) -> None:
    """MapError if a map holds one of some files already, or the very scans."""
    root = Path(path)
    if not (root / MANIFEST).is_file():
        return
    sessions = read_manifest(root).sessions
    known = {source["sha256"]: session.id for session in sessions for source in session.sources if source["sha256"]}
    for source in sources:
        if source["sha256"] in known:
            raise MapError(
                f"{root} holds {source['path']} already, as session {known[source['sha256']]}; it stays as it is"
            )
    content = hashlib.sha256()
    for scan in scans:
        content.update(scan.to_bytes())
    for session in sessions:
        if session.content == content.hexdigest():
            raise MapError(f"{root} holds these scans already, as session {session.id}; it stays as it is")


def check_target(root: Path, force: bool) -> bool:
    """Whether there is a map at `root` to replace; MapError where none may be written."""
    if not root.name:
        raise MapError(f"{root}: a map needs a directory of its own; name one that does not exist yet")
    if not root.exists():
        return False
    if not (root / MANIFEST).is_file():
        raise MapError(f"{root} exists and is not a tempog map, so it stays as it is; choose another name")
    if not force:
        raise MapError(
            f"{root} exists already; use --append to add to it, --force (force=True) to replace it, or another name"
        )
    read_document(root)
    return True


def clear_other_files(root: Path) -> None:
    """Remove what map.json does not name: what was replaced, or was not completed."""
    try:
        manifest = read_manifest(root)
    except MapError:  # of a newer tempog: nothing here is known
        return
    named = {segment.name for segment in manifest.segments} | set(manifest.retired)
    with suppress(OSError):
        (root / f"{MANIFEST}.unfinished").unlink(missing_ok=True)
        for journal in read_journals(root / JOURNAL):
            if journal.header.get("map") != manifest.id:
                journal.path.unlink()
    for folder in [*root.glob("data-*"), *root.glob(f"{SEGMENTS}/*")]:
        if folder.relative_to(root).as_posix() not in named:
            shutil.rmtree(folder, ignore_errors=True)
