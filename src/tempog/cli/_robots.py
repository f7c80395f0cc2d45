"""How commands talk to robots."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from tempog.cli._output import print_note
from tempog.errors import ConfigError

if TYPE_CHECKING:
    from tempog.live.transport import Connection

ZENOH_ENDPOINT = "tcp/127.0.0.1:7447"

ZenohOption = Annotated[
    str | None,
    typer.Option("--zenoh", metavar="ENDPOINT", help=f"Router of ROS 2 nodes. Default: {ZENOH_ENDPOINT}"),
]
BridgeFlag = Annotated[
    bool, typer.Option("--bridge", help="The nodes are behind a zenoh-bridge-ros2dds, not on rmw_zenoh.")
]
Ros1Flag = Annotated[bool, typer.Option("--ros1", help="A ROS 1 master, at ROS_MASTER_URI, through rospy.")]
DomainOption = Annotated[int, typer.Option("--domain", min=0, max=232, help="ROS_DOMAIN_ID.")]
NamespaceOption = Annotated[
    str, typer.Option("--namespace", metavar="/NAME", help="Topics without a slash before them are in it.")
]


def connection_of(
    zenoh: str | None, bridge: bool, ros1: bool, domain: int, namespace: str, *, node: str, patient: bool = False
) -> Connection:
    """What the options say; ConfigError if they contradict each other."""
    from tempog.live.transport import Connection

    if ros1 and (zenoh is not None or bridge):
        raise ConfigError("--ros1 is another way to a robot than --zenoh and --bridge; give one or the other")
    kind = "ros1" if ros1 else "bridge" if bridge else "zenoh"
    return Connection(kind, zenoh or ZENOH_ENDPOINT, domain, namespace, node, patient)


def patience(stop: Callable[[], bool], quiet: bool) -> Callable[[str], bool]:
    """For `connect`: says once what it waits for, and goes on until told to stop."""
    said: list[str] = []

    def waiting(why: str) -> bool:
        if not said and not quiet:
            print_note(why)
        said.append(why)
        return not stop()

    return waiting
