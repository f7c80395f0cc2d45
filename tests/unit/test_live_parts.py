"""Names on the network, the process that looks for objects, and a log that is played."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from live_peers import Memory, until
from same_history import CONFIG, room_scans
from tempog.errors import ConfigError, ScanError
from tempog.live import ros2_names
from tempog.live.analyst import Analyst, Question
from tempog.live.replay import Replay
from tempog.live.stopping import Stop
from tempog.live.transport import Connection
from tempog.ros.messages import LASER_SCAN, STRING, TF_MESSAGE, Codec, sweep_of, transforms_of
from tempog.scans.scan import Scan
from tempog.store.live_map import LiveMap


def test_the_key_of_chatter_is_the_one_of_rmw_zenoh():
    """The example of rmw_zenoh's docs/design.md."""
    type_hash = Codec("ros2").definition(STRING)[1]
    assert ros2_names.topic_key(2, "/robot1/chatter", STRING, type_hash) == (
        "2/robot1/chatter/std_msgs::msg::dds_::String_/"
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


def test_the_token_of_the_talker_is_the_one_of_rmw_zenoh():
    """The example of rmw_zenoh's docs/design.md."""
    type_hash = Codec("ros2").definition(STRING)[1]
    token = ros2_names.endpoint_token(
        2, "8b20917502ee955ac4476e0266340d5c", 10, "MP", "", "talker", "/chatter", STRING, type_hash,
        ros2_names.quality(depth=7),
    )  # fmt: skip
    assert token == (
        "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,"
    )
    assert ros2_names.endpoint_of(token) == ("MP", "/chatter", STRING)
    assert ros2_names.endpoint_of("@ros2_lv/2/aac3/0/0/NN/%/%/listener") is None


def test_an_attachment_is_laid_out_as_rmw_zenoh_reads_it():
    """Two int64, a length and 16 bytes, as zenoh's own serializer writes a tuple of these."""
    zenoh_ext = pytest.importorskip("zenoh.ext", reason="the extra live is not installed")
    gid = bytes(range(16))
    raw = ros2_names.attachment(5, 1_700_000_000_000_000_000, gid)
    kinds = zenoh_ext.Int64(5), zenoh_ext.Int64(1_700_000_000_000_000_000), bytearray(gid)
    assert raw == zenoh_ext.z_serialize(kinds).to_bytes()
    assert ros2_names.read_attachment(raw) == (5, 1_700_000_000_000_000_000, gid)
    with pytest.raises(ValueError, match="wanted 33"):
        ros2_names.read_attachment(raw[:-1])


@pytest.mark.parametrize("settings", [{"kind": "dds"}, {"domain": -1}, {"domain": 233}])
def test_connections_that_cannot_work_are_refused(settings):
    with pytest.raises(ConfigError, match="wanted"):
        Connection(**settings)


@pytest.mark.parametrize("name", ["/", "a//b", "scan*", "r$1", "front scan", ""])
def test_names_that_no_topic_can_have_are_refused(name):
    with pytest.raises(ConfigError, match="is no name of a ROS topic; wanted letters"):
        Connection().full_name(name)


def test_namespaces_are_names():
    assert Connection(namespace="/").full_name("scan") == "/scan"
    assert Connection(namespace="/site/r1/").full_name("scan") == "/site/r1/scan"
    with pytest.raises(ConfigError, match=r"'r\*' is no name of a ROS namespace"):
        Connection(namespace="r*")


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "map"
    with LiveMap(path, CONFIG) as live:
        live.integrate_many(room_scans(80))
    return path


def answered(analyst):
    answers = []

    def there():
        answers.extend(one for one in [analyst.answer()] if one is not None)
        return answers

    until(there, "an answer")
    return answers[0]


def test_an_analyst_answers_and_may_be_killed(saved):
    analyst = Analyst(saved)
    try:
        analyst.ask(Question(0))
        assert analyst.busy
        first = answered(analyst)
        assert not analyst.busy
        assert first.failure == ""
        assert first.found.history is None
        assert first.found.walls.shape == first.found.extent.shape
        analyst.ask(Question(2**62))  # waits for what never comes
        os.kill(analyst.pid, signal.SIGKILL)
        assert "has ended" in answered(analyst).failure
        analyst.ask(Question(0))
        np.testing.assert_array_equal(answered(analyst).found.walls, first.found.walls)
    finally:
        analyst.close()


def test_an_analyst_that_cannot_be_started_says_so(saved, monkeypatch):
    analyst = Analyst(saved)
    with monkeypatch.context() as full:

        def refuse(*args, **settings):
            raise BlockingIOError("Resource temporarily unavailable")

        full.setattr(subprocess, "Popen", refuse)
        analyst.ask(Question(0))
        assert analyst.busy
        assert "could not be started: Resource" in answered(analyst).failure
    assert not analyst.busy
    try:
        analyst.ask(Question(0))
        assert answered(analyst).failure == ""
    finally:
        analyst.close()


def test_an_analyst_of_no_map_says_so(tmp_path):
    analyst = Analyst(tmp_path / "nothing")
    try:
        analyst.ask(Question(0))
        assert "nothing" in answered(analyst).failure
    finally:
        analyst.close()


class Time:
    def __init__(self):
        self.now_s, self.slept = 50.0, []

    def clock(self):
        return self.now_s

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now_s += seconds


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_a_log_is_played_at_its_rate(rate):
    memory, time, scans = Memory(), Time(), room_scans(30)
    when = []
    memory.subscribe("/scan", LASER_SCAN, lambda raw: when.append(time.now_s))
    Replay(memory, scans, rate=rate, sleep=time.sleep, clock=time.clock).run()
    assert max(time.slept) <= 0.1
    np.testing.assert_allclose(np.array(when) - 50.0, [(one.t - scans[0].t) / rate for one in scans], atol=1e-9)


def test_what_is_played_says_what_the_log_says():
    memory, scans = Memory(), room_scans(5)
    Replay(memory, scans, rate=float("inf")).run()
    codec = Codec("ros2")
    sweeps = [sweep_of(codec.decode(raw, LASER_SCAN)) for raw in memory.sent["/scan"]]
    assert [sweep.stamp_ns for sweep in sweeps] == [scan.stamp_ns for scan in scans]
    np.testing.assert_array_equal(sweeps[2].ranges, scans[2].ranges)
    np.testing.assert_allclose(sweeps[2].angles, scans[2].angles, atol=1e-5)
    moved = [one for raw in memory.sent["/tf"] for one in transforms_of(codec.decode(raw, TF_MESSAGE))]
    last = next(one for one in reversed(moved) if one.child == "base_link")
    assert last.translation[:2] == pytest.approx((scans[-1].x, scans[-1].y))
    assert len(memory.sent["/tf_static"]) == 1


def test_a_log_whose_sweeps_were_compensated_is_played_with_even_beams():
    memory, rng = Memory(), np.random.default_rng(4)
    scans = [
        Scan(
            0.0, (one.x, one.y, one.theta), np.arctan2(np.sin(bent), np.cos(bent)), one.ranges, stamp_ns=one.stamp_ns
        )
        for one in room_scans(5)
        for bent in [2.0 + one.angles + rng.normal(0, 2e-3, len(one.angles))]  # across the seam at pi
    ]
    player = Replay(memory, scans, rate=float("inf"))
    player.run()
    assert player.n_spaced == player.n_scans == 5
    codec = Codec("ros2")
    for raw, scan in zip(memory.sent["/scan"], scans, strict=True):
        sweep = sweep_of(codec.decode(raw, LASER_SCAN))
        assert len(sweep.angles) == len(scan.angles)
        step = sweep.angles[1] - sweep.angles[0]
        seen = np.isfinite(sweep.ranges)
        assert seen.mean() > 0.8
        apart = np.abs(np.angle(np.exp(1j * (sweep.angles[seen, None] - scan.angles[None, :]))))
        near = apart <= 0.51 * step
        assert (near & (sweep.ranges[seen, None] == scan.ranges[None, :])).any(axis=1).all()


def test_a_replay_ends_when_it_is_told_to():
    memory, scans = Memory(), room_scans(30)
    player = Replay(memory, scans, rate=float("inf"))
    player.run(lambda: player.n_scans >= 7, times=float("inf"))
    assert len(memory.sent["/scan"]) == 7


def test_nothing_cannot_be_played():
    with pytest.raises(ScanError, match="at least one"):
        Replay(Memory(), [])
    with pytest.raises(ConfigError, match="above 0"):
        Replay(Memory(), room_scans(1), rate=0.0)


def test_the_second_signal_interrupts():
    with Stop() as stop:
        assert not stop()
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.slow
def test_an_hour_live_takes_no_more_memory_than_ten_minutes(tmp_path):
    """10 Hz of 720 beams, doors that move, objects followed; as fast as it goes."""
    script = Path(__file__).parents[1] / "live_hour.py"
    words = [sys.executable, str(script), str(tmp_path / "map"), "60"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["mapped"], said["lost"]) == (36_000, 0)
    assert said["events"] > 50
    resident_mb = np.array(said["resident_mb"])[:, 1]
    # Medians: for some seconds, now and then, small files of the map are made one.
    assert np.median(resident_mb[-5:]) < 1.15 * np.median(resident_mb[7:12])
