"""What every kind of bag file gives: messages as bytes, by topic, and what could not be read."""

from __future__ import annotations

import bz2
import io
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from tempog._extras import need
from tempog.ros.messages import RosVersion

BLOCK_BYTES = 1 << 16
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no message of ROS 2 begins so: CDR has a zero there
ENCODINGS = {"cdr": "ros2"}  # ros1 is called so everywhere
LANGUAGES = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl"}
MESSAGES_PER_NEWS = 64
MOST_UNPACKED_BYTES = 2**31  # of one chunk or message; recorders make chunks of a few MB


class Topic(NamedTuple):
    """One stream of messages, as a bag announces it.

    Attributes
    ----------
    name, msgtype : str
        The type as ROS 2 writes it: sensor_msgs/msg/LaserScan.
    encoding : "ros1", "ros2", or what else the file says
    definition : str
        Of the type and all that it is made of; may be empty.
    language : "msg", "idl" or ""
        What the definition is written in.
    """

    name: str
    msgtype: str
    encoding: str
    definition: str = ""
    language: str = ""

    @property
    def version(self) -> RosVersion | None:
        """Which ROS packs its messages so; None for neither."""
        return "ros1" if self.encoding == "ros1" else "ros2" if self.encoding == "ros2" else None


class RawMessage(NamedTuple):
    """One message: its topic, when it was recorded, and its bytes."""

    topic: Topic
    log_ns: int
    raw: bytes | memoryview


Wanted = Callable[[Topic], bool]


@dataclass
class Reading:
    """How far a file was read, what it holds, and what of it was lost.

    Attributes
    ----------
    n_messages : Counter of Topic
        Also of topics that were not wanted, as far as the file says without unpacking them.
    losses : list of str
        What could not be read, and where.
    lost_bytes : int
        Of the file.
    unfinished : str
        Why it seems that its recorder did not end properly; empty if it did. That alone loses nothing.
    last_ns : int, nanoseconds, optional
        When the last readable message was recorded.
    moved_on : callable
        Called with the bytes that were dealt with so far, for a progress bar.
    """

    n_messages: Counter[Topic] = field(default_factory=Counter)
    losses: list[str] = field(default_factory=list)
    lost_bytes: int = 0
    unfinished: str = ""
    last_ns: int | None = None
    moved_on: Callable[[int], None] = lambda _: None

    def lose(self, what: str, n_bytes: int = 0) -> None:
        """Something cannot be read."""
        self.losses.append(what)
        self.lost_bytes += n_bytes

    def announce(self, topic: Topic) -> None:
        """A topic is there, perhaps without messages."""
        self.n_messages[topic] += 0

    def take(self, topic: Topic, wanted: bool, log_ns: int, raw: bytes) -> Iterator[RawMessage]:
        """Count a message; it, unpacked, if it is wanted."""
        self.n_messages[topic] += 1
        self.last_ns = max(log_ns, self.last_ns or log_ns)
        if not wanted:
            return
        if topic.encoding == "ros2" and raw[:4] == ZSTD_MAGIC:
            try:
                raw = unpacked(raw)
            except Exception as error:  # of a packer that is given any bytes
                number = self.n_messages[topic]
                self.lose(f"{topic.name} message {number} cannot be unpacked: {error}", len(raw))
                return
        yield RawMessage(topic, log_ns, raw)


def type_name(text: str) -> str:
    """A type as ROS 2 writes it.

    >>> type_name("sensor_msgs/LaserScan"), type_name("sensor_msgs/msg/LaserScan")
    ('sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/LaserScan')
    """
    package, _, name = text.partition("/")
    return text if "/" in name or not name else f"{package}/msg/{name}"


def unpacked(packed: bytes) -> bytes:
    """What was packed by Zstandard, as recorders of ROS 2 can do with single messages; raises if it is damaged."""
    stream = need("zstandard", "bags").ZstdDecompressor().stream_reader(packed)
    parts: list[bytes] = []
    while part := stream.read(BLOCK_BYTES):
        parts.append(part)
        if len(parts) * BLOCK_BYTES > MOST_UNPACKED_BYTES:
            raise ValueError(f"it holds more than {MOST_UNPACKED_BYTES} bytes")
    return b"".join(parts)


def unpacked_as_far(how: str, packed: bytes) -> bytes:
    """What was packed as "zstd", "lz4", "bz2", or not at all, as far as it goes before it is cut off or damaged."""
    if how == "bz2":
        stream: Any = bz2.BZ2File(io.BytesIO(packed))
    elif how == "zstd":
        stream = need("zstandard", "bags").ZstdDecompressor().stream_reader(packed)
    elif how == "lz4":
        stream = need("lz4.frame", "bags").LZ4FrameFile(io.BytesIO(packed))
    else:
        return packed
    parts: list[bytes] = []
    with suppress(Exception):  # the damage, in the words of any of these
        while len(parts) < MOST_UNPACKED_BYTES // BLOCK_BYTES and (part := stream.read1(BLOCK_BYTES)):
            parts.append(part)
    return b"".join(parts)
