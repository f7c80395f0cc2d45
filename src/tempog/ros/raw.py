"""What every kind of bag file gives: messages as bytes, by topic, and what could not be read."""

from __future__ import annotations

import bz2
import io
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from tempog._extras import need
from tempog.ros.messages import RosVersion

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


def type_name(text: str) -> str:
    """A type as ROS 2 writes it.

    >>> type_name("sensor_msgs/LaserScan"), type_name("sensor_msgs/msg/LaserScan")
    ('sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/LaserScan')
    """
    package, _, name = text.partition("/")
    return text if "/" in name or not name else f"{package}/msg/{name}"


def unpacked(how: str, packed: memoryview | bytes, size: int, whole: bool) -> bytes:
    """What was packed; of something cut off, as much as there is.

    Parameters
    ----------
    how : "", "none", "zstd", "lz4" or "bz2"
    size : int
        How many bytes there should be.
    whole : bool
        Raise if there are fewer.
    """
    if how in ("", "none"):
        return bytes(packed)
    if how == "bz2":
        stream: Any = bz2.BZ2File(io.BytesIO(packed))
    elif how == "zstd":
        stream = need("zstandard", "bags").ZstdDecompressor().stream_reader(packed)
    elif how == "lz4":
        data: bytes = need("lz4.frame", "bags").LZ4FrameDecompressor().decompress(packed, max_length=size)
        stream = io.BytesIO(data)
    else:
        raise ValueError(f"it is packed as {how[:20]!r}; known are zstd, lz4 and bz2")
    parts: list[bytes] = []
    n_left = size
    try:
        while n_left > 0 and (part := stream.read(min(n_left, 1 << 20))):
            parts.append(part)
            n_left -= len(part)
    except Exception:
        if whole:
            raise
    if whole and n_left:
        raise ValueError(f"{n_left} of {size} bytes are missing in it")
    return b"".join(parts)
