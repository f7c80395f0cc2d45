"""How long after a scan was sent is the state of the door in it known, while a robot drives?"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from live_world import MOUNTS, N_BEAMS, RATE_HZ, TF_HZ, scans_of
from numpy.typing import NDArray
from report import Row, Section, at_most

from tempog import build_grid, save_map
from tempog.live import outgoing
from tempog.live.transport import Connection, connect
from tempog.ros.messages import LASER_SCAN, POINT_CLOUD, STRING, Codec, stamp_ns_of

KNOWN_S = 60.0  # of driving before, in which the doors become known
LIVE_S, LIVE_S_QUICK = 240.0, 60.0
MOST_MS = 50.0
CONTROL = "scan"
NAMES = {
    outgoing.EVENTS: "event of a door",
    outgoing.DOORS: "states of doors",
    outgoing.HIGH_DYNAMIC: "who moves",
    CONTROL: "the scan itself, without tempog",
}
CHILD = str(Path(__file__).with_name("live_child.py"))


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """One drive in real time, whatever the logs; all processes share the machine."""
    live_s = LIVE_S if n_scans is None else LIVE_S_QUICK
    with tempfile.TemporaryDirectory() as folder:
        measured = _drive(Path(folder), live_s)
    section = Section(
        f"Live: two lasers of {N_BEAMS} beams at {RATE_HZ} Hz each, transforms at {TF_HZ} Hz, {live_s:.0f} s"
    )
    for what, latency_ms in measured["latencies"].items():
        target = None if what == NAMES[CONTROL] else at_most(MOST_MS, "ms")
        middle, late = (float(np.percentile(latency_ms, share)) for share in (50, 99))
        text = f"{len(latency_ms)} messages"
        section.rows.append(Row(f"{what}: median", text, "", middle, target, "ms"))
        section.rows.append(Row(f"{what}: 99 of 100 within", text, "", late, target, "ms"))
        section.rows.append(Row(f"{what}: longest", text, "", float(latency_ms.max()), unit="ms"))
    said = measured["said"]
    section.rows.append(
        Row("scans that were lost", f"of {said['received']}", "", said["received"] - said["mapped"], unit="")
    )
    section.rows.append(
        Row("processor time of tempog live", "without its child", "", measured["cpu_share"], unit="cores")
    )
    section.notes += [
        "From putting a scan to Zenoh in the robot's process to having, in another, the message that follows from it;"
        " a router, the robot, tempog, its child and who listens share the machine.",
        f"A scan waits for the next transform, up to {1000 / TF_HZ:.0f} ms, as it is sent at its stamp.",
        "The scan itself, as who listens gets it from the robot, shows how busy the machine is with other things.",
        "An event is counted from the scan that settled it; that a door's state must hold for half a second is not.",
    ]
    return [section]


def _drive(folder: Path, live_s: float) -> dict[str, Any]:
    scans = scans_of(KNOWN_S + live_s)
    known = [scan for scan in scans if scan.stamp_ns - scans[0].stamp_ns < (KNOWN_S - 1) * 1e9]
    save_map(build_grid(known), folder / "doors.tempog")
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    router = _child("router", endpoint)
    robot = _child("robot", endpoint, KNOWN_S + live_s, KNOWN_S, folder / "put.npy")
    words = [str(folder / "doors.tempog"), "--zenoh", endpoint, "--json"]
    topics = [word for mount in MOUNTS for word in ("--scan-topic", mount.topic)]
    live = subprocess.Popen([sys.executable, "-m", "tempog", "live", *words, *topics], stdout=subprocess.PIPE)
    got: dict[str, list[tuple[int, int]]] = {
        CONTROL: [],
        outgoing.EVENTS: [],
        outgoing.DOORS: [],
        outgoing.HIGH_DYNAMIC: [],
    }
    codec = Codec("ros2")
    listener = connect(Connection("zenoh", endpoint, node="listener"))

    def on_text(topic: str) -> Any:
        def take(raw: bytes) -> None:
            now_ns = time.monotonic_ns()
            got[topic].append((json.loads(codec.decode(raw, STRING).data)["stamp_ns"], now_ns))

        return take

    def on_cloud(raw: bytes) -> None:
        now_ns = time.monotonic_ns()
        got[outgoing.HIGH_DYNAMIC].append((stamp_ns_of(codec.decode(raw, POINT_CLOUD).header.stamp), now_ns))

    for topic in (outgoing.EVENTS, outgoing.DOORS):
        listener.subscribe(topic, STRING, on_text(topic))

    def on_scan(raw: bytes) -> None:
        now_ns = time.monotonic_ns()
        got[CONTROL].append((stamp_ns_of(codec.decode(raw, LASER_SCAN).header.stamp), now_ns))

    listener.subscribe(outgoing.HIGH_DYNAMIC, POINT_CLOUD, on_cloud)
    for mount in MOUNTS:
        listener.subscribe(mount.topic, LASER_SCAN, on_scan)
    while not any(topic.endswith("/map") for topic in listener.topics_of("nav_msgs/msg/OccupancyGrid")):
        time.sleep(0.1)
    assert robot.stdin is not None
    robot.stdin.write(b"go\n")
    robot.stdin.flush()
    before = _cpu_s(live.pid)
    started_s = time.monotonic()
    robot.wait()
    cpu_share = (_cpu_s(live.pid) - before) / (time.monotonic() - started_s)
    live.terminate()
    out, _ = live.communicate()
    listener.close()
    router.kill()
    router.communicate()
    put = dict(np.load(folder / "put.npy").tolist())
    settled = {stamp_ns for stamp_ns, _ in got[outgoing.EVENTS]}  # the other states follow from an analysis
    got[outgoing.DOORS] = [pair for pair in got[outgoing.DOORS] if pair[0] in settled]
    latencies = {NAMES[topic]: _latencies(put, pairs) for topic, pairs in got.items()}
    return {"latencies": latencies, "said": json.loads(out), "cpu_share": cpu_share}


def _latencies(put: dict[int, int], pairs: list[tuple[int, int]]) -> NDArray[np.float64]:
    """Milliseconds from putting a scan to having its answer."""
    return np.array([(now_ns - put[stamp_ns]) / 1e6 for stamp_ns, now_ns in pairs if stamp_ns in put])


def _child(*words: object) -> subprocess.Popen[bytes]:
    child = subprocess.Popen(
        [sys.executable, CHILD, *(str(word) for word in words)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdout is not None
    child.stdout.readline()
    return child


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
