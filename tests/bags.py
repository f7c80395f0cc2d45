"""A robot that drives through an empty room, and bags of what it would record."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tempog.ros.bag_writers import OutMessage, open_bag_writer
from tempog.ros.messages import Codec, StampedTransform, Sweep, laser_scan, quaternion, tf_message, vector
from tempog.scans.scan import Scan

ROOM_M = (10.0, 6.0)  # from (0, 0)
START_NS = 1_700_000_000_000_000_000
START_S = START_NS / 1e9
BEAMS = np.linspace(-3.0, 3.0, 121)


def pose_at(t: float) -> tuple[float, float, float]:
    """Of the laser, in seconds after the start: straight on, and turning."""
    return 2.0 + 0.5 * t, 3.0 - 0.1 * t, 0.3 * t


def distance(x: NDArray[np.float64], y: NDArray[np.float64], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """To the room's walls, from inside."""
    cos, sin = np.cos(theta), np.sin(theta)
    with np.errstate(divide="ignore"):
        along_x = np.where(cos > 0, (ROOM_M[0] - x) / cos, -x / cos)
        along_y = np.where(sin > 0, (ROOM_M[1] - y) / sin, -y / sin)
    return np.minimum(np.where(cos == 0, np.inf, along_x), np.where(sin == 0, np.inf, along_y))


def room_scan(t: float, sweep_s: float = 0.0, angles: NDArray[np.float64] = BEAMS) -> Scan:
    """What the laser sees, each ray from where it is then."""
    when = t + np.linspace(0, sweep_s, len(angles))
    x, y, theta = pose_at(when)
    ranges = distance(x, y, theta + angles)
    return Scan(0.0, pose_at(t), angles, ranges, 30.0, stamp_ns=START_NS + round(t * 1e9))


def room_scans(n: int = 20, period_s: float = 0.1, **how: object) -> list[Scan]:
    return [room_scan(k * period_s, **how) for k in range(n)]


def wall_distance(scan: Scan) -> NDArray[np.float64]:
    """How far each end point is from the nearest wall of the room."""
    away = scan.ranges.astype(np.float64)
    x = scan.x + away * np.cos(scan.theta + scan.angles)
    y = scan.y + away * np.sin(scan.theta + scan.angles)
    return np.min([np.abs(x), np.abs(x - ROOM_M[0]), np.abs(y), np.abs(y - ROOM_M[1])], axis=0)


def write_messages(path: Path, messages: Iterable[OutMessage], compression: str = "none") -> Path:
    with open_bag_writer(path, compression=compression) as bag:
        for message in messages:
            bag.write(message)
    return path


def sweep_messages(
    codec: Codec, scans: Sequence[Scan], topic: str = "/scan", frame: str = "laser", every: int = 1
) -> list[OutMessage]:
    """LaserScan messages alone; `every` second beam, say."""
    return [
        OutMessage(
            topic,
            scan.stamp_ns,
            laser_scan(
                codec, Sweep(scan.stamp_ns, frame, scan.angles[::every], scan.ranges[::every].copy(), scan.max_range)
            ),
        )
        for scan in scans
    ]


def transform(t: float, parent: str, child: str, x: float = 0.0, y: float = 0.0, theta: float = 0.0, z: float = 0.0):
    turned = (0.0, 0.0, float(np.sin(theta / 2)), float(np.cos(theta / 2)))
    return StampedTransform(START_NS + round(t * 1e9), parent, child, (x, y, z), turned)


def tf(codec: Codec, *transforms: StampedTransform, topic: str = "/tf") -> OutMessage:
    return OutMessage(topic, transforms[0].stamp_ns, tf_message(codec, transforms), latched="static" in topic)


def moving(codec: Codec, times: Iterable[float], parent: str = "odom", child: str = "base_link") -> list[OutMessage]:
    return [tf(codec, transform(t, parent, child, *pose_at(t))) for t in times]


def odometry(
    codec: Codec, t: float, frame: str = "odom", child: str = "base_link", topic: str = "/odom"
) -> OutMessage:
    """An Odometry of where the robot is."""
    twist = codec.make("geometry_msgs/msg/Twist", linear=vector(codec, (0, 0, 0)), angular=vector(codec, (0, 0, 0)))
    message = codec.make(
        "nav_msgs/msg/Odometry",
        header=codec.header(START_NS + round(t * 1e9), frame),
        child_frame_id=child,
        pose=_pose_with_covariance(codec, t),
        twist=codec.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )
    return OutMessage(topic, START_NS + round(t * 1e9), message)


def amcl_pose(codec: Codec, t: float, frame: str = "map", topic: str = "/amcl_pose") -> OutMessage:
    """A PoseWithCovarianceStamped of where the robot is."""
    header = codec.header(START_NS + round(t * 1e9), frame)
    message = codec.make(
        "geometry_msgs/msg/PoseWithCovarianceStamped", header=header, pose=_pose_with_covariance(codec, t)
    )
    return OutMessage(topic, START_NS + round(t * 1e9), message)


def stamped_pose(codec: Codec, t: float, frame: str = "map", topic: str = "/slam_pose") -> OutMessage:
    """A PoseStamped of where the robot is."""
    header = codec.header(START_NS + round(t * 1e9), frame)
    message = codec.make("geometry_msgs/msg/PoseStamped", header=header, pose=_pose(codec, t))
    return OutMessage(topic, START_NS + round(t * 1e9), message)


def _pose(codec: Codec, t: float) -> object:
    x, y, theta = pose_at(t)
    turned = quaternion(codec, (0.0, 0.0, float(np.sin(theta / 2)), float(np.cos(theta / 2))))
    return codec.make(
        "geometry_msgs/msg/Pose", position=vector(codec, (x, y, 0.0), "geometry_msgs/msg/Point"), orientation=turned
    )


def _pose_with_covariance(codec: Codec, t: float) -> object:
    return codec.make("geometry_msgs/msg/PoseWithCovariance", pose=_pose(codec, t), covariance=np.zeros(36))
