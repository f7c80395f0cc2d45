"""One sweep of a range finder, and a log of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ScanError

MAX_ANGLE_RAD = 1e6  # rad; a heading that was never wrapped stays far below, a corrupt one does not
MAX_STAMP_S = 9.2e9  # s; int64 nanoseconds end at 9.22e9 s, in the year 2262


class Scan:
    """One sweep: a stamp, the laser's pose in the map frame, and its beams.

    Parameters
    ----------
    t : float, seconds
        Time of the scan, in the log's own clock (Unix seconds in most logs).
    pose : (x, y, theta)
        Pose of the laser in the map frame; metres, metres, radians.
    angles : (n_beams,) radians
        Direction of each beam in the laser frame; 0 is ahead, positive is to the left.
    ranges : (n_beams,) metres
        After REP-117: ``+inf`` or a reading at or beyond `max_range` is a beam without return; NaN,
        ``-inf``, zero and negative readings say nothing.
    max_range : float, metres
        The sensor's maximum range. Not how far the map trusts it: that is `SensingConfig.max_range_m`.
    stamp_ns : int, nanoseconds, optional
        Used instead of `t` where the exact integer is known.
    label : str
        Where the scan came from ("line 17"), for error messages.

    Raises
    ------
    ScanError
        Shapes that do not match, or a stamp, pose, angle or maximum range that is not a usable number.

    Examples
    --------
    >>> scan = Scan(t=12.5, pose=(0.0, 1.0, 0.0), angles=[-0.5, 0.0, 0.5], ranges=[2.0, float("inf"), 2.2])
    >>> scan
    Scan(t=12.5, pose=(0.0, 1.0, 0.0), 3 beams, 2 returns)
    """

    __slots__ = ("angles", "label", "max_range", "ranges", "stamp_ns", "theta", "x", "y")

    def __init__(
        self,
        t: float,
        pose: tuple[float, float, float],
        angles: ArrayLike,
        ranges: ArrayLike,
        max_range: float = math.inf,
        *,
        stamp_ns: int | None = None,
        label: str = "",
    ) -> None:
        where = f"{label}: " if label else ""
        self.label = label
        if stamp_ns is None:
            if not abs(t) < MAX_STAMP_S:  # also catches NaN
                raise ScanError(f"{where}stamp {t!r} s is not a usable time (wanted: within ±{MAX_STAMP_S:g} s)")
            stamp_ns = round(t * 1e9)
        self.stamp_ns = int(stamp_ns)
        if abs(self.stamp_ns) >= MAX_STAMP_S * 1e9:
            raise ScanError(f"{where}stamp {stamp_ns} ns is not a usable time (wanted: within ±{MAX_STAMP_S:g} s)")
        if len(pose) != 3:
            raise ScanError(f"{where}pose {pose!r} has {len(pose)} numbers; wanted x, y (m) and theta (rad)")
        self.x, self.y, self.theta = (float(value) for value in pose)
        if not usable_poses(np.array([self.x, self.y, self.theta])):
            raise ScanError(f"{where}pose {(self.x, self.y, self.theta)} is not usable (wanted: finite m, m, rad)")
        self.angles: NDArray[np.float64] = _owned(angles, np.float64)
        with np.errstate(over="ignore"):  # a reading too large for float32 is a beam without return
            self.ranges: NDArray[np.float32] = _owned(ranges, np.float32)
        if self.angles.ndim != 1 or self.angles.shape != self.ranges.shape:
            raise ScanError(
                f"{where}angles of shape {self.angles.shape} and ranges of shape {self.ranges.shape}"
                " do not fit; wanted one angle and one range per beam"
            )
        if not (np.abs(self.angles) <= MAX_ANGLE_RAD).all():  # also catches NaN
            raise ScanError(f"{where}some beam angles are not usable (wanted: finite radians)")
        self.max_range = float(max_range)
        if not self.max_range > 0:
            raise ScanError(f"{where}the sensor's maximum range is {max_range!r}; wanted metres above 0")

    @property
    def t(self) -> float:
        """Stamp in seconds."""
        return self.stamp_ns / 1e9

    def to_bytes(self) -> bytes:
        """Stamp, pose and readings, to tell scans apart by."""
        pose = np.array([self.x, self.y, self.theta])
        return self.stamp_ns.to_bytes(8, "little", signed=True) + pose.tobytes() + self.ranges.tobytes()

    def __repr__(self) -> str:
        returns = int(np.count_nonzero((self.ranges > 0) & (self.ranges < self.max_range)))
        pose = (round(self.x, 3), round(self.y, 3), round(self.theta, 4))
        return f"Scan(t={self.t:.10g}, pose={pose}, {len(self.ranges)} beams, {returns} returns)"


def usable_poses(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether poses ``(..., 3)`` of x, y, theta are finite, with headings of a possible size."""
    usable: NDArray[np.bool_] = np.isfinite(poses).all(axis=-1) & (np.abs(poses[..., 2]) <= MAX_ANGLE_RAD)
    return usable


def _owned(values: ArrayLike, kind: type[np.generic]) -> NDArray[Any]:
    """A read-only array that nobody else can change; one that is read-only already is shared."""
    array = np.ascontiguousarray(values, dtype=kind)
    if array.flags.writeable:
        array = array.copy() if isinstance(values, np.ndarray) and np.may_share_memory(array, values) else array
        array.flags.writeable = False
    return array


def scan_period_s(stamps_ns: Sequence[int] | NDArray[np.int64]) -> float:
    """Median time between successive scans in seconds; NaN for fewer than two."""
    steps = np.diff(np.asarray(stamps_ns, dtype=np.int64))
    return float(np.median(steps)) / 1e9 if len(steps) else math.nan


@dataclass(frozen=True)
class ScanLog(Sequence[Scan]):
    """A log that was read: its scans in time order, and what the reader noticed.

    Iterate over it, index it, or pass it wherever scans are wanted.

    Attributes
    ----------
    scans : list of Scan
        Sorted by stamp.
    source : str
        Path of the file.
    format : str
        What the reader recognised, for people.
    notes : tuple of str
        What was mended, skipped or assumed on the way. Empty for a clean log.
    n_skipped : int
        Unusable lines that were left out.
    files : tuple of str
        Paths of the files, where `source` is not the path of one.
    """

    scans: list[Scan]
    source: str = ""
    format: str = ""
    notes: tuple[str, ...] = field(default=())
    n_skipped: int = 0
    files: tuple[str, ...] = field(default=())

    @overload
    def __getitem__(self, index: int) -> Scan: ...
    @overload
    def __getitem__(self, index: slice) -> list[Scan]: ...
    def __getitem__(self, index: int | slice) -> Scan | list[Scan]:
        return self.scans[index]

    def __len__(self) -> int:
        return len(self.scans)

    def __iter__(self) -> Iterator[Scan]:
        return iter(self.scans)

    @property
    def duration_s(self) -> float:
        """Seconds from the first scan to the last."""
        return (self.scans[-1].stamp_ns - self.scans[0].stamp_ns) / 1e9 if self.scans else 0.0

    @property
    def scan_period_s(self) -> float:
        """Median seconds between scans; NaN for a log of one scan."""
        return scan_period_s([scan.stamp_ns for scan in self.scans])


N_LABELS_NOTED = 5  # enough to find the place in the file, short enough for one line


class BadRows:
    """The unusable lines or rows of one log: stops at the first, or counts them with `skip_bad`.

    Readers hand every such row to `add`, and put `notes()` and `n` into the `ScanLog`.
    """

    def __init__(self, source: str, skip_bad: bool) -> None:
        self.source = source
        self.skip_bad = skip_bad
        self.n = 0
        self._labels: list[str] = []
        self._first_reason = ""

    def add(self, label: str, reason: str) -> None:
        """Count the row `label` ("line 17"); raise ScanError unless bad rows are to be skipped."""
        if not self.skip_bad:
            raise ScanError(f"{self.source}, {label}: {reason}.\n  Use --skip-bad to leave such data out.")
        self._first_reason = self._first_reason or reason
        if self.n < N_LABELS_NOTED:
            self._labels.append(label)
        self.n += 1

    def notes(self) -> list[str]:
        """One note with the first few places and the first reason; none if nothing was skipped."""
        if not self.n:
            return []
        places = ", ".join(self._labels) + (", ..." if self.n > N_LABELS_NOTED else "")
        return [f"skipped {self.n} unusable: {places} (the first: {self._first_reason})"]
