"""The journal of a live map: every scan is written here first, and read again after a crash.

A file is a row of records: length and CRC-32 of what follows, 4 bytes each, then the payload. The first payload is
JSON and says which session goes on at which scan; the others are one scan each. A record that was cut off, or whose
CRC does not fit, ends the file: what follows was never acknowledged, or the disk lost it.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ScanError
from tempog.scans.scan import Scan
from tempog.store.tables import sync

SUFFIX = ".journal"
FRAME = struct.Struct("<II")  # length of the payload, CRC-32
SCAN = struct.Struct("<qqddddI?")  # number, stamp (ns), x, y (m), theta (rad), max_range (m), beams, angles follow
HEADER = {"map": str, "id": str, "robot": str, "strand": int, "first_scan": int, "config": dict, "sources": list}
LARGEST_PAYLOAD = 2**28  # bytes; a length beyond is damage


class JournalWriter:
    """Appends scans to a new file; what `append` was given is with the operating system when it returns.

    Parameters
    ----------
    folder : path
    first_scan : int
        Number of the scan that comes next.
    header : dict
        What is kept of the map and the session, as `HEADER` has it.
    """

    def __init__(self, folder: Path, first_scan: int, header: dict[str, Any]) -> None:
        folder.mkdir(exist_ok=True)
        self.path = folder / f"{first_scan:010d}{SUFFIX}"
        self.first_scan = first_scan
        self._file = os.open(self.path, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_APPEND, 0o666)
        self._end = 0
        self._is_listed = False  # whether its folder was put on the disk since it is there
        self._torn = False  # whether the file may be longer than that
        self._angles: NDArray[np.float64] | None = None
        self._before: tuple[int, NDArray[np.float64] | None] = 0, None
        try:
            self._put(json.dumps(header).encode())
        except BaseException:
            self.close()
            with suppress(OSError):
                self.path.unlink()
            raise

    def append(self, number: int, scan: Scan) -> None:
        """Write one scan; OSError if that fails, and then nothing of it is left."""
        self._before = self._end, self._angles
        repeated = self._angles is not None and (
            self._angles is scan.angles or np.array_equal(self._angles, scan.angles)
        )
        head = (number, scan.stamp_ns, scan.x, scan.y, scan.theta, scan.max_range, len(scan.ranges), not repeated)
        angles = b"" if repeated else scan.angles.tobytes()
        self._put(SCAN.pack(*head) + angles + scan.ranges.tobytes())
        self._angles = scan.angles

    def take_back(self) -> None:
        """Remove the scan that was appended last, which was refused."""
        self._end, self._angles = self._before
        self._torn = True
        with suppress(OSError):  # then it is done before the next scan is written
            self._mend()

    def sync(self) -> None:
        """Have the operating system put it on the disk."""
        os.fsync(self._file)
        if not self._is_listed:
            sync(self.path.parent)
            self._is_listed = True

    def close(self) -> None:
        """Let go of the file, and leave it."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _put(self, payload: bytes) -> None:
        record = FRAME.pack(len(payload), zlib.crc32(payload)) + payload
        self._mend()
        self._torn = True
        try:
            done = 0
            while done < len(record):
                done += os.write(self._file, record[done:])
        except BaseException:
            with suppress(OSError):
                self._mend()
            raise
        self._end += len(record)
        self._torn = False

    def _mend(self) -> None:
        """Cut off what lies beyond the last whole record: nothing behind it would be read."""
        if self._torn:
            os.ftruncate(self._file, self._end)
            self._torn = False


@dataclass(frozen=True)
class Journal:
    """A journal that was read.

    Attributes
    ----------
    path : Path
    header : dict
    scans : list of (int, Scan)
        With the numbers they were given.
    n_lost_bytes : int
        At the end of the file, that hold no whole record.
    """

    path: Path
    header: dict[str, Any]
    scans: list[tuple[int, Scan]]
    n_lost_bytes: int


def read_journals(folder: Path) -> list[Journal]:
    """Every journal of a map, in the order of their scans."""
    return [read_journal(path) for path in sorted(folder.glob(f"*{SUFFIX}"))]


def has_journals(folder: Path) -> bool:
    """Whether a map has any."""
    return any(folder.glob(f"*{SUFFIX}"))


def remove_journals(folder: Path, before_scan: int | None = None) -> None:
    """Remove those journals that hold no scan from a number on, as another one follows; or all, and their folder."""
    files = sorted(folder.glob(f"*{SUFFIX}"))
    covered = [a for a, b in pairwise(files) if before_scan is not None and int(b.stem) <= before_scan]
    for file in files if before_scan is None else covered:
        file.unlink(missing_ok=True)
    if before_scan is None:
        with suppress(OSError):  # there may be other files
            folder.rmdir()


def read_journal(path: Path) -> Journal:
    """What one file holds, up to the first record that is not whole; `header` is empty if not even that is."""
    data = path.read_bytes()
    at, header, scans = 0, {}, []
    angles: NDArray[np.float64] | None = None
    while at + FRAME.size <= len(data):
        length, crc = FRAME.unpack_from(data, at)
        payload = data[at + FRAME.size : at + FRAME.size + length]
        if length > LARGEST_PAYLOAD or len(payload) < length or zlib.crc32(payload) != crc:
            break
        try:
            if at == 0:
                header = _to_header(payload)
            else:
                number, scan = _to_scan(payload, angles)
                scans.append((number, scan))
                angles = scan.angles
        except (struct.error, ScanError, ValueError):  # such as zeros, which a power cut may leave: their CRC is 0
            break
        at += FRAME.size + length
    return Journal(path, header, scans, len(data) - at)


def _to_header(payload: bytes) -> dict[str, Any]:
    header = json.loads(payload)
    if not isinstance(header, dict) or not all(isinstance(header.get(key), of) for key, of in HEADER.items()):
        raise ValueError("the first record of a journal names no session")
    return {key: header[key] for key in HEADER}


def _to_scan(payload: bytes, angles: NDArray[np.float64] | None) -> tuple[int, Scan]:
    number, stamp_ns, x, y, theta, max_range, n_beams, with_angles = SCAN.unpack_from(payload)
    at = SCAN.size
    if with_angles:
        angles = np.frombuffer(payload, np.float64, n_beams, at)
        at += 8 * n_beams
    ranges = np.frombuffer(payload, np.float32, n_beams, at)
    if angles is None:
        raise ValueError("the first scan of a journal has no angles")
    return number, Scan(0.0, (x, y, theta), angles, ranges, max_range, stamp_ns=stamp_ns)
