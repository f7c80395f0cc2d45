"""One session that is being mapped into a strand: journal, mapper, commits."""

from __future__ import annotations

import hashlib
import math
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from tempog.config import MapConfig
from tempog.errors import MapError, ScanError
from tempog.grid.mapper import Mapper, MapState
from tempog.scans.scan import Scan
from tempog.store.committer import Committed, Committer
from tempog.store.journal import HEADER, JournalWriter, remove_journals
from tempog.store.live_strand import LiveStrand
from tempog.store.manifest import JOURNAL, Manifest, Session, with_room
from tempog.store.segment_files import Content, hits_of
from tempog.store.strand import Strand, strand_of
from tempog.times import MAX_NS, NS_PER_S

FLUSH_INTERVALS = 2**21  # that ended; a commit before its time, so that few are in memory only
SYNC_NS = NS_PER_S  # of scans, that a power cut may cost; a crash of the program costs none
MOST_PENDING = 4  # commits that wait for the disk; then mapping waits, too


class SessionWriter:
    """Maps a session; for the one process that may write the map.

    Parameters
    ----------
    root : path
    manifest : Manifest
        What map.json says; from now on the writer changes it.
    session : Session
        A new one, or one that goes on.
    scan_period_s : float, seconds
        See `TemporalGrid`.
    window_ns, flush_ns : int, nanoseconds
        Of history that stays in memory; of scans between two commits.
    journal : bool
        Whether scans are kept until they are committed.
    at_once : bool
        Whether commits count at once, or the whole session at `close`.

    Attributes
    ----------
    live : LiveStrand
        The strand's history, with what is not committed.
    """

    def __init__(
        self,
        root: Path,
        manifest: Manifest,
        session: Session,
        *,
        scan_period_s: float = math.nan,
        window_ns: int = MAX_NS,
        flush_ns: int = MAX_NS,
        journal: bool = False,
        at_once: bool = True,
    ) -> None:
        self.root = root
        self._window_ns, self._flush_ns, self._at_once = window_ns, flush_ns, at_once
        manifest.config = with_room(manifest.config, session.config)
        disk = strand_of(root, manifest, session.strand)
        mapper = Mapper(
            MapConfig.from_dict(session.config), scan_period_s=scan_period_s, state=_state(disk, session.first_scan)
        )
        disk.longest_gap_s = max(disk.longest_gap_s, mapper.gap_s)
        session = replace(session, config=mapper.config.to_dict())
        if not manifest.segments:
            manifest.config = session.config
            disk.config = mapper.config
        self.live = LiveStrand(disk, mapper)
        self._flushed_scan, self._flushed_tiles = mapper.n_scans, mapper.tiles.n_tiles
        self._flushed_hits = mapper.surfaces.hit_count[: mapper.surfaces.n_slots].copy()
        self._flushed_ns = self._synced_ns = session.stop_ns
        self._not_before_ns = disk.segments[-1].stop_ns if disk.segments else -MAX_NS
        self._n_changed = 0  # open intervals written since the last time that all were
        self._digest = hashlib.sha256()
        self._futures: deque[Future[Committed]] = deque()
        self._committer = Committer(root, manifest, session, at_once)
        self._syncs = ThreadPoolExecutor(1, thread_name_prefix="tempog-sync")  # a commit may take longer than SYNC_NS
        self._journal = self._new_journal() if journal else None

    @property
    def session(self) -> Session:
        """The session as far as it was written."""
        return self._committer.session

    def integrate(self, scan: Scan) -> None:
        """Add one scan; see `LiveMap.integrate`."""
        self.collect()
        mapper = self.live.mapper
        if mapper.n_scans == self.session.first_scan and scan.stamp_ns < self._not_before_ns:
            raise ScanError(f"{scan.label or 'the scan'} at {scan.t:.3f} s is earlier than the session before it")
        if scan.stamp_ns - self._flushed_ns >= self._flush_ns or self.live.n_fresh >= FLUSH_INTERVALS:
            self._submit()  # before the scan: if there is no room for it, the scan was not taken in
        if self._journal is None:
            mapper.integrate(scan)
        else:
            self._integrate_and_keep(self._journal, scan)
        if not self._at_once:
            self._digest.update(scan.to_bytes())

    def flush(self) -> None:
        """Commit what was mapped, and wait until that is done."""
        self._submit()
        self._futures.append(self._committer.retry())
        self.collect(wait=True)

    def close(self) -> None:
        """Commit what was mapped, and end."""
        try:
            self.flush()
            if not self._at_once:
                self._committer.end_session(self._digest.hexdigest())
        finally:
            self.abandon()
        with suppress(OSError):  # all of it was committed
            remove_journals(self.root / JOURNAL)

    def abandon(self) -> None:
        """End without a last commit; what is in the journal stays there."""
        self._committer.finish()
        self._syncs.shutdown()
        if self._journal is not None:
            self._journal.close()

    def collect(self, wait: bool = False) -> None:
        """Take note of the commits that are done; MapError if the latest one failed, which is tried again later."""
        failure = None
        while self._futures and (wait or self._futures[0].done()):
            try:
                segments, added, dropped = self._futures.popleft().result()
            except MapError as error:
                failure = error
                continue
            failure = None
            disk = self.live.disk
            disk.replace_segments(segments)
            for segment, sealed in added:
                if segment in segments:
                    disk.hold(segment, sealed)
            self._committer.remove(dropped)
            end = segments[-1].end_scan if segments else 0
            self.live.pending = [one for one in self.live.pending if one.end_scan > end]
            self.live.mapper.forget_scans(end)
        if failure is not None:
            raise failure

    def _integrate_and_keep(self, journal: JournalWriter, scan: Scan) -> None:
        mapper = self.live.mapper
        try:
            journal.append(mapper.n_scans, scan)
        except OSError as error:
            raise MapError(f"{self.root}: the scan could not be kept: {error}") from error
        try:
            mapper.integrate(scan)
        except BaseException:
            journal.take_back()
            raise
        if scan.stamp_ns - self._synced_ns >= SYNC_NS:
            self._synced_ns = scan.stamp_ns
            self._syncs.submit(journal.sync)

    def _new_journal(self) -> JournalWriter:
        session = self._committer.session
        of_session = {name: getattr(session, name) for name in HEADER if name != "map"}
        header = {"map": self._committer.manifest.id, **of_session}
        try:
            return JournalWriter(self.root / JOURNAL, self.live.mapper.n_scans, header)
        except OSError as error:
            raise MapError(f"{self.root}: no journal could be written: {error}") from error

    def _submit(self) -> None:
        """Hand what was mapped since the last time to the committer."""
        mapper = self.live.mapper
        if mapper.n_scans == self._flushed_scan:
            return
        while len(self._futures) >= MOST_PENDING:
            self.collect(wait=True)
        if self._journal is not None:
            following = self._new_journal()  # before anything is taken, as there may be no room for it
            self._syncs.submit(self._journal.sync)
            self._syncs.submit(self._journal.close)
            self._journal = following
        content, n_cells = self._taken()
        self._flushed_ns = content.stop_ns
        self.live.disk.held_since_ns = max(-MAX_NS, self._flushed_ns - self._window_ns)
        self._futures.append(self._committer.add(content, n_cells))

    def _taken(self) -> tuple[Content, int]:
        """What changed since the last commit, and how many cells were seen until now."""
        mapper, tiles, surfaces = self.live.mapper, self.live.mapper.tiles, self.live.mapper.surfaces
        new, new_tiles = (
            slice(self._flushed_scan - mapper.first_kept, None),
            slice(self._flushed_tiles, tiles.n_tiles),
        )
        n_cells, changed = self.live.n_cells, mapper.open_runs(self._flushed_scan)
        self._n_changed += len(changed.cells)
        full = self._n_changed >= n_cells
        if full:
            self._n_changed = 0
        content = Content(
            self._flushed_scan,
            mapper.stamps_ns[new].copy(),
            mapper.poses[new].copy(),
            self._flushed_tiles,
            tiles.tile_rows[new_tiles].copy(),
            tiles.tile_cols[new_tiles].copy(),
            self.live.take_fresh(),
            mapper.open_runs() if full else changed,
            hits_of(surfaces, None if full else self._flushed_hits),
            full,
        )
        self._flushed_scan, self._flushed_tiles = mapper.n_scans, tiles.n_tiles
        self._flushed_hits = surfaces.hit_count[: surfaces.n_slots].copy()
        return content, n_cells


def _state(disk: Strand, session_start: int) -> MapState:
    """What mapping goes on from at the end of a strand, by the numbers that scans have on disk."""
    open_runs = disk.state_after(len(disk.segments))
    open_runs = open_runs._replace(first=open_runs.first + disk.base, last=open_runs.last + disk.base)
    of_session = slice(session_start - disk.base, None)
    scans = disk.stamps_ns[of_session], disk.poses[of_session]
    return MapState(disk.tiles, disk.surfaces, open_runs, disk.base + disk.n_scans, session_start, *scans)
