"""A live robot in memory: what is mapped, what is lost, and what is said about it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from live_peers import Memory, Robot
from same_history import CONFIG, grid_of, room_scans
from tempog.config import MapConfig
from tempog.errors import ConfigError
from tempog.live import outgoing
from tempog.live.robot import LiveRobot, LiveSettings
from tempog.ros.messages import (
    LASER_SCAN,
    OCCUPANCY_GRID,
    POINT_CLOUD,
    Codec,
    StampedTransform,
    tf_message,
)
from tempog.scans.bag_writer import Frames, Mount
from tempog.scans.scan import Scan
from tempog.store.live_map import LiveMap
from tempog.store.saved_map import open_map

NO_OBJECTS = LiveSettings(objects=False, publish_every_s=0)


class Clock:
    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s


class Bench:
    """A robot, a map, and what is between them."""

    def __init__(self, path, settings=NO_OBJECTS, config=CONFIG, frames=None, mount=None, version="ros2"):
        self.memory, self.clock, self.notes = Memory(version), Clock(), []
        self.map = LiveMap(path, config)
        self.robot = Robot(self.memory, mount, frames)
        self.live = LiveRobot(self.memory, self.map, settings, note=self.notes.append, clock=self.clock)
        self.robot.stand()

    def drive(self, scans):
        for scan in scans:
            self.robot.say(scan)
            self.steps()

    def steps(self):
        self.live.step(0.0)
        while len(self.live._inbox) or self.live._inbox._transforms:
            self.live.step(0.0)

    def end(self):
        self.live.close()
        self.map.close()


@pytest.fixture
def scans():
    """As the messages hold them: beams evenly spaced in float32."""
    return room_scans(60)


@pytest.mark.parametrize("version", ["ros1", "ros2"])
def test_the_map_is_that_of_the_log(quick_path, scans, version):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)), version=version)
    bench.drive(scans)
    bench.end()
    assert bench.live.counts.mapped == bench.live.counts.received == len(scans)
    assert bench.live.counts.lost == 0
    saved, wanted = open_map(quick_path / "map"), grid_of(scans)
    np.testing.assert_array_equal(saved.stamps_ns, wanted.stamps_ns)
    np.testing.assert_allclose(saved.poses, wanted.poses, atol=1e-12)
    moment = scans[-1].t
    got, known = saved.at(moment, hold=60.0), wanted.at(moment, hold=60.0)
    assert got.extent == known.extent
    same = (got.value == known.value) | (np.isnan(got.value) & np.isnan(known.value))
    assert same.mean() > 0.999  # angles are float32 in a message


def test_scans_that_come_too_fast_are_dropped_whole_oldest_first_and_counted(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",), most_scans=10))
    for scan in scans:
        bench.robot.say(scan)
    bench.steps()
    bench.end()
    counts = bench.live.counts
    assert (counts.received, counts.mapped, counts.too_fast) == (60, 10, 50)
    assert open_map(quick_path / "map").stamps_ns.tolist() == [scan.stamp_ns for scan in scans[-10:]]
    assert any("faster than they can be mapped" in note for note in bench.notes)


def test_a_scan_waits_for_its_transform_and_is_then_mapped(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.drive(scans[:1])
    bench.robot.say(scans[1], only="/scan")
    bench.steps()
    assert bench.live.counts.mapped == 1
    bench.clock.now_s += 0.1
    bench.robot.before = scans[0]
    bench.robot.say(scans[1], only="/tf")
    bench.steps()
    assert bench.live.counts.mapped == 2
    bench.end()


def test_a_scan_whose_transform_never_comes_is_dropped_counted_and_explained(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.drive(scans[:1])
    bench.robot.say(scans[20], only="/scan")
    bench.steps()
    bench.clock.now_s += 0.3
    bench.steps()
    assert (bench.live.counts.mapped, bench.live.counts.unplaced) == (1, 1)
    assert any("are connected from 100.000 to 100.000 s" in note for note in bench.notes)
    bench.end()


def test_without_any_transforms_the_note_says_so(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.live._placing.buffer._tracks.clear()
    bench.live._inbox._transforms.clear()
    bench.robot.say(scans[0], only="/scan")
    bench.steps()
    bench.clock.now_s += 1.0
    bench.steps()
    assert bench.notes == ["scans without a place: no transforms have come yet, so that laser has no place"]
    bench.end()


def test_a_robot_without_a_map_frame_is_mapped_in_odom_after_a_while(quick_path, scans):
    frames = Frames(fixed="odom", odom="")
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)), frames=frames)
    for scan in scans:
        bench.clock.now_s += 0.2
        bench.drive([scan])
    assert bench.live.status()["frame"] == "odom"
    assert bench.live.counts.mapped > 30
    assert "mapping laser in odom" in bench.notes
    bench.end()


def test_a_map_is_not_gone_on_with_in_odom_unless_asked_to(quick_path, scans):
    """odom begins anew with every start of the robot: other walls in the same places."""
    with LiveMap(quick_path / "map", CONFIG) as before:
        before.integrate_many(scans[:20])
    frames = Frames(fixed="odom", odom="")
    settings = replace(NO_OBJECTS, scan_topics=("/scan",))
    bench = Bench(quick_path / "map", settings, config=None, frames=frames)
    for scan in scans[20:]:
        bench.clock.now_s += 0.3
        bench.drive([scan])
    bench.end()
    assert bench.live.counts.mapped == 0
    assert any("laser is not connected with map" in note and "--fixed-frame odom" in note for note in bench.notes)
    bench = Bench(quick_path / "map", replace(settings, fixed_frame="odom"), config=None, frames=frames)
    bench.drive(scans[20:])
    bench.end()
    assert bench.live.counts.mapped == 40


def test_frames_that_are_named_for_every_person_do_not_pile_up(quick_path, scans, monkeypatch):
    monkeypatch.setattr("tempog.live.placing.MOST_MOVING", 10)
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    codec = Codec("ros2")
    for k, scan in enumerate(scans):
        person = [StampedTransform(scan.stamp_ns, "map", f"person_{k}", (1.0, 1.0, 0.0))]
        bench.robot.publishers["/tf"].publish(codec.encode(tf_message(codec, person)))
        bench.drive([scan])
    bench.end()
    assert bench.live.counts.mapped == 60
    links = bench.live._placing.buffer.links()
    assert len(links) <= 11
    assert ("map", "person_59") in links


def test_one_transform_from_the_future_does_not_lose_the_robot(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    codec = Codec("ros2")
    bench.drive(scans[:10])
    ahead = StampedTransform(2**60, "odom", "base_link", (0.0, 0.0, 0.0))
    bench.robot.publishers["/tf"].publish(codec.encode(tf_message(codec, [ahead])))
    for scan in scans[10:]:
        bench.clock.now_s += 0.3
        bench.drive([scan])
    bench.end()
    assert bench.live.counts.unplaced > 0
    assert bench.live.counts.mapped >= 50


def test_scans_that_wait_ask_once_together(quick_path, scans, monkeypatch):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",), wait_s=60.0, most_scans=100))
    bench.drive(scans[:1])
    for scan in scans[1:]:
        bench.robot.say(scan, only="/scan")
    bench.steps()
    asked = []
    span_ns = bench.live._placing.buffer.span_ns
    with monkeypatch.context() as counted:
        counted.setattr(bench.live._placing.buffer, "span_ns", lambda *names: asked.append(names) or span_ns(*names))
        bench.live.step(0.0)
    assert len(asked) == 1
    assert len(bench.live._placing) == 59
    bench.robot.before = scans[0]
    bench.robot.say(scans[-1], only="/tf")
    bench.steps()
    bench.end()
    assert bench.live.counts.mapped == 60


def test_scans_without_a_frame_are_called_so(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.robot.mount = replace(bench.robot.mount, frame="")
    bench.drive(scans[:1])
    bench.clock.now_s += 1.0
    bench.steps()
    bench.end()
    assert bench.live.counts.unplaced == 1
    assert bench.notes == [
        "scans without a place: LaserScans come without a frame: their header.frame_id is empty; the laser's driver"
        " sets it"
    ]


def test_unknown_frames_are_named_as_flags(quick_path, scans):
    frames = Frames(fixed="world", odom="")
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)), frames=frames)
    bench.drive(scans[:1])
    bench.clock.now_s += 10.0
    bench.drive(scans[1:2])
    bench.clock.now_s += 1.0
    bench.steps()
    assert bench.live.counts.mapped == 0
    assert any("Choose: --fixed-frame world" in note for note in bench.notes)
    bench.end()


def test_when_time_goes_back_scans_are_left_out_until_it_has_passed_again(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.drive(scans[:40])
    bench.robot.before = None
    bench.drive(scans)  # the bag is played again
    bench.end()
    counts = bench.live.counts
    assert counts.earlier == 34  # those within half a second of the latest are only late
    assert counts.mapped == 100 - counts.earlier
    assert sum("time has gone back by 3.9 s" in note for note in bench.notes) == 1
    assert open_map(quick_path / "map").stamps_ns[-1] == scans[-1].stamp_ns


def test_two_lasers_that_speak_out_of_order_are_both_mapped(quick_path, scans):
    settings = replace(NO_OBJECTS, scan_topics=("/scan", "/rear"))
    bench = Bench(quick_path / "map", settings)
    rear = Robot(bench.memory, Mount(topic="/rear", frame="rear", theta=np.pi))
    rear.stand()
    for scan in scans:
        pose = scan.x, scan.y, scan.theta + np.pi
        earlier = Scan(0.0, pose, scan.angles, scan.ranges, stamp_ns=scan.stamp_ns - 30_000_000)
        bench.drive([scan])
        rear.say(earlier, only="/rear")
        bench.steps()
    bench.clock.now_s += 1.0
    bench.steps()
    bench.end()
    counts = bench.live.counts
    assert counts.mapped == 2 * len(scans) - counts.unplaced
    assert counts.unplaced <= 1  # the first of the rear is from before all transforms
    assert counts.shifted >= len(scans) - 1
    stamps = open_map(quick_path / "map").stamps_ns
    assert len(stamps) == counts.mapped
    assert (np.diff(stamps) >= 0).all()


@pytest.mark.parametrize("raw", [b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + 40 * b"\xff"])
def test_what_is_no_message_is_counted(quick_path, scans, raw):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    for topic in ("/scan", "/tf"):
        for received in bench.memory.subscribed[topic]:
            received(raw)
    bench.drive(scans)
    bench.end()
    assert (bench.live.counts.unusable, bench.live.counts.mapped) == (2, 60)


def test_frames_that_are_named_too_well_do_not_end_it(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    codec = Codec("ros2")
    bad = tf_message(codec, [StampedTransform(0, "map", "map", (0.0, 0.0, 0.0))])
    bench.robot.publishers["/tf"].publish(codec.encode(bad))
    bench.drive(scans)
    bench.end()
    assert bench.live.counts.mapped == 60


def test_it_says_which_scans_there_are_when_none_come(quick_path):
    bench = Bench(quick_path / "map", NO_OBJECTS)
    bench.clock.now_s += 6.0
    bench.live.step(0.0)
    bench.end()
    assert bench.notes == ["no scan has come on scan yet; LaserScans are published elsewhere: --scan-topic /scan"]


def test_a_laser_that_is_silent_is_named_though_another_speaks(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan", "/raer")))
    bench.memory.advertise("/rear", LASER_SCAN)
    bench.drive(scans)
    bench.clock.now_s += 6.0
    bench.live.step(0.0)
    bench.end()
    wanted = "no scan has come on /raer yet; LaserScans are published elsewhere: --scan-topic /rear"
    assert [note for note in bench.notes if "no scan" in note] == [wanted]


def test_a_publisher_that_says_nothing_is_not_offered_as_another(quick_path):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.clock.now_s += 6.0
    bench.live.step(0.0)
    bench.end()
    assert bench.notes == ["no scan has come on /scan yet; a publisher is there, and says nothing"]


def test_a_laser_that_leans_is_no_laser_in_the_plane(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    leaning = (0.0, np.sin(np.radians(5)), 0.0, np.cos(np.radians(5)))
    codec = Codec("ros2")
    mounted = tf_message(codec, [StampedTransform(0, "base_link", "laser", (0.0, 0.0, 0.3), leaning)])
    bench.robot.publishers["/tf_static"].publish(codec.encode(mounted))
    bench.drive(scans[:1])
    bench.end()
    assert bench.live.counts.unplaced == 1
    assert bench.notes == ["scans without a place: laser leans by more than 3 degrees in map"]


def test_a_connection_that_goes_and_comes_back_is_said(quick_path):
    bench = Bench(quick_path / "map", NO_OBJECTS)
    for there in (False, True):
        bench.memory.is_connected = there
        bench.clock.now_s += 1.5
        bench.live.step(0.0)
    bench.end()
    assert bench.notes == ["memory: gone; waiting for it", "memory: there again"]


def test_the_current_map_is_published_for_who_comes_late(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",), publish_every_s=1.0))
    bench.drive(scans)
    bench.clock.now_s += 10.0
    bench.live.step(0.0)
    late = []
    bench.memory.subscribe(outgoing.CURRENT_MAP, OCCUPANCY_GRID, late.append, latched=True)
    now = Codec("ros2").decode(late[0], OCCUPANCY_GRID)
    known = bench.map.at(scans[-1].t, hold=float("inf"))
    cells = now.data.reshape(now.info.height, now.info.width)
    np.testing.assert_array_equal(cells, outgoing.current_cells(known.value))
    assert (now.header.frame_id, now.info.resolution) == ("map", np.float32(0.1))
    assert now.info.origin.position.x == pytest.approx(known.extent.col0 * 0.1)
    assert now.info.origin.position.y == pytest.approx(known.extent.row0 * 0.1)
    assert set(np.unique(cells)) == {-1, 0, 100}
    bench.end()


def test_status_counts(quick_path, scans):
    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.drive(scans)
    bench.clock.now_s += 10.0
    bench.live.step(0.0)
    (text,) = bench.memory.texts(outgoing.STATUS)
    status = json.loads(text)
    assert (status["mapped"], status["received"], status["frame"], status["connected"]) == (60, 60, "map", True)
    bench.end()


def test_a_full_disk_loses_scans_and_does_not_end_it(quick_path, scans, monkeypatch):
    from tempog.errors import MapError

    bench = Bench(quick_path / "map", replace(NO_OBJECTS, scan_topics=("/scan",)))
    bench.drive(scans[:20])
    with monkeypatch.context() as full:

        def refuse(scan):
            raise MapError("the scan could not be kept: no space left on device")

        full.setattr(bench.map, "integrate", refuse)
        bench.drive(scans[20:30])
    bench.drive(scans[30:])
    bench.end()
    assert (bench.live.counts.unsaved, bench.live.counts.mapped) == (10, 50)
    assert sum("no space left" in note for note in bench.notes) == 1
    assert open_map(quick_path / "map").n_scans == 50


@pytest.mark.parametrize(
    "settings", [{"scan_topics": ()}, {"wait_s": -1.0}, {"most_scans": 0}, {"publish_every_s": float("nan")}]
)
def test_settings_that_cannot_work_are_refused(settings):
    with pytest.raises(ConfigError, match="wanted"):
        LiveSettings(**settings)


def test_what_is_learned_live_is_published(tmp_path):
    """A map is gone on with; its door is known, and its moves become events."""
    from live_peers import until
    from tempog.pipeline import build_grid
    from tempog.simulation import corridor, simulate
    from tempog.store.saved_map import save_map

    scans = simulate(corridor()).scans
    save_map(build_grid(scans[:1000], MapConfig()), tmp_path / "site.tempog")
    settings = LiveSettings(("/scan",), publish_every_s=0.5)
    bench = Bench(tmp_path / "site.tempog", settings, config=None)
    bench.drive(scans[1000:1010])

    def known():
        bench.live.step(0.0)
        return bench.live.tracker is not None

    until(known, "the answer about objects")
    bench.drive(scans[1010:])
    bench.clock.now_s += 10.0
    bench.live.step(0.0)
    bench.end()
    events = [json.loads(text) for text in bench.memory.texts(outgoing.EVENTS)]
    doors = json.loads(bench.memory.texts(outgoing.DOORS)[-1])
    assert bench.live.counts.events == len(events) > 0
    assert {event["state"] for event in events} == {"occupied", "free"}
    stamps = {scan.stamp_ns for scan in scans}
    assert all(event["stamp_ns"] in stamps for event in events)
    (door,) = doors["objects"]
    assert [place["state"] for place in door["places"] if place["id"] == door["place"]] == ["occupied"]
    codec = Codec("ros2")
    markers = codec.decode(bench.memory.sent[outgoing.DOOR_MARKERS][-1], outgoing.MARKERS).markers
    assert len(markers) == 1 + 2 * len(door["places"])
    walls = codec.decode(bench.memory.sent[outgoing.STATIC_MAP][-1], OCCUPANCY_GRID)
    assert set(np.unique(walls.data)) == {-1, 0, 100}
    clouds = [codec.decode(raw, POINT_CLOUD) for raw in bench.memory.sent[outgoing.HIGH_DYNAMIC]]
    assert max(cloud.width for cloud in clouds) > 3  # the person who walks by
    assert any("objects known" in note for note in bench.notes)
