"""Sweeps of a laser and transforms -> scans: the pose of each, and beams as if all were taken at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tempog.ros.messages import Sweep
from tempog.ros.transforms import MOST_TILT_RAD, TransformBuffer, flatten
from tempog.scans.scan import Scan
from tempog.times import NS_PER_S

KNOT_S = 0.02  # s; between these moments of a sweep the motion is taken as even, as odometry at 50 Hz says it
# Motion that shifts no beam by more is not worth angles of its own for every scan: a fifth of ranges' usual noise.
LEAST_SHIFT_M = 0.002


def scans_of(
    sweeps: Sequence[Sweep],
    buffer: TransformBuffer,
    fixed: str,
    *,
    label: Callable[[int], str] = "scan {}".format,
    max_tilt_rad: float = MOST_TILT_RAD,
) -> list[Scan | None]:
    """Sweeps as scans: pose and stamp of the first ray, and every beam as it would be seen from there.

    Parameters
    ----------
    sweeps : sequence of Sweep
        Of one laser, in time order.
    buffer : TransformBuffer
    fixed : str
        The frame to map in.
    label : callable
        From a sweep's number to what messages call its scan.
    max_tilt_rad : float, radians
        A laser that leans farther is no laser in the plane; pi/2 takes any, knowingly.

    Returns
    -------
    list of Scan or None
        None where the pose during the sweep is not known (`TransformBuffer.explain` says why), or the laser leans.

    Raises
    ------
    TransformError
        Frames that nothing connects.

    Notes
    -----
    Ray ``i`` is taken at ``stamp + i * time_increment``. Where it ended is exact for any motion that is even over
    `KNOT_S`; what it crossed on its way is displaced by at most what the robot drove during the sweep.
    """
    if not sweeps:
        return []
    frame = sweeps[0].frame
    start_ns = np.array([sweep.stamp_ns for sweep in sweeps], dtype=np.int64)
    lasted_ns = np.array([sweep.stop_ns - sweep.stamp_ns for sweep in sweeps], dtype=np.int64)
    n_knots = 1 + math.ceil(int(lasted_ns.max()) / (KNOT_S * NS_PER_S))
    if n_knots > 1:
        n_knots = min(n_knots, 64)  # of a sweep that takes a second
    shares = np.linspace(0.0, 1.0, n_knots)
    knots_ns = start_ns[:, None] + np.rint(lasted_ns[:, None] * shares).astype(np.int64)
    flat, upside_down, level = flatten(*buffer.poses(fixed, frame, knots_ns.ravel(), partial=True), max_tilt_rad)
    poses = flat.reshape(len(sweeps), n_knots, 3)
    usable = np.asarray((np.isfinite(flat).all(axis=1) & level).reshape(len(sweeps), n_knots).all(axis=1))
    poses[..., 2] = np.unwrap(poses[..., 2], axis=1)
    return [
        _scan(sweep, poses[k], shares, bool(upside_down[k * n_knots]), label(k)) if usable[k] else None
        for k, sweep in enumerate(sweeps)
    ]


def scan_of(
    sweep: Sweep, buffer: TransformBuffer, fixed: str, *, label: str = "", max_tilt_rad: float = MOST_TILT_RAD
) -> Scan | None:
    """One sweep as a scan; see `scans_of`.

    Examples
    --------
    >>> from tempog.ros.transforms import buffer_of
    >>> from tempog.ros.messages import StampedTransform
    >>> track = [StampedTransform(k * 10**8, "odom", "laser", (0.1 * k, 0.0, 0.0)) for k in (0, 1)]  # 1 m/s
    >>> sweep = Sweep(0, "laser", np.array([0.0, 0.0]), np.array([5.0, 5.0], np.float32), time_increment_s=0.1)
    >>> scan_of(sweep, buffer_of(track), "odom").ranges  # the second ray began 0.1 m farther on
    array([5. , 5.1], dtype=float32)
    """
    return scans_of([sweep], buffer, fixed, label=lambda _: label, max_tilt_rad=max_tilt_rad)[0]


def _scan(sweep: Sweep, knots: NDArray[np.float64], shares: NDArray[np.float64], mirrored: bool, label: str) -> Scan:
    angles = -sweep.angles if mirrored else sweep.angles
    ranges, max_range = sweep.ranges, sweep.max_range
    x, y, theta = knots[0].tolist()
    driven = knots - knots[0]
    shift_m = float(np.hypot(driven[:, 0], driven[:, 1]).max())
    turn_rad = float(np.abs(driven[:, 2]).max())
    returned = (ranges > 0) & (ranges < max_range)
    farthest = float(ranges[returned].max()) if returned.any() else 0.0
    if shift_m + turn_rad * farthest > LEAST_SHIFT_M:
        n_beams = len(ranges)
        at = np.linspace(0.0, 1.0, n_beams)
        ahead, aside, turned = (np.interp(at, shares, driven[:, k]) for k in range(3))
        angles = angles + turned
        cos, sin = math.cos(theta), math.sin(theta)
        away = ranges[returned].astype(np.float64)
        east = cos * ahead[returned] + sin * aside[returned] + away * np.cos(angles[returned])
        north = cos * aside[returned] - sin * ahead[returned] + away * np.sin(angles[returned])
        ranges = np.where(ranges >= max_range, np.float32(np.inf), ranges)
        with np.errstate(over="ignore"):  # a pose or a reading that is far too large: a beam without return
            ranges[returned] = np.hypot(east, north)
        angles[returned] = np.arctan2(north, east)
        max_range += shift_m
    return Scan(0.0, (x, y, theta), angles, ranges, max_range, stamp_ns=sweep.stamp_ns, label=label)
