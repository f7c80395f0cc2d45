"""ROS 1 through rospy, where it is installed: messages pass as bytes, so that no message package is needed."""

from __future__ import annotations

import importlib
import io
import logging
import os
import socket
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stderr
from typing import Any
from urllib.parse import urlsplit

from tempog.errors import ExtraError, LinkError
from tempog.live.transport import Connection, Received
from tempog.ros.messages import Codec, RosVersion

RETRY_S = 1.0
LOOK_S = 2.0  # s; between two looks at whether the master is still the same
TIMEOUT_S = 2.0  # s; a master that does not answer by then is not there
RUN_ID = "/run_id"  # a parameter that every roscore sets anew


class Ros1Transport:
    """A node of a ROS 1 master, which may go away and come back: all is then registered again.

    rospy allows one node in a process, for as long as that lives: so there is one of these at a time.

    Parameters
    ----------
    connection : Connection
    waiting : callable
        See `tempog.live.transport.connect`.
    """

    version: RosVersion = "ros1"

    def __init__(self, connection: Connection, waiting: Callable[[str], bool] = lambda _: True) -> None:
        self._rospy, self._rosgraph = _ros()
        self._codec = Codec("ros1")
        self._connection = connection
        self.where = f"the ROS 1 master at {self._rosgraph.get_master_uri()}"
        self._master = self._rosgraph.Master(f"/{connection.node}")
        self._subscribed: list[tuple[str, str, Received]] = []
        self._subscribers: list[Any] = []
        self._publishers: list[Ros1Publisher] = []
        self._changed = threading.Lock()
        self._connected = True
        self._look_again = time.monotonic() + LOOK_S
        while (run := self._run_id()) is None:
            if not waiting(f"there is no ROS master at {self._rosgraph.get_master_uri()} yet; start one: roscore"):
                raise LinkError(f"no ROS master was reached at {self._rosgraph.get_master_uri()}")
            time.sleep(RETRY_S)
        self._run = run
        if not self._rospy.core.is_initialized():
            logged = logging.root.handlers[:], logging.root.level
            with redirect_stderr(io.StringIO()):  # it says that it cannot log, as it is told not to
                self._rospy.init_node(connection.node, anonymous=True, disable_signals=True, disable_rosout=True)
            logging.root.handlers[:], logging.root.level = logged

    def subscribe(self, topic: str, msgtype: str, received: Received, *, latched: bool = False) -> None:
        """Call `received` with each message's bytes; whether it is latched is up to the publisher."""
        one = (self._connection.full_name(topic), _ros1_type(msgtype), received)
        self._subscribed.append(one)
        self._subscribers.append(self._subscriber(*one))

    def advertise(self, topic: str, msgtype: str, *, latched: bool = False) -> Ros1Publisher:
        """Begin to publish."""
        text, md5 = self._codec.definition(msgtype)
        raw = _raw_message(self._rospy, _ros1_type(msgtype), md5, text)
        name = self._connection.full_name(topic)

        def made() -> Any:
            queue = 0 if self._connection.patient else 10  # of messages per connection, for those who listen slowly
            return self._rospy.Publisher(name, raw, queue_size=queue, latch=latched)

        one = Ros1Publisher(made, raw, latched)
        self._publishers.append(one)
        return one

    def connected(self) -> bool:
        """Whether the master is there; if it is a new one, registers everything with it."""
        if time.monotonic() >= self._look_again:
            run = self._run_id()
            self._connected = run is not None
            if run is not None and run != self._run:
                self._register_again()
                self._run = run
            self._look_again = time.monotonic() + LOOK_S
        return self._connected

    def topics_of(self, msgtype: str) -> list[str]:
        """Topics of a type that somebody publishes."""
        try:
            topics = self._master.getPublishedTopics("")
        except (OSError, self._rosgraph.MasterException):
            return []
        return sorted(topic for topic, kind in topics if kind == _ros1_type(msgtype))

    def close(self) -> None:
        """Unregister; the process can be no other node afterwards."""
        for one in [*self._subscribers, *self._publishers]:
            one.unregister()
        self._rospy.signal_shutdown("tempog ends")

    def _subscriber(self, topic: str, kind: str, received: Received) -> Any:
        def take(message: Any) -> None:
            seen = message._connection_header.get("type", kind)
            if seen == kind:
                received(message._buff)

        return self._rospy.Subscriber(topic, self._rospy.AnyMsg, take, queue_size=None, tcp_nodelay=True)

    def _register_again(self) -> None:
        for one in self._subscribers:
            one.unregister()
        self._subscribers = [self._subscriber(*one) for one in self._subscribed]
        for publisher in self._publishers:
            publisher.make_again()

    def _run_id(self) -> str | None:
        """What tells one master from the next; None if there is none."""
        address = urlsplit(self._rosgraph.get_master_uri())
        try:  # xmlrpc itself would wait for minutes
            socket.create_connection((address.hostname, address.port or 11311), TIMEOUT_S).close()
            return str(self._master.getParam(RUN_ID))
        except self._rosgraph.MasterError:
            return "unnamed"  # a rosmaster without roscore
        except (OSError, self._rosgraph.MasterException):
            return None


class Ros1Publisher:
    """One topic that is written to; see `tempog.live.transport.Publisher`."""

    def __init__(self, made: Callable[[], Any], raw: Any, latched: bool) -> None:
        self._made, self._raw, self._latched = made, raw, latched
        self._publisher = made()
        self._last: bytes | None = None

    def publish(self, raw: bytes) -> None:
        """Send a message that is encoded already."""
        self._last = raw if self._latched else None
        message = self._raw()
        message._buff = raw
        self._publisher.publish(message)

    def make_again(self) -> None:
        """Register with the master that is there now, and latch the last message again."""
        self._publisher.unregister()
        self._publisher = self._made()
        if self._last is not None:
            self.publish(self._last)

    def unregister(self) -> None:
        """Publish no more."""
        self._publisher.unregister()


def _ros() -> tuple[Any, Any]:
    os.environ.setdefault("ROS_PYTHON_LOG_CONFIG_FILE", os.devnull)  # or rospy makes a directory of logs
    try:
        rosgraph, rospy = (importlib.import_module(name) for name in ("rosgraph", "rospy"))
    except ImportError as error:
        raise ExtraError(
            f"ROS 1 is reached through rospy, which cannot be imported here ({error}); install it as ROS or your"
            " system does (Debian: python3-rospy), then use a virtual environment with --system-site-packages, or set"
            " PYTHONPATH=/usr/lib/python3/dist-packages"
        ) from None
    return rospy, rosgraph


def _ros1_type(msgtype: str) -> str:
    return msgtype.replace("/msg/", "/")


def _raw_message(rospy: Any, kind: str, md5: str, text: str) -> Any:
    """A class of messages that are written as the bytes they are."""

    def serialize(self: Any, buffer: Any) -> None:
        buffer.write(self._buff)

    fields = {"_type": kind, "_md5sum": md5, "_full_text": text, "_has_header": False, "serialize": serialize}
    return type("RawMessage", (rospy.AnyMsg,), fields)
