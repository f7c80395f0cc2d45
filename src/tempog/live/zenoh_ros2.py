"""ROS 2 over Zenoh without a ROS installation: as a node that runs rmw_zenoh, or beside a zenoh-bridge-ros2dds."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from tempog._extras import need
from tempog.errors import ConfigError, LinkError
from tempog.live import ros2_names as names
from tempog.live.transport import Connection, Received
from tempog.ros.messages import Codec, RosVersion

RETRY_S = 1.0
LATCHED_DEPTH = 1  # messages; as a map server and a static transform publisher keep them
PLAIN_DEPTH = 10
HEARTBEAT_S = 0.5  # s; tells subscribers the number of the last latched message, so that they miss none


class ZenohTransport:
    """A client of a Zenoh router.

    Nothing is scouted for by multicast, and no port is opened: all goes through the router. It may come later, go
    away and come back; subscriptions, latched messages and tokens are then declared again by Zenoh itself.

    Parameters
    ----------
    connection : Connection
    waiting : callable
        See `tempog.live.transport.connect`.
    """

    version: RosVersion = "ros2"

    def __init__(self, connection: Connection, waiting: Callable[[str], bool] = lambda _: True) -> None:
        self._zenoh, self._ext = need("zenoh", "live"), need("zenoh.ext", "live")
        self._codec = Codec("ros2")
        self._connection = connection
        self._bridge = connection.kind == "bridge"
        keys = "zenoh-bridge-ros2dds" if self._bridge else f"rmw_zenoh, domain {connection.domain}"
        self.where = f"Zenoh at {connection.endpoint}, keys of {keys}"
        self._session = self._opened(waiting)
        self._id = str(self._session.zid())
        self._kept: list[Any] = []  # declarations end with the objects that stand for them
        self._n_endpoints = 0
        self._lock = threading.Lock()
        self._endpoints: dict[str, names.Endpoint] = {}
        if not self._bridge:
            domain, namespace = connection.domain, connection.namespace
            tokens = self._session.liveliness()
            self._kept.append(tokens.declare_token(names.node_token(domain, self._id, namespace, connection.node)))
            self._kept.append(
                tokens.declare_subscriber(f"{names.TOKENS}/{domain}/*/*/*/MP/**", self._seen, history=True)
            )

    def subscribe(self, topic: str, msgtype: str, received: Received, *, latched: bool = False) -> None:
        """Call `received` with each message's bytes."""
        topic = self._connection.full_name(topic)
        put = self._zenoh.SampleKind.PUT

        def take(sample: Any) -> None:
            if sample.kind == put:
                received(sample.payload.to_bytes())

        domain = self._connection.domain
        key = names.bridge_key(topic) if self._bridge else names.topic_key(domain, topic, msgtype)
        if latched:
            subscriber = self._ext.declare_advanced_subscriber(
                self._session,
                key,
                take,
                history=self._ext.HistoryConfig(detect_late_publishers=True),
                recovery=self._ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                subscriber_detection=True,
            )
        else:
            subscriber = self._session.declare_subscriber(key, take)
        self._kept.append(subscriber)
        self._declare(names.SUBSCRIPTION, topic, msgtype, latched)

    def advertise(self, topic: str, msgtype: str, *, latched: bool = False) -> ZenohPublisher:
        """Begin to publish."""
        topic = self._connection.full_name(topic)
        type_hash = self._codec.definition(msgtype)[1]
        domain = self._connection.domain
        key = names.bridge_key(topic) if self._bridge else names.topic_key(domain, topic, msgtype, type_hash)
        control = self._zenoh.CongestionControl
        congestion = control.BLOCK if self._connection.patient else control.DROP
        if latched:
            publisher = self._ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=congestion,
                cache=self._ext.CacheConfig(LATCHED_DEPTH),
                publisher_detection=True,
                sample_miss_detection=self._ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
            )
        else:
            publisher = self._session.declare_publisher(key, congestion_control=congestion)
        token = self._declare(names.PUBLISHER, topic, msgtype, latched)
        one = ZenohPublisher(publisher, None if self._bridge else names.gid_of(token))
        self._kept.append(publisher)
        return one

    def connected(self) -> bool:
        """Whether the router is there, or the peer: a bridge may be either."""
        return bool(self._session.info.routers_zid() or self._session.info.peers_zid())

    def topics_of(self, msgtype: str) -> list[str]:
        """Topics of a type that nodes of rmw_zenoh publish; a bridge's are not known."""
        with self._lock:
            return sorted({one.topic for one in self._endpoints.values() if one.msgtype == msgtype})

    def close(self) -> None:
        """End the session, and with it all that was declared."""
        with suppress(self._zenoh.ZError):  # a router that hangs; it will notice that nobody is there
            self._session.close()

    def _declare(self, kind: str, topic: str, msgtype: str, latched: bool) -> str:
        """Say on the network that an endpoint is there, as `ros2 topic info` shows it; returns its token."""
        self._n_endpoints += 1
        token = names.endpoint_token(
            self._connection.domain,
            self._id,
            self._n_endpoints,
            kind,
            self._connection.namespace,
            self._connection.node,
            topic,
            msgtype,
            self._codec.definition(msgtype)[1],
            names.quality(depth=LATCHED_DEPTH if latched else PLAIN_DEPTH, latched=latched),
        )
        if not self._bridge:
            self._kept.append(self._session.liveliness().declare_token(token))
        return token

    def _seen(self, sample: Any) -> None:
        token = str(sample.key_expr)
        with self._lock:
            if sample.kind != self._zenoh.SampleKind.PUT:
                self._endpoints.pop(token, None)
            elif (endpoint := names.endpoint_of(token)) is not None and f"/{self._id}/" not in token:
                self._endpoints[token] = endpoint

    def _opened(self, waiting: Callable[[str], bool]) -> Any:
        endpoint = self._connection.endpoint
        settings = {
            "mode": "client",
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": 0,
            "connect/retry": {"period_init_ms": 250, "period_max_ms": 2000, "period_increase_factor": 2},
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "timestamping/enabled": True,  # subscribers of latched topics put messages in order by it
        }
        config = self._zenoh.Config()
        try:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
        except self._zenoh.ZError as error:
            why = str(error).split(" at ")[0]
            raise ConfigError(
                f"{endpoint!r} is no Zenoh endpoint ({why}); wanted one like tcp/127.0.0.1:7447"
            ) from None
        while True:
            try:
                return self._zenoh.open(config)
            except self._zenoh.ZError:
                start = "start one: ros2 run rmw_zenoh_cpp rmw_zenohd"
                if not waiting(f"there is no Zenoh router at {endpoint} yet; {start}"):
                    raise LinkError(f"no Zenoh router was reached at {endpoint}") from None
                time.sleep(RETRY_S)


class ZenohPublisher:
    """One topic that is written to; see `tempog.live.transport.Publisher`."""

    def __init__(self, publisher: Any, gid: bytes | None) -> None:
        self._publisher, self._gid = publisher, gid
        self._n = 0

    def publish(self, raw: bytes) -> None:
        """Send a message that is encoded already."""
        self._n += 1
        if self._gid is None:
            self._publisher.put(raw)
        else:
            self._publisher.put(raw, attachment=names.attachment(self._n, time.time_ns(), self._gid))
