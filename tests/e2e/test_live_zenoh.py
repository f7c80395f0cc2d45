"""A robot that drives now, through a Zenoh router that is a process of its own; all of it on 127.0.0.1."""

from __future__ import annotations

import json
import signal
import threading
import time
import urllib.request
from collections.abc import Iterator

import numpy as np
import pytest

from live_peers import Robot, Router, free_port, start_tempog, until, zenoh_router
from same_history import room_scans
from tempog.live import outgoing, ros2_names
from tempog.live.replay import Replay
from tempog.live.robot import LASER_PERIOD_S, LiveRobot, LiveSettings
from tempog.live.transport import Connection, connect
from tempog.ros.messages import LASER_SCAN, OCCUPANCY_GRID, STRING, TF_MESSAGE, Codec
from tempog.scans.npz import write_npz
from tempog.scans.scan import ScanLog
from tempog.store.live_map import LiveMap
from tempog.store.saved_map import open_map

zenoh = pytest.importorskip("zenoh", reason="the extra live is not installed")

SETTINGS = LiveSettings(most_scans=100_000, objects=False, publish_every_s=0.2)


@pytest.fixture
def router() -> Iterator[Router]:
    with zenoh_router() as one:
        yield one


@pytest.fixture
def scans():
    return room_scans(100)


@pytest.fixture
def log(tmp_path, scans):
    write_npz(tmp_path / "room.npz", scans)
    return tmp_path / "room.npz"


class Running:
    """A live robot in a thread of its own."""

    def __init__(self, connection, path, settings=SETTINGS):
        self.notes: list[str] = []
        self.transport = connect(connection)
        self.map = LiveMap(path, scan_period_s=LASER_PERIOD_S)
        self.live = LiveRobot(self.transport, self.map, settings, note=self.notes.append)
        self._go_on = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while self._go_on:
            self.live.step(0.02)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._go_on = False
        self._thread.join()
        self.live.close()
        self.map.close()
        self.transport.close()


def mapped(running, n):
    until(lambda: running.live.counts.mapped >= n, f"mapping of {n} scans")


def assert_mapped(path, scans):
    saved = open_map(path)
    assert saved.stamps_ns.tolist() == [scan.stamp_ns for scan in scans]
    np.testing.assert_allclose(saved.poses, [(scan.x, scan.y, scan.theta) for scan in scans], atol=1e-12)


@pytest.mark.parametrize("keys", [[], ["--bridge"]])
def test_replayed_logs_become_the_map_that_is_made_of_them(tmp_path, tempog, log, scans, router, keys):
    path = tmp_path / "live.tempog"
    live = start_tempog(
        "live",
        path,
        "--zenoh",
        router.endpoint,
        "--queue",
        1000,
        "--max-range",
        6,
        "--resolution",
        0.1,
        "--json",
        *keys,
    )
    codec = Codec("ros2")
    with_status = connect(Connection("bridge" if keys else "zenoh", router.endpoint))
    states: list[dict] = []
    with_status.subscribe(
        outgoing.STATUS, STRING, lambda raw: states.append(json.loads(codec.decode(raw, STRING).data))
    )
    until(lambda: states, "the first status")
    played = tempog("replay", log, "--zenoh", router.endpoint, "--rate", 20, *keys)
    assert played.code == 0, played.err
    assert "100 scans on /scan, through Zenoh at" in played.out
    until(lambda: states[-1]["mapped"] == len(scans), "mapping")
    live.send_signal(signal.SIGINT)
    out, err = live.communicate(timeout=60)
    with_status.close()
    assert live.returncode == 0, err
    said = json.loads(out)
    assert (said["mapped"], said["received"], said["hurried"]) == (100, 100, False)
    assert_mapped(path, scans)
    wanted = tmp_path / "log.tempog"
    assert tempog("map", log, "-o", wanted, "--max-range", 6, "--resolution", 0.1, "--gap", "2s").code == 0
    got, known = (open_map(one).at(scans[-1].t, hold=60.0) for one in (path, wanted))
    assert got.extent == known.extent
    assert ((got.value == known.value) | (np.isnan(got.value) & np.isnan(known.value))).mean() > 0.999


def test_sigterm_saves_and_ends(tmp_path, scans, router):
    path = tmp_path / "live.tempog"
    live = start_tempog("live", path, "--zenoh", router.endpoint)
    transport = connect(router.connection())
    maps: list[bytes] = []
    transport.subscribe(outgoing.CURRENT_MAP, OCCUPANCY_GRID, maps.append)
    robot = Robot(transport)
    robot.stand()
    until(robot.is_heard, "start")
    for scan in scans:
        robot.say(scan)
        time.sleep(0.02)
    until(lambda: maps, "a map")
    time.sleep(0.5)
    live.send_signal(signal.SIGTERM)
    out, err = live.communicate(timeout=60)
    transport.close()
    assert live.returncode == 0, err
    assert "100 scans mapped" in out
    assert_mapped(path, scans)


def test_asked_to_end_while_there_is_no_router_it_ends(tmp_path):
    nowhere = Router()
    live = start_tempog("live", tmp_path / "live.tempog", "--zenoh", nowhere.endpoint)
    assert live.stderr is not None
    assert "there is no Zenoh router" in live.stderr.readline()
    live.send_signal(signal.SIGINT)
    live.communicate(timeout=30)
    assert live.returncode == 0


def test_a_bridge_that_is_a_peer_is_there_until_it_goes():
    with zenoh_router("peer") as bridge:
        transport = connect(bridge.connection("bridge"))
        until(transport.connected, "the connection")
        bridge.kill()
        until(lambda: not transport.connected(), "notice that it is gone")
        bridge.start()
        until(transport.connected, "its return")
        transport.close()


def test_a_router_that_hangs_does_not_spoil_the_end(router):
    transport = connect(router.connection())
    session = transport._session

    class Hanging:
        def close(self):
            raise zenoh.ZError("close operation timed out!")

    transport._session = Hanging()
    transport.close()
    session.close()


def test_a_router_may_come_late_go_away_and_come_back(tmp_path, scans):
    router = Router()
    connections: list = []
    thread = threading.Thread(target=lambda: connections.append(connect(router.connection(node="robot"))))
    thread.start()
    time.sleep(0.5)
    router.start()
    try:
        thread.join(30)
        robot = Robot(connections[0])
        with Running(router.connection(), tmp_path / "map") as running:
            robot.stand()
            until(robot.is_heard, "discovery")
            for scan in scans[:40]:
                robot.say(scan)
            mapped(running, 40)
            router.kill()
            until(lambda: any("gone; waiting" in note for note in running.notes), "notice that it is gone")
            for scan in scans[40:50]:
                robot.say(scan)  # into the void
            router.start()
            until(lambda: any("there again" in note for note in running.notes), "notice that it is there")
            until(robot.is_heard, "the robot's return")
            until(lambda: running.transport.topics_of(LASER_SCAN), "tokens declared again")
            late: list[bytes] = []
            third = connect(router.connection(node="late"))
            third.subscribe(outgoing.CURRENT_MAP, OCCUPANCY_GRID, late.append, latched=True)
            until(lambda: late, "the latched map after the restart")
            third.close()
            robot.before = None
            for scan in scans[50:]:
                robot.say(scan)
            mapped(running, 90)
        assert open_map(tmp_path / "map").stamps_ns.tolist() == [s.stamp_ns for s in [*scans[:40], *scans[50:]]]
        connections[0].close()
    finally:
        router.kill()


def test_who_comes_late_gets_what_is_latched(tmp_path, scans, router):
    transport = connect(router.connection(node="robot"))
    robot = Robot(transport)
    robot.stand()  # before anybody listens
    time.sleep(0.3)
    with Running(router.connection(), tmp_path / "map") as running:
        until(lambda: running.live._placing.buffer.is_static("base_link", "laser"), "the static transform")
        for scan in scans[:20]:
            robot.say(scan)
        mapped(running, 20)
        time.sleep(0.5)
        maps: list[bytes] = []
        late = connect(router.connection(node="late"))
        late.subscribe(outgoing.CURRENT_MAP, OCCUPANCY_GRID, maps.append, latched=True)
        until(lambda: maps, "the latched map")
        late.close()
    transport.close()
    assert Codec("ros2").decode(maps[0], OCCUPANCY_GRID).info.width > 10


def test_a_session_as_rmw_zenoh_opens_it_is_heard(tmp_path, scans, router):
    """Nodes of rmw_zenoh are peers that gossip, and publish by advanced publishers with their own type hashes."""
    config = zenoh.Config()
    for key, value in {
        "mode": "peer",
        "connect/endpoints": [router.endpoint],
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "timestamping/enabled": True,
    }.items():
        config.insert_json5(key, json.dumps(value))
    node = zenoh.open(config)
    codec = Codec("ros2")

    class Node:
        version = "ros2"

        def advertise(self, topic, msgtype, *, latched=False):
            key = ros2_names.topic_key(0, topic, msgtype, "RIHS01_" + "0" * 64)
            cache = zenoh.ext.CacheConfig(1) if latched else None
            publisher = zenoh.ext.declare_advanced_publisher(node, key, cache=cache, publisher_detection=latched)

            class One:
                def publish(self, raw):
                    publisher.put(raw, attachment=ros2_names.attachment(1, 0, bytes(16)))

            return One()

    robot = Robot(Node())
    robot.stand()
    heard: list[tuple[bytes, bytes]] = []
    listener = node.declare_subscriber(
        ros2_names.topic_key(0, "/tempog/map", OCCUPANCY_GRID, codec.definition(OCCUPANCY_GRID)[1]),
        lambda sample: heard.append((sample.payload.to_bytes(), sample.attachment.to_bytes())),
    )
    with Running(router.connection(), tmp_path / "map") as running:
        until(lambda: running.live._placing.buffer.is_static("base_link", "laser"), "the static transform")
        for scan in scans:
            robot.say(scan)
            time.sleep(0.005)
        mapped(running, len(scans))
        until(lambda: heard, "a map")
        tokens = [str(reply.ok.key_expr) for reply in node.liveliness().get("@ros2_lv/0/**")]
    listener.undeclare()
    node.close()
    numbers = [ros2_names.read_attachment(attachment)[0] for _, attachment in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert codec.decode(heard[-1][0], OCCUPANCY_GRID).header.frame_id == "map"
    endpoints = [ros2_names.endpoint_of(token) for token in tokens]
    published = {one.topic: one.msgtype for one in endpoints if one and one.kind == ros2_names.PUBLISHER}
    assert published["/tempog/map"] == OCCUPANCY_GRID
    assert published["/tempog/doors"] == STRING
    assert len(published) == 7
    heard_topics = {one.topic for one in endpoints if one and one.kind == ros2_names.SUBSCRIPTION}
    assert heard_topics == {"/scan", "/tf", "/tf_static"}
    assert any("/NN/%/%/tempog" in token for token in tokens)


def test_robots_of_other_domains_and_namespaces_are_not_heard(tmp_path, scans, router):
    other = connect(router.connection(domain=7, node="robot"))
    robot = Robot(other)
    mine = connect(router.connection(domain=7, node="robot"))
    with (
        Running(router.connection(), tmp_path / "domain_0") as wrong,
        Running(router.connection(domain=7, namespace="/r1"), tmp_path / "r1") as named,
        Running(router.connection(domain=7), tmp_path / "domain_7") as right,
    ):
        robot.stand()
        until(robot.is_heard, "discovery")
        until(lambda: right.transport.topics_of(LASER_SCAN), "tokens")
        for scan in scans[:20]:
            robot.say(scan)
        mapped(right, 20)
        assert wrong.live.counts.received == named.live.counts.received == 0
        assert wrong.transport.topics_of(LASER_SCAN) == []
        assert named.transport.topics_of(LASER_SCAN) == ["/scan"]
    other.close()
    mine.close()


def test_a_second_signal_hurries_and_loses_nothing(tmp_path, scans, router):
    """Whatever the second one interrupts: what was mapped is in the map, or in its journal."""
    path = tmp_path / "live.tempog"
    live = start_tempog("live", path, "--zenoh", router.endpoint)
    transport = connect(router.connection())
    maps: list[bytes] = []
    transport.subscribe(outgoing.CURRENT_MAP, OCCUPANCY_GRID, maps.append)
    robot = Robot(transport)
    robot.stand()
    until(robot.is_heard, "start")
    for scan in scans:
        robot.say(scan)
        time.sleep(0.02)
    until(lambda: maps, "a map")
    time.sleep(0.5)
    live.send_signal(signal.SIGINT)
    live.send_signal(signal.SIGTERM)
    _, err = live.communicate(timeout=60)
    transport.close()
    assert live.returncode == 0, err
    with LiveMap(path) as again:
        assert again.n_scans == 100
    assert_mapped(path, scans)


def test_a_loop_goes_on_in_time(tmp_path, scans, router):
    transport = connect(Connection("zenoh", router.endpoint, node="robot", patient=True))
    settings = LiveSettings(("/scan",), most_scans=100_000, objects=False, publish_every_s=0)
    with Running(router.connection(), tmp_path / "map", settings) as running:
        player = Replay(transport, ScanLog(scans[:30]), rate=50.0, start_ns=10**9)
        plain = [player._publishers[topic]._publisher for topic in ("/tf", "/scan")]
        until(lambda: all(one.matching_status.matching for one in plain), "discovery")
        player.run(times=3)
        mapped(running, 90)
    transport.close()
    stamps = open_map(tmp_path / "map").stamps_ns
    assert player.n_scans == len(stamps) == 90
    assert stamps[0] == 10**9
    assert set(np.diff(stamps).tolist()) == {100_000_000}


def test_the_map_is_shown_while_it_grows(tmp_path, scans, router):
    pytest.importorskip("uvicorn", reason="the extra view is not installed")
    port = free_port()
    live = start_tempog("live", tmp_path / "live.tempog", "--zenoh", router.endpoint, "--queue", 1000, "--view", port)

    def shown(what):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/api/{what}", timeout=10) as answer:
            return json.load(answer)

    transport = connect(router.connection())
    robot = Robot(transport)
    robot.stand()
    until(robot.is_heard, "start")
    for scan in scans[:50]:
        robot.say(scan)
    until(lambda: shown("map")["n_scans"] == 50, "50 scans on the page")
    assert shown("map")["live"]
    before = shown("map")["version"]
    for scan in scans[50:]:
        robot.say(scan)
    until(lambda: shown("map")["n_scans"] == 100, "100 scans on the page")
    assert shown("map")["version"] != before
    x, y = scans[0].x, scans[0].y
    assert [interval[2] < 0.5 for interval in shown(f"cell?x={x + 0.3}&y={y + 0.3}")["intervals"]] == [True]
    live.send_signal(signal.SIGINT)
    _, err = live.communicate(timeout=60)
    transport.close()
    assert live.returncode == 0, err
    assert f"http://127.0.0.1:{port}/" in err
    assert_mapped(tmp_path / "live.tempog", scans)


@pytest.mark.parametrize("view", ["here", "127.0.0.1:", "99999"])
def test_a_page_without_a_port_is_wrong_usage(tmp_path, tempog, view):
    result = tempog("live", tmp_path / "live.tempog", "--view", view)
    assert result.code == 2
    assert "names no port" in result.err
    assert not (tmp_path / "live.tempog").exists()


def test_an_endpoint_that_is_none_is_wrong_usage(tmp_path, tempog):
    result = tempog("live", tmp_path / "live.tempog", "--zenoh", "127.0.0.1:7447")
    assert result.code == 2
    assert "wanted one like tcp/127.0.0.1:7447" in result.err


def test_ways_that_exclude_each_other_are_wrong_usage(tmp_path, tempog, log):
    for words in (["live", tmp_path / "live.tempog"], ["replay", log]):
        result = tempog(*words, "--ros1", "--bridge")
        assert result.code == 2
        assert "give one or the other" in result.err


@pytest.mark.parametrize("rate", ["0", "-1", "fast", "inf", "nan"])
def test_rates_that_are_none_are_wrong_usage(tempog, log, rate):
    result = tempog("replay", log, "--rate", rate)
    assert result.code == 2
    assert "wanted a number above 0" in result.err


def test_settings_of_an_existing_map_are_its_own(tmp_path, tempog, log):
    assert tempog("map", log, "-o", tmp_path / "a.tempog").code == 0
    result = tempog("live", tmp_path / "a.tempog", "--resolution", 0.1)
    assert result.code == 2
    assert "leave out --resolution" in result.err


def test_without_the_extra_the_error_names_it(tmp_path, tempog, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "zenoh", None)
    result = tempog("live", tmp_path / "live.tempog")
    assert result.code == 1
    assert "pip install 'tempog[live]'" in result.err


def test_transforms_by_another_name_are_found(tmp_path, scans, router):
    transport = connect(router.connection(node="robot"))
    from tempog.scans.bag_writer import Frames, messages_of, static_messages

    frames, codec = Frames(prefix="/r1"), Codec("ros2")
    publishers = {
        "/r1/tf_static": transport.advertise("/r1/tf_static", TF_MESSAGE, latched=True),
        "/r1/tf": transport.advertise("/r1/tf", TF_MESSAGE),
        "/scan": transport.advertise("/r1/scan", LASER_SCAN),
    }
    settings = LiveSettings(("scan",), tf_topic="tf", objects=False, most_scans=1000)
    with Running(router.connection(namespace="r1"), tmp_path / "map", settings) as running:
        plain = [publishers[topic]._publisher for topic in ("/r1/tf", "/scan")]
        until(lambda: all(one.matching_status.matching for one in plain), "discovery")
        for scan in scans[:20]:
            for message in [*static_messages(codec, frames=frames), *messages_of(scan, codec, frames=frames)]:
                publishers[message.topic].publish(codec.encode(message.message))
        mapped(running, 20)
    transport.close()


def test_who_is_too_slow_drops_whole_scans_and_counts_them(tmp_path, router):
    scans = room_scans(600)
    transport = connect(Connection("zenoh", router.endpoint, node="robot", patient=True))
    settings = LiveSettings(("/scan",), most_scans=5, objects=False, publish_every_s=0)
    with Running(router.connection(), tmp_path / "map", settings) as running:
        integrate = running.map.integrate

        def slowly(scan):
            time.sleep(0.01)
            integrate(scan)

        running.map.integrate = slowly
        robot = Robot(transport)
        robot.stand()
        until(robot.is_heard, "discovery")
        for scan in scans:
            robot.say(scan)
        counts = running.live.counts
        until(lambda: counts.received == counts.mapped + counts.lost == 600, "an end")
        assert counts.too_fast > 100
        assert counts.lost == counts.too_fast
    transport.close()
    assert open_map(tmp_path / "map").n_scans == counts.mapped
    assert any("faster than they can be mapped" in note for note in running.notes)
