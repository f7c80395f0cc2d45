"""ROS messages to bytes and back, held against ROS 1's own definitions where these are installed."""

from __future__ import annotations

import base64
import math
import re

import numpy as np
import pytest

import system_ros
from tempog.errors import MessageError
from tempog.ros.messages import (
    LASER_SCAN,
    OCCUPANCY_GRID,
    ODOMETRY,
    POINT_CLOUD,
    POSE,
    POSE_WITH_COVARIANCE,
    TF_MESSAGE,
    Codec,
    RosVersion,
    StampedTransform,
    Sweep,
    laser_scan,
    occupancy_grid,
    point_cloud,
    pose,
    pose_of,
    string,
    sweep_of,
    tf_message,
    transforms_of,
)

STAMP_NS = 1_700_000_000_123_456_789
needs_ros1 = pytest.mark.skipif(
    not system_ros.has("sensor_msgs.msg", "nav_msgs.msg", "tf2_msgs.msg"),
    reason="ROS 1's message definitions are not installed (Debian: python3-sensor-msgs, -nav-msgs, -tf2-msgs)",
)


@pytest.fixture(params=["ros1", "ros2"])
def codec(request: pytest.FixtureRequest) -> Codec:
    version: RosVersion = request.param
    return Codec(version)


def _sweep(**changed: object) -> Sweep:
    ranges = np.array([0.5, np.nan, 7.25, np.inf, 29.0], dtype=np.float32)
    fields: dict = {
        "stamp_ns": STAMP_NS,
        "frame": "laser",
        "angles": np.linspace(-1, 1, 5),
        "ranges": ranges,
        "max_range": 30.0,
        "time_increment_s": 0.001,
    }
    return Sweep(**(fields | changed))


def test_a_sweep_comes_back(codec: Codec) -> None:
    back = sweep_of(codec.decode(codec.encode(laser_scan(codec, _sweep())), LASER_SCAN))
    assert (back.stamp_ns, back.frame, back.max_range) == (STAMP_NS, "laser", 30.0)
    np.testing.assert_array_equal(back.ranges, _sweep().ranges)
    np.testing.assert_allclose(back.angles, _sweep().angles, atol=1e-6)
    assert back.stop_ns - back.stamp_ns == pytest.approx(4e6, rel=1e-6)


def test_angles_are_summed_up_in_float64(codec: Codec) -> None:
    angles = -2.35 + 0.00436332 * np.arange(1081)
    message = laser_scan(codec, _sweep(angles=angles, ranges=np.ones(1081, np.float32)))
    back = sweep_of(codec.decode(codec.encode(message), LASER_SCAN))
    first, step = np.float64(np.float32(angles[0])), np.float64(np.float32((angles[-1] - angles[0]) / 1080))
    np.testing.assert_allclose(back.angles, first + step * np.arange(1081), rtol=0, atol=1e-15)


def test_readings_too_near_say_nothing_and_slashes_of_old_ros_go(codec: Codec) -> None:
    message = laser_scan(codec, _sweep(frame="/laser", ranges=np.array([0.1, 0.3, np.inf, 1, 2], np.float32)), 0.2)
    back = sweep_of(codec.decode(codec.encode(message), LASER_SCAN))
    assert back.frame == "laser"
    assert np.isnan(back.ranges).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(("range_max", "wanted"), [(0.0, math.inf), (-1.0, math.inf), (math.nan, math.inf), (8, 8)])
def test_a_maximum_that_is_none_counts_as_none(codec: Codec, range_max: float, wanted: float) -> None:
    message = laser_scan(codec, _sweep())
    message.range_max = range_max
    assert sweep_of(codec.decode(codec.encode(message), LASER_SCAN)).max_range == wanted


@pytest.mark.parametrize(("name", "value"), [("angle_min", math.nan), ("angle_increment", 0.0)])
def test_angles_that_are_none_are_refused(codec: Codec, name: str, value: float) -> None:
    message = laser_scan(codec, _sweep())
    setattr(message, name, value)
    with pytest.raises(MessageError, match="make no 5 beams"):
        sweep_of(message)


def test_transforms_come_back(codec: Codec) -> None:
    wanted = [
        StampedTransform(STAMP_NS, "odom", "base", (1.0, -2.0, 0.5), (0.0, 0.0, 0.6, 0.8)),
        StampedTransform(0, "base", "laser", (0.0, 0.0, 0.0)),
    ]
    raw = codec.encode(tf_message(codec, wanted))
    assert transforms_of(codec.decode(raw, TF_MESSAGE)) == wanted


@pytest.mark.parametrize("msgtype", [ODOMETRY, POSE, POSE_WITH_COVARIANCE])
def test_poses_are_read(codec: Codec, msgtype: str) -> None:
    header, at = codec.header(STAMP_NS, "map"), pose(codec, 1.0, 2.0, math.pi / 2)
    covered = codec.make("geometry_msgs/msg/PoseWithCovariance", pose=at, covariance=np.zeros(36))
    zero = codec.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    twist = codec.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
    still = codec.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36))
    fields = {
        ODOMETRY: {"pose": covered, "child_frame_id": "base", "twist": still},
        POSE: {"pose": at},
        POSE_WITH_COVARIANCE: {"pose": covered},
    }[msgtype]
    message = codec.decode(codec.encode(codec.make(msgtype, header=header, **fields)), msgtype)
    found = pose_of(message)
    assert found[:4] == (STAMP_NS, "map", "base" if msgtype == ODOMETRY else "", (1.0, 2.0, 0.0))
    assert found.quaternion == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)))


def test_bytes_that_are_no_message_are_refused(codec: Codec) -> None:
    raw = codec.encode(laser_scan(codec, _sweep()))
    for cut in range(0, len(raw), 3):
        with pytest.raises(MessageError, match="no sensor_msgs/msg/LaserScan"):
            codec.decode(raw[:cut], LASER_SCAN)


def test_types_that_nobody_defined_are_named(codec: Codec) -> None:
    with pytest.raises(MessageError, match="nobody has said what a my_robot/msg/Thing is made of"):
        codec.decode(b"", "my_robot/msg/Thing")


def test_times_that_do_not_fit_are_refused(codec: Codec) -> None:
    for stamp_ns in (-1, 2**31 * 10**9, 2**63):
        with pytest.raises(MessageError, match="is no time in"):
            codec.header(stamp_ns, "map")


def test_fields_that_do_not_fit_are_refused(codec: Codec) -> None:
    with pytest.raises(MessageError, match="cannot be written"):
        codec.encode(codec.make("std_msgs/msg/String", data=7))


@needs_ros1
def test_ros1_reads_what_was_written() -> None:
    codec = Codec("ros1")
    cells = np.array([[0, 100, -1], [50, 0, 100]], dtype=np.int8)
    transform = StampedTransform(STAMP_NS, "odom", "base", (1.0, -2.0, 0.5), (0.0, 0.0, 0.6, 0.8))
    messages = [
        laser_scan(codec, _sweep()),
        tf_message(codec, [transform]),
        occupancy_grid(codec, STAMP_NS, "map", 0.05, (-1.5, 2.5), cells),
        point_cloud(codec, STAMP_NS, "map", np.array([[1.5, 2.5], [-3.0, 0.25]])),
        string(codec, "Tür 4 geht auf"),
    ]
    question = [
        (*re.fullmatch(r"(\w+)/msg/(\w+)", one.__msgtype__).groups(), base64.b64encode(codec.encode(one)).decode())  # type: ignore[union-attr]
        for one in messages
    ]
    answers = system_ros.ask("ros1_reader.py", question)
    for message, answer in zip(messages, answers, strict=True):
        assert codec.definition(message.__msgtype__)[1] == answer["md5"]
    scan, transforms, grid, cloud, text = (answer["text"] for answer in answers)
    for said, within in (
        ("secs: 1700000000", scan),
        ("nsecs: 123456789", scan),
        ('frame_id: "laser"', scan),
        ("ranges: [0.5, nan, 7.25, inf, 29.0]", scan),
        ('child_frame_id: "base"', transforms),
        ("z: 0.6", transforms),
        ("data: [0, 100, -1, 50, 0, 100]", grid),
        ("width: 3", grid),
        ("x: -1.5", grid),
        ("point_step: 12", cloud),
        ("width: 2", cloud),
    ):
        assert said in within
    assert "geht auf" in text


def test_type_hashes_are_those_of_ros2() -> None:
    """As ROS 2 Jazzy prints them: `ros2 topic info --verbose`."""
    codec = Codec("ros2")
    known = {
        "std_msgs/msg/String": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        LASER_SCAN: "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    }
    assert {name: codec.definition(name)[1] for name in known} == known
    for name in (OCCUPANCY_GRID, POINT_CLOUD, TF_MESSAGE):
        assert re.fullmatch(r"RIHS01_[0-9a-f]{64}", codec.definition(name)[1])
