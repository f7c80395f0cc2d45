"""A live map on a disk that is full, that may only be read, or that somebody else writes."""

from __future__ import annotations

import errno
import os
from concurrent.futures import Future
from pathlib import Path

import pytest

from same_history import CONFIG, assert_same, debris, grid_of, room_scans
from tempog import LiveMap, open_map
from tempog.errors import ConfigError, ExtentError, MapError, ScanError
from tempog.scans.scan import Scan
from tempog.store import committer, journal, manifest, segment_files, session_writer
from tempog.store.manifest import only_writer, read_manifest
from tempog.store.saved_map import save_map

SCANS = room_scans(40)


def full_disk() -> OSError:
    return OSError(errno.ENOSPC, "No space left on device")


@pytest.fixture
def root(quick_path):
    return quick_path / "map"


class Disk:
    """Makes functions of the store fail while the disk is full."""

    def __init__(self, monkeypatch) -> None:
        self.monkeypatch = monkeypatch
        self.full: set[str] = set()
        self.n_calls = 0

    def watch(self, name: str, module, function: str) -> None:
        original = getattr(module, function)

        def guarded(*args, **kwargs):
            if name in self.full:
                self.n_calls += 1
                raise full_disk()
            return original(*args, **kwargs)

        self.monkeypatch.setattr(module, function, guarded)


@pytest.fixture
def disk(monkeypatch):
    disk = Disk(monkeypatch)
    disk.watch("journal", journal.JournalWriter, "append")
    disk.watch("new journal", session_writer, "JournalWriter")
    disk.watch("tables", segment_files, "write_table")
    disk.watch("map.json", committer, "write_manifest")
    disk.watch("merge", committer, "merge_segments")
    return disk


def mapped_with_failures(live, scans, disk, what, full_from, full_to):
    """Integrate scans; the disk is full for some tries. Each refused scan is tried again, as a user would."""
    n_refused, tries = 0, 0
    for scan in scans:
        while True:
            tries += 1
            disk.full = what if full_from <= tries < full_to else set()
            before, refused = live.n_scans, None
            try:
                live.integrate(scan)
            except MapError as error:
                refused = error
            if refused is None:
                assert live.n_scans == before + 1
                break
            n_refused += 1
            assert "No space left" in str(refused)
            assert live.n_scans == before
    return n_refused


@pytest.mark.parametrize("what", ["journal", "new journal", "tables", "map.json", "merge"])
@pytest.mark.parametrize("flush_s", [0.15, 1.0])
def test_a_full_disk_refuses_scans_and_loses_none(root, disk, monkeypatch, what, flush_s):
    monkeypatch.setattr(committer, "FANOUT", 3)
    with LiveMap(root, CONFIG, flush_s=flush_s) as live:
        mapped_with_failures(live, SCANS, disk, {what}, 12, 30)
        assert disk.n_calls > 0 or what == "merge" or (flush_s == 1.0 and what in ("tables", "map.json"))
        assert_same(live, grid_of(SCANS))
    assert_same(open_map(root), grid_of(SCANS))
    assert not open_map(root).repaired


def test_what_was_taken_in_while_commits_failed_is_answered_and_survives_a_crash(root, disk):
    live = LiveMap(root, CONFIG, flush_s=0.3)
    n_refused = mapped_with_failures(live, SCANS, disk, {"tables"}, 10, 99)
    assert n_refused > 0
    assert_same(live, grid_of(SCANS))
    live.abandon()
    disk.full = set()
    assert_same(open_map(root), grid_of(SCANS))


def test_a_failed_commit_is_no_error_of_a_question(root, disk):
    live = LiveMap(root, CONFIG, flush_s=60)
    for scan in SCANS[:10]:
        live.integrate(scan)
    disk.full = {"tables"}
    live._writer._submit()
    waited(live)
    assert_same(live, grid_of(SCANS[:10]))
    with pytest.raises(MapError, match="No space left"):
        live.integrate(SCANS[10])
    disk.full = set()
    live.integrate(SCANS[10])
    live.close()
    assert_same(open_map(root), grid_of(SCANS[:11]))


def waited(live) -> None:
    for future in live._writer._futures:
        assert isinstance(future, Future)
        future.exception()


def test_a_commit_that_failed_is_made_good_by_the_next_flush(root, disk):
    live = LiveMap(root, CONFIG, flush_s=60)
    for k, scan in enumerate(SCANS[:20]):
        live.integrate(scan)
        disk.full = {"tables"} if k % 5 == 4 else set()
        if k % 5 == 4:
            with pytest.raises(MapError, match="No space left"):
                live.flush()
            assert read_manifest(root).n_scans == 0
    disk.full = set()
    live.flush()
    assert open_map(root).n_scans == 20
    assert [segment.first_scan for segment in read_manifest(root).segments] == [0, 5, 10, 15]
    assert_same(live, grid_of(SCANS[:20]))
    live.close()


def test_closing_after_failed_commits_commits_them(root, disk):
    live = LiveMap(root, CONFIG, flush_s=60)
    for scan in SCANS[:10]:
        live.integrate(scan)
    disk.full = {"tables"}
    live._writer._submit()
    waited(live)
    disk.full = set()
    live.close()
    assert not open_map(root).repaired
    assert_same(open_map(root), grid_of(SCANS[:10]))


@pytest.mark.parametrize("what", ["tables", "map.json", "new journal"])
def test_what_could_not_be_committed_when_the_map_was_closed_is_in_the_journal(root, disk, what):
    live = LiveMap(root, CONFIG, flush_s=1.0)
    for scan in SCANS:
        live.integrate(scan)
    disk.full = {what}
    with pytest.raises(MapError, match="No space left"):
        live.close()
    with pytest.raises(MapError, match="closed"):
        live.integrate(SCANS[-1])
    in_memory = open_map(root)  # while there is still no room
    assert_same(in_memory, grid_of(SCANS))
    if what != "new journal":
        assert any("in the journal only" in note for note in in_memory.repaired)
    disk.full = set()
    opened = open_map(root)
    assert_same(opened, grid_of(SCANS))
    assert what == "new journal" or any("never closed" in note for note in opened.repaired)
    assert not open_map(root).repaired
    assert debris(root) == []


def test_a_session_that_cannot_be_begun_takes_nothing_from_the_map(root, disk):
    """Two strands, so that a strand that is forgotten would be missed."""
    with LiveMap(root, CONFIG, robot="a") as live:
        for scan in SCANS:
            live.integrate(scan)
    other = room_scans(40, start_s=101.0, seed=1)
    with LiveMap(root, robot="b") as live:
        for scan in other:
            live.integrate(scan)
    later = room_scans(10, start_s=300.0, seed=2)
    wanted = open_map(root).all_runs()
    with LiveMap(root, robot="a") as live:
        disk.full = {"new journal"}
        for _ in range(3):
            with pytest.raises(MapError, match="No space left"):
                live.integrate(later[0])
            assert live.n_scans == 80
        for mine, yours in zip(live.all_runs(), wanted, strict=True):
            assert (mine == yours).all()
        disk.full = set()
        for scan in later:
            live.integrate(scan)
        assert live.n_scans == 90
    assert open_map(root).n_scans == 90
    assert_same(open_map(root, robots=["b"]), grid_of(other))


@pytest.mark.parametrize("function", ["remove_journals", "sync"])
def test_what_fails_after_the_rename_does_not_undo_the_commit(root, monkeypatch, function):
    module = committer if function == "remove_journals" else manifest
    original = getattr(module, function)

    def fails(path, *args):
        if function == "remove_journals" or path == root:
            raise full_disk()
        return original(path, *args)

    monkeypatch.setattr(module, function, fails)
    if function == "remove_journals":
        monkeypatch.setattr(session_writer, function, fails)
    with LiveMap(root, CONFIG, flush_s=0.5) as live:
        for scan in SCANS:
            live.integrate(scan)
    assert_same(open_map(root), grid_of(SCANS))


def test_a_file_that_cannot_be_put_on_the_disk_is_a_failed_commit(root, monkeypatch):
    live = LiveMap(root, CONFIG)
    for scan in SCANS[:10]:
        live.integrate(scan)

    def broken(file):
        raise OSError(errno.EIO, "broken disk")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", broken)
        with pytest.raises(MapError, match="broken disk"):
            live.flush()
    assert read_manifest(root).n_scans == 0
    live.close()
    assert_same(open_map(root), grid_of(SCANS[:10]))


@pytest.mark.parametrize("at_once", [True, False])
def test_a_map_that_cannot_be_finished_has_all_of_the_session_or_nothing(root, disk, at_once):
    live = LiveMap(root, CONFIG, journal=False, at_once=at_once, flush_s=1.0)
    for scan in SCANS:
        live.integrate(scan)
    waited(live)
    disk.full = {"map.json"}
    with pytest.raises(MapError, match="No space left"):
        live.close()
    assert open_map(root).n_scans in ((0,) if not at_once else range(1, 40))
    assert debris(root) == []


# Scans that are refused.


def test_refused_scans_are_not_in_the_journal(root):
    live = LiveMap(root, CONFIG)
    for k, scan in enumerate(SCANS[:20]):
        live.integrate(scan)
        if k % 3 == 0:
            with pytest.raises(ScanError, match="earlier"):
                live.integrate(SCANS[max(k - 1, 0)] if k else Scan(1.0, (0, 0, 0), [], []))
            with pytest.raises(ExtentError):
                live.integrate(Scan(scan.t, (1e9, 0, 0), [0.0], [1.0]))
    live.abandon()
    opened = open_map(root)
    assert opened.repaired == [
        f"session {live.session} was never closed; 20 of its scans were taken from the journal"
    ]
    assert_same(opened, grid_of(SCANS[:20]))


def test_scans_that_come_slower_than_at_first_survive_a_crash(root):
    """After ten scans of 0.1 s the gap threshold was found to fit; after a crash it is not judged by all scans."""
    slow = [Scan(110.0 + 5 * k, (0, 0, 0), [0.0], [2.0]) for k in range(30)]
    live = LiveMap(root, CONFIG, flush_s=60)
    for scan in [*SCANS[:12], *slow]:
        live.integrate(scan)
    live.abandon()
    assert_same(open_map(root), grid_of([*SCANS[:12], *slow]))


def test_scans_of_a_known_period_survive_a_crash(root):
    slow = [Scan(110.0 + 5 * k, (0, 0, 0), [0.0], [2.0]) for k in range(30)]
    live = LiveMap(root, CONFIG, scan_period_s=0.1)
    for scan in slow:
        live.integrate(scan)
    live.abandon()
    assert open_map(root).n_scans == 30


def test_a_gap_that_does_not_fit_is_told_and_the_map_stays(root):
    slow = [Scan(110.0 + 5 * k, (0, 0, 0), [0.0], [2.0]) for k in range(12)]
    with LiveMap(root, CONFIG) as live:
        for scan in slow[:10]:
            live.integrate(scan)
        for scan in slow[10:]:
            with pytest.raises(ConfigError, match="shorter than the scan period"):
                live.integrate(scan)
    assert open_map(root).n_scans == 10


def test_a_session_does_not_begin_before_the_end_of_the_strand_that_was_chosen_for_it(root):
    """The first scan is refused, and the second is older than the session before."""
    with LiveMap(root, CONFIG) as live:
        for scan in SCANS:
            live.integrate(scan)
    with LiveMap(root) as live:
        with pytest.raises(ExtentError):
            live.integrate(Scan(500.0, (1e9, 0, 0), [0.0], [1.0]))
        with pytest.raises(ScanError, match="earlier than the session before"):
            live.integrate(Scan(101.0, (0, 0, 0), [0.0], [1.0]))
        live.integrate(Scan(300.0, (0, 0, 0), [0.0], [1.0]))
    assert open_map(root).n_scans == 41


# Journals and maps that replace each other.


def crashed(root, scans, **settings):
    live = LiveMap(root, CONFIG, **settings)
    for scan in scans:
        live.integrate(scan)
    live.abandon()


def test_the_journal_of_a_replaced_map_is_not_taken_for_that_of_the_new_one(root, monkeypatch):
    """The process dies after the new map counts and before the old journal is gone."""
    crashed(root, SCANS[:30], flush_s=60)
    with monkeypatch.context() as patch:
        patch.setattr("tempog.store.saved_map.clear_other_files", lambda root: None)
        save_map(grid_of(SCANS[:5]), root, force=True)
    assert list(root.glob("journal/*")) != []
    opened = open_map(root)
    assert_same(opened, grid_of(SCANS[:5]))
    assert opened.repaired == []
    assert list(root.glob("journal/*")) == []


def test_a_map_that_could_not_be_replaced_keeps_its_journal(root, disk):
    crashed(root, SCANS[:30], flush_s=60)
    disk.full = {"tables"}
    with pytest.raises(MapError, match="No space left"):
        save_map(grid_of(SCANS[:5]), root, force=True)
    disk.full = set()
    assert_same(open_map(root), grid_of(SCANS[:30]))


def test_a_map_of_format_2_without_a_journal_is_not_repaired(root):
    save_map(grid_of(SCANS), root)
    assert open_map(root).repaired == []


def test_damage_in_the_middle_of_the_journals_keeps_what_is_whole(root):
    """The first of two journals is cut off: the second one's scans are taken in behind it."""
    live = LiveMap(root, CONFIG, flush_s=60)
    for scan in SCANS[:10]:
        live.integrate(scan)
    live._writer._journal.close()
    live._writer._journal = live._writer._new_journal()
    for scan in SCANS[10:20]:
        live.integrate(scan)
    live.abandon()
    first = min(root.glob("journal/*"))
    os.truncate(first, first.stat().st_size - 5)
    opened = open_map(root)
    assert any("bytes of a scan that was cut off" in note for note in opened.repaired)
    assert_same(opened, grid_of([*SCANS[:9], *SCANS[10:20]]))


# Maps that may only be read.


@pytest.fixture
def unwritable(monkeypatch):
    """Lets this process write nothing below a folder, as if it were another user's."""

    def protect(root: Path):
        if os.geteuid() == 0:
            for folder in [root, *(path for path in root.rglob("*") if path.is_dir())]:
                folder.chmod(0o555)
            for parent in root.parents:
                if not parent.stat().st_mode & 0o001:
                    pytest.skip(f"{parent} cannot be entered by another user")
            os.seteuid(65534)
        else:
            for folder in [root, *(path for path in root.rglob("*") if path.is_dir())]:
                folder.chmod(0o555)

    user = os.geteuid()
    yield protect
    if os.geteuid() != user:
        os.seteuid(user)


def test_a_map_that_may_only_be_read_is_opened_with_the_scans_of_its_journal(root, unwritable):
    live = LiveMap(root, CONFIG, flush_s=1.0)
    for scan in SCANS:
        live.integrate(scan)
    live.abandon()
    before = read_manifest(root).n_scans
    assert 0 < before < 40
    unwritable(root)
    opened = open_map(root)
    assert opened.n_scans == 40
    (note,) = opened.repaired
    assert "scans are in the journal only" in note
    assert "Permission denied" in note
    assert opened.sessions[0].n_scans == 40
    assert_same(opened, grid_of(SCANS))
    assert_same(open_map(root, sessions=[live.session]), grid_of(SCANS))
    assert read_manifest(root).n_scans == before


def test_a_map_that_may_only_be_read_is_not_written(root, unwritable):
    save_map(grid_of(SCANS), root)
    unwritable(root)
    assert_same(open_map(root), grid_of(SCANS))
    with pytest.raises(MapError, match="may only read"):
        LiveMap(root)
    with pytest.raises(MapError, match=r"could not be written|may only read"):
        save_map(grid_of(SCANS[:5]), root, force=True)
    assert_same(open_map(root), grid_of(SCANS))


# Two who write.


def test_a_map_that_is_being_written_is_not_written_by_another(root):
    with LiveMap(root, CONFIG) as live:
        live.integrate(SCANS[0])
        for other in (
            lambda: LiveMap(root),
            lambda: save_map(grid_of(SCANS[:5]), root, force=True),
        ):
            with pytest.raises(MapError, match="is being written by another process"):
                other()
        live.integrate(SCANS[1])
        live.flush()
        assert open_map(root).n_scans == 2
    with LiveMap(root) as live:
        assert live.n_scans == 2


def test_a_lock_that_cannot_be_had_is_told(root, monkeypatch):
    save_map(grid_of(SCANS), root)
    original = os.open

    def refuses(path, *args):
        if Path(path) == root:
            raise PermissionError(errno.EACCES, "Permission denied")
        return original(path, *args)

    monkeypatch.setattr(os, "open", refuses)
    with pytest.raises(MapError, match="Permission denied"), only_writer(root):
        pass


def test_a_folder_with_nothing_but_an_unfinished_map_becomes_one(root):
    root.mkdir()
    (root / "map.json.unfinished").write_text("{")
    with LiveMap(root, CONFIG) as live:
        live.integrate(SCANS[0])
    assert open_map(root).n_scans == 1
    assert debris(root) == []


def test_a_map_that_cannot_be_made_leaves_nothing(root, monkeypatch):
    def fail(*_):
        raise full_disk()

    monkeypatch.setattr("tempog.store.live_map.write_manifest", fail)
    with pytest.raises(MapError, match="No space left"):
        LiveMap(root, CONFIG)
    assert list(root.parent.iterdir()) == []
