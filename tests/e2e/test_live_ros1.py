"""A robot that drives now, through Debian's ROS 1: roscore and rospy, each in processes of their own."""

from __future__ import annotations

import importlib.util
import json
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from live_peers import ROS1_PYTHON, Master, start_tempog, until
from same_history import room_scans
from tempog.scans.npz import write_npz
from tempog.store.saved_map import open_map

HERE = f"cpython-{sys.version_info.major}{sys.version_info.minor}"
pytestmark = [
    pytest.mark.skipif(shutil.which("roscore") is None, reason="there is no roscore here (Debian: python3-roscore)"),
    pytest.mark.skipif(not (ROS1_PYTHON / "rospy").is_dir(), reason="there is no rospy here (Debian: python3-rospy)"),
    pytest.mark.skipif(importlib.util.find_spec("rosbags") is None, reason="the extra live is not installed"),
    pytest.mark.skipif(not list(ROS1_PYTHON.glob(f"netifaces*{HERE}*")), reason="rospy here is for another Python"),
]
# Plain rospy and Debian's message packages, which know nothing of tempog.
LISTENER = """
import sys, json, rospy
from std_msgs.msg import String
from nav_msgs.msg import OccupancyGrid
from visualization_msgs.msg import MarkerArray
from sensor_msgs.msg import PointCloud2
rospy.init_node("listener", anonymous=True)
heard = {}
for topic, kind in [("map", OccupancyGrid), ("status", String)]:
    message = rospy.wait_for_message("/tempog/" + topic, kind, timeout=60)
    heard[topic] = [message.info.width, message.header.frame_id] if topic == "map" else json.loads(message.data)
print(json.dumps(heard))
"""


@pytest.fixture
def master(tmp_path):
    one = Master(tmp_path / "ros")
    one.start()
    yield one
    one.stop()


def finished(process, patience_s=60):
    out, err = process.communicate(timeout=patience_s)
    assert process.returncode == 0, err
    return out


def registered(master, topic):
    """Whether somebody listens there, as the master says."""
    code = "import rosgraph, sys; print([t for t, _ in rosgraph.Master('/test').getSystemState()[1]])"
    state = subprocess.run([sys.executable, "-c", code], env=master.environment, capture_output=True, text=True)
    return topic in state.stdout


def test_replayed_logs_are_mapped_and_what_comes_out_is_what_ros_reads(tmp_path, master):
    scans = room_scans(100)
    write_npz(tmp_path / "room.npz", scans)
    path = tmp_path / "live.tempog"
    live = start_tempog(
        "live", path, "--ros1", "--max-range", 6, "--resolution", 0.1, "--json", env=master.environment
    )
    until(lambda: registered(master, "/scan"), "registration")
    play = ["replay", tmp_path / "room.npz", "--ros1", "--rate", 10, "--delay", 3]
    assert "100 scans on /scan" in finished(start_tempog(*play, env=master.environment))
    code = [sys.executable, "-c", LISTENER]
    listener = subprocess.run(code, env=master.environment, capture_output=True, text=True, timeout=90)
    live.send_signal(signal.SIGTERM)
    said = json.loads(finished(live))
    assert said["mapped"] == said["received"] == 100
    saved = open_map(path)
    assert saved.stamps_ns.tolist() == [scan.stamp_ns for scan in scans]
    np.testing.assert_allclose(saved.poses, [(scan.x, scan.y, scan.theta) for scan in scans], atol=1e-12)
    if "No module named" in listener.stderr:
        pytest.skip("Debian's message packages are not here; the map itself was checked")
    heard = json.loads(listener.stdout)
    assert heard["map"] == [saved.extent.n_cols, "map"]
    assert heard["status"]["mapped"] == 100


def test_a_master_may_go_away_and_come_back(tmp_path, master):
    scans = room_scans(60)
    path = tmp_path / "live.tempog"
    live = start_tempog("live", path, "--ros1", "--json", env=master.environment)
    until(lambda: registered(master, "/scan"), "registration")

    def play(part):
        write_npz(tmp_path / "part.npz", part)
        words = ["replay", tmp_path / "part.npz", "--ros1", "--rate", 10, "--delay", 3, "-q"]
        finished(start_tempog(*words, env=master.environment))

    play(scans[:30])
    master.stop()
    time.sleep(3)
    master.start()
    until(lambda: registered(master, "/scan"), "registration with the new master")
    play(scans[30:])
    live.send_signal(signal.SIGINT)
    _, err = live.communicate(timeout=60)
    assert live.returncode == 0, err
    assert "gone; waiting for it" in err
    assert "there again" in err
    assert open_map(path).stamps_ns.tolist() == [scan.stamp_ns for scan in scans]


def test_without_rospy_the_error_says_how_to_get_it(tmp_path, tempog, monkeypatch):
    monkeypatch.setitem(sys.modules, "rospy", None)
    result = tempog("live", tmp_path / "live.tempog", "--ros1")
    assert result.code == 1
    assert "PYTHONPATH=/usr/lib/python3/dist-packages" in result.err
