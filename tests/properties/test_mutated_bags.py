"""Whatever happened to a bag, reading it gives scans or a TempogError, never another exception, and it ends."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import mcap.writer
import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from bags import odometry, room_scans
from tempog.errors import TempogError
from tempog.ros.bag_files import kind_of_file, read_messages
from tempog.ros.bag_writers import OutMessage, open_bag_writer
from tempog.ros.messages import Codec, point_cloud
from tempog.ros.raw import Reading
from tempog.scans.bag_choice import BagChoice
from tempog.scans.bag_writer import Mount, messages_of, static_messages, write_bag
from tempog.scans.open import open_scans
from tempog.scans.scan import ScanLog

NO_HEALTH_CHECKS = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]
ENDS_WITHIN = timedelta(seconds=60)
KINDS = ["mcap", "mcap without checksums", "mcap without chunks", "mcap zstd", "mcap lz4"]
KINDS += ["bag", "bag bz2", "bag lz4", "db3", "db3 zstd", "poses", "clouds"]
BEAMS = np.linspace(-1, 1, 5)
CHOICES = {"clouds": BagChoice(from_cloud=(-1.0, 1.0))}


@cache
def bag_bytes(kind: str) -> bytes:
    """A small bag."""
    scans = room_scans(12, angles=BEAMS)
    ending, _, how = kind.partition(" ")
    with TemporaryDirectory() as folder:
        path = Path(folder, f"run.{ending}")
        if kind in ("mcap", "mcap zstd", "mcap lz4", "bag", "bag bz2", "bag lz4", "db3"):
            write_bag(path, {Mount(sweep_s=0.05): scans}, compression=how or "none")
        elif kind == "db3 zstd":
            write_bag(path, scans)
            return zstandard.compress(path.read_bytes())
        elif kind in ("poses", "clouds"):
            path = Path(folder, "run.bag")
            with open_bag_writer(path) as bag:
                for message in static_messages(bag.codec):
                    bag.write(message)
                for scan in scans:
                    for message in other_messages(bag.codec, kind, scan):
                        bag.write(message)
        else:
            write_bag(path, scans)
            rewrite(path, chunked="chunks" not in how)
        return path.read_bytes()


def other_messages(codec: Codec, kind: str, scan) -> list[OutMessage]:
    if kind == "poses":
        t = (scan.stamp_ns - room_scans(1)[0].stamp_ns) / 1e9
        return [odometry(codec, t), messages_of(scan, codec)[-1]]
    points = np.column_stack([np.cos(BEAMS) * scan.ranges, np.sin(BEAMS) * scan.ranges, 0 * BEAMS])
    cloud = OutMessage("/points", scan.stamp_ns, point_cloud(codec, scan.stamp_ns, "laser", points))
    return [messages_of(scan, codec)[0], cloud]


def rewrite(path: Path, chunked: bool) -> None:
    """The same MCAP file without checksums, which let no damage through, or without chunks."""
    messages = list(read_messages(path, kind_of_file(path), lambda _: True, Reading()))
    with path.open("wb") as file:
        kind = mcap.writer.CompressionType.NONE
        writer = mcap.writer.Writer(file, compression=kind, enable_crcs=False, use_chunking=chunked, chunk_size=1500)
        writer.start("ros2", "")
        channels = {}
        for one in messages:
            if one.topic not in channels:
                schema = writer.register_schema(one.topic.msgtype, "ros2msg", one.topic.definition.encode())
                channels[one.topic] = writer.register_channel(one.topic.name, "cdr", schema)
            writer.add_message(channels[one.topic], one.log_ns, one.raw, one.log_ns)
        writer.finish()


@dataclass(frozen=True)
class Damaged:
    """A kind of bag and what was done to it; small when printed, as its bytes would not be."""

    kind: str
    edits: tuple[tuple[str, int, int], ...]

    def content(self) -> bytes:
        damaged = bytearray(bag_bytes(self.kind))
        for how, at, value in self.edits:
            if not damaged:
                break
            at %= len(damaged)
            if how == "flip":
                damaged[at] ^= 1 << value % 8
            elif how == "set":
                damaged[at] = value
            elif how == "many":
                damaged[at : at + 8] = bytes([value]) * len(damaged[at : at + 8])
            elif how == "insert":
                damaged[at:at] = bytes([value]) * (1 + value % 8)
            elif how == "delete":
                del damaged[at : at + 1 + value % 40]
            else:
                del damaged[at:]
        return bytes(damaged)


EDITS = st.tuples(
    st.sampled_from(["flip", "flip", "set", "set", "many", "insert", "delete", "cut"]),
    st.integers(0, 2**16) | st.integers(0, 400),
    st.integers(0, 255) | st.sampled_from([0, 255]),
)
DAMAGED = st.builds(Damaged, st.sampled_from(KINDS), st.lists(EDITS, min_size=1, max_size=4).map(tuple))


def read_or_refuse(path: Path, kind: str, content: bytes, clock: str, skip_bad: bool) -> str:
    """What was the matter, or nothing."""
    path.write_bytes(content)
    try:
        log = open_scans(path, clock=clock, skip_bad=skip_bad, bag=CHOICES.get(kind))
    except TempogError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert str(path) in message
        return message
    assert isinstance(log, ScanLog)
    assert len(log) > 0
    assert (np.diff([scan.stamp_ns for scan in log]) >= 0).all()
    assert all(np.isfinite([scan.x, scan.y, scan.theta]).all() for scan in log)
    assert skip_bad or log.n_skipped == 0
    return ""


CLOCKS = st.sampled_from(["auto", "auto", "sort", "rate=5"])


@given(DAMAGED, CLOCKS, st.booleans())
@settings(max_examples=200, deadline=ENDS_WITHIN, derandomize=True, suppress_health_check=NO_HEALTH_CHECKS)
@example(Damaged("mcap", (("cut", 0, 0),)), "auto", False)
def test_a_damaged_bag_is_read_or_refused(tmp_path, bag, clock, skip_bad):
    read_or_refuse(tmp_path / "run", bag.kind, bag.content(), clock, skip_bad)


@pytest.mark.slow
@given(DAMAGED, CLOCKS, st.booleans())
@settings(max_examples=5_000, deadline=ENDS_WITHIN, suppress_health_check=NO_HEALTH_CHECKS)
def test_five_thousand_damaged_bags_are_read_or_refused(tmp_path, bag, clock, skip_bad):
    read_or_refuse(tmp_path / "run", bag.kind, bag.content(), clock, skip_bad)


@pytest.mark.parametrize("kind", KINDS)
def test_the_undamaged_bags_are_read(tmp_path, kind):
    assert read_or_refuse(tmp_path / "run", kind, bag_bytes(kind), "auto", False) == ""


@pytest.mark.parametrize("kind", KINDS)
def test_bags_cut_anywhere_are_read_or_refused(tmp_path, kind):
    content = bag_bytes(kind)
    for n_bytes in range(0, len(content), max(1, len(content) // 40)):
        read_or_refuse(tmp_path / "run", kind, content[:n_bytes], "auto", True)
