"""A map on disk that grows while a robot maps."""

from __future__ import annotations

import math
import os
import shutil
import uuid
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tempog.config import MapConfig
from tempog.errors import ConfigError, MapError
from tempog.grid.delegate import Delegate
from tempog.grid.history import History
from tempog.scans.scan import Scan
from tempog.sensing.surfaces import SurfaceMemory
from tempog.store.manifest import (
    MANIFEST,
    Lock,
    Manifest,
    Session,
    read_manifest,
    require_lock,
    unlock_map,
    write_manifest,
)
from tempog.store.repair import repair
from tempog.store.session_writer import SessionWriter
from tempog.store.strand import as_one, strands_of
from tempog.store.tables import sync
from tempog.times import MAX_NS, NS_PER_S, parse_duration

FLUSH_S = 30.0  # s of scans between two commits: few enough files, and little to replay after a crash


class LiveMap(Delegate):
    """A map on disk that scans are added to; ask it what a `TemporalGrid` or a `SavedMap` can be asked.

    Each scan is with the operating system when `integrate` returns: if the process dies, the next one that opens
    the map finds it. Every `flush_s` what was mapped is committed to the map's tables, in a thread of its own. One
    process writes at a time; others may read meanwhile, and see what was committed.

    Parameters
    ----------
    path : path
        A map to go on with, or the directory to make.
    config : MapConfig, optional
        Default: that of the map.
    robot, session : str
        Kept with what is mapped; the session's name must be new. Default: a name made of the date.
    window : str or float, optional
        ``"24h"``, or seconds: history older than that leaves memory, and is read again when asked for. Default: what
        was read or mapped stays in memory.
    flush_s : float, seconds
        Of scans, between two commits.
    journal : bool
        Whether each scan is kept until it is committed. Without, a crash loses what was not.
    at_once : bool
        Whether each commit counts at once. Else the session is added as a whole, when the map is closed, or not at
        all; nothing of it is in the journal.
    sources : iterable of dict
        Files the session comes from, with all that `Session` keeps of them.
    scan_period_s : float, seconds
        Typical time between scans, where it is known; see `TemporalGrid`.

    Raises
    ------
    MapError
        The map is being written by another process, or cannot be.
    ConfigError
        Settings that do not fit the map's.

    Attributes
    ----------
    repaired : list of str
        What was found to be unfinished when the map was opened, and what was done about it.

    Examples
    --------
    >>> import tempfile
    >>> from tempog import LiveMap, open_map
    >>> from tempog.simulation import corridor, simulate
    >>> path = tempfile.mkdtemp() + "/site.tempog"
    >>> with LiveMap(path, robot="r1", window="1h") as live:
    ...     for scan in simulate(corridor(), duration_s=60.0).scans:
    ...         live.integrate(scan)
    ...     now = live.at("+59", hold=10.0)
    >>> open_map(path).n_scans == live.n_scans
    True
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        config: MapConfig | None = None,
        *,
        robot: str = "",
        session: str = "",
        window: str | float | None = None,
        flush_s: float = FLUSH_S,
        journal: bool = True,
        at_once: bool = True,
        sources: Iterable[dict[str, Any]] = (),
        scan_period_s: float = math.nan,
    ) -> None:
        if not flush_s > 0:
            raise ConfigError(f"flush_s = {flush_s!r} cannot work; wanted seconds above 0")
        sources = list(sources)
        for source in sources:
            if missing := {"path", "sha256", "format", "n_scans", "n_skipped", "notes"} - set(source):
                raise ConfigError(f"source {source!r} of the session lacks {', '.join(sorted(missing))}")
        self.path = Path(path)
        self._settings: dict[str, Any] = {
            "window_ns": MAX_NS if window is None else round(parse_duration(window) * NS_PER_S),
            "flush_ns": round(min(flush_s * NS_PER_S, MAX_NS)),
            "journal": journal and at_once,
            "at_once": at_once,
            "scan_period_s": scan_period_s,
        }
        self._writer: SessionWriter | None = None
        self._merged: tuple[int, History] | None = None
        self._lock: Lock | None = _lock_or_make(self.path, config)
        try:
            self.repaired = repair(self.path)
            self._manifest = read_manifest(self.path)
            self.config = _fitting(config, self._manifest, self.path)
            session = session or f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{uuid.uuid4().hex[:4]}"
            if session in {one.id for one in self._manifest.sessions}:
                raise MapError(f"{self.path} has a session {session!r} already; choose another name")
            self._named = session, robot, sources
            self._others = strands_of(self.path, self._manifest)
        except BaseException:
            self._unlock()
            raise

    @property
    def _whole(self) -> History:
        if self._writer is None:
            return as_one(self.path, self._manifest, self._others)
        live = self._writer.live  # as it is until the next scan or flush, so that a question gets one answer
        if not self._others:
            return live
        if self._merged is None or self._merged[0] != live.n_scans:
            self._merged = live.n_scans, as_one(self.path, self._manifest, [live, *self._others])
        return self._merged[1]

    @property
    def surfaces(self) -> SurfaceMemory:
        """Where inside each cell the hits fell."""
        memory: SurfaceMemory = self._whole.surfaces  # type: ignore[attr-defined]
        return memory

    @property
    def memory_bytes(self) -> int:
        """Bytes held by the map: cells, intervals, hit points and scans; not by strands that are only read."""
        return self._writer.live.memory_bytes if self._writer else 0

    @property
    def session(self) -> str:
        """Name of the session that is being mapped."""
        return self._named[0]

    def integrate(self, scan: Scan) -> None:
        """Add one scan; it is kept when this returns.

        Raises
        ------
        ScanError, ExtentError, ConfigError
            See `TemporalGrid.integrate`; the map is as it was.
        MapError
            It could not be written, or something before it could not; the map is as it was. Once there is room on
            the disk, go on with the same scan. Or the map is closed.
        """
        if self._closed:
            raise MapError(f"{self.path}: the map is closed")
        if self._writer is None:
            self._writer = self._begun(scan.stamp_ns)
        self._writer.integrate(scan)

    def integrate_many(self, scans: Iterable[Scan]) -> None:
        """Add scans in order, as `integrate` one by one."""
        for scan in scans:
            self.integrate(scan)

    def flush(self) -> None:
        """Commit what was mapped, and wait until that is done; MapError if it cannot be."""
        if self._writer is not None and not self._closed:
            self._writer.flush()

    def close(self) -> None:
        """Commit what was mapped and let others write the map; MapError if it cannot be, then the journal has it."""
        if not self._closed:
            try:
                if self._writer is not None:
                    self._writer.close()
            finally:
                self._unlock()

    def abandon(self) -> None:
        """Let others write the map without a last commit: who opens it next finds what is in the journal."""
        if not self._closed:
            try:
                if self._writer is not None:
                    self._writer.abandon()
            finally:
                self._unlock()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None or self._settings["at_once"]:
            self.close()
        else:
            self.abandon()

    def _begun(self, stamp_ns: int) -> SessionWriter:
        """The writer of the session, in a strand that ended before it."""
        name, robot, sources = self._named
        strand = _strand_for(self._manifest, robot, stamp_ns)
        segments = self._manifest.strands[strand] if strand < len(self._manifest.strands) else []
        first_scan = segments[-1].end_scan if segments else 0
        session = Session(name, robot, strand, first_scan, 0, stamp_ns, stamp_ns, self.config.to_dict(), sources)
        writer = SessionWriter(self.path, self._manifest, session, **self._settings)
        del self._others[strand : strand + 1]
        self.config = writer.live.config
        return writer

    @property
    def _closed(self) -> bool:
        return self._lock is None

    def _unlock(self) -> None:
        if self._lock is not None:
            unlock_map(self._lock)
        self._lock = None


def _lock_or_make(path: Path, config: MapConfig | None) -> Lock:
    """The lock of an existing map, or of a new one that is empty."""
    if not path.name:
        raise MapError(f"{path}: a map needs a directory of its own; name one that does not exist yet")
    empty = Manifest((config or MapConfig()).to_dict())
    try:
        if not path.exists():
            _make(path, empty)
        is_empty = path.is_dir() and {file.name for file in path.iterdir()} <= {f"{MANIFEST}.unfinished"}
        if not is_empty and not (path / MANIFEST).is_file():
            raise MapError(f"{path} exists and is not a tempog map, so it stays as it is; choose another name")
        if not os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids):
            raise MapError(f"{path}: the map cannot be written: this user may only read its directory")
        lock = require_lock(path)
        try:
            if is_empty and not (path / MANIFEST).exists():
                write_manifest(path, empty)
            read_manifest(path)
        except BaseException:
            unlock_map(lock)
            raise
    except OSError as error:
        raise MapError(f"{path}: the map could not be written: {error}") from error
    return lock


def _make(path: Path, manifest: Manifest) -> None:
    unfinished = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.unfinished")
    try:
        unfinished.mkdir(parents=True)
        write_manifest(unfinished, manifest)
        unfinished.rename(path)
        sync(path.parent)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)  # there only if it was not moved into place


def _fitting(config: MapConfig | None, manifest: Manifest, path: Path) -> MapConfig:
    of_map = MapConfig.from_dict(manifest.config)
    if config is None:
        return of_map
    if manifest.segments and config.grid.resolution_m != of_map.grid.resolution_m:
        raise ConfigError(
            f"{path} has cells of {of_map.grid.resolution_m:g} m, and {config.grid.resolution_m:g} m were asked for;"
            " a map has one resolution: leave it out, or make another map"
        )
    return config


def _strand_for(manifest: Manifest, robot: str, stamp_ns: int) -> int:
    """The strand that ended before a session begins: of the same robot if possible, else the latest; or a new one."""
    ended = [k for k, strand in enumerate(manifest.strands) if not strand or strand[-1].stop_ns <= stamp_ns]
    if not ended:
        return len(manifest.strands)
    latest_of = {session.strand: session.robot for session in manifest.sessions}

    def preferred(k: int) -> tuple[bool, int]:
        strand = manifest.strands[k]
        return latest_of.get(k) == robot, strand[-1].stop_ns if strand else -MAX_NS

    return max(ended, key=preferred)
