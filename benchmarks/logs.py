"""The logs that are timed: real ones where present, else the simulated corridor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tempog import GridConfig, MapConfig, Scan, SensingConfig, open_scans
from tempog.config import DEFAULT_GAP, Evidence, parse_gap
from tempog.scans.scan import scan_period_s
from tempog.simulation import corridor, simulate

LOG_FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data" / "laser_logs"
MAX_RANGE_M = 30.0
RESOLUTION_M = 0.05


@dataclass(frozen=True)
class BenchLog:
    """Scans that hold returns within MAX_RANGE_M only: the same rays for everybody.

    Attributes
    ----------
    name : str
    scans : list of Scan
        A beam without return, or one beyond MAX_RANGE_M, is NaN: it says nothing.
    """

    name: str
    scans: list[Scan]

    @property
    def n_rays(self) -> int:
        """Beams with a return."""
        return sum(int(np.count_nonzero(~np.isnan(scan.ranges))) for scan in self.scans)

    @property
    def duration_s(self) -> float:
        """Seconds from the first scan to the last."""
        return (self.scans[-1].stamp_ns - self.scans[0].stamp_ns) / 1e9

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(x_min, x_max, y_min, y_max)`` of all poses and end points, metres."""
        points = np.concatenate([end_points(scan)[:, :2] for scan in self.scans])
        poses = np.array([[scan.x, scan.y] for scan in self.scans])
        low, high = np.minimum(points.min(0), poses.min(0)), np.maximum(points.max(0), poses.max(0))
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])

    def config(self, evidence: Evidence) -> MapConfig:
        """The settings all rows share."""
        sensing = SensingConfig(evidence=evidence, no_return="never", max_range_m=MAX_RANGE_M)
        gap_s = parse_gap(DEFAULT_GAP, scan_period_s([scan.stamp_ns for scan in self.scans]))
        return MapConfig(sensing, GridConfig(resolution_m=RESOLUTION_M, gap_s=gap_s))


def load(name: str, n_scans: int | None = None) -> BenchLog:
    """The log called `name` ("freiburg-079", "intel"), or the simulated corridor if it is absent."""
    path = log_path(name)
    if path.is_file():
        scans = open_scans(path).scans
    else:
        name, scans = f"simulated corridor ({name} is absent)", simulate(corridor(seed=0)).scans
    return BenchLog(name, [_only_returns(scan) for scan in scans[:n_scans]])


def log_path(name: str) -> Path:
    """Where a real log is, if it is there."""
    return LOG_FOLDER / f"{name}-corrected.log.gz"


def end_points(scan: Scan) -> NDArray[np.float64]:
    """``(n_returns, 3)`` metres: where the beams end in the map frame, at z = 0."""
    returned = ~np.isnan(scan.ranges)
    directions = scan.theta + scan.angles[returned]
    ranges = scan.ranges[returned].astype(np.float64)
    x, y = scan.x + ranges * np.cos(directions), scan.y + ranges * np.sin(directions)
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def _only_returns(scan: Scan) -> Scan:
    says = (scan.ranges > 0) & (scan.ranges < scan.max_range) & (scan.ranges <= MAX_RANGE_M)
    ranges = np.where(says, scan.ranges, np.float32(np.nan))
    return at_time(scan, scan.stamp_ns, ranges)


def at_time(scan: Scan, stamp_ns: int, ranges: NDArray[np.float32] | None = None) -> Scan:
    """A copy of `scan` with another stamp, and other ranges if given."""
    pose = (scan.x, scan.y, scan.theta)
    ranges = scan.ranges if ranges is None else ranges
    return Scan(0.0, pose, scan.angles, ranges, scan.max_range, stamp_ns=stamp_ns)
