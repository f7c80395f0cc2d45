"""Messages of a ROS 1 bag of version 2.0, in the order of the file: also of one that was cut off, or has no index."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from tempog.ros.raw import MOST_UNPACKED_BYTES, RawMessage, Reading, Topic, Wanted, type_name, unpacked
from tempog.times import NS_PER_S

MAGIC = b"#ROSBAG V"
VERSION_2 = b"#ROSBAG V2.0\n"
MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
MOST_HEADER_BYTES = 1 << 24  # a connection's header holds its definition, in places


def read_ros1(path: Path, wants: Wanted, reading: Reading) -> Iterator[RawMessage]:
    """The messages of wanted topics; what is damaged is told to `reading`."""
    with path.open("rb") as file:
        yield from _Ros1File(file, wants, reading).messages()


class _Ros1File:
    def __init__(self, file: IO[bytes], wants: Wanted, reading: Reading) -> None:
        self.file, self.wants, self.reading = file, wants, reading
        self.size = os.fstat(file.fileno()).st_size
        self.topics: dict[int, tuple[Topic, bool]] = {}

    def messages(self) -> Iterator[RawMessage]:
        if self.file.read(len(VERSION_2)) != VERSION_2:
            self.reading.lose("it is not of version 2.0 (rosbag fix makes it so)", self.size)
            return
        at, indexed = len(VERSION_2), False
        while (record := self._record(at)) is not None:
            header, begin, length = record
            start, at = at, begin + length
            try:
                kind = header[b"op"][0]
                if kind == BAG_HEADER:
                    indexed = struct.unpack("<Q", header[b"index_pos"])[0] > 0
                elif kind == CHUNK:
                    channels, at = self._indexed(at)
                    yield from self._chunk(start, begin, length, header, channels)
                elif kind in (CONNECTION, MESSAGE):
                    self.file.seek(begin)
                    data = self.file.read(length)
                    if len(data) == length or kind == CONNECTION:
                        yield from self._single(kind, header, data)
            except (KeyError, IndexError, struct.error, ValueError) as error:
                self.reading.lose(f"the record at byte {start} cannot be read: {error}", length)
            self.reading.moved_on(min(at, self.size))
        if not indexed:
            self.reading.unfinished = "it has no index, as after a crash of its recorder (rosbag reindex makes one)"
        self.reading.moved_on(self.size)

    def _record(self, at: int) -> tuple[dict[bytes, bytes], int, int] | None:
        """Header of the record at a place, and where its data begin and how many they are; None at the end."""
        if at >= self.size:
            return None
        self.file.seek(at)
        try:
            (n_header,) = struct.unpack("<I", self.file.read(4))
            if n_header > min(MOST_HEADER_BYTES, self.size - at):
                raise ValueError(f"a header of {n_header} bytes")
            header = fields_of(self.file.read(n_header))
            (length,) = struct.unpack("<I", self.file.read(4))
            if b"op" not in header:
                raise ValueError("it does not say what it is")
        except (struct.error, ValueError) as error:
            self.reading.lose(f"the record at byte {at} cannot be read: {error}", self.size - at)
            return None
        begin = at + 8 + n_header
        if begin + length > self.size:
            left = self.size - begin
            what = f"it ends in the middle of the record at byte {at}, of which {length - left} bytes are missing"
            self.reading.lose(what, 0 if header[b"op"] == bytes([CHUNK]) else left)
        return header, begin, length

    def _indexed(self, at: int) -> tuple[dict[int, int], int]:
        """How many messages each connection has in the chunk before `at`; and where the indexes there end."""
        connections: dict[int, int] = {}
        while at + 8 <= self.size:
            self.file.seek(at)
            try:
                (n_header,) = struct.unpack("<I", self.file.read(4))
                if n_header > 200:
                    break
                header = fields_of(self.file.read(n_header))
                (length,) = struct.unpack("<I", self.file.read(4))
                if header[b"op"][0] != INDEX or at + 8 + n_header + length > self.size:
                    break
                (connection,) = struct.unpack("<I", header[b"conn"])
                (connections[connection],) = struct.unpack("<I", header[b"count"])
            except (struct.error, ValueError, KeyError, IndexError):
                break
            at += 8 + n_header + length
        return connections, at

    def _chunk(
        self, start: int, begin: int, length: int, header: dict[bytes, bytes], connections: dict[int, int]
    ) -> Iterator[RawMessage]:
        if connections and all(one in self.topics and not self.topics[one][1] for one in connections):
            for one, count in connections.items():
                self.reading.n_messages[self.topics[one][0]] += min(count, length)
            return
        self.file.seek(begin)
        packed = self.file.read(min(length, self.size - begin))
        whole = len(packed) == length
        try:
            (size,) = struct.unpack("<I", header[b"size"])
            if size > MOST_UNPACKED_BYTES:
                raise ValueError(f"it should hold {size} bytes")
            data = unpacked(header[b"compression"].decode(), packed, size, whole)
        except Exception as error:  # of packers that are given any bytes
            if whole:
                self.reading.lose(f"the chunk at byte {start} cannot be read: {error}", length)
            return
        yield from self._records(data, start)

    def _records(self, data: bytes, where: int) -> Iterator[RawMessage]:
        at, end = 0, len(data)
        while at + 8 <= end:
            (n_header,) = struct.unpack_from("<I", data, at)
            begin = at + 8 + n_header
            if begin > end:
                break
            (length,) = struct.unpack_from("<I", data, begin - 4)
            if begin + length > end:
                break
            try:
                header = fields_of(data[at + 4 : begin - 4])
                yield from self._single(header[b"op"][0], header, data[begin : begin + length])
            except (KeyError, IndexError, struct.error, ValueError) as error:
                self.reading.lose(f"a record near byte {where} cannot be read: {error}", length)
            at = begin + length

    def _single(self, kind: int, header: dict[bytes, bytes], data: bytes) -> Iterator[RawMessage]:
        """A message; or a connection, which is kept."""
        if kind == CONNECTION:
            (number,) = struct.unpack("<I", header[b"conn"])
            said = fields_of(data)
            topic = Topic(
                header[b"topic"].decode("utf-8", "replace"),
                type_name(said[b"type"].decode("utf-8", "replace")),
                "ros1",
                said.get(b"message_definition", b"").decode("utf-8", "replace"),
                "msg",
            )
            self.topics[number] = topic, self.wants(topic)
            self.reading.announce(topic)
        elif kind == MESSAGE:
            (number,) = struct.unpack("<I", header[b"conn"])
            sec, nanosec = struct.unpack("<II", header[b"time"])
            if number not in self.topics:
                raise ValueError(f"a message of connection {number}, which nobody announced")
            topic, wanted = self.topics[number]
            self.reading.n_messages[topic] += 1
            log_ns = sec * NS_PER_S + nanosec
            self.reading.last_ns = max(log_ns, self.reading.last_ns or log_ns)
            if wanted:
                yield RawMessage(topic, log_ns, data)


def fields_of(header: bytes) -> dict[bytes, bytes]:
    """Names and values of a record's header; ValueError if it is none.

    >>> fields_of(b"\\x04\\x00\\x00\\x00op=\\x02")
    {b'op': b'\\x02'}
    """
    fields = {}
    at = 0
    while at < len(header):
        if at + 4 > len(header):
            raise ValueError("its header ends early")
        size = int.from_bytes(header[at : at + 4], "little")
        at += 4 + size
        name, found, value = header[at - size : at].partition(b"=")
        if not found or at > len(header):
            raise ValueError("its header is damaged")
        fields[name] = value
    return fields
