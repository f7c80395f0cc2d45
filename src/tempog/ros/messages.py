"""ROS messages as bytes and as numbers, for ROS 1 and ROS 2, without a ROS installation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog._extras import need
from tempog.errors import MessageError
from tempog.times import NS_PER_S

RosVersion = Literal["ros1", "ros2"]

LASER_SCAN = "sensor_msgs/msg/LaserScan"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
OLD_TF_MESSAGE = "tf/msg/tfMessage"  # before ROS Hydro; the same bytes
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"
STRING = "std_msgs/msg/String"

NOT_IN_ROSBAGS = {TF_MESSAGE: "geometry_msgs/TransformStamped[] transforms"}  # as of its ROS 1 definitions
MAX_SEC = 2**31 - 1  # s; ROS 1 itself has 32 bits without a sign, which rosbags takes for one with
MOST_SWEEP_S = 60.0  # s; a laser on a slow tilting mount takes some seconds
UNKNOWN_CELL = -1  # of an OccupancyGrid


def yawed(theta: float) -> tuple[float, float, float, float]:
    """The quaternion x, y, z, w of a turn in the plane, by radians."""
    return 0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2)


class StampedTransform(NamedTuple):
    """Where a frame is in its parent's: metres, and a quaternion x, y, z, w.

    `child` is empty where a message does not say which frame it is about.
    """

    stamp_ns: int
    parent: str
    child: str
    translation: tuple[float, float, float]
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Sweep:
    """One sweep of a laser in its own frame: what a LaserScan says.

    Attributes
    ----------
    stamp_ns : int
        Of the first ray.
    frame : str
    angles : (n_beams,) float64, radians
    ranges : (n_beams,) float32, metres
        As a `Scan` wants them: NaN says nothing, inf is no return.
    max_range : float, metres
        Readings from here on are no returns.
    time_increment_s : float, seconds
        From one ray to the next; 0 if all rays were taken at once, or the driver does not say.
    """

    stamp_ns: int
    frame: str
    angles: NDArray[np.float64]
    ranges: NDArray[np.float32]
    max_range: float = math.inf
    time_increment_s: float = 0.0

    @property
    def stop_ns(self) -> int:
        """When the last ray was taken."""
        return self.stamp_ns + round(self.time_increment_s * max(0, len(self.ranges) - 1) * NS_PER_S)


class Codec:
    """Messages to bytes and back: CDR for ROS 2, its own format for ROS 1.

    Parameters
    ----------
    version : "ros1" or "ros2"
    store : rosbags.typesys.store.Typestore, optional
        Definitions, as of a bag. Default: those of ROS Noetic, or of ROS 2 Jazzy.

    Raises
    ------
    ExtraError
        The package rosbags is not installed.

    Examples
    --------
    >>> codec = Codec("ros2")
    >>> raw = codec.encode(string(codec, "door 4 is open"))
    >>> raw[:4], codec.decode(raw, STRING).data
    (b'\\x00\\x01\\x00\\x00', 'door 4 is open')
    """

    def __init__(self, version: RosVersion, store: Any = None) -> None:
        self.version = version
        self.store = _default_store(version) if store is None else store

    def decode(self, raw: bytes | memoryview, msgtype: str) -> Any:
        """The message in some bytes; MessageError if they hold none."""
        self._require(msgtype)
        read = self.store.deserialize_ros1 if self.version == "ros1" else self.store.deserialize_cdr
        try:
            return read(raw, msgtype)
        except Exception as error:  # whatever the decoder stumbles over: bytes can be anything
            raise MessageError(f"{len(raw)} bytes are no {msgtype}: {error}") from None

    def encode(self, message: Any) -> bytes:
        """A message as bytes; MessageError if a field does not fit its type."""
        write = self.store.serialize_ros1 if self.version == "ros1" else self.store.serialize_cdr
        try:
            return bytes(write(message, message.__msgtype__))
        except Exception as error:
            raise MessageError(f"a {message.__msgtype__} cannot be written: {error}") from None

    def make(self, msgtype: str, **fields: Any) -> Any:
        """A message with these fields."""
        self._require(msgtype)
        return self.store.types[msgtype](**fields)

    def definition(self, msgtype: str) -> tuple[str, str]:
        """Text of a type's definition, with all that it is made of, and its MD5 (ROS 1) or type hash (ROS 2)."""
        self._require(msgtype)
        text, md5 = self.store.generate_msgdef(msgtype, ros_version=1 if self.version == "ros1" else 2)
        return text, md5 if self.version == "ros1" else self.store.hash_rihs01(msgtype)

    def stamp(self, stamp_ns: int) -> Any:
        """A time; MessageError for one that the ROS version has no bits for."""
        sec, nanosec = divmod(stamp_ns, NS_PER_S)
        if not 0 <= sec <= MAX_SEC:
            raise MessageError(f"{stamp_ns} ns is no time in {self.version} (wanted: 0 to {MAX_SEC} s)")
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def header(self, stamp_ns: int, frame: str) -> Any:
        """A header."""
        counter = {"seq": 0} if self.version == "ros1" else {}
        return self.make("std_msgs/msg/Header", **counter, stamp=self.stamp(stamp_ns), frame_id=frame)

    def _require(self, msgtype: str) -> None:
        if msgtype not in self.store.types:
            raise MessageError(f"nobody has said what a {msgtype} is made of: its definition is missing")


@cache
def _default_store(version: RosVersion) -> Any:
    typesys = need("rosbags.typesys", "bags")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if version == "ros1" else typesys.Stores.ROS2_JAZZY)
    for msgtype, text in NOT_IN_ROSBAGS.items():
        if msgtype not in store.types:
            store.register(typesys.get_types_from_msg(text, msgtype))
    return store


def frame_name(text: str) -> str:
    """A frame without the slash that old ROS put before it."""
    return text.lstrip("/")


def stamp_ns_of(stamp: Any) -> int:
    """A time of a message in nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def sweep_of(message: Any) -> Sweep:
    """What a LaserScan says, after REP 117; MessageError if its angles or ranges make no sweep.

    Readings below `range_min` say nothing. `angle_min` and `angle_increment` are float32 in the message; the angles
    are worked out in float64. Intensities are not used.
    """
    ranges = np.asarray(message.ranges, dtype=np.float32)
    angles = _beam_angles(float(message.angle_min), float(message.angle_increment), len(ranges))
    if message.range_min > 0:
        ranges = np.where(ranges < message.range_min, np.float32(np.nan), ranges)
    ranges.flags.writeable = False
    increment_s = float(message.time_increment)
    if MOST_SWEEP_S < increment_s * len(ranges) < math.inf:
        raise MessageError(f"time_increment {increment_s:g} s makes a sweep of {increment_s * len(ranges):.3g} s")
    return Sweep(
        stamp_ns_of(message.header.stamp),
        frame_name(message.header.frame_id),
        angles,
        ranges,
        float(message.range_max) if message.range_max > 0 else math.inf,
        increment_s if 0 < increment_s < math.inf else 0.0,
    )


@lru_cache(maxsize=32)  # lasers say the same thing with every sweep
def _beam_angles(angle_min: float, increment: float, n_beams: int) -> NDArray[np.float64]:
    with np.errstate(all="ignore"):
        angles: NDArray[np.float64] = angle_min + np.arange(n_beams, dtype=np.float64) * increment
    if not np.isfinite(angles).all() or (n_beams > 1 and increment == 0):
        raise MessageError(f"angle_min {angle_min!r} and angle_increment {increment!r} make no {n_beams} beams")
    angles.flags.writeable = False
    return angles


def transforms_of(message: Any) -> list[StampedTransform]:
    """What a TFMessage says."""
    return [
        _stamped(one.header, one.child_frame_id, one.transform.translation, one.transform.rotation)
        for one in message.transforms
    ]


def pose_of(message: Any) -> StampedTransform:
    """What an Odometry, a PoseWithCovarianceStamped or a PoseStamped says; only the first names its frame."""
    pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    return _stamped(message.header, getattr(message, "child_frame_id", ""), pose.position, pose.orientation)


def _stamped(header: Any, child: str, at: Any, turned: Any) -> StampedTransform:
    return StampedTransform(
        stamp_ns_of(header.stamp),
        frame_name(header.frame_id),
        frame_name(child),
        (at.x, at.y, at.z),
        (turned.x, turned.y, turned.z, turned.w),
    )


def laser_scan(codec: Codec, sweep: Sweep, range_min: float = 0.0) -> Any:
    """A LaserScan; its beams must be evenly spaced."""
    n_beams = len(sweep.angles)
    first, last = (float(sweep.angles[k]) for k in (0, -1)) if n_beams else (0.0, 0.0)
    return codec.make(
        LASER_SCAN,
        header=codec.header(sweep.stamp_ns, sweep.frame),
        angle_min=first,
        angle_max=last,
        angle_increment=(last - first) / max(1, n_beams - 1),
        time_increment=sweep.time_increment_s,
        scan_time=sweep.time_increment_s * n_beams,
        range_min=range_min,
        range_max=min(sweep.max_range, float(np.finfo(np.float32).max)),
        ranges=sweep.ranges,
        intensities=np.empty(0, dtype=np.float32),
    )


def tf_message(codec: Codec, transforms: Sequence[StampedTransform]) -> Any:
    """A TFMessage."""
    return codec.make(
        TF_MESSAGE,
        transforms=[
            codec.make(
                "geometry_msgs/msg/TransformStamped",
                header=codec.header(one.stamp_ns, one.parent),
                child_frame_id=one.child,
                transform=codec.make(
                    "geometry_msgs/msg/Transform",
                    translation=vector(codec, one.translation),
                    rotation=quaternion(codec, one.quaternion),
                ),
            )
            for one in transforms
        ],
    )


def vector(codec: Codec, xyz: tuple[float, float, float], msgtype: str = "geometry_msgs/msg/Vector3") -> Any:
    """A Vector3 or a Point."""
    return codec.make(msgtype, x=xyz[0], y=xyz[1], z=xyz[2])


def quaternion(codec: Codec, xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)) -> Any:
    """A Quaternion."""
    return codec.make("geometry_msgs/msg/Quaternion", x=xyzw[0], y=xyzw[1], z=xyzw[2], w=xyzw[3])


def pose(codec: Codec, x: float, y: float, theta: float = 0.0) -> Any:
    """A Pose in the plane."""
    at = vector(codec, (x, y, 0.0), "geometry_msgs/msg/Point")
    return codec.make("geometry_msgs/msg/Pose", position=at, orientation=quaternion(codec, yawed(theta)))


def occupancy_grid(
    codec: Codec,
    stamp_ns: int,
    frame: str,
    resolution_m: float,
    origin_m: tuple[float, float],
    cells: NDArray[np.int8],
) -> Any:
    """An OccupancyGrid.

    Parameters
    ----------
    origin_m : (x, y), metres
        South-west corner of the first cell.
    cells : (n_rows, n_cols) int8
        0 free to 100 occupied, -1 unknown; row grows with y.
    """
    info = codec.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=codec.stamp(stamp_ns),
        resolution=resolution_m,
        width=cells.shape[1],
        height=cells.shape[0],
        origin=pose(codec, *origin_m),
    )
    data = np.ascontiguousarray(cells, dtype=np.int8).ravel()
    return codec.make(OCCUPANCY_GRID, header=codec.header(stamp_ns, frame), info=info, data=data)


def point_cloud(codec: Codec, stamp_ns: int, frame: str, points_m: NDArray[np.float64]) -> Any:
    """A PointCloud2 of points (n, 2) or (n, 3), metres."""
    xyz = np.zeros((len(points_m), 3), dtype="<f4")
    xyz[:, : points_m.shape[1]] = points_m
    float32 = 7  # PointField.FLOAT32
    fields = [
        codec.make("sensor_msgs/msg/PointField", name=name, offset=4 * k, datatype=float32, count=1)
        for k, name in enumerate("xyz")
    ]
    return codec.make(
        POINT_CLOUD,
        header=codec.header(stamp_ns, frame),
        height=1,
        width=len(xyz),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(xyz),
        data=xyz.view(np.uint8).ravel(),
        is_dense=True,
    )


def string(codec: Codec, text: str) -> Any:
    """A String."""
    return codec.make(STRING, data=text)
