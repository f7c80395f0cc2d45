"""A robot to be live with: in memory, through a Zenoh router or a ROS 1 master that are processes of their own."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tempog.live.transport import Connection
from tempog.ros.messages import LASER_SCAN, TF_MESSAGE, Codec
from tempog.scans.bag_writer import Frames, Mount, messages_of, static_messages
from tempog.scans.scan import Scan

ROUTER = """
import json, sys, zenoh
config = zenoh.Config()
for key, value in {
    "mode": sys.argv[2], "listen/endpoints": [sys.argv[1]],
    "scouting/multicast/enabled": False, "scouting/gossip/enabled": False,
}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
print("up", flush=True)
sys.stdin.read()
"""
ROS1_PYTHON = Path("/usr/lib/python3/dist-packages")
PATIENCE_S = 60.0  # a machine that does five other things


class Memory:
    """A transport within the process: what is published is received at once, by all that subscribe."""

    def __init__(self, version="ros2"):
        self.version, self.where, self.is_connected = version, "memory", True
        self.subscribed: dict[str, list[Callable[[bytes], None]]] = {}
        self.sent: dict[str, list[bytes]] = {}
        self.latched: dict[str, bytes] = {}
        self.types: dict[str, str] = {}

    def subscribe(self, topic, msgtype, received, *, latched=False):
        self.subscribed.setdefault(topic, []).append(received)
        if latched and topic in self.latched:
            received(self.latched[topic])

    def advertise(self, topic, msgtype, *, latched=False):
        self.types[topic] = msgtype
        return MemoryPublisher(self, topic, latched)

    def connected(self):
        return self.is_connected

    def topics_of(self, msgtype):
        return sorted(topic for topic, kind in self.types.items() if kind == msgtype)

    def close(self):
        self.subscribed.clear()

    def texts(self, topic):
        """What was sent there as String."""
        codec = Codec(self.version)
        return [codec.decode(raw, "std_msgs/msg/String").data for raw in self.sent.get(topic, [])]


class MemoryPublisher:
    def __init__(self, memory, topic, latched):
        self.memory, self.topic, self.latched = memory, topic, latched

    def publish(self, raw):
        self.memory.sent.setdefault(self.topic, []).append(raw)
        if self.latched:
            self.memory.latched[self.topic] = raw
        for received in self.memory.subscribed.get(self.topic, []):
            received(raw)


class Robot:
    """Publishes scans and transforms one by one."""

    def __init__(self, transport, mount: Mount | None = None, frames: Frames | None = None):
        self.mount, self.frames = mount or Mount(), frames or Frames()
        self.codec = Codec(transport.version)
        self.publishers = {
            "/tf_static": transport.advertise("/tf_static", TF_MESSAGE, latched=True),
            "/tf": transport.advertise("/tf", TF_MESSAGE),
            self.mount.topic: transport.advertise(self.mount.topic, LASER_SCAN),
        }
        self.before: Scan | None = None

    def is_heard(self) -> bool:
        """Whether it knows, through Zenoh, that it is listened to; before, it keeps quiet."""
        plain = [self.publishers[topic]._publisher for topic in ("/tf", self.mount.topic)]
        return all(publisher.matching_status.matching for publisher in plain)

    def stand(self) -> None:
        """Say where the laser sits."""
        for message in static_messages(self.codec, [self.mount], self.frames):
            self.publishers[message.topic].publish(self.codec.encode(message.message))

    def say(self, scan: Scan, *, only: str = "") -> None:
        """Say where it is, then what it sees; or only one of both."""
        for message in messages_of(scan, self.codec, self.mount, self.frames, self.before):
            if not only or message.topic == only:
                self.publishers[message.topic].publish(self.codec.encode(message.message))
        self.before = scan


def until(true: Callable[[], object], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for something to become true, but not for ever."""
    stop_s = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < stop_s, f"{what} did not happen within {patience_s:g} s"
        time.sleep(0.02)


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Router:
    """A Zenoh router, or peer, on this machine that can be killed and started again."""

    def __init__(self, mode: str = "router") -> None:
        self.mode = mode
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", ROUTER, self.endpoint, self.mode], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == b"up\n"

    def kill(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None

    def connection(self, kind: str = "zenoh", **settings) -> Connection:
        return Connection(kind, self.endpoint, **settings)


@contextmanager
def zenoh_router(mode: str = "router") -> Iterator[Router]:
    router = Router(mode)
    router.start()
    try:
        yield router
    finally:
        router.kill()


class Master:
    """Debian's roscore on a port of its own."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.uri = f"http://127.0.0.1:{self.port}"
        paths = [os.environ.get("PYTHONPATH", ""), str(Path(__file__).parents[1] / "src"), str(ROS1_PYTHON)]
        self.environment = {
            **os.environ,
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder),
            "ROS_LOG_DIR": str(folder),
            "PYTHONPATH": os.pathsep.join(path for path in paths if path),
        }
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        own = {name: value for name, value in self.environment.items() if name != "PYTHONPATH"}
        self.process = subprocess.Popen(
            [str(shutil.which("roscore")), "-p", str(self.port)],
            env=own,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        until(self.answers, "a ROS master's start")

    def answers(self) -> bool:
        try:
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
        except OSError:
            return False
        return True

    def stop(self) -> None:
        if self.process is not None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)  # a session of its own: nobody else's
                self.process.wait()
            self.process = None


def start_tempog(*words: object, env: dict[str, str] | None = None) -> subprocess.Popen[str]:
    """``tempog WORDS...`` as a process."""
    command = [sys.executable, "-m", "tempog", *(str(word) for word in words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env)
