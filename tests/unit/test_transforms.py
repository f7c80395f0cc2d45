"""The transform buffer at its bounds, and what it says of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tempog.errors import ConfigError, TransformError
from tempog.ros.messages import StampedTransform, Sweep
from tempog.ros.transforms import TransformBuffer, buffer_of, flatten
from tempog.scans.sweep import scan_of, scans_of

S = 10**9


def _at(
    second: float, parent: str, child: str, x: float = 0.0, y: float = 0.0, theta: float = 0.0
) -> StampedTransform:
    turned = (0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))
    return StampedTransform(round(second * S), parent, child, (x, y, 0.0), turned)


def _x(buffer: TransformBuffer, second: float) -> float:
    return float(buffer.poses("odom", "base", [round(second * S)])[0][0, 0])


def test_beyond_its_ends_a_pose_is_held_for_a_bounded_time() -> None:
    buffer = TransformBuffer(extrapolate_s=0.5)
    for second in (1, 2):
        buffer.add(_at(second, "odom", "base", x=second))
    assert (_x(buffer, 0.5), _x(buffer, 1.5), _x(buffer, 2.5)) == (1.0, 1.5, 2.0)
    for second in (0.4, 2.6):
        with pytest.raises(TransformError, match=r"not known at \d.\d00 s: base and odom .* from 1.000 to 2.000 s"):
            _x(buffer, second)


def test_pauses_are_bridged_only_where_nothing_moved() -> None:
    buffer = buffer_of([_at(0, "odom", "base"), _at(60, "odom", "base", x=0.05), _at(120, "odom", "base", x=3)])
    assert _x(buffer, 30) == pytest.approx(0.025)
    with pytest.raises(TransformError, match="pauses above 5 s in which it moved"):
        _x(buffer, 90)


def test_turning_in_a_pause_is_moving() -> None:
    buffer = buffer_of([_at(0, "odom", "base"), _at(60, "odom", "base", theta=math.pi)])
    with pytest.raises(TransformError, match="pauses"):
        _x(buffer, 30)


def test_old_transforms_are_forgotten() -> None:
    buffer = TransformBuffer(keep_s=10)
    for second in range(1000):
        buffer.add(_at(second, "odom", "base", x=second))
    assert len(buffer._tracks["odom", "base"]) <= 22
    assert _x(buffer, 995.5) == 995.5
    with pytest.raises(TransformError):
        _x(buffer, 5.5)


def test_transforms_may_come_in_any_order_and_the_first_of_a_moment_stays() -> None:
    buffer = buffer_of([_at(k, "odom", "base", x=k) for k in (3, 1, 2, 0)] + [_at(2, "odom", "base", x=99)])
    assert [_x(buffer, k) for k in (0, 1, 2, 3)] == [0, 1, 2, 3]


def test_a_static_transform_holds_at_all_times_and_the_last_one_counts() -> None:
    buffer = buffer_of([], [_at(5, "base", "laser", x=1), _at(5, "base", "laser", x=2)])
    assert buffer.poses("base", "laser", [-S, 10**18])[0][:, 0].tolist() == [2, 2]
    assert buffer.span_ns("base", "laser") is None
    assert buffer.is_static("base", "laser")


@pytest.mark.parametrize(
    ("fixed", "frame", "said"),
    [
        ("map", "lidar", "there is no frame 'lidar'; there are base, laser, map, odom"),
        ("map", "laser", "on one side are base, laser, on the other map, odom"),
    ],
)
def test_frames_that_do_not_hang_together_are_named(fixed: str, frame: str, said: str) -> None:
    buffer = buffer_of([_at(0, "map", "odom")], [_at(0, "base", "laser")])
    with pytest.raises(TransformError) as raised:
        buffer.poses(fixed, frame, [0])
    assert said in str(raised.value).replace("one side are map, odom, on the other base, laser", said)


def test_an_empty_buffer_says_so() -> None:
    with pytest.raises(TransformError, match="no transforms at all"):
        TransformBuffer().poses("map", "laser", [0])


@pytest.mark.parametrize(
    "bad",
    [
        StampedTransform(0, "a", "a", (0.0, 0.0, 0.0)),
        StampedTransform(0, "", "a", (0.0, 0.0, 0.0)),
        StampedTransform(0, "a", "b", (math.nan, 0.0, 0.0)),
        StampedTransform(0, "a", "b", (0.0, -1e300, 0.0)),  # finite, but its square is not
        StampedTransform(0, "a", "b", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_unusable_transforms_are_refused(bad: StampedTransform) -> None:
    with pytest.raises(TransformError, match="wanted"):
        TransformBuffer().add(bad)


def test_unusable_settings_are_refused() -> None:
    with pytest.raises(ConfigError, match="keep_s"):
        TransformBuffer(keep_s=-1)


def test_partial_answers_have_nan_where_nothing_is_known() -> None:
    buffer = buffer_of([_at(0, "odom", "base"), _at(1, "odom", "base")])
    moved, _ = buffer.poses("odom", "base", [0, 10 * S], partial=True)
    assert np.isnan(moved[:, 0]).tolist() == [False, True]


def test_a_leaning_laser_is_no_laser_in_the_plane_unless_wanted() -> None:
    half = math.radians(10) / 2
    buffer = buffer_of(
        [], [StampedTransform(0, "map", "laser", (0, 0, 0), (0.0, math.sin(half), 0.0, math.cos(half)))]
    )
    sweep = Sweep(0, "laser", np.zeros(1), np.ones(1, np.float32))
    assert scan_of(sweep, buffer, "map") is None
    assert scan_of(sweep, buffer, "map", max_tilt_rad=math.pi / 2) is not None


def test_a_laser_upside_down_sees_left_on_its_right() -> None:
    buffer = buffer_of([], [StampedTransform(0, "map", "laser", (1.0, 2.0, 0.3), (1.0, 0.0, 0.0, 0.0))])
    scan = scan_of(Sweep(0, "laser", np.array([0.5]), np.ones(1, np.float32)), buffer, "map")
    assert scan is not None
    assert (scan.x, scan.y, round(scan.theta, 9), scan.angles.tolist()) == (1.0, 2.0, 0.0, [-0.5])


@pytest.mark.parametrize(("speed", "spin"), [(1.0, 0.0), (0.0, 1.5), (0.7, -2.0)])
def test_motion_during_the_sweep_is_compensated(speed: float, spin: float) -> None:
    """A robot drives on an arc past a point-like pole in every direction; all beams must end in their poles."""
    increment = 0.1 / 719
    moments = np.arange(720) * increment

    def pose(t: float) -> tuple[float, float, float]:
        theta = 0.3 + spin * t
        if spin == 0:
            return 1 + speed * t * math.cos(0.3), 2 + speed * t * math.sin(0.3), theta
        radius = speed / spin
        return 1 + radius * (math.sin(theta) - math.sin(0.3)), 2 - radius * (math.cos(theta) - math.cos(0.3)), theta

    track = [_at(t, "odom", "laser", *pose(t)) for t in np.arange(0, 0.2, 0.02)]
    angles = np.linspace(-3.0, 3.0, 720)
    ranges = np.full(720, 8.0, dtype=np.float32)
    ranges[100] = np.inf
    ranges[200] = np.nan
    scan = scan_of(Sweep(0, "laser", angles, ranges, 30.0, increment), buffer_of(track), "odom")
    assert scan is not None
    xs, ys, thetas = np.array([pose(t) for t in moments]).T
    ended = np.stack([xs + 8 * np.cos(thetas + angles), ys + 8 * np.sin(thetas + angles)])
    away = scan.ranges.astype(float)
    seen = np.stack(
        [scan.x + away * np.cos(scan.theta + scan.angles), scan.y + away * np.sin(scan.theta + scan.angles)]
    )
    kept = np.isfinite(ranges)
    assert np.abs(seen - ended)[:, kept].max() < 1e-4
    assert math.isinf(scan.ranges[100])
    assert math.isnan(scan.ranges[200])
    assert scan.angles[100] + scan.theta == pytest.approx(thetas[100] + angles[100])


def test_a_standing_robots_scans_share_their_angles() -> None:
    angles = np.linspace(-1, 1, 5)
    angles.flags.writeable = False
    track = [_at(t, "odom", "laser", 1.0) for t in (0, 1, 2)]
    sweeps = [Sweep(k * S, "laser", angles, np.ones(5, np.float32), 30.0, 0.01) for k in (0, 1)]
    scans = scans_of(sweeps, buffer_of(track), "odom")
    assert all(scan is not None and scan.angles is angles for scan in scans)


def test_sweeps_outside_the_transforms_become_no_scans() -> None:
    track = [_at(t, "odom", "laser") for t in (1, 2)]
    sweeps = [Sweep(k * S, "laser", np.zeros(1), np.ones(1, np.float32)) for k in (0, 1, 2, 3)]
    assert [scan is not None for scan in scans_of(sweeps, buffer_of(track), "odom")] == [False, True, True, False]


def test_flatten_keeps_headings() -> None:
    turned = np.array([[0.0, 0.0, math.sin(1.0), math.cos(1.0)]])
    poses, upside_down, level = flatten(np.array([[1.0, 2.0, 3.0]]), turned)
    np.testing.assert_allclose(poses, [[1, 2, 2]])
    assert (upside_down.tolist(), level.tolist()) == ([False], [True])
