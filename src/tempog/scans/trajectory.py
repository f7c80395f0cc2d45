"""Poses from elsewhere: where something was at its own stamps, and from that where it was at others."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ConfigError, ScanError
from tempog.ros.transforms import MAX_POSITION_M, SAME_HEADING_RAD, SAME_PLACE_M
from tempog.scans.scan import MAX_STAMP_S, Scan, ScanLog, usable_poses
from tempog.times import NS_PER_S

MAX_GAP_S = 1.0  # s; a robot that turns at 1 rad/s and drives at 1 m/s leaves the straight line by 0.12 m in it
END_SLACK_S = 0.005  # stamps in text files are rounded, often to milliseconds; 1 m/s is 5 mm in that time
FAST_M_PER_S = 20.0  # no indoor robot; where the poses jump, they do


class Coverage(NamedTuple):
    """Which of some stamps a trajectory says a pose of; each array (n,) bool.

    Attributes
    ----------
    known : there is a pose
    before, after : it begins later, or has ended
    in_gap : between two poses too far apart in time
    """

    known: NDArray[np.bool_]
    before: NDArray[np.bool_]
    after: NDArray[np.bool_]
    in_gap: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses at stamps of their own, and interpolated in between.

    Parameters
    ----------
    stamps_ns : (n,) int64, nanoseconds
        Each later than the one before.
    poses : (n, 3) float64
        x, y, theta; metres, metres, radians. Headings need not be wrapped.
    source, format : str
        Path of the file, and what the reader recognised.
    notes : tuple of str
        What was mended or skipped.
    n_skipped : int
        Unusable rows that were left out.

    Raises
    ------
    ScanError
        No poses, shapes that do not match, stamps that do not grow, or a pose that is not finite.

    Examples
    --------
    >>> turning = Trajectory([0, 500_000_000], [(0, 0, 3.1), (1, 0, -3.1)])
    >>> turning.at([250_000_000]).round(3)
    array([[0.5  , 0.   , 3.142]])
    """

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    source: str = ""
    format: str = ""
    notes: tuple[str, ...] = field(default=())
    n_skipped: int = 0

    def __post_init__(self) -> None:
        stamps_ns, poses = np.array(self.stamps_ns, dtype=np.int64), np.array(self.poses, dtype=np.float64)
        name = self.source or "trajectory"
        if stamps_ns.ndim != 1 or poses.shape != (len(stamps_ns), 3):
            raise ScanError(
                f"{name}: stamps of shape {stamps_ns.shape} and poses of shape {poses.shape} do not fit;"
                " wanted (n,) and (n, 3)"
            )
        if not len(stamps_ns):
            raise ScanError(f"{name} holds no poses; wanted at least one")
        if max(abs(int(stamps_ns[0])), abs(int(stamps_ns[-1]))) >= MAX_STAMP_S * NS_PER_S:
            raise ScanError(f"{name}: its stamps are no usable times (wanted: within ±{MAX_STAMP_S:g} s)")
        late = np.flatnonzero(stamps_ns[1:] <= stamps_ns[:-1])
        if late.size:
            i = int(late[0])
            raise ScanError(
                f"{name}: pose {i + 1} is of {stamps_ns[i + 1] / NS_PER_S:.6f} s, not later than pose {i} before it;"
                " wanted stamps in order, each once"
            )
        bad = np.flatnonzero(~possible_poses(poses))
        if bad.size:
            raise ScanError(
                f"{name}: pose {bad[0]} is {tuple(poses[bad[0]].tolist())}; wanted metres within"
                f" ±{MAX_POSITION_M:g}, and radians"
            )
        stamps_ns.flags.writeable = poses.flags.writeable = False
        object.__setattr__(self, "stamps_ns", stamps_ns)
        object.__setattr__(self, "poses", poses)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def start_s(self) -> float:
        """Stamp of the first pose, seconds."""
        return int(self.stamps_ns[0]) / NS_PER_S

    @property
    def stop_s(self) -> float:
        """Stamp of the last pose, seconds."""
        return int(self.stamps_ns[-1]) / NS_PER_S

    def shifted(self, offset_s: float) -> Trajectory:
        """The same poses with `offset_s` seconds added to every stamp, for a clock that differs."""
        if not abs(offset_s) < MAX_STAMP_S:  # also catches NaN
            raise ConfigError(f"an offset of {offset_s!r} s cannot work; wanted seconds within ±{MAX_STAMP_S:g}")
        offset_ns = round(offset_s * NS_PER_S)
        for stamp_ns in (int(self.stamps_ns[0]), int(self.stamps_ns[-1])):
            if abs(stamp_ns + offset_ns) >= MAX_STAMP_S * NS_PER_S:
                raise ConfigError(
                    f"an offset of {offset_s:g} s puts a pose at {(stamp_ns + offset_ns) / NS_PER_S:.6g} s;"
                    f" wanted stamps within ±{MAX_STAMP_S:g} s"
                )
        return replace(self, stamps_ns=self.stamps_ns + offset_ns)

    def moved(self, x: float, y: float, theta: float) -> Trajectory:
        """The trajectory of what is mounted on it at `x`, `y`, `theta` (m, m, rad), seen from it.

        >>> Trajectory([0], [(1, 2, math.pi / 2)]).moved(0.5, 0, 0).poses.round(3)
        array([[1.   , 2.5  , 1.571]])
        """
        if not possible_poses(np.array([x, y, theta], dtype=np.float64)):
            raise ConfigError(f"a place of {(x, y, theta)} cannot be used; wanted metres, metres, radians")
        cos, sin = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        poses = self.poses + np.stack([cos * x - sin * y, sin * x + cos * y, np.full(len(self), theta)], axis=-1)
        return replace(self, poses=poses)

    def coverage(self, stamps_ns: ArrayLike, max_gap_s: float = MAX_GAP_S) -> Coverage:
        """At which stamps there is a pose; see `at`."""
        if not max_gap_s >= 0:
            raise ConfigError(f"max_gap_s = {max_gap_s!r} cannot work; wanted seconds, 0 or more")
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        slack_ns = round(END_SLACK_S * NS_PER_S)
        before = stamps < self.stamps_ns[0] - slack_ns
        after = stamps > self.stamps_ns[-1] + slack_ns
        left, right = self._around(stamps)
        step = self.poses[right] - self.poses[left]
        stood = (np.hypot(step[..., 0], step[..., 1]) <= SAME_PLACE_M) & (
            np.abs(wrapped(step[..., 2])) <= SAME_HEADING_RAD
        )
        short = apart_s(self.stamps_ns[left], self.stamps_ns[right]) <= max_gap_s
        exact = (stamps <= self.stamps_ns[left]) | (stamps >= self.stamps_ns[right])  # or in the slack at an end
        in_gap = ~(before | after | stood | short | exact)
        return Coverage(~(before | after | in_gap), before, after, in_gap)

    def at(self, stamps_ns: ArrayLike, max_gap_s: float = MAX_GAP_S) -> NDArray[np.float64]:
        """Poses at any stamps within the trajectory's time.

        Parameters
        ----------
        stamps_ns : (n,) int64, nanoseconds
            In any order.
        max_gap_s : float, seconds
            Poses farther apart in time are not interpolated between, unless the robot stood meanwhile: both lie
            within 0.1 m and 5 degrees. SLAM systems write no poses of a robot that stands.

        Returns
        -------
        (n, 3) float64
            x, y, theta; NaN where there is no pose, see `coverage`. Nothing is extrapolated; up to 5 ms beyond
            either end, the pose there is taken, since stamps in files are rounded.

        Notes
        -----
        With ``f = (t - t0) / (t1 - t0)``, x and y are linear in f, and so is theta along the shorter arc.
        """
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        known = self.coverage(stamps, max_gap_s).known
        left, right = self._around(stamps)
        since, until = self.stamps_ns[left], self.stamps_ns[right]
        length_s = np.maximum(apart_s(since, until), 1 / NS_PER_S)
        share = np.minimum(apart_s(since, np.maximum(stamps, since)) / length_s, 1.0)
        step = self.poses[right] - self.poses[left]
        step[..., 2] = wrapped(step[..., 2])
        poses = self.poses[left] + share[..., None] * step
        poses[~known] = np.nan
        return np.asarray(poses)

    def _around(self, stamps_ns: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Numbers of the poses on either side of each stamp; at the ends and beyond, of the two nearest."""
        last = len(self) - 1
        left = np.clip(np.searchsorted(self.stamps_ns, stamps_ns, side="right") - 1, 0, max(last - 1, 0))
        return left, np.minimum(left + 1, last)


def with_poses(
    log: ScanLog,
    trajectory: Trajectory,
    *,
    offset_s: float = 0.0,
    max_gap_s: float = MAX_GAP_S,
    laser_at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    skip_bad: bool = False,
) -> ScanLog:
    """The scans of a log with other poses, interpolated to their stamps.

    Parameters
    ----------
    log : ScanLog
        Its own poses are not used.
    trajectory : Trajectory
        Of the laser, or of the robot if `laser_at` is given.
    offset_s : float, seconds
        Added to the trajectory's stamps.
    max_gap_s : float, seconds
        See `Trajectory.at`.
    laser_at : (x, y, theta)
        Where the laser is mounted, seen from what the poses are of; metres, metres, radians.
    skip_bad : bool
        Leave scans without a pose out, counted and noted, instead of stopping.

    Raises
    ------
    ScanError
        Scans outside the trajectory's time or in a gap of it, unless `skip_bad`; or all of them.
    ConfigError
        An offset, a gap or a place of the laser that is no usable number.

    Examples
    --------
    >>> log = ScanLog([Scan(t, (0, 0, 0), [0.0], [2.0]) for t in (10.0, 10.5)], source="two.npz")
    >>> poses = Trajectory([10_000_000_000, 11_000_000_000], [(0, 0, 0), (1, 0, 0)], source="run.tum")
    >>> with_poses(log, poses).scans
    [Scan(t=10, pose=(0.0, 0.0, 0.0), 1 beams, 1 returns), Scan(t=10.5, pose=(0.5, 0.0, 0.0), 1 beams, 1 returns)]
    """
    placed = trajectory.shifted(offset_s).moved(*laser_at)
    stamps_ns = np.array([scan.stamp_ns for scan in log], dtype=np.int64)
    coverage = placed.coverage(stamps_ns, max_gap_s)
    n_lost = int(np.count_nonzero(~coverage.known))
    notes = [f"poses from {_name(trajectory)} ({len(trajectory)})", *trajectory.notes]
    if n_lost:
        what = _lost(log, placed, stamps_ns, coverage, max_gap_s)
        if not skip_bad or n_lost == len(log):
            raise ScanError(f"{what}.\n  {_remedy(placed, stamps_ns, coverage, offset_s, n_lost == len(log))}")
        notes.append(f"left out: {what}")
    poses = placed.at(stamps_ns, max_gap_s).tolist()
    scans = [
        Scan(
            0.0,
            (poses[i][0], poses[i][1], poses[i][2]),
            log[i].angles,
            log[i].ranges,
            log[i].max_range,
            stamp_ns=log[i].stamp_ns,
            label=log[i].label,
        )
        for i in np.flatnonzero(coverage.known).tolist()
    ]
    return replace(
        log,
        scans=scans,
        notes=(*log.notes, *notes),
        n_skipped=log.n_skipped + n_lost,
    )


def possible_poses(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether poses ``(..., 3)`` can be: finite, and somewhere on Earth."""
    return usable_poses(poses) & (np.abs(poses[..., :2]) <= MAX_POSITION_M).all(axis=-1)


def apart_s(earlier_ns: NDArray[np.int64], later_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Seconds between stamps, exact to the nanosecond before the division; it may be more than int64 holds."""
    return np.asarray(later_ns - earlier_ns).view(np.uint64) / NS_PER_S


def wrapped(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles within -pi..pi."""
    return np.asarray((angles + math.pi) % (2 * math.pi) - math.pi)


def _name(trajectory: Trajectory) -> str:
    return trajectory.source or "the trajectory"


def _lost(
    log: ScanLog, placed: Trajectory, stamps_ns: NDArray[np.int64], coverage: Coverage, max_gap_s: float
) -> str:
    """How many scans have no pose, and why."""
    reasons = []
    if coverage.before.any():
        first = int(stamps_ns[coverage.before].min()) / NS_PER_S
        reasons.append(
            f"{np.count_nonzero(coverage.before)} from {first:.3f} s on, before its first at {placed.start_s:.3f} s"
        )
    if coverage.after.any():
        last = int(stamps_ns[coverage.after].max()) / NS_PER_S
        reasons.append(
            f"{np.count_nonzero(coverage.after)} up to {last:.3f} s, after its last at {placed.stop_s:.3f} s"
        )
    if coverage.in_gap.any():
        left, right = placed._around(stamps_ns[coverage.in_gap])
        widest = int(np.argmax(apart_s(placed.stamps_ns[left], placed.stamps_ns[right])))
        since, until = (int(placed.stamps_ns[side[widest]]) / NS_PER_S for side in (left, right))
        reasons.append(
            f"{np.count_nonzero(coverage.in_gap)} between poses more than {max_gap_s:g} s apart (the farthest:"
            f" {since:.3f} and {until:.3f} s, {until - since:.2f} s)"
        )
    n_lost = int(np.count_nonzero(~coverage.known))
    name = log.source or "the log"
    return f"{n_lost} of {len(log)} scans of {name} have no pose in {_name(placed)}: {'; '.join(reasons)}"


def _remedy(
    placed: Trajectory, stamps_ns: NDArray[np.int64], coverage: Coverage, offset_s: float, all_lost: bool
) -> str:
    """What would help."""
    apart = placed.start_s > int(stamps_ns.max()) / NS_PER_S or placed.stop_s < int(stamps_ns.min()) / NS_PER_S
    if apart:
        offset = offset_s + int(stamps_ns.min()) / NS_PER_S - placed.start_s
        return (
            "They share no time: is it the trajectory of this log? If their clocks differ, shift the poses; were they"
            f" to begin together: --pose-offset {offset:.6f}"
        )
    remedies = [] if all_lost else ["Use --skip-bad to leave these scans out"]
    if coverage.in_gap.any():
        left, right = placed._around(stamps_ns[coverage.in_gap])
        widest_s = float(np.max(apart_s(placed.stamps_ns[left], placed.stamps_ns[right])))
        remedies.append(f"--pose-gap {math.ceil(widest_s * 10) / 10:g} to interpolate across all gaps")
    if coverage.before.any() or coverage.after.any():
        remedies.append("--pose-offset SECONDS if the clocks differ")
    return "; ".join(remedies)
