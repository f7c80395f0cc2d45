"""Messages of an MCAP file, in the order of the file: also of one that was cut off, or has no index.

Records follow each other, each with its length. Chunks hold messages, packed; behind each stands whose they are, so
that those of cameras need not be unpacked.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from tempog._extras import need
from tempog.ros.raw import MOST_UNPACKED_BYTES, RawMessage, Reading, Topic, Wanted, type_name, unpacked

MAGIC = b"\x89MCAP"
WHOLE_MAGIC = b"\x89MCAP0\r\n"
HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, DATA_END = 0x01, 0x03, 0x04, 0x05, 0x06, 0x07, 0x0F
LAST_OPCODE = 0x0F
RECORD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
ENCODINGS = {"cdr": "ros2", "ros1": "ros1"}
LANGUAGES = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl"}
MOST_NS = 2**63 - 1


def read_mcap(path: Path, wants: Wanted, reading: Reading) -> Iterator[RawMessage]:
    """The messages of wanted topics; what is damaged is told to `reading`."""
    need("mcap", "bags")
    with path.open("rb") as file:
        yield from _McapFile(file, wants, reading).messages()


class _McapFile:
    def __init__(self, file: IO[bytes], wants: Wanted, reading: Reading) -> None:
        self.file, self.wants, self.reading = file, wants, reading
        self.size = os.fstat(file.fileno()).st_size
        self.schemas: dict[int, Any] = {}
        self.topics: dict[int, tuple[Topic, bool]] = {}

    def messages(self) -> Iterator[RawMessage]:
        at = len(WHOLE_MAGIC)
        if self.file.read(at) != WHOLE_MAGIC:
            self.reading.lose("it does not begin as an MCAP file of version 0")
        while (head := self._head(at)) is not None:
            opcode, length = head
            begin, at = at + RECORD.size, at + RECORD.size + length
            if opcode == DATA_END:
                self.reading.moved_on(self.size)
                return
            if opcode == CHUNK:
                channels, at = self._indexed(at)
                yield from self._chunk(begin, length, channels)
            elif opcode in (SCHEMA, CHANNEL, MESSAGE):
                self.file.seek(begin)
                data = self.file.read(length)
                if len(data) < length and opcode == MESSAGE:
                    break
                yield from self._records(memoryview(RECORD.pack(opcode, length) + data), begin - RECORD.size, {})
            self.reading.moved_on(min(at, self.size))
        if not self.reading.losses:
            self.reading.unfinished = "it has no end, as after a crash of its recorder"
        self.reading.moved_on(self.size)

    def _head(self, at: int) -> tuple[int, int] | None:
        """Kind and length of the record at a place; None, perhaps with a loss, where there is none."""
        if at >= self.size:
            return None
        self.file.seek(at)
        head = self.file.read(RECORD.size)
        if len(head) < RECORD.size:
            self.reading.lose(f"it ends in the middle of a record, at byte {at}", len(head))
            return None
        opcode, length = RECORD.unpack(head)
        if not HEADER <= opcode <= LAST_OPCODE and not opcode >= 0x80:
            self.reading.lose(f"there is no record at byte {at}", self.size - at)
            return None
        left = self.size - at - RECORD.size
        if length > left:
            what = f"it ends in the middle of the record at byte {at}, of which {length - left} bytes are missing"
            self.reading.lose(what, 0 if opcode == CHUNK else left)
            if opcode != CHUNK:  # of which the beginning may be of use
                return None
        return opcode, length

    def _indexed(self, at: int) -> tuple[dict[int, int], int]:
        """How many messages each channel has in the chunk before `at`, by the indexes there; and where those end."""
        channels: dict[int, int] = {}
        while at + RECORD.size + 6 <= self.size:
            self.file.seek(at)
            opcode, length = RECORD.unpack(self.file.read(RECORD.size))
            if opcode != MESSAGE_INDEX or not 6 <= length <= self.size - at - RECORD.size:
                break
            channel, n_bytes = struct.unpack("<HI", self.file.read(6))
            channels[channel] = n_bytes // 16
            at += RECORD.size + length
        return channels, at

    def _chunk(self, begin: int, length: int, channels: dict[int, int]) -> Iterator[RawMessage]:
        if channels and all(channel in self.topics and not self.topics[channel][1] for channel in channels):
            for channel, count in channels.items():
                self.reading.n_messages[self.topics[channel][0]] += count
            return
        self.file.seek(begin)
        record = self.file.read(length) if length <= self.size - begin else self.file.read()
        try:
            size, crc, n_name = struct.unpack_from("<QII", record, 16)
            name = bytes(record[32 : 32 + n_name]).decode()
            (n_data,) = struct.unpack_from("<Q", record, 32 + n_name)
            packed = memoryview(record)[40 + n_name :]
            if size > MOST_UNPACKED_BYTES:
                raise ValueError(f"it should hold {size} bytes")
            whole = len(packed) >= n_data
            data = unpacked(name, packed[:n_data], size, whole)
            if whole and crc and zlib.crc32(data) != crc:
                raise ValueError("its checksum is wrong")
        except Exception as error:  # of packers that are given any bytes
            if length <= self.size - begin:  # else it was told of already
                self.reading.lose(f"the chunk at byte {begin} cannot be read: {error}", length)
            return
        yield from self._records(memoryview(data), begin, channels)

    def _records(self, data: memoryview, where: int, channels: dict[int, int]) -> Iterator[RawMessage]:
        """Messages of records that stand one behind the other; schemas and channels are kept."""
        at, end = 0, len(data)
        topics, reading = self.topics, self.reading
        while at + RECORD.size <= end:
            opcode, length = RECORD.unpack_from(data, at)
            at += RECORD.size
            stop = at + length
            if stop > end:
                break
            if opcode == MESSAGE and length >= MESSAGE_HEAD.size:
                channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(data, at)
                known = topics.get(channel)
                if known is None:
                    reading.lose(f"a message near byte {where} is of no known channel", length)
                else:
                    topic, wanted = known
                    reading.n_messages[topic] += 1
                    if log_ns <= MOST_NS:
                        reading.last_ns = max(log_ns, reading.last_ns or log_ns)
                        if wanted:
                            yield RawMessage(topic, log_ns, bytes(data[at + MESSAGE_HEAD.size : stop]))
                    elif wanted:
                        reading.lose(f"a message near byte {where} has no usable time", length)
            elif opcode in (SCHEMA, CHANNEL):
                try:
                    self._learn(opcode, bytes(data[at:stop]))
                except Exception as error:
                    reading.lose(f"a record near byte {where} cannot be read: {error}", length)
            at = stop

    def _learn(self, opcode: int, data: bytes) -> None:
        records = need("mcap.records", "bags")
        stream = need("mcap.data_stream", "bags").ReadDataStream(io.BytesIO(data))
        if opcode == SCHEMA:
            schema = records.Schema.read(stream)
            self.schemas[schema.id] = schema
            return
        channel = records.Channel.read(stream)
        schema = self.schemas.get(channel.schema_id)
        topic = Topic(
            channel.topic,
            type_name(schema.name) if schema else "",
            ENCODINGS.get(channel.message_encoding, channel.message_encoding),
            schema.data.decode("utf-8", "replace") if schema else "",
            LANGUAGES.get(schema.encoding, "") if schema else "",
        )
        self.topics[channel.id] = topic, self.wants(topic)
        self.reading.announce(topic)
