"""``--poses`` and what goes with it, for logs and for bags."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from tempog.errors import ConfigError
from tempog.scans.trajectory import MAX_GAP_S, Trajectory, with_poses
from tempog.scans.trajectory_file import read_trajectory

if TYPE_CHECKING:
    from tempog.scans.bag_choice import BagChoice
    from tempog.scans.scan import ScanLog

NOWHERE = "0,0,0"  # of --laser-at: the poses are the laser's


@dataclass(frozen=True)
class OtherPoses:
    """Poses of a file, and how they are to be taken."""

    path: Path
    times: Path | None
    offset_s: float
    max_gap_s: float
    laser_at: tuple[float, float, float]
    skip_bad: bool

    def placed(self, log: ScanLog) -> ScanLog:
        """A log that is no bag, with these poses."""
        trajectory = read_trajectory(
            self.path, times=self.times, scan_stamps_ns=[scan.stamp_ns for scan in log], skip_bad=self.skip_bad
        )
        return with_poses(
            log,
            trajectory,
            offset_s=self.offset_s,
            max_gap_s=self.max_gap_s,
            laser_at=self.laser_at,
            skip_bad=self.skip_bad,
        )

    def of_bag(self, choice: BagChoice) -> Trajectory:
        """These poses as a bag takes them: its transforms say where lasers are on the base frame."""
        if self.max_gap_s != MAX_GAP_S:
            raise ConfigError(
                "--pose-gap is not for bags, whose poses and transforms are bridged for 5 s; leave it out"
            )
        if choice.base_frame and any(self.laser_at):
            raise ConfigError("--laser-at and --base-frame both say what --poses are of; give one of them")
        trajectory = read_trajectory(self.path, times=self.times, skip_bad=self.skip_bad)
        return trajectory.shifted(self.offset_s).moved(*self.laser_at)

    @staticmethod
    def noted(logs: list[ScanLog], trajectory: Trajectory) -> list[ScanLog]:
        """Logs of a bag, the first with what is to be said of the poses."""
        notes = (f"poses from {trajectory.source} ({len(trajectory)})", *trajectory.notes)
        return [replace(logs[0], notes=(*logs[0].notes, *notes)), *logs[1:]]


def other_poses(
    path: Path | None,
    times: Path | None,
    offset_s: float,
    max_gap_s: float,
    laser_at: str,
    skip_bad: bool,
) -> OtherPoses | None:
    """What the options say; None where the logs' own poses are wanted.

    >>> other_poses(Path("run.tum"), None, 0.0, 1.0, "0.2,0,90", False).laser_at
    (0.2, 0.0, 1.5707963267948966)
    """
    if path is None:
        if (times, offset_s, max_gap_s, laser_at) != (None, 0.0, MAX_GAP_S, NOWHERE):
            raise ConfigError(
                "--pose-times, --pose-offset, --pose-gap and --laser-at go with --poses FILE; give that"
            )
        return None
    try:
        x, y, degrees = (float(field) for field in laser_at.split(","))
    except ValueError:
        raise ConfigError(
            f"--laser-at {laser_at} is no place; wanted X,Y,DEG in metres and degrees, as in 0.2,0,180"
        ) from None
    return OtherPoses(path, times, offset_s, max_gap_s, (x, y, math.radians(degrees)), skip_bad)
