"""Messages of a bag file: MCAP through mcap, ROS 1 through rosbags; of damaged ones, what is intact.

Libraries are given any bytes here, and raise anything: all of that is damage.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Generator, Iterable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, BinaryIO

from tempog._extras import need
from tempog.ros.raw import (
    ENCODINGS,
    LANGUAGES,
    MESSAGES_PER_NEWS,
    MOST_UNPACKED_BYTES,
    RawMessage,
    Reading,
    Topic,
    Wanted,
    type_name,
    unpacked_as_far,
)

NO_INDEX = "it has no index, as after a crash of its recorder (rosbag reindex makes one)"
MOST_NS = 2**63 - 1
RECORD_HEAD_BYTES = 9  # of MCAP: kind and length

Messages = Generator[RawMessage, None, None]


def read_ros1(path: Path, wants: Wanted, reading: Reading) -> Messages:
    """A ROS 1 bag by its index; without one, record by record."""
    size = path.stat().st_size
    reader = need("rosbags.rosbag1", "bags").Reader(path)
    try:
        reader.open()
    except Exception as error:
        if "not supported" in str(error):
            reading.lose(_said(error), size)
            return
        with path.open("rb") as file:
            yield from _unindexed(file, size, wants, reading)
        if not reading.losses:
            reading.unfinished = NO_INDEX
        return
    try:
        with closing(reader):
            topics = {one.id: _topic_of(one) for one in reader.connections}
            wanted = [one for one in reader.connections if wants(topics[one.id])]
            for one in reader.connections:
                reading.n_messages[topics[one.id]] += 0 if one in wanted else one.msgcount
            n_all = max(1, sum(one.msgcount for one in wanted))
            for k, (one, log_ns, raw) in enumerate(reader.messages(wanted) if wanted else ()):  # none would mean all
                if k % MESSAGES_PER_NEWS == 0:
                    reading.moved_on(min(size, size * k // n_all))
                yield from reading.take(topics[one.id], True, log_ns, raw)
    except Exception as error:
        reading.lose(f"after {sum(reading.n_messages.values())} messages: {_said(error)}")
        yield from _later(path, size, wants, reading)


def _later(path: Path, size: int, wants: Wanted, reading: Reading) -> Messages:
    """What a ROS 1 bag with a damaged part holds after the last message that its index led to, record by record."""
    last_ns = reading.last_ns
    with path.open("rb") as file:
        for one in _unindexed(file, size, wants, Reading()):
            if last_ns is None or one.log_ns > last_ns:
                yield from reading.take(one.topic, True, one.log_ns, bytes(one.raw))


def _unindexed(file: BinaryIO, size: int, wants: Wanted, reading: Reading) -> Messages:
    """A ROS 1 bag record by record."""
    parts = need("rosbags.rosbag1.reader", "bags")
    kinds, topics = parts.RecordType, dict[int, tuple[Topic, bool]]()

    def records(stream: BinaryIO, end: int) -> Generator[tuple[Any, bytes], None, None]:
        while (at := stream.tell()) < end:
            try:
                header = parts.Header.read(stream)
                length = parts.read_uint32(stream)
            except Exception as error:
                reading.lose(f"it ends in the middle of the record at byte {at}: {_said(error)}", end - at)
                return
            left = end - stream.tell()
            if length > left:
                reading.lose(f"it ends in the middle of the record at byte {at}", left)
            if length <= left or header.get("op") == bytes([kinds.CHUNK]):
                yield header, stream.read(min(length, left))

    def take(found: Iterable[tuple[Any, bytes]]) -> Messages:
        for header, data in found:
            reading.moved_on(min(size, file.tell()))
            try:
                kind = header.get_uint8("op")
                if kind == kinds.CHUNK:
                    content = unpacked_as_far(header.get_string("compression"), data)
                    yield from take(records(io.BytesIO(content), len(content)))
                elif kind == kinds.CONNECTION:
                    said = parts.Header.read(io.BytesIO(len(data).to_bytes(4, "little") + data))
                    text, name = said.get_string("message_definition"), type_name(said.get_string("type"))
                    topic = Topic(header.get_string("topic"), name, "ros1", text, "msg")
                    topics[header.get_uint32("conn")] = topic, wants(topic)
                    reading.announce(topic)
                elif kind == kinds.MSGDATA:
                    topic, wanted = topics[header.get_uint32("conn")]
                    yield from reading.take(topic, wanted, header.get_time("time"), data)
            except Exception as error:
                reading.lose(f"the record before byte {file.tell()} cannot be read: {_said(error)}", len(data))

    file.readline()  # the version
    yield from take(records(file, size))


def read_mcap(path: Path, wants: Wanted, reading: Reading) -> Messages:
    """An MCAP file, record by record and chunk by chunk: one that was cut off is read until there."""
    stream_reader, records = need("mcap.stream_reader", "bags"), need("mcap.records", "bags")
    size, schemas, topics = path.stat().st_size, dict[int, Any](), dict[int, tuple[Topic, bool]]()
    counted: set[int] = set()  # channels of which nothing is wanted, and it is known how much there is

    def take(found: Iterable[Any]) -> Messages:
        for record in found:
            if isinstance(record, records.Schema):
                schemas[record.id] = record
            elif isinstance(record, records.Channel):
                topic = _topic_of_channel(record, schemas.get(record.schema_id))
                topics[record.id] = topic, wants(topic)
                reading.announce(topic)
            elif isinstance(record, records.Message):
                if record.channel_id in counted:
                    continue
                if record.channel_id not in topics or record.log_time > MOST_NS:
                    reading.lose("a message is of no known channel, or of no usable time", len(record.data))
                else:
                    yield from reading.take(*topics[record.channel_id], record.log_time, record.data)

    with path.open("rb") as file:
        skipped = _learn_from_summary(file, take, topics, counted, reading)
        stream = iter(
            stream_reader.StreamReader(file, emit_chunks=True, record_size_limit=MOST_UNPACKED_BYTES).records
        )
        while True:
            while (at := file.tell()) in skipped:
                file.seek(skipped[at], io.SEEK_CUR)
            reading.moved_on(at)
            try:
                record = next(stream)
            except Exception as error:
                if at == size:
                    reading.unfinished = "it has no end, as after a crash of its recorder"
                    return
                found = list(_of_cut_chunk(file, at))
                why = "" if isinstance(error, need("mcap.exceptions", "bags").EndOfFile) else f": {_said(error)}"
                reading.lose(f"it ends in the middle of the record at byte {at}{why}", 0 if found else size - at)
                yield from take(found)
                return
            if isinstance(record, records.DataEnd):  # behind it is only what was there before
                return
            found = [record]
            if isinstance(record, records.Chunk):
                try:
                    if record.uncompressed_size > MOST_UNPACKED_BYTES:
                        raise ValueError(f"it should hold {record.uncompressed_size} bytes")
                    found = stream_reader.breakup_chunk(record, validate_crc=True)
                except Exception as error:
                    reading.lose(f"the chunk at byte {at} cannot be read: {_said(error)}", file.tell() - at)
                    continue
            yield from take(found)


def _learn_from_summary(
    file: BinaryIO,
    take: Callable[[Iterable[Any]], Messages],
    topics: dict[int, tuple[Topic, bool]],
    counted: set[int],
    reading: Reading,
) -> dict[int, int]:
    """Places and lengths of chunks of which nothing is wanted; and the topics, also those of damaged chunks.

    At the end of a whole file all this is told once more.
    """
    skipped: dict[int, int] = {}
    with suppress(Exception):  # of a file without an end, or with a damaged one
        summary = need("mcap.reader", "bags").SeekingReader(file).get_summary()
        list(take([*summary.schemas.values(), *summary.channels.values()]))
        for channel, count in summary.statistics.channel_message_counts.items():
            topic, wanted = topics[channel]
            if not wanted:
                counted.add(channel)
                reading.n_messages[topic] += count
        for chunk in summary.chunk_indexes:
            if (
                chunk.chunk_length > 0
                and chunk.message_index_offsets
                and counted.issuperset(chunk.message_index_offsets)
            ):
                skipped[chunk.chunk_start_offset] = chunk.chunk_length
    file.seek(0)
    return skipped


def _of_cut_chunk(file: BinaryIO, at: int) -> Generator[Any, None, None]:
    """Records at the beginning of the last one in an MCAP file, if that is a chunk, which was cut off."""
    stream_reader, records = need("mcap.stream_reader", "bags"), need("mcap.records", "bags")
    file.seek(at)
    with suppress(Exception):  # of whatever is no chunk, and where it ends
        if file.read(RECORD_HEAD_BYTES)[0] == need("mcap.opcode", "bags").Opcode.CHUNK:
            chunk = records.Chunk.read(need("mcap.data_stream", "bags").ReadDataStream(file))
            content = io.BytesIO(unpacked_as_far(chunk.compression, chunk.data))
            yield from stream_reader.StreamReader(content, skip_magic=True).records


def _topic_of(connection: Any) -> Topic:
    language = connection.msgdef.format.name.lower()
    known = language if language in ("msg", "idl") else ""
    encoding = getattr(connection.ext, "serialization_format", "ros1")
    definition = connection.msgdef.data if known else ""
    name = type_name(connection.msgtype)
    return Topic(connection.topic, name, ENCODINGS.get(encoding, encoding), definition, known)


def _topic_of_channel(channel: Any, schema: Any) -> Topic:
    language = LANGUAGES.get(schema.encoding, "") if schema else ""
    definition = schema.data.decode("utf-8", "replace") if language else ""
    encoding = ENCODINGS.get(channel.message_encoding, channel.message_encoding)
    return Topic(channel.topic, type_name(schema.name) if schema else "", encoding, definition, language)


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__
