"""Two ways to keep scans safe until their intervals are written: MCAP, and framed records of our own.

A scan is a stamp, a pose and ranges; the angles of its beams stay the same and are not written again.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

from tempog import Scan

POSE = struct.Struct("<qddd")  # stamp_ns, x, y, theta
FRAME = struct.Struct("<II")  # bytes of the payload, CRC-32 of the payload
LONGEST_PAYLOAD = 2**24


class Journal(Protocol):
    """A file that scans are appended to."""

    def append(self, payload: bytes, stamp_ns: int) -> None:
        """Hand a scan to the operating system."""

    def sync(self) -> None:
        """Wait for the disk."""

    def close(self) -> None:
        """Let go of the file, as a process does that dies: nothing is added at the end."""


Opener = Callable[[Path], Journal]


def to_payload(scan: Scan) -> bytes:
    """A scan as bytes: 32, and 4 for each beam."""
    return POSE.pack(scan.stamp_ns, scan.x, scan.y, scan.theta) + scan.ranges.tobytes()


class Frames:
    """Each scan is its length, its CRC and its bytes, in one write."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)

    def append(self, payload: bytes, stamp_ns: int) -> None:
        """One write."""
        del stamp_ns  # it is in the payload
        os.write(self._descriptor, FRAME.pack(len(payload), zlib.crc32(payload)) + payload)

    def sync(self) -> None:
        """Data only: the file's size goes with it."""
        os.fdatasync(self._descriptor)

    def close(self) -> None:
        """No trailer."""
        os.close(self._descriptor)


def read_frames(data: bytes) -> Iterator[bytes]:
    """Every whole payload up to the first that is not, if any.

    Zeros look like an empty payload with the right CRC, and files end in zeros after some power cuts: too short is
    not whole either.
    """
    at = 0
    while at + FRAME.size <= len(data):
        length, crc = FRAME.unpack_from(data, at)
        payload = data[at + FRAME.size : at + FRAME.size + length]
        if not POSE.size < length <= LONGEST_PAYLOAD or len(payload) < length or zlib.crc32(payload) != crc:
            return
        yield payload
        at += FRAME.size + length


class Mcap:
    """A message for each scan.

    Parameters
    ----------
    path : Path
    chunked : bool
        A chunk, with a CRC of its own, for each message; otherwise none, and no CRC before the end of the file.
    """

    def __init__(self, path: Path, *, chunked: bool) -> None:
        from mcap.writer import CompressionType, IndexType, Writer

        self._file = path.open("wb")
        self._writer = Writer(
            self._file,
            chunk_size=1,  # a chunk ends when it is longer than this
            compression=CompressionType.NONE,
            index_types=IndexType.NONE,
            use_chunking=chunked,
        )
        self._writer.start()
        schema = self._writer.register_schema("scan", "", b"")
        self._channel = self._writer.register_channel("scans", "raw", schema)

    def append(self, payload: bytes, stamp_ns: int) -> None:
        """One message, flushed."""
        self._writer.add_message(self._channel, stamp_ns, payload, stamp_ns)
        self._file.flush()

    def sync(self) -> None:
        """Data only: the file's size goes with it."""
        os.fdatasync(self._file.fileno())

    def close(self) -> None:
        """Neither the end of the data nor the footer is written."""
        self._file.close()


def read_mcap(data: bytes) -> Iterator[bytes]:
    """What mcap's reader for streams gives before it raises or ends; CRCs are checked."""
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    try:
        for record in StreamReader(io.BytesIO(data), validate_crcs=True, record_size_limit=LONGEST_PAYLOAD).records:
            if isinstance(record, Message):
                yield record.data
    except Exception:  # mcap raises struct.error, EndOfFile, ValueError ... on damaged files
        return


def read_mcap_seeking(data: bytes) -> Iterator[bytes]:
    """What mcap's ordinary reader gives before it raises or ends."""
    from mcap.reader import make_reader

    try:
        reader: Any = make_reader(io.BytesIO(data), validate_crcs=True)
        for _, _, message in reader.iter_messages(log_time_order=False):
            yield message.data
    except Exception:
        return
