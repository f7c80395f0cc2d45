"""Bags of every kind: what was written is read, and what is wrong with them is said."""

from __future__ import annotations

import bz2
import itertools
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bags import BEAMS, START_S, room_scans, sweep_messages, tf, transform, wall_distance, write_messages
from tempog import ScanError, open_scans
from tempog.errors import ClockError, ConfigError, ExtraError, MessageError, TransformError
from tempog.ros.bag_files import files_of, kind_of_file, read_messages
from tempog.ros.bag_writers import open_bag_writer
from tempog.ros.messages import Codec, StampedTransform, string
from tempog.ros.raw import ZSTD_MAGIC, Reading
from tempog.scans.bag_writer import (
    Frames,
    Mount,
    OutMessage,
    messages_of,
    static_messages,
    write_bag,
)
from tempog.scans.rosbag import open_bag

KINDS = [
    ("run.mcap", "none"),
    ("run.mcap", "zstd"),
    ("run.mcap", "lz4"),
    ("run.bag", "none"),
    ("run.bag", "bz2"),
    ("run.bag", "lz4"),
    ("run.db3", "none"),
    ("run", "none"),
    ("run", "zstd"),
]
ROS1_PYTHON = "/usr/bin/python3"


def has_rosbag() -> bool:
    if not Path(ROS1_PYTHON).is_file():
        return False
    return subprocess.run([ROS1_PYTHON, "-c", "import rosbag"], capture_output=True, check=False).returncode == 0


def assert_same(log, scans, angle_rad=1e-6):
    assert len(log) == len(scans)
    for read, written in zip(log, scans, strict=True):
        assert read.stamp_ns == written.stamp_ns
        assert read.max_range == written.max_range
        np.testing.assert_array_equal(read.ranges, written.ranges)
        np.testing.assert_allclose(read.angles, written.angles, atol=angle_rad)
        np.testing.assert_allclose([read.x, read.y], [written.x, written.y], atol=1e-9)
        assert abs(np.remainder(read.theta - written.theta + np.pi, 2 * np.pi) - np.pi) < 1e-9


@pytest.mark.parametrize(("name", "compression"), KINDS)
def test_what_was_written_is_read(tmp_path, name, compression):
    scans = room_scans(30)
    scans[3].ranges.flags.writeable = True
    scans[3].ranges[:3] = [np.nan, np.inf, 40.0]
    write_bag(tmp_path / name, scans, compression=compression)
    log = open_scans(tmp_path / name)
    assert_same(log, scans)
    assert "/scan in laser, 121 beams, sensor maximum 30 m; placed in map by transforms" in log.format
    assert log.n_skipped == 0
    assert log[7].label == "/scan message 8"


@pytest.mark.parametrize(("name", "compression"), KINDS)
def test_rosbags_reads_the_same_messages(tmp_path, name, compression):
    from rosbags.highlevel import AnyReader

    write_bag(tmp_path / name, room_scans(5), compression=compression)
    (file,), missing = files_of(tmp_path / name)
    assert not missing
    reading = Reading()
    ours = [
        (one.topic.name, one.log_ns, one.raw)
        for one in read_messages(file, kind_of_file(file), lambda _: True, reading)
    ]
    with AnyReader([tmp_path / name]) as reader:
        theirs = [(connection.topic, stamp, bytes(raw)) for connection, stamp, raw in reader.messages()]
    assert sorted(ours) == sorted(theirs)
    assert reading.losses == []
    assert reading.unfinished == ""


def test_a_laser_off_the_base_upside_down_and_odometry_that_drifted_change_nothing(tmp_path):
    scans = room_scans(10)
    mount = Mount("/front", "front_laser", 0.3, -0.1, 0.4, theta=0.7, upside_down=True)
    write_bag(tmp_path / "run.mcap", {mount: scans}, frames=Frames(odom_in_map=(1.0, -2.0, 0.5)))
    assert_same(open_scans(tmp_path / "run.mcap"), scans)


def test_motion_during_a_sweep_is_taken_out(tmp_path):
    scans = room_scans(20, sweep_s=0.09)
    assert max(wall_distance(scan).max() for scan in scans) > 0.05
    write_bag(tmp_path / "run.mcap", {Mount(sweep_s=0.09): scans})
    log = open_scans(tmp_path / "run.mcap")
    assert max(wall_distance(scan).max() for scan in log[:-1]) < 0.002  # after the last scan there are no transforms


def test_several_lasers_are_logs_of_their_own_or_one_by_time(tmp_path):
    front, rear = room_scans(10), room_scans(20, 0.05)[1::2]
    mounts = Mount("/front", "front_laser", 0.3), Mount("/rear", "rear_laser", -0.3, theta=np.pi)
    write_bag(tmp_path / "run.mcap", dict(zip(mounts, (front, rear), strict=True)))
    logs = open_bag(tmp_path / "run.mcap")
    assert_same(logs[0], front)
    assert_same(logs[1], rear)
    together = open_scans(tmp_path / "run.mcap")
    assert [scan.stamp_ns for scan in together] == sorted(scan.stamp_ns for scan in (*front, *rear))
    assert any("--scan-topic /front or --scan-topic /rear" in note for note in together.notes)


def test_messages_one_by_one_make_the_bag(tmp_path):
    scans = room_scans(10)
    with open_bag_writer(tmp_path / "run.mcap") as bag:
        for message in static_messages(bag.codec):
            bag.write(message)
        for previous, scan in zip([None, *scans], scans, strict=False):
            for message in messages_of(scan, bag.codec, previous=previous):
                bag.write(message)
    assert_same(open_scans(tmp_path / "run.mcap"), scans)


def test_a_folder_without_metadata_is_its_files_by_name(tmp_path):
    scans = room_scans(30)
    write_bag(tmp_path / "whole.mcap", scans)
    codec = Codec("ros2")
    everything = list(read_of(tmp_path / "whole.mcap"))
    (tmp_path / "run").mkdir()
    for k in range(3):  # /tf_static is in the first alone
        part = everything[k * len(everything) // 3 : (k + 1) * len(everything) // 3]
        write_messages(tmp_path / "run" / f"run_{k}.mcap", [decoded(codec, one) for one in part])
    log = open_scans(tmp_path / "run")
    assert_same(log, scans)
    assert log.format.startswith("MCAP, 3 files: ")
    backwards = sorted((tmp_path / "run").iterdir(), reverse=True)
    assert_same(open_bag(backwards)[0], scans)


def read_of(path):
    return read_messages(path, kind_of_file(path), lambda _: True, Reading())


def decoded(codec, one):
    return OutMessage(one.topic.name, one.log_ns, codec.decode(one.raw, one.topic.msgtype))


def test_what_metadata_names_must_be_there(tmp_path):
    write_bag(tmp_path / "run", room_scans(5))
    listing = tmp_path / "run" / "metadata.yaml"
    listing.write_text(listing.read_text().replace("  - run.db3\n", "  - run.db3\n  - run_1.db3\n", 1))
    with pytest.raises(ScanError, match=r"run_1\.db3 .*metadata\.yaml names this file, but it is not there"):
        open_scans(tmp_path / "run")
    log = open_scans(tmp_path / "run", skip_bad=True)
    assert (len(log), log.n_skipped) == (5, 1)


def test_a_file_under_two_names_is_read_once(tmp_path):
    scans = room_scans(10)
    write_bag(tmp_path / "run", scans)
    (file,) = (tmp_path / "run").glob("*.db3")
    (tmp_path / "link.db3").symlink_to(file)
    (log,) = open_bag([tmp_path / "run", file, tmp_path / "run" / ".." / "run" / file.name, tmp_path / "link.db3"])
    assert_same(log, scans)


def test_a_folder_with_the_same_run_twice_is_not_guessed_at(tmp_path):
    (tmp_path / "runs").mkdir()
    for name in ("run.mcap", "run.bag"):
        write_bag(tmp_path / "runs" / name, room_scans(5))
    with pytest.raises(ScanError, match=r"bags of several kinds: run\.bag, run\.mcap"):
        open_scans(tmp_path / "runs")


def test_a_folder_without_bags(tmp_path):
    with pytest.raises(ScanError, match="is a folder without bags"):
        open_scans(tmp_path)


def test_an_empty_bag(tmp_path):
    write_messages(tmp_path / "run.mcap", [])
    with pytest.raises(ScanError, match=r"no usable scan.*no topics at all"):
        open_scans(tmp_path / "run.mcap")


def test_a_bag_without_scans_lists_what_it_has(tmp_path):
    codec = Codec("ros2")
    write_messages(tmp_path / "run.mcap", [OutMessage("/chatter", 5, string(codec, "hello"))])
    with pytest.raises(ScanError, match=r"saw /chatter \(std_msgs/msg/String, 1\)"):
        open_scans(tmp_path / "run.mcap")


# ---- cut, damaged and unfinished -----------------------------------------------------------------


@pytest.mark.parametrize("compression", ["none", "zstd", "lz4"])
def test_what_is_intact_of_a_cut_mcap_is_used_when_asked_for(tmp_path, compression):
    scans = room_scans(300)
    write_bag(tmp_path / "run.mcap", scans, compression=compression)
    content = (tmp_path / "run.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: len(content) // 2])
    with pytest.raises(
        ScanError, match=r"ends in the middle of the record .* messages can be read, \d+ of them scans"
    ):
        open_scans(cut)
    log = open_scans(cut, skip_bad=True)
    assert 50 < len(log) < 200
    assert log.n_skipped >= 1
    assert any("of them scans, the last of 17000000" in note for note in log.notes)
    assert_same(log, scans[: len(log)])


def test_an_mcap_without_an_end_or_index_loses_nothing(tmp_path):
    scans = room_scans(30)
    write_bag(tmp_path / "run.mcap", scans)
    content = (tmp_path / "run.mcap").read_bytes()
    end = content.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")  # the record DataEnd
    (tmp_path / "run.mcap").write_bytes(content[:end])
    log = open_scans(tmp_path / "run.mcap")
    assert_same(log, scans)
    assert any("it has no end, as after a crash" in note for note in log.notes)


@pytest.mark.parametrize("at", [0.05, 0.5])  # the first chunk says where the laser sits, and what topics there are
def test_a_chunk_with_a_wrong_checksum_is_lost_alone(tmp_path, at):
    import mcap.writer

    scans = room_scans(60)
    write_bag(tmp_path / "whole.mcap", scans)
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = mcap.writer.Writer(file, chunk_size=20_000, compression=mcap.writer.CompressionType.NONE)
        writer.start("ros2", "")
        channels = {}
        for one in read_of(tmp_path / "whole.mcap"):
            if one.topic not in channels:
                schema = writer.register_schema(one.topic.msgtype, "ros2msg", one.topic.definition.encode())
                channels[one.topic] = writer.register_channel(one.topic.name, "cdr", schema)
            writer.add_message(channels[one.topic], one.log_ns, one.raw, one.log_ns)
        writer.finish()
    content = bytearray((tmp_path / "run.mcap").read_bytes())
    content[round(at * len(content))] ^= 1
    (tmp_path / "run.mcap").write_bytes(content)
    with pytest.raises(ScanError, match=r"the chunk at byte [0-9]+ cannot be read: crc validation failed"):
        open_scans(tmp_path / "run.mcap")
    if at < 0.1:
        with pytest.raises(
            TransformError, match=r"/scan \(sensor_msgs/msg/LaserScan, 49\)(.*\n)*.*crc validation failed"
        ):
            open_scans(tmp_path / "run.mcap", skip_bad=True)
        return
    log = open_scans(tmp_path / "run.mcap", skip_bad=True)
    assert 40 < len(log) < 60
    assert log.n_skipped >= 1


@pytest.mark.parametrize("name", ["run.mcap", "run.bag"])
def test_what_others_recorded_is_not_even_unpacked(tmp_path, name):
    codec, scans = Codec("ros1" if name == "run.bag" else "ros2"), room_scans(10)
    rng = np.random.default_rng(0)
    frames = [OutMessage("/camera", 0, string(codec, rng.bytes(2_000_000).hex())) for _ in range(2)]
    with open_bag_writer(tmp_path / name, compression="lz4") as bag:
        for message in (*frames, *static_messages(codec), *messages_of(scans[0], codec)):
            bag.write(message)
        for previous, scan in itertools.pairwise(scans):
            for message in messages_of(scan, codec, previous=previous):
                bag.write(message)
    content = bytearray((tmp_path / name).read_bytes())
    content[1_000_000:1_100_000] = bytes(100_000)
    (tmp_path / name).write_bytes(content)
    log = open_scans(tmp_path / name)
    assert_same(log, scans)


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_a_ros_1_bag_without_an_index_is_read(tmp_path, compression):
    scans = room_scans(30)
    write_bag(tmp_path / "run.bag", scans, compression=compression)
    content = (tmp_path / "run.bag").read_bytes()
    at = content.index(b"index_pos=") + len(b"index_pos=")
    index_pos = int.from_bytes(content[at : at + 8], "little")
    (tmp_path / "run.bag").write_bytes(content[:at] + bytes(8) + content[at + 8 : index_pos])
    log = open_scans(tmp_path / "run.bag")
    assert_same(log, scans)
    assert any("no index" in note and "rosbag reindex" in note for note in log.notes)


def test_a_chunk_of_a_ros_1_bag_that_cannot_be_unpacked_is_lost_alone(tmp_path):
    from rosbags.rosbag1 import Writer

    scans = room_scans(60)
    write_bag(tmp_path / "whole.bag", scans)
    writer = Writer(tmp_path / "run.bag")
    writer.set_compression(Writer.CompressionFormat.LZ4)
    writer.chunk_threshold = 10_000
    with writer:
        connections = {}
        for one in read_of(tmp_path / "whole.bag"):
            if one.topic not in connections:
                said = {"msgdef": one.topic.definition, "md5sum": "0" * 32}
                connections[one.topic] = writer.add_connection(one.topic.name, one.topic.msgtype, **said)
            writer.write(connections[one.topic], one.log_ns, one.raw)
    content = bytearray((tmp_path / "run.bag").read_bytes())
    starts = [at for at in range(len(content)) if content[at : at + 4] == b"\x04\x22\x4d\x18"]  # LZ4's magic
    content[starts[len(starts) // 2]] ^= 1
    (tmp_path / "run.bag").write_bytes(content)
    with pytest.raises(ScanError, match=r"damaged: after \d+ messages: "):
        open_scans(tmp_path / "run.bag")
    log = open_scans(tmp_path / "run.bag", skip_bad=True)
    assert 45 < len(log) < 60
    by_stamp = {scan.stamp_ns: scan for scan in scans}
    assert_same(log, [by_stamp[scan.stamp_ns] for scan in log])


def test_what_is_intact_of_a_cut_ros_1_bag_is_used_when_asked_for(tmp_path):
    scans = room_scans(100)
    write_bag(tmp_path / "run.bag", scans)
    content = (tmp_path / "run.bag").read_bytes()
    (tmp_path / "run.bag").write_bytes(content[: len(content) // 2])
    with pytest.raises(ScanError, match="ends in the middle of the record"):
        open_scans(tmp_path / "run.bag")
    log = open_scans(tmp_path / "run.bag", skip_bad=True)
    assert 20 < len(log) < 80
    assert_same(log, scans[: len(log)])


def test_an_old_ros_1_bag_is_refused(tmp_path):
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(ScanError, match="Bag version 102 is not supported"):
        open_scans(tmp_path / "run.bag")


def test_what_is_intact_of_a_cut_database_is_used_when_asked_for(tmp_path):
    scans = room_scans(300)
    write_bag(tmp_path / "run.db3", scans)
    content = (tmp_path / "run.db3").read_bytes()
    (tmp_path / "run.db3").write_bytes(content[: len(content) // 2])
    with pytest.raises(ScanError, match="malformed"):
        open_scans(tmp_path / "run.db3")
    log = open_scans(tmp_path / "run.db3", skip_bad=True)
    assert len(log) > 50
    by_stamp = {scan.stamp_ns: scan for scan in scans}  # pages that lack hold some early messages as well
    assert_same(log, [by_stamp[scan.stamp_ns] for scan in log])


def test_a_database_of_something_else(tmp_path):
    with sqlite3.connect(tmp_path / "run.db3") as database:
        database.execute("CREATE TABLE cats (name TEXT)")
    with pytest.raises(ScanError, match="no such table: topics"):
        open_scans(tmp_path / "run.db3")


def test_messages_packed_one_by_one_are_read(tmp_path):
    from rosbags import rosbag2

    scans = room_scans(10)
    write_bag(tmp_path / "whole.mcap", scans)
    writer = rosbag2.Writer(tmp_path / "run", version=9)
    writer.set_compression(rosbag2.CompressionMode.MESSAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for one in read_of(tmp_path / "whole.mcap"):
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(
                    one.topic.name, one.topic.msgtype, msgdef=one.topic.definition, rihs01="RIHS01_0"
                )
            writer.write(connections[one.topic], one.log_ns, one.raw)
    assert_same(open_scans(tmp_path / "run"), scans)


@pytest.mark.parametrize("name", ["run.mcap", "run.db3"])
def test_a_message_that_cannot_be_unpacked_is_lost_alone(tmp_path, name):
    with open_bag_writer(tmp_path / name) as bag:
        encode = bag.codec.encode
        for message in static_messages(bag.codec):
            bag.write(message)
        for k, scan in enumerate(room_scans(10)):
            if k == 4:
                bag.codec.encode = lambda message: ZSTD_MAGIC + encode(message)
            for message in messages_of(scan, bag.codec)[-1 if k == 4 else 0 :]:
                bag.write(message)
            bag.codec.encode = encode
    with pytest.raises(ScanError, match="/scan message 5 cannot be unpacked"):
        open_bag(tmp_path / name)
    (log,) = open_bag(tmp_path / name, skip_bad=True)
    assert (len(log), log.n_skipped) == (9, 1)


def test_zstandard_without_a_bag_in_it(tmp_path):
    import zstandard

    (tmp_path / "run").write_bytes(zstandard.compress(b"hello" * 100))
    with pytest.raises(ScanError, match="a Zstandard file with something else than a bag"):
        open_scans(tmp_path / "run")
    (tmp_path / "run").write_bytes(bz2.compress(b"hello"))
    with pytest.raises(ScanError, match="bzip2"):
        open_scans(tmp_path / "run")


# ---- messages ------------------------------------------------------------------------------------


def test_a_broken_message_stops_or_is_counted(tmp_path):
    scans = room_scans(10)
    with sqlite_copy(tmp_path, scans) as database:
        database.execute("UPDATE messages SET data = substr(data, 1, 100) WHERE id = 20")
        (topic,) = database.execute(
            "SELECT name FROM topics, messages WHERE messages.id = 20 AND topics.id = topic_id"
        ).fetchone()
    with pytest.raises(ScanError, match=rf"1 unusable: {topic} message \d+ .*100 bytes are no .*\n.*--skip-bad"):
        open_scans(tmp_path / "run.db3")
    log = open_scans(tmp_path / "run.db3", skip_bad=True)
    assert log.n_skipped == 1


def sqlite_copy(folder, scans):
    write_bag(folder / "run.db3", scans)
    return sqlite3.connect(folder / "run.db3")


def test_ros_2_bags_without_definitions_are_read(tmp_path):
    scans = room_scans(5)
    with sqlite_copy(tmp_path, scans) as database:
        database.execute("DROP TABLE message_definitions")
    assert_same(open_scans(tmp_path / "run.db3"), scans)


def test_messages_in_another_packing_are_refused(tmp_path):
    with sqlite_copy(tmp_path, room_scans(5)) as database:
        database.execute("UPDATE topics SET serialization_format = 'protobuf' WHERE name = '/scan'")
    with pytest.raises(ScanError, match="/scan are packed as 'protobuf'; wanted cdr or ros1"):
        open_scans(tmp_path / "run.db3")


def test_a_definition_that_differs_is_obeyed(tmp_path):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    scans = room_scans(5)
    write_bag(tmp_path / "whole.bag", scans)
    usual = Codec("ros1")
    text, _ = usual.definition("sensor_msgs/msg/LaserScan")
    text = text.replace("float32[] ranges", "float64 temperature\nfloat32[] ranges", 1)
    store = get_typestore(Stores.EMPTY)
    time = "builtin_interfaces/msg/Time"
    store.register(get_types_from_msg(text, "sensor_msgs/msg/LaserScan") | {time: usual.store.fielddefs[time]})
    with Writer(tmp_path / "run.bag") as writer:
        connections = {}
        for one in read_of(tmp_path / "whole.bag"):
            definition, raw = one.topic.definition, one.raw
            if one.topic.name == "/scan":
                message = usual.decode(raw, one.topic.msgtype)
                fields = {
                    name: getattr(message, name) for name in message.__dataclass_fields__ if name != "__msgtype__"
                }
                message = store.types[one.topic.msgtype](temperature=21.5, **fields)
                definition, raw = text, store.serialize_ros1(message, one.topic.msgtype)
            if one.topic.name not in connections:
                connections[one.topic.name] = writer.add_connection(
                    one.topic.name, one.topic.msgtype, msgdef=definition, md5sum="0" * 32
                )
            writer.write(connections[one.topic.name], one.log_ns, bytes(raw))
    log = open_scans(tmp_path / "run.bag")
    assert_same(log, scans)
    assert any("not the usual one; read as the bag says" in note for note in log.notes)


def test_transforms_of_old_ros_1_are_read(tmp_path):
    from rosbags.rosbag1 import Writer

    scans = room_scans(5)
    write_bag(tmp_path / "whole.bag", scans)
    with Writer(tmp_path / "run.bag") as writer:
        connections = {}
        for one in read_of(tmp_path / "whole.bag"):
            if one.topic not in connections:
                old = one.topic.msgtype.replace("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
                said = {"msgdef": one.topic.definition, "md5sum": "0" * 32}
                connections[one.topic] = writer.add_connection(one.topic.name, old, **said)
            writer.write(connections[one.topic], one.log_ns, one.raw)
    log = open_scans(tmp_path / "run.bag")
    assert_same(log, scans)
    assert "usual" not in " ".join(log.notes)


def test_a_sweep_of_minutes_is_refused(tmp_path):
    codec = Codec("ros2")
    message = sweep_messages(codec, room_scans(1))[0]
    message.message.time_increment = 1e30
    write_messages(tmp_path / "run.mcap", [message, tf(codec, transform(0, "map", "laser"))])
    with pytest.raises(ScanError, match=r"/scan message 1 .*time_increment 1e\+30 s"):
        open_scans(tmp_path / "run.mcap")


def test_stamps_that_jump_back_are_told(tmp_path):
    codec = Codec("ros2")
    scans = room_scans(40)
    messages = sweep_messages(codec, [*scans[20:], *scans[:20]])
    static = tf(codec, transform(0, "map", "laser"), topic="/tf_static")
    write_messages(tmp_path / "run.mcap", [static, *messages])
    with pytest.raises(ClockError, match=r"/scan message 21: stamp .* comes after"):
        open_scans(tmp_path / "run.mcap")
    log = open_scans(tmp_path / "run.mcap", clock="sort")
    assert [scan.stamp_ns for scan in log] == [scan.stamp_ns for scan in scans]
    again = open_scans(tmp_path / "run.mcap", clock="rate=10")
    assert again[1].stamp_ns - again[0].stamp_ns == 100_000_000


def test_the_sensor_maximum_can_be_overridden(tmp_path):
    write_bag(tmp_path / "run.mcap", room_scans(3))
    assert open_scans(tmp_path / "run.mcap", sensor_max_range=12)[0].max_range == 12


def test_reading_tells_how_far_it_is(tmp_path):
    write_bag(tmp_path / "run.mcap", room_scans(30))
    told = []
    open_bag(tmp_path / "run.mcap", progress=lambda done, total: told.append((done, total)))
    size = (tmp_path / "run.mcap").stat().st_size
    assert told[-1] == (size, size)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


@pytest.mark.parametrize(("name", "package"), [("run.mcap", "mcap.stream_reader"), ("run.db3", "rosbags.typesys")])
def test_a_package_that_is_missing_is_named_with_its_extra(tmp_path, monkeypatch, name, package):
    from tempog.ros import messages

    write_bag(tmp_path / name, room_scans(3))
    messages._default_store.cache_clear()
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ExtraError, match=r"needs the package (mcap|rosbags): pip install 'tempog\[bags\]'"):
        open_scans(tmp_path / name)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ScanError, match=r"cannot read .*: No such file"):
        open_bag(tmp_path / "run.mcap")
    with pytest.raises(ScanError, match="no bags were given"):
        open_bag([])
    (tmp_path / "run.mcap").write_text("hello")
    with pytest.raises(ScanError, match="is no bag; wanted an MCAP file"):
        open_bag(tmp_path / "run.mcap")


# ---- writing -------------------------------------------------------------------------------------


def test_what_cannot_be_written_is_refused(tmp_path):
    uneven = room_scans(2, angles=BEAMS**3)
    with pytest.raises(ScanError, match="not evenly spaced"):
        write_bag(tmp_path / "run.mcap", uneven)
    with pytest.raises(ScanError, match="no scans to write"):
        write_bag(tmp_path / "run.mcap", [])
    with pytest.raises(ConfigError, match="names no kind of bag"):
        write_bag(tmp_path / "run.zip", room_scans(2))
    with pytest.raises(ConfigError, match=r"for \.bag wanted none, lz4, bz2"):
        write_bag(tmp_path / "run.bag", room_scans(2), compression="zstd")
    with pytest.raises(ScanError, match="cannot write"):
        write_bag(tmp_path / "nowhere" / "run.mcap", room_scans(2))
    with pytest.raises(MessageError, match="is no time in ros1"):
        write_bag(tmp_path / "run.bag", [room_scans(1)[0].__class__(-5.0, (0, 0, 0), BEAMS, BEAMS * 0)])
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "run").mkdir()
    with pytest.raises(ScanError, match="exists already"):
        write_bag(tmp_path / "run", room_scans(2))


# ---- ROS itself ----------------------------------------------------------------------------------

RECORDER = """
import sys, rosbag, rospy
from sensor_msgs.msg import LaserScan
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
path, compression, whole = sys.argv[1:]
bag = rosbag.Bag(path, "w", compression=compression, chunk_threshold=4000)
def placed(t, parent, child, x):
    one = TransformStamped()
    one.header.stamp, one.header.frame_id, one.child_frame_id = t, parent, child
    one.transform.translation.x, one.transform.rotation.w = x, 1
    return one
for k in range(50):
    t = rospy.Time(1700000000, k * 10000000)
    if k == 0:
        bag.write("/tf_static", TFMessage([placed(t, "base_link", "laser", 0.25)]), t)
    bag.write("/tf", TFMessage([placed(t, "odom", "base_link", 0.01 * k)]), t)
    scan = LaserScan(angle_min=-1, angle_increment=0.01, range_max=30, ranges=[2 + 0.01 * k] * 201)
    scan.header.stamp, scan.header.frame_id = t, "laser"
    bag.write("/scan", scan, t)
if whole == "whole":
    bag.close()
else:
    bag.flush()
    import os; os._exit(0)
"""


@pytest.mark.skipif(not has_rosbag(), reason="the rosbag of ROS 1 is not on this machine")
@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
@pytest.mark.parametrize("whole", ["whole", "crashed"])
def test_what_ros_1_records_is_read(tmp_path, compression, whole):
    path = tmp_path / "run.bag"
    command = [ROS1_PYTHON, "-c", RECORDER, path, compression, whole]
    subprocess.run(command, check=True, env={"PATH": "/usr/bin:/bin"})
    log = open_scans(path, skip_bad=whole == "crashed")
    assert len(log) == 50 if whole == "whole" else len(log) >= 30
    assert [scan.x for scan in log] == pytest.approx([0.25 + 0.01 * k for k in range(len(log))])
    assert [float(scan.ranges[5]) for scan in log] == pytest.approx([2 + 0.01 * k for k in range(len(log))])
    assert ("no index" in " ".join(log.notes)) == (whole == "crashed")


@pytest.mark.skipif(not has_rosbag(), reason="the rosbag of ROS 1 is not on this machine")
@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_ros_1_reads_what_is_written(tmp_path, compression):
    write_bag(tmp_path / "run.bag", room_scans(7), compression=compression)
    script = (
        "import sys, rosbag\n"
        "for topic, message, t in rosbag.Bag(sys.argv[1]).read_messages(topics=['/scan']):\n"
        "    print(len(message.ranges), message.header.frame_id, t.to_nsec())"
    )
    command = [ROS1_PYTHON, "-c", script, tmp_path / "run.bag"]
    done = subprocess.run(command, check=True, env={"PATH": "/usr/bin:/bin"}, capture_output=True, text=True)
    assert done.stdout.splitlines() == [f"121 laser {scan.stamp_ns}" for scan in room_scans(7)]


def test_unplaced_scans_stop_or_are_counted(tmp_path):
    codec = Codec("ros2")
    scans = room_scans(40)
    messages = [
        *sweep_messages(codec, scans),
        *[tf(codec, transform(t / 10, "odom", "laser")) for t in range(10, 30)],
    ]
    write_messages(tmp_path / "run.mcap", messages)
    text = rf"18 of 40 scans of /scan cannot be placed: .*laser and odom are connected from {START_S + 1:.3f}"
    with pytest.raises(TransformError, match=text):
        open_scans(tmp_path / "run.mcap")
    log = open_scans(tmp_path / "run.mcap", skip_bad=True)
    assert (len(log), log.n_skipped) == (22, 18)
    assert any("18 of 40 scans of /scan left out" in note for note in log.notes)


def test_a_stamped_transform_without_numbers_stops_or_is_counted(tmp_path):
    codec = Codec("ros2")
    broken = StampedTransform(0, "odom", "base_link", (float("nan"), 0.0, 0.0))
    write_messages(
        tmp_path / "run.mcap",
        [
            *sweep_messages(codec, room_scans(3)),
            tf(codec, broken),
            tf(codec, transform(0, "map", "laser"), topic="/tf_static"),
        ],
    )
    with pytest.raises(ScanError, match=r"/tf message 1 .*the transform of base_link in odom .* is unusable"):
        open_scans(tmp_path / "run.mcap")
    assert open_scans(tmp_path / "run.mcap", skip_bad=True).n_skipped == 1


def test_a_database_whose_messages_are_all_in_its_log_is_read(tmp_path):
    write_bag(tmp_path / "whole.db3", room_scans(400, period_s=0.05))  # transforms are many and small
    with closing(sqlite3.connect(tmp_path / "run.db3")) as recorder:
        recorder.execute("PRAGMA journal_mode = WAL")
        recorder.execute("PRAGMA wal_autocheckpoint = 0")
        with closing(sqlite3.connect(tmp_path / "whole.db3")) as whole:
            recorder.executescript(
                ";".join(sql for (sql,) in whole.execute("SELECT sql FROM sqlite_master WHERE sql > ''"))
            )
        recorder.execute("ATTACH ? AS whole", (str(tmp_path / "whole.db3"),))
        for table in ("topics", "messages"):
            recorder.execute(f"INSERT INTO {table} SELECT * FROM whole.{table}")
        recorder.commit()
        assert (tmp_path / "run.db3").stat().st_size < 10_000
        assert len(open_scans(tmp_path / "run.db3")) == 400
