"""Messages -> bag files: MCAP through mcap, ROS 1 bags and ROS 2 folders through rosbags."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

from tempog._extras import need
from tempog._files import whole_file
from tempog._version import __version__
from tempog.errors import ConfigError, ScanError
from tempog.ros.messages import Codec, RosVersion

Compression = Literal["none", "lz4", "zstd", "bz2"]
COMPRESSIONS: dict[str, tuple[Compression, ...]] = {
    ".mcap": ("none", "lz4", "zstd"),
    ".bag": ("none", "lz4", "bz2"),
    ".db3": ("none",),
    "": ("none", "zstd"),
}
ROS2_BAG_VERSION = 9  # of metadata.yaml
STORED = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 0, nsec: 0}}
  lifespan: {{sec: 0, nsec: 0}}
  liveliness: system_default
  liveliness_lease_duration: {{sec: 0, nsec: 0}}
  avoid_ros_namespace_conventions: false"""


class OutMessage(NamedTuple):
    """One message, when it was sent and where; `latched` ones are for who comes late as well."""

    topic: str
    stamp_ns: int
    message: Any
    latched: bool = False


class BagWriter(Protocol):
    """A bag that is being written."""

    codec: Codec

    def write(self, message: OutMessage) -> None:
        """Add one message; its topic is made with the first."""
        ...


@contextmanager
def open_bag_writer(
    path: str | Path, *, compression: Compression = "none", codec: Codec | None = None
) -> Iterator[BagWriter]:
    """A new bag, kind by its ending; it appears whole, when the context ends, or not at all.

    Parameters
    ----------
    path : path of the bag
    compression : "none", "lz4", "zstd" or "bz2"
    codec : Codec, optional
        With more types than the default ones, say.

    Raises
    ------
    ScanError
        A place that cannot be written.
    ConfigError
        An ending or a compression that no bag has.
    ExtraError
        The packages rosbags and mcap are not installed.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in COMPRESSIONS:
        raise ConfigError(f"{path} names no kind of bag; wanted .mcap, .bag, .db3, or no ending for a folder")
    if compression not in COMPRESSIONS[kind]:
        wanted = ", ".join(COMPRESSIONS[kind])
        raise ConfigError(f"compression = {compression!r}; for {kind or 'a folder'} wanted {wanted}")
    version: RosVersion = "ros1" if kind == ".bag" else "ros2"
    codec = codec or Codec(version)
    if not kind and path.exists():
        raise ScanError(f"{path} exists already; a folder is not replaced, choose another name")
    openers: dict[str, Callable[..., AbstractContextManager[BagWriter]]] = {
        ".mcap": mcap_writer,
        ".bag": _ros1,
        ".db3": _db3,
        "": partial(_folder, name=path.name),
    }
    try:
        with whole_file(path) as unfinished, openers[kind](unfinished, compression, codec) as bag:
            yield bag
    except OSError as error:
        raise ScanError(f"cannot write {path}: {error.strerror or error}") from error


class _McapWriter:
    def __init__(self, writer: Any, codec: Codec) -> None:
        self.codec, self._writer = codec, writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._n_written: dict[int, int] = {}

    def write(self, message: OutMessage) -> None:
        key = message.topic, message.message.__msgtype__
        if key not in self._channels:
            self._channels[key] = self._channel(*key, message.latched)
        channel = self._channels[key]
        self._n_written[channel] = number = self._n_written.get(channel, 0) + 1
        raw = self.codec.encode(message.message)
        self._writer.add_message(channel, message.stamp_ns, raw, message.stamp_ns, number)

    def _channel(self, topic: str, msgtype: str, latched: bool) -> int:
        if msgtype not in self._schemas:
            text, _ = self.codec.definition(msgtype)
            self._schemas[msgtype] = self._writer.register_schema(msgtype, "ros2msg", text.encode())
        profile = STORED.format(depth=1 if latched else 10, durability="transient_local" if latched else "volatile")
        quality = {"offered_qos_profiles": profile}
        return int(self._writer.register_channel(topic, "cdr", self._schemas[msgtype], quality))


@contextmanager
def mcap_writer(path: Path, compression: Compression, codec: Codec) -> Iterator[BagWriter]:
    """A new MCAP file, whatever its ending; it is written in place."""
    module = need("mcap.writer", "bags")
    kind = module.CompressionType[compression.upper()]
    with path.open("wb") as file:
        writer = module.Writer(file, compression=kind)
        writer.start("ros2", f"tempog {__version__}")
        yield _McapWriter(writer, codec)
        writer.finish()


class _RosbagsWriter:
    def __init__(self, writer: Any, codec: Codec) -> None:
        self.codec, self._writer = codec, writer
        self._connections: dict[tuple[str, str], Any] = {}

    def write(self, message: OutMessage) -> None:
        key = message.topic, message.message.__msgtype__
        if key not in self._connections:
            text, digest = self.codec.definition(key[1])
            said: dict[str, Any] = {"md5sum": digest} if self.codec.version == "ros1" else {"rihs01": digest}
            if self.codec.version == "ros1" and message.latched:
                said["latching"] = 1
            self._connections[key] = self._writer.add_connection(*key, msgdef=text, **said)
        self._writer.write(self._connections[key], message.stamp_ns, self.codec.encode(message.message))


@contextmanager
def _ros1(path: Path, compression: Compression, codec: Codec) -> Iterator[BagWriter]:
    writer = need("rosbags.rosbag1", "bags").Writer(path)
    if compression != "none":
        writer.set_compression(writer.CompressionFormat[compression.upper()])
    if compression == "lz4":  # ROS 1 itself reads no blocks that lean on each other, as rosbags writes them
        pack = need("lz4.frame", "bags").compress
        writer.compressor = partial(pack, block_linked=False, content_checksum=True, store_size=False)
    with writer:
        yield _RosbagsWriter(writer, codec)


@contextmanager
def _folder(path: Path, compression: Compression, codec: Codec, name: str = "") -> Iterator[BagWriter]:
    module = need("rosbags.rosbag2", "bags")
    parts = path.with_suffix(".parts")
    try:
        parts.mkdir()
        made = parts / (name or "bag")  # its files are named after it
        writer = module.Writer(made, version=ROS2_BAG_VERSION)
        if compression != "none":
            writer.set_compression(module.CompressionMode.FILE, module.CompressionFormat.ZSTD)
        with writer:
            yield _RosbagsWriter(writer, codec)
        made.replace(path)
    finally:
        shutil.rmtree(parts, ignore_errors=True)


@contextmanager
def _db3(path: Path, compression: Compression, codec: Codec) -> Iterator[BagWriter]:
    folder = path.with_suffix("")
    try:
        with _folder(folder, compression, codec) as bag:
            yield bag
        (folder / "bag.db3").replace(path)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
