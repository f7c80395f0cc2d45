"""What a crash left of a map: finished by the next process that opens it."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from tempog.errors import MapError, TempogError
from tempog.grid.mapper import Mapper
from tempog.scans.scan import Scan
from tempog.store.journal import Journal, has_journals, read_journals, remove_journals
from tempog.store.live_strand import LiveStrand
from tempog.store.manifest import (
    JOURNAL,
    MANIFEST,
    SEGMENTS,
    Manifest,
    Session,
    is_format_1,
    read_manifest,
    try_lock,
    unlock_map,
)
from tempog.store.session_writer import SessionWriter
from tempog.store.strand import Strand, strands_of

AnyStrands = list[Strand | LiveStrand]


def open_strands(root: Path) -> tuple[Manifest, AnyStrands, list[str]]:
    """What a map says, a history per strand, and what was repaired.

    Scans that a crash left in the journal are committed, unless a process is writing the map just now. If the map
    cannot be written, they are mapped in memory.
    """
    notes: list[str] = []
    if has_journals(root / JOURNAL) and (lock := try_lock(root)) is not None:
        try:
            notes = repair(root)
        except MapError as error:
            return _in_memory(root, _journals_of(root, read_manifest(root)), str(error))
        finally:
            unlock_map(lock)
    manifest = read_manifest(root)
    return manifest, [*strands_of(root, manifest)], notes


def repair(root: Path) -> list[str]:
    """Finish what a crash interrupted, and say what was done; only for the process that may write the map.

    Raises
    ------
    MapError
        It cannot be written; nothing is lost.
    """
    manifest, notes = read_manifest(root), []
    try:
        journals = _journals_of(root, manifest)
        removed = _remove_debris(root, manifest)
        todo = _to_replay(journals, manifest)
        if todo is not None:
            writer = SessionWriter(root, manifest, todo[0])
            n_scans = _integrate_all(writer.live.mapper, todo[1])
            writer.close()
            notes.append(f"session {todo[0].id} was never closed; {n_scans} of its scans were taken from the journal")
        remove_journals(root / JOURNAL)
    except OSError as error:
        raise MapError(f"{root}: the map could not be written: {error}") from error
    notes += _lost(journals)
    if removed:
        notes.append(f"removed what an interrupted change had left: {', '.join(removed)}")
    return notes


def _in_memory(root: Path, journals: Sequence[Journal], why: str) -> tuple[Manifest, AnyStrands, list[str]]:
    manifest = read_manifest(root)
    strands: AnyStrands = [*strands_of(root, manifest)]
    todo = _to_replay(journals, manifest)
    if todo is None:
        return manifest, strands, _lost(journals)
    session, scans = todo
    writer = SessionWriter(root, manifest, session, at_once=False)
    n_scans = _integrate_all(writer.live.mapper, scans)
    writer.abandon()
    if not n_scans:
        return manifest, strands, _lost(journals)
    strands[session.strand : session.strand + 1] = [writer.live]
    stamps_ns = writer.live.stamps_ns
    manifest.sessions = [one for one in manifest.sessions if one.id != session.id] + [
        Session(
            session.id,
            session.robot,
            session.strand,
            session.first_scan,
            writer.live.mapper.n_scans - session.first_scan,
            session.start_ns,
            int(stamps_ns[-1]),
            session.config,
            session.sources,
        )
    ]
    return manifest, strands, [f"{n_scans} scans are in the journal only: {why}", *_lost(journals)]


def _journals_of(root: Path, manifest: Manifest) -> list[Journal]:
    """The journals of a map, not those of a map that it replaced."""
    try:
        journals = read_journals(root / JOURNAL)
    except OSError as error:
        raise MapError(f"{root}: its journal cannot be read: {error}") from error
    return [journal for journal in journals if journal.header.get("map", manifest.id) == manifest.id]


def _to_replay(journals: Sequence[Journal], manifest: Manifest) -> tuple[Session, list[tuple[int, Scan]]] | None:
    """The session whose journals are there, and those of its scans that were not committed."""
    headers = [journal.header for journal in journals if journal.header]
    if not headers:
        return None
    header = {name: value for name, value in headers[-1].items() if name != "map"}
    segments = manifest.strands[header["strand"]] if header["strand"] < len(manifest.strands) else []
    end = segments[-1].end_scan if segments else 0
    mine = [journal for journal in journals if journal.header.get("id") == header["id"]]
    scans = [(number, scan) for journal in mine for number, scan in journal.scans if number >= end]
    if not scans:
        return None
    known = [session for session in manifest.sessions if session.id == header["id"]]
    stamp_ns = scans[0][1].stamp_ns
    fresh = Session(**header, n_scans=0, start_ns=stamp_ns, stop_ns=stamp_ns)
    return (known[0] if known else fresh), scans


def _integrate_all(mapper: Mapper, scans: Sequence[tuple[int, Scan]]) -> int:
    """Integrate scans of a journal; returns how many. The last one may be refused, if a crash came before it was."""
    before = mapper.n_scans
    mapper.gap_judged = True  # it was found to fit when the scans were taken in
    for _, scan in scans:
        try:
            mapper.integrate(scan)
        except TempogError:
            continue
    return mapper.n_scans - before


def _lost(journals: Sequence[Journal]) -> list[str]:
    n_bytes = sum(journal.n_lost_bytes for journal in journals)
    return [f"the journal ends in {n_bytes} bytes of a scan that was cut off or damaged"] if n_bytes else []


def _remove_debris(root: Path, manifest: Manifest) -> list[str]:
    """Remove what map.json does not name; returns what that was."""
    known = {segment.name for segment in manifest.segments} | set(manifest.retired)
    debris = [root / f"{MANIFEST}.unfinished", *root.glob(f"{SEGMENTS}/*"), *root.glob("data-*")]
    removed = []
    for path in debris:
        name = path.relative_to(root).as_posix()
        if path.is_dir() and name not in known and (is_format_1(name) or path.parent.name == SEGMENTS):
            shutil.rmtree(path)
            removed.append(name)
        elif path.is_file() and path.name.startswith(MANIFEST):
            path.unlink()
            removed.append(name)
    return removed
