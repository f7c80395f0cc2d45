"""What is done to a map as a whole: compact it, prune it, merge it with others."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tempog.analysis.find_objects import find_objects
from tempog.config import MapConfig
from tempog.errors import ConfigError, MapError
from tempog.grid.segments import Runs, join
from tempog.store.committer import FANOUT, SEGMENT_INTERVALS, merge_segments
from tempog.store.manifest import (
    SEGMENTS,
    Manifest,
    Segment,
    Session,
    is_format_1,
    only_writer,
    read_manifest,
    with_room,
    write_manifest,
)
from tempog.store.repair import repair
from tempog.store.rewrite import NO_SUCCESSOR, chosen, successors
from tempog.store.saved_map import clear_other_files, new_map
from tempog.store.segment_files import Content, SegmentFiles, joined, write_segment
from tempog.store.strand import Strand, as_one, strands_of


@dataclass(frozen=True)
class Compacted:
    """What compacting came to: numbers of segments and bytes, before and after."""

    n_segments_before: int
    n_segments: int
    n_bytes_before: int
    n_bytes: int


def compact(path: str | os.PathLike[str], *, by_reference: bool = False) -> Compacted:
    """Write the segments of a map anew as few large ones, and delete what it does not need any more.

    It answers as before. Readers that have it open must open it again.

    Parameters
    ----------
    path : path
    by_reference : bool
        Keep intervals that cells of an object share once (paper, V.A), with the objects that `find_objects` finds.
        Other programs then do not find all intervals in the tables of that name. It does not pay: see
        docs/storage.md.

    Raises
    ------
    MapError
        There is no map, another process writes it, or it cannot be written; it is as it was.
    """
    root = Path(path)
    with _changed(root) as manifest:
        before = _size(root), len(manifest.segments)
        for strand in manifest.strands:
            strand[:] = [
                merge_segments(root, group) if _worth_writing(group) else group[0] for group in _groups(strand)
            ]
            if by_reference and strand:
                strand[:] = _referring(root, strand, MapConfig.from_dict(manifest.config))
    return Compacted(before[1], len(manifest.segments), before[0], _size(root))


def _referring(root: Path, strand: list[Segment], config: MapConfig) -> list[Segment]:
    history = Strand(root, strand, config)
    places = [place for one in find_objects(history).objects for place in one.configurations]
    groups = [history.tiles.cell_numbers(*place.cells.T) for place in places]
    return [
        write_segment(root, SegmentFiles(root, segment).content(), n_cells=segment.n_cells, groups=groups)
        for segment in strand
    ]


@dataclass(frozen=True)
class Pruned:
    """What pruning deletes, or deleted.

    Attributes
    ----------
    before_ns : int
        What ended before this moment goes.
    n_scans, n_intervals : int
        That go.
    n_last_seen : int
        Cells of the strands that were last seen before: their last state stays, unless it was to be forgotten.
    n_bytes : int
        That the map becomes smaller by; None before it is done.
    """

    before_ns: int
    n_scans: int
    n_intervals: int
    n_last_seen: int
    n_bytes: int | None = None


def prune(path: str | os.PathLike[str], before_ns: int, *, forget: bool = False, dry_run: bool = False) -> Pruned:
    """Delete for ever what ended before a moment.

    Parameters
    ----------
    path : path
    before_ns : int, nanoseconds
    forget : bool
        Also the last state of cells that were not seen since. By default that stays: at the moment and later, the
        map answers as before.
    dry_run : bool
        Only say what would go.

    Raises
    ------
    MapError
        There is no map, another process writes it, or it cannot be written; it is as it was.
    """
    root = Path(path)
    with _changed(root, dry_run) as manifest:
        size = _size(root)
        cuts = [_cut_of(root, strand, before_ns) for strand in manifest.strands]
        plans = {
            number: _Plan(root, strand, cut, forget)
            for number, (strand, cut) in enumerate(zip(manifest.strands, cuts, strict=True))
            if strand and cut > strand[0].first_scan
        }
        gone = Pruned(
            before_ns,
            sum(plan.n_scans for plan in plans.values()),
            sum(plan.n_intervals for plan in plans.values()),
            sum(plan.n_last_seen for plan in plans.values()),
        )
        if dry_run or not (gone.n_scans or gone.n_intervals):
            return gone
        for number, plan in plans.items():
            manifest.strands[number] = plan.written()
        manifest.sessions = [
            kept for s in manifest.sessions if (kept := _cut_session(s, plans.get(s.strand), cuts[s.strand]))
        ]
        when = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
        manifest.pruned.append(
            {"when": when, "before_ns": before_ns, "n_scans": gone.n_scans, "n_intervals": gone.n_intervals}
        )
    return replace(gone, n_bytes=size - _size(root))


class _Plan:
    """One strand without what ended before its scan `cut`.

    Intervals that reach over the cut begin with it. Of those that ended before and stay, the last look stays; the
    scans of these looks get the numbers just before `cut`, and no other scan's number changes.
    """

    def __init__(self, root: Path, strand: list[Segment], cut: int, forget: bool) -> None:
        self._root, self._cut, self._forget = root, cut, forget
        n_early = next((k for k, segment in enumerate(strand) if segment.end_scan > cut), len(strand) - 1) + 1
        self._later = strand[n_early:]
        full_from = max((k for k in range(n_early) if strand[k].full), default=0)
        early = joined(
            [
                # What ended in a segment did so because something else began in it.
                SegmentFiles(root, segment).content(sealed=segment.end_scan > cut, latest=k >= full_from)
                for k, segment in enumerate(strand[:n_early])
            ]
        )
        self._early = self._without_old(early)
        is_used = np.zeros(cut - early.first_scan, dtype=np.bool_)
        unseen = np.zeros(int(early.open_runs.cells[-1]) + 1 if len(early.open_runs.cells) else 0, dtype=np.bool_)
        unseen[early.open_runs.cells[early.open_runs.last < cut]] = True
        self._note_used(is_used, early.first_scan, self._early.sealed, self._early.open_runs)
        self._reaching_back = set()
        for segment in self._later:
            sealed, open_runs = SegmentFiles(root, segment).sealed(), SegmentFiles(root, segment).open_runs()
            if any(bool((runs.first < cut).any()) for runs in (sealed, open_runs)):
                self._reaching_back.add(segment)
                if not forget:
                    self._note_used(is_used, early.first_scan, sealed, open_runs)
            seen = open_runs.cells[open_runs.last >= cut]
            unseen[seen[seen < len(unseen)]] = False
        self.n_last_seen = int(np.count_nonzero(unseen))
        self._scans = (np.flatnonzero(is_used) + early.first_scan).astype(np.int32)  # before the cut, that stay
        self._stamps_ns, self._poses = early.stamps_ns, early.poses
        self.first_stamp_ns = int(early.stamps_ns[min(cut - early.first_scan, len(early.stamps_ns) - 1)])
        self.n_scans = cut - early.first_scan - len(self._scans)
        n_before = sum(segment.n_intervals for segment in strand[:n_early]) + early.open_runs.n_intervals
        n_after = self._early.sealed.n_intervals + self._early.open_runs.n_intervals
        self.n_intervals = n_before - n_after

    def written(self) -> list[Segment]:
        """New segments on disk, and those that can stay."""
        n_kept, early, cut = len(self._scans), self._early, self._cut
        live = slice(cut - early.first_scan, None)
        before = self._scans - early.first_scan
        content = self._renumbered(early)._replace(
            first_scan=cut - n_kept,
            stamps_ns=np.concatenate([self._stamps_ns[before], self._stamps_ns[live]]),
            poses=np.concatenate([self._poses[before], self._poses[live]]),
            full=True,
        )
        if not len(content.stamps_ns):
            return []
        cells = content.open_runs.cells
        segments = [write_segment(self._root, content, n_cells=len(cells))]
        for segment in self._later:
            n_cells = segment.n_cells
            if self._forget:
                cells = np.union1d(cells, self._recent(SegmentFiles(self._root, segment).open_runs()).cells)
                n_cells = len(cells)
            if segment in self._reaching_back:
                content = self._renumbered(self._read(segment))
                segments.append(write_segment(self._root, content, n_cells=n_cells))
            else:
                segments.append(replace(segment, n_cells=n_cells))
        return segments

    def _without_old(self, early: Content) -> Content:
        runs = join([early.sealed, early.open_runs])
        ended_at, cell = successors(runs), runs.cell
        kept = runs.last >= self._cut
        if not self._forget:
            kept |= ended_at >= self._cut
        goes_on = ended_at == NO_SUCCESSOR
        return early._replace(
            sealed=chosen(runs, cell, kept & ~goes_on), open_runs=chosen(runs, cell, kept & goes_on)
        )

    def _read(self, segment: Segment) -> Content:
        content = SegmentFiles(self._root, segment).content()
        if not self._forget:
            return content
        return content._replace(sealed=self._recent(content.sealed), open_runs=self._recent(content.open_runs))

    def _recent(self, runs: Runs) -> Runs:
        return chosen(runs, runs.cell, runs.last >= self._cut)

    def _note_used(self, is_used: NDArray[np.bool_], first_scan: int, *sets: Runs) -> None:
        """Scans before the cut that saw a cell last   [noted]."""
        for runs in sets:
            is_used[runs.last[runs.last < self._cut] - first_scan] = True

    def _renumbered(self, content: Content) -> Content:
        return content._replace(sealed=self._cut_off(content.sealed), open_runs=self._cut_off(content.open_runs))

    def _cut_off(self, runs: Runs) -> Runs:
        last = self._new(runs.last)
        first = np.where(runs.first >= self._cut, runs.first, np.minimum(last, self._cut))
        return runs._replace(first=first.astype(np.int32), last=last)

    def _new(self, numbers: NDArray[np.int32]) -> NDArray[np.int32]:
        moved = np.searchsorted(self._scans, numbers) + (self._cut - len(self._scans))
        return np.where(numbers < self._cut, moved, numbers).astype(np.int32)


def merge(paths: Sequence[str | os.PathLike[str]], output: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Put several maps of one site, in one map frame, into one; the maps stay as they are.

    All sessions are kept and can be chosen. Where maps overlap in time, see `tempog.grid.merged.Merged`.

    Raises
    ------
    MapError
        One is no map, is being written, or `output` exists and `force` is not set. Or they lie too far apart.
    ConfigError
        Fewer than two maps, maps of different resolutions, or maps that hold the same log or the same segments.
    """
    roots, target = [Path(path) for path in paths], Path(output)
    if len(roots) < 2:
        raise ConfigError(f"{len(roots)} map was given; merging takes two or more")
    for root in roots:
        if root.resolve() == target.resolve():
            raise ConfigError(f"{target} is one of the maps to merge, which stay as they are; choose another name")
    with new_map(target, force) as folder:
        merged = Manifest(read_manifest(roots[0]).config)
        resolution_m = merged.config["grid"]["resolution_m"]
        copied: set[str] = set()
        for root in roots:
            read_manifest(root)
            with only_writer(root):
                repair(root)
                manifest = read_manifest(root)
                if manifest.config["grid"]["resolution_m"] != resolution_m:
                    raise ConfigError(
                        f"{roots[0]} has cells of {resolution_m:g} m, {root} of"
                        f" {manifest.config['grid']['resolution_m']:g} m; map the logs again with one --resolution"
                    )
                _refuse_same(merged, manifest, root)
                names = {segment.name for segment in manifest.segments}
                if copied & names:
                    raise ConfigError(f"{root} was given twice, or is a copy of another of the maps")
                copied |= names
                merged.config = with_room(merged.config, manifest.config)
                _copy(root, manifest, folder, merged)
        as_one(target, merged, strands_of(folder, merged))
        write_manifest(folder, merged)
    return target


def _refuse_same(merged: Manifest, manifest: Manifest, root: Path) -> None:
    def names(sessions: list[Session]) -> dict[str, str]:
        hashes = {source["sha256"]: session.id for session in sessions for source in session.sources}
        return hashes | {session.content: session.id for session in sessions}

    known, new = names(merged.sessions), names(manifest.sessions)
    for content in set(known) & set(new) - {"", None}:
        raise ConfigError(f"session {new[content]} of {root} is in another of the maps, too, as {known[content]}")


def _copy(root: Path, manifest: Manifest, folder: Path, merged: Manifest) -> None:
    n_strands, taken = len(merged.strands), {session.id for session in merged.sessions}
    for strand in manifest.strands:
        copies = []
        for segment in strand:
            name = f"{SEGMENTS}/{segment.first_scan:010d}-{uuid.uuid4().hex[:8]}"
            if is_format_1(segment.name):
                content = SegmentFiles(root, segment).content()
                copies.append(write_segment(folder, content, n_cells=segment.n_cells))
                continue
            try:
                shutil.copytree(root / segment.name, folder / name)
            except (OSError, shutil.Error) as error:
                raise MapError(f"{root}: its segments could not be copied: {error}") from error
            copies.append(replace(segment, name=name))
        merged.strands.append(copies)
    for session in manifest.sessions:
        name, k = session.id, 2
        while name in taken:
            name, k = f"{session.id}-{k}", k + 1
        taken.add(name)
        merged.sessions.append(replace(session, id=name, strand=session.strand + n_strands))
    merged.pruned += manifest.pruned


@contextmanager
def _changed(root: Path, dry_run: bool = False) -> Iterator[Manifest]:
    """What map.json says, to be changed. If nothing fails the change counts, and what it left behind is deleted."""
    read_manifest(root)
    with only_writer(root):
        repair(root)
        manifest = read_manifest(root)
        try:
            yield manifest
            if not dry_run:
                manifest.retired.clear()
                write_manifest(root, manifest)
        except (OSError, pa.ArrowException) as error:
            raise MapError(f"{root}: the map could not be written: {error}") from error
        finally:
            clear_other_files(root)


def _groups(strand: list[Segment]) -> list[list[Segment]]:
    """Segments that become one: as many as are within the size of two large ones."""
    groups: list[list[Segment]] = []
    for segment in strand:
        if groups and sum(s.n_intervals for s in [*groups[-1], segment]) <= 2 * SEGMENT_INTERVALS:
            groups[-1].append(segment)
        else:
            groups.append([segment])
    return groups


def _worth_writing(group: list[Segment]) -> bool:
    return len(group) > 1 or is_format_1(group[0].name) or group[0].n_intervals < SEGMENT_INTERVALS // FANOUT


def _cut_of(root: Path, strand: list[Segment], before_ns: int) -> int:
    """The first scan from a moment on."""
    for segment in strand:
        if segment.stop_ns >= before_ns:
            stamps_ns, _ = SegmentFiles(root, segment).scans()
            return segment.first_scan + int(np.searchsorted(stamps_ns, before_ns, side="left"))
    return strand[-1].end_scan if strand else 0


def _cut_session(session: Session, plan: _Plan | None, cut: int) -> Session | None:
    """What is left of a session; None if nothing is."""
    if plan is None or session.first_scan >= cut:
        return session
    if session.end_scan <= cut:
        return None
    n_scans = session.end_scan - cut
    return replace(session, first_scan=cut, n_scans=n_scans, start_ns=plan.first_stamp_ns, content="")


def _size(root: Path) -> int:
    return sum(file.stat().st_size for file in root.rglob("*") if file.is_file())
