"""What ROS 2 topics, their publishers and their messages are called on a Zenoh network.

After the sources and docs/design.md of rmw_zenoh (Jazzy and later), and those of zenoh-plugin-ros2dds.
"""

from __future__ import annotations

import hashlib
import struct
from typing import NamedTuple

TOKENS = "@ros2_lv"  # the part of the network where nodes, publishers and subscriptions say that they are there
NODE, PUBLISHER, SUBSCRIPTION = "NN", "MP", "MS"
TRANSIENT_LOCAL, BEST_EFFORT = "1", "2"  # of rmw's enumerations; what is left out is the default
ATTACHMENT = struct.Struct("<qqB16s")  # the third is the length of the fourth
GID_BYTES = 16


def dds_type(msgtype: str) -> str:
    """A type's name in keys.

    >>> dds_type("sensor_msgs/msg/LaserScan")
    'sensor_msgs::msg::dds_::LaserScan_'
    """
    package, kind, name = msgtype.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_type(text: str) -> str:
    """The opposite of `dds_type`; text that is none stays as it is."""
    parts = text.split("::")
    return f"{parts[0]}/{parts[1]}/{parts[3].removesuffix('_')}" if len(parts) == 4 else text


def topic_key(domain: int, topic: str, msgtype: str, type_hash: str = "*") -> str:
    """The key that messages of a topic are put to; by default a pattern for any version of the type.

    >>> topic_key(0, "/r1/scan", "sensor_msgs/msg/LaserScan")
    '0/r1/scan/sensor_msgs::msg::dds_::LaserScan_/*'
    """
    return f"{domain}/{topic.strip('/')}/{dds_type(msgtype)}/{type_hash}"


def bridge_key(topic: str) -> str:
    """The key of a topic behind a zenoh-bridge-ros2dds.

    >>> bridge_key("/r1/scan")
    'r1/scan'
    """
    return topic.strip("/")


def quality(*, depth: int, latched: bool = False, best_effort: bool = False) -> str:
    """How a publisher or subscription says its quality of service; what is default is left out.

    >>> quality(depth=7), quality(depth=1, latched=True)
    ('::,7:,:,:,,', ':1:,1:,:,:,,')
    """
    return f"{BEST_EFFORT * best_effort}:{TRANSIENT_LOCAL * latched}:,{depth}:,:,:,,"


def node_token(domain: int, session: str, namespace: str, node: str) -> str:
    """The token of a node that is there; it is the first of its session.

    >>> node_token(2, "aac3", "", "listener")
    '@ros2_lv/2/aac3/0/0/NN/%/%/listener'
    """
    return f"{TOKENS}/{domain}/{session}/0/0/{NODE}/%/{_mangled(namespace)}/{node}"


def endpoint_token(
    domain: int,
    session: str,
    number: int,
    kind: str,
    namespace: str,
    node: str,
    topic: str,
    msgtype: str,
    type_hash: str,
    qos: str,
) -> str:
    """The token of a publisher or a subscription of a node."""
    owner = f"{TOKENS}/{domain}/{session}/0/{number}/{kind}/%/{_mangled(namespace)}/{node}"
    return f"{owner}/{_mangled(topic)}/{dds_type(msgtype)}/{type_hash}/{qos}"


class Endpoint(NamedTuple):
    """A publisher or subscription somewhere on the network."""

    kind: str
    topic: str
    msgtype: str


def endpoint_of(token: str) -> Endpoint | None:
    """What a token stands for; None if for something else.

    >>> endpoint_of("@ros2_lv/0/8b/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/RIHS01_df/::,7:,:,:,,")
    Endpoint(kind='MP', topic='/chatter', msgtype='std_msgs/msg/String')
    """
    parts = token.split("/")
    if len(parts) < 13 or parts[0] != TOKENS or parts[5] not in (PUBLISHER, SUBSCRIPTION):
        return None
    return Endpoint(parts[5], parts[9].replace("%", "/"), ros_type(parts[10]))


def gid_of(token: str) -> bytes:
    """A publisher's 16 bytes of identity.

    rmw_zenoh uses XXH3-128 of the token. Receivers only compare them, so any digest that differs will do.
    """
    return hashlib.md5(token.encode(), usedforsecurity=False).digest()


def attachment(number: int, stamp_ns: int, gid: bytes) -> bytes:
    """What goes with each message: its number from 1, when it was sent, who sent it; 33 bytes.

    >>> len(attachment(1, 0, bytes(16)))
    33
    """
    return ATTACHMENT.pack(number, stamp_ns, GID_BYTES, gid)


def read_attachment(raw: bytes) -> tuple[int, int, bytes]:
    """The three parts of an attachment; ValueError if it is none."""
    if len(raw) != ATTACHMENT.size or raw[16] != GID_BYTES:
        raise ValueError(f"{len(raw)} bytes are no attachment; wanted {ATTACHMENT.size}")
    number, stamp_ns, _, gid = ATTACHMENT.unpack(raw)
    return number, stamp_ns, gid


def _mangled(name: str) -> str:
    return "%" + name.strip("/").replace("/", "%")
