"""The journal: whole scans before a damage survive bit for bit, and nothing else is taken for a scan."""

from __future__ import annotations

import errno
import json
import math
import os
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tempog.scans.scan import Scan
from tempog.store.journal import FRAME, JournalWriter, read_journal, read_journals, remove_journals

HEADER = {
    "map": "m",
    "id": "s",
    "robot": "r",
    "strand": 0,
    "first_scan": 7,
    "config": {"grid": {}},
    "sources": [{"path": "ä"}],
}
WRONG_HEADERS = [[], 5, None, {}, {**HEADER, "strand": "0"}, {key: HEADER[key] for key in list(HEADER)[1:]}]


@st.composite
def journaled_scans(draw):
    """Scans with readings of every kind, whose angles repeat or do not."""
    scans = []
    angles = np.linspace(-1, 1, draw(st.integers(0, 5)))
    for k in range(draw(st.integers(0, 5))):
        if draw(st.booleans()):
            angles = np.array(draw(st.lists(st.floats(-7, 7), max_size=6)))
        readings = st.one_of(st.floats(width=32), st.sampled_from([math.inf, math.nan, 0.0, -1.0, 2.5]))
        ranges = draw(st.lists(readings, min_size=len(angles), max_size=len(angles)))
        pose = draw(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-7, 7)))
        max_range = draw(st.sampled_from([math.inf, 30.0]))
        scans.append(Scan(0.0, pose, angles, ranges, max_range, stamp_ns=draw(st.integers(-(2**62), 2**62)) + k))
    return scans


def bits(scan):
    """All that a scan says, so that equal means equal in every bit."""
    pose = np.array([scan.x, scan.y, scan.theta, scan.max_range]).tobytes()
    return scan.stamp_ns, pose, scan.angles.tobytes(), scan.ranges.tobytes()


def journal_of(folder, scans, first_scan=7):
    writer = JournalWriter(folder, first_scan, HEADER)
    ends = []
    for k, scan in enumerate(scans):
        writer.append(first_scan + k, scan)
        ends.append(writer.path.stat().st_size)
    writer.close()
    return writer.path, ends


def same(journal, scans):
    return [(n, bits(scan)) for n, scan in journal.scans] == [(7 + k, bits(scan)) for k, scan in enumerate(scans)]


PROPERTY = settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


@given(journaled_scans())
@PROPERTY
def test_a_journal_cut_off_at_any_byte_holds_the_whole_scans_before(tmp_path_factory, scans):
    path, ends = journal_of(tmp_path_factory.mktemp("journal"), scans)
    start = FRAME.size + len(json.dumps(HEADER))
    for size in reversed(range(path.stat().st_size + 1)):
        os.truncate(path, size)
        journal = read_journal(path)
        whole = sum(end <= size for end in ends)
        assert journal.header == (HEADER if size >= start else {})
        assert same(journal, scans[:whole])
        assert journal.n_lost_bytes == size - max([start if size >= start else 0, *ends[:whole]])


@given(journaled_scans(), st.data())
@PROPERTY
def test_flipped_bits_end_a_journal_before_them(tmp_path_factory, scans, data):
    path, ends = journal_of(tmp_path_factory.mktemp("journal"), scans)
    content = path.read_bytes()
    for _ in range(20):
        place, mask = data.draw(st.integers(0, len(content) - 1)), data.draw(st.integers(1, 255))
        spoiled = bytearray(content)
        spoiled[place] ^= mask
        path.with_name("spoiled").write_bytes(spoiled)
        journal = read_journal(path.with_name("spoiled"))
        assert same(journal, scans[: sum(end <= place for end in ends)])
        assert journal.n_lost_bytes > 0


@given(journaled_scans(), st.binary(max_size=200))
@PROPERTY
def test_what_follows_the_last_scan_is_no_scan(tmp_path_factory, scans, tail):
    path, _ = journal_of(tmp_path_factory.mktemp("journal"), scans)
    path.write_bytes(path.read_bytes() + tail)
    journal = read_journal(path)
    assert same(journal, scans)
    assert journal.n_lost_bytes == len(tail)


@pytest.mark.parametrize("n_bytes", [1, 8, 9, 4096])
def test_zeros_that_a_power_cut_leaves_are_no_record(tmp_path, n_bytes):
    empty = tmp_path / "0000000000.journal"
    empty.write_bytes(bytes(n_bytes))
    assert (read_journal(empty).header, read_journal(empty).scans) == ({}, [])
    scans = [Scan(1.0, (0, 0, 0), [0.0], [2.0])]
    path, _ = journal_of(tmp_path, scans)
    path.write_bytes(path.read_bytes() + bytes(n_bytes))
    assert same(read_journal(path), scans)


@pytest.mark.parametrize("header", WRONG_HEADERS)
def test_a_first_record_that_names_no_session_is_no_journal(tmp_path, header):
    payload = json.dumps(header).encode()
    path = tmp_path / "0000000000.journal"
    path.write_bytes(FRAME.pack(len(payload), zlib.crc32(payload)) + payload)
    assert (read_journal(path).header, read_journal(path).n_lost_bytes) == ({}, path.stat().st_size)


def test_a_scan_that_was_taken_back_leaves_no_trace(tmp_path):
    angles = [np.zeros(2), np.ones(3), np.ones(3)]
    scans = [Scan(k, (k, 0, 0), angles[k], np.full(len(angles[k]), 2.0)) for k in range(3)]
    writer = JournalWriter(tmp_path, 7, HEADER)
    writer.append(7, scans[0])
    writer.append(8, scans[1])
    writer.take_back()  # with its angles, so that the next scan must bring them again
    writer.append(8, scans[2])
    writer.close()
    assert same(read_journal(writer.path), [scans[0], scans[2]])


class FailingDisk:
    """Takes the place of os.write: writes some bytes of a record, then fails."""

    def __init__(self, monkeypatch, n_bytes: int, error: BaseException) -> None:
        self.write, self.left, self.error = os.write, n_bytes, error
        monkeypatch.setattr(os, "write", self)

    def __call__(self, file, data):
        if self.left <= 0:
            raise self.error
        n = self.write(file, data[: self.left])
        self.left -= n
        return n


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), KeyboardInterrupt()], ids=["full", "interrupt"])
@pytest.mark.parametrize("cut", ["works", "fails"])
@pytest.mark.parametrize("n_bytes", [0, 1, 20, 60])
def test_a_record_that_could_not_be_written_is_not_in_the_way_of_the_next(tmp_path, monkeypatch, n_bytes, cut, error):
    scans = [Scan(k, (k, 0, 0), [0.0, 1.0], [2.0, 3.0]) for k in range(3)]

    def fails(file, size):
        raise OSError(errno.EIO, "broken")

    writer = JournalWriter(tmp_path, 7, HEADER)
    writer.append(7, scans[0])
    with monkeypatch.context() as patch:
        FailingDisk(patch, n_bytes, error)
        if cut == "fails":
            patch.setattr(os, "ftruncate", fails)
        with pytest.raises(type(error)):
            writer.append(8, scans[1])
    writer.append(8, scans[2])
    writer.close()
    assert same(read_journal(writer.path), [scans[0], scans[2]])


def test_a_journal_that_cannot_be_begun_is_not_there(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        FailingDisk(patch, 10, OSError(errno.ENOSPC, "full"))
        with pytest.raises(OSError, match="full"):
            JournalWriter(tmp_path, 7, HEADER)
    assert list(tmp_path.iterdir()) == []


def test_journals_are_read_in_order_and_removed_once_another_one_follows(tmp_path):
    for first_scan in (0, 3, 10, 12):
        journal_of(tmp_path, [Scan(first_scan, (0, 0, 0), [], [])], first_scan)
    assert [journal.scans[0][0] for journal in read_journals(tmp_path)] == [0, 3, 10, 12]
    remove_journals(tmp_path, before_scan=10)  # the third may hold scan 10
    assert [journal.scans[0][0] for journal in read_journals(tmp_path)] == [10, 12]
    remove_journals(tmp_path, before_scan=99)
    assert [journal.scans[0][0] for journal in read_journals(tmp_path)] == [12]
    remove_journals(tmp_path)
    assert read_journals(tmp_path) == []
    remove_journals(tmp_path / "none")
