"""How messages come in and go out, whatever carries them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from tempog.errors import ConfigError
from tempog.ros.messages import RosVersion

Received = Callable[[bytes], None]
"""Takes a message's bytes, in a thread of the transport's; must return at once."""

ZENOH_ENDPOINT = "tcp/127.0.0.1:7447"  # where a router of rmw_zenoh listens, on this machine
NODE = "tempog"
NAME = re.compile("[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*")  # of topics and namespaces, in ROS 1 and ROS 2


class Publisher(Protocol):
    """One topic that is written to."""

    def publish(self, raw: bytes) -> None:
        """Send a message that is encoded already."""


class Transport(Protocol):
    """A connection to a robot."""

    version: RosVersion
    where: str

    def subscribe(self, topic: str, msgtype: str, received: Received, *, latched: bool = False) -> None:
        """Call `received` with the bytes of each message; if latched, with the last ones before now as well."""

    def advertise(self, topic: str, msgtype: str, *, latched: bool = False) -> Publisher:
        """Begin to publish; who subscribes to a latched topic later gets its last message."""

    def connected(self) -> bool:
        """Whether a router or master is there. Also mends what its restart broke; call it every second or so."""

    def topics_of(self, msgtype: str) -> list[str]:
        """Topics of a type that somebody publishes, as far as is known."""

    def close(self) -> None:
        """End the connection."""


@dataclass(frozen=True)
class Connection:
    """Which robot to talk to, and how.

    Attributes
    ----------
    kind : "zenoh", "bridge" or "ros1"
        ROS 2 nodes that run rmw_zenoh, ROS 2 nodes behind a zenoh-bridge-ros2dds, or a ROS 1 master.
    endpoint : str
        Of the Zenoh router.
    domain : int
        ROS_DOMAIN_ID; a bridge has put its own in place.
    namespace : str
        Topics that do not begin with a slash are in it: ``/r1``.
    node : str
        Our own name.
    patient : bool
        Whether publishing waits for a slow network, instead of dropping messages.
    """

    kind: str = "zenoh"
    endpoint: str = ZENOH_ENDPOINT
    domain: int = 0
    namespace: str = ""
    node: str = NODE
    patient: bool = False

    def __post_init__(self) -> None:
        if self.kind not in ("zenoh", "bridge", "ros1"):
            raise ConfigError(f"kind = {self.kind!r} is unknown; wanted zenoh, bridge or ros1")
        if not 0 <= self.domain <= 232:
            raise ConfigError(f"domain = {self.domain} cannot work; wanted a ROS_DOMAIN_ID from 0 to 232")
        if self.namespace.strip("/"):
            _require_name(self.namespace, "namespace")

    def full_name(self, topic: str) -> str:
        """A topic with the namespace, and one slash before it.

        >>> Connection(namespace="r1").full_name("scan"), Connection(namespace="/r1/").full_name("/tf")
        ('/r1/scan', '/tf')
        """
        _require_name(topic, "topic")
        if topic.startswith("/"):
            return f"/{topic.strip('/')}"
        return "/" + "/".join(part for part in (self.namespace.strip("/"), topic.strip("/")) if part)


def _require_name(text: str, what: str) -> None:
    if not NAME.fullmatch(text.strip("/")):
        raise ConfigError(f"{text!r} is no name of a ROS {what}; wanted letters, digits and _, such as /r1/scan")


def connect(connection: Connection, waiting: Callable[[str], bool] = lambda _: True) -> Transport:
    """Connect; `waiting` is told each second why that takes long, and says whether to go on trying.

    Raises
    ------
    ExtraError
        The packages for it are not installed.
    LinkError
        It was told not to go on, or the settings can never work.
    """
    if connection.kind == "ros1":
        from tempog.live.ros1 import Ros1Transport

        return Ros1Transport(connection, waiting)
    from tempog.live.zenoh_ros2 import ZenohTransport

    return ZenohTransport(connection, waiting)
