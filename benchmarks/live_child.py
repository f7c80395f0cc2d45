"""Processes of the live benchmark: python live_child.py router ENDPOINT | robot ENDPOINT SECONDS FROM OUT."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import zenoh
from live_world import MOUNTS, said, scans_of

from tempog.live.transport import Connection, connect
from tempog.ros.messages import LASER_SCAN, TF_MESSAGE, Codec
from tempog.scans.bag_writer import static_messages


def router(endpoint: str) -> None:
    """A Zenoh router, until standard input ends."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config):
        print("up", flush=True)
        sys.stdin.read()


def robot(endpoint: str, duration_s: float, from_s: float, out: Path) -> None:
    """Plays the world from a moment on in real time; writes when each scan was put, by its stamp."""
    codec = Codec("ros2")
    scans = scans_of(duration_s)
    scans = [scan for scan in scans if scan.stamp_ns - scans[0].stamp_ns >= from_s * 1e9]
    todo = [
        (one.at_s, one.message.topic, one.message.stamp_ns, codec.encode(one.message.message))
        for one in said(codec, scans)
    ]
    transport = connect(Connection("zenoh", endpoint, node="robot"))
    publishers = {mount.topic: transport.advertise(mount.topic, LASER_SCAN) for mount in MOUNTS}
    publishers["/tf"] = transport.advertise("/tf", TF_MESSAGE)
    publishers["/tf_static"] = transport.advertise("/tf_static", TF_MESSAGE, latched=True)
    for message in static_messages(codec, MOUNTS):
        publishers[message.topic].publish(codec.encode(message.message))
    print("ready", flush=True)
    sys.stdin.readline()
    start_s = time.monotonic()
    put: list[tuple[int, int]] = []
    for at_s, topic, stamp_ns, raw in todo:
        time.sleep(max(0.0, start_s + at_s - time.monotonic()))
        now_ns = time.monotonic_ns()
        publishers[topic].publish(raw)
        if topic != "/tf":
            put.append((stamp_ns, now_ns))
    time.sleep(2.0)
    transport.close()
    np.save(out, np.array(put, dtype=np.int64))


if __name__ == "__main__":
    if sys.argv[1] == "router":
        router(sys.argv[2])
    else:
        robot(sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), Path(sys.argv[5]))
