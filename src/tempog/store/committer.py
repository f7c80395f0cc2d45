"""Writes segments and map.json in a thread of its own, one change after the other, and merges what is small."""

from __future__ import annotations

import shutil
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from tempog.errors import MapError
from tempog.grid.segments import Runs
from tempog.store.journal import remove_journals
from tempog.store.manifest import JOURNAL, Manifest, Segment, Session, write_manifest
from tempog.store.segment_files import Content, SegmentFiles, joined, write_segment
from tempog.store.tables import QUICK_ZSTD_LEVEL, ZSTD_LEVEL

FANOUT = 8  # so many small segments become one, so that there are few however many were written
SEGMENT_INTERVALS = 2**21  # a segment that large is left alone; it reads in 0.1 s
GRACE_S = 600.0  # s; readers that opened the map before a merge may finish their questions for so long
MOST_RETIRED = 128  # segments that wait for that: so many come about in 600 s if commits are 6 s apart


class Committed(NamedTuple):
    """What a change came to.

    Attributes
    ----------
    segments : list of Segment
        Of the strand, now.
    added : list of (Segment, Runs)
        What was written, with what ended in it.
    dropped : list of Segment
        Replaced before any map.json named them: nobody needs them once these `segments` are asked instead.
    """

    segments: list[Segment]
    added: list[tuple[Segment, Runs]]
    dropped: list[Segment]


class Committer:
    """Changes one strand of a map, for the one process that may.

    Parameters
    ----------
    root : path
    manifest : Manifest
        What map.json says; from now on only the committer changes it.
    session : Session
        Scans are added to it; its strand may be the next new one.
    at_once : bool
        Whether each change counts at once, or all of them at `finish`.
    """

    def __init__(self, root: Path, manifest: Manifest, session: Session, at_once: bool) -> None:
        self.root = root
        self.manifest = manifest
        self.session = session
        self.at_once = at_once
        if session.strand == len(manifest.strands):
            manifest.strands.append([])
        self._strand = manifest.strands[session.strand]
        self._unnamed: list[Segment] = []  # written, but in no map.json yet
        self._dropped: list[Segment] = []  # in no map.json, and not needed any more
        self._to_write: deque[tuple[Content, int]] = deque()  # what failed is tried again before what comes next
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="tempog-commit")

    def add(self, content: Content, n_cells: int) -> Future[Committed]:
        """Write a segment, and name it in map.json if changes count at once."""
        self._to_write.append((content, n_cells))
        return self.retry()

    def retry(self) -> Future[Committed]:
        """Write what could not be written before."""
        return self._worker.submit(self._guarded, self._write)

    def end_session(self, content: str) -> None:
        """What was written counts from now on; waits until it does."""
        self.session = replace(self.session, content=content)
        self._worker.submit(self._guarded, self._name).result()

    def finish(self) -> None:
        """Wait until everything is done; remove what does not count yet."""
        self._worker.shutdown()
        self.remove([*self._unnamed, *self._dropped])

    def remove(self, segments: list[Segment]) -> None:
        """Remove files of segments that no map.json names."""
        for segment in segments:
            shutil.rmtree(self.root / segment.name, ignore_errors=True)

    def _guarded(self, change: Callable[[], Committed]) -> Committed:
        try:
            return change()
        except (OSError, pa.ArrowException) as error:
            raise MapError(f"{self.root}: the map could not be written: {error}") from error

    def _write(self) -> Committed:
        added = []
        while self._to_write:
            content, n_cells = self._to_write[0]
            merged_soon = self.at_once and content.sealed.n_intervals < SEGMENT_INTERVALS // FANOUT
            level = QUICK_ZSTD_LEVEL if merged_soon else ZSTD_LEVEL
            segment = write_segment(self.root, content, n_cells=n_cells, level=level)
            session = self.session
            self._strand.append(segment)
            self._unnamed.append(segment)
            self.session = replace(
                session,
                n_scans=segment.end_scan - session.first_scan,
                start_ns=session.start_ns if session.n_scans else segment.start_ns,
                stop_ns=segment.stop_ns,
            )
            if self.at_once:
                try:
                    self._name()
                except BaseException:
                    self.session = session
                    self._strand.remove(segment)
                    self._unnamed.remove(segment)
                    shutil.rmtree(self.root / segment.name, ignore_errors=True)
                    raise
            self._to_write.popleft()
            added.append((segment, content.sealed))
        self._merge_small()
        dropped, self._dropped = self._dropped, []
        return Committed(list(self._strand), added, dropped)

    def _name(self) -> Committed:
        sessions = [session for session in self.manifest.sessions if session.id != self.session.id]
        self.manifest.sessions = [*sessions, self.session] if self.session.n_scans else sessions
        write_manifest(self.root, self.manifest)
        self._unnamed.clear()
        with suppress(OSError):  # it counts already
            remove_journals(self.root / JOURNAL, self._strand[-1].end_scan if self._strand else 0)
        self._remove_retired()
        return Committed(list(self._strand), [], [])

    def _merge_small(self) -> None:
        """Make one of the latest segments where `FANOUT` of about one size follow each other."""
        while (since := first_to_merge(self._strand)) is not None:
            merged = self._strand[since:]
            segment = merge_segments(self.root, merged)
            self._strand[since:] = [segment]
            self.replaced(merged, segment)
            if self.at_once:
                self._name()

    def replaced(self, merged: list[Segment], by: Segment) -> None:
        """Note that a segment took the place of others."""
        self._unnamed.append(by)
        for segment in merged:
            if segment in self._unnamed:
                self._unnamed.remove(segment)
                self._dropped.append(segment)
            else:
                self.manifest.retired[segment.name] = time.time()

    def _remove_retired(self) -> None:
        retired, now = self.manifest.retired, time.time()
        old = [name for name, when in retired.items() if not 0 <= now - when < GRACE_S]
        for name in old or list(retired)[: max(0, len(retired) - MOST_RETIRED)]:
            shutil.rmtree(self.root / name, ignore_errors=True)
            del retired[name]


def first_to_merge(strand: list[Segment]) -> int | None:
    """From which segment on the latest ones should become one; None if they should stay.

    Once there are `FANOUT` small ones, those are merged that are no larger than all newer ones together: of any
    sizes few are left, and an interval is in a segment of twice the size each time it is written again.
    """
    small = len(strand)
    while small and strand[small - 1].n_intervals < SEGMENT_INTERVALS:
        small -= 1
    if len(strand) - small < FANOUT:
        return None
    sizes = [segment.n_intervals for segment in strand]
    return next((k for k in range(small, len(strand) - 1) if sizes[k] <= sum(sizes[k + 1 :])), None)


def merge_segments(root: Path, segments: list[Segment]) -> Segment:
    """Write one segment that says what several say."""
    content = joined([SegmentFiles(root, segment).content() for segment in segments])
    return write_segment(root, content, n_cells=segments[-1].n_cells)
