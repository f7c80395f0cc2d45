"""Reference relations of the public SLAM benchmark: how a robot truly moved from one moment to another.

A row is ``t1 t2 x y z roll pitch yaw``: where the robot was at t2, seen from where it was at t1; seconds, metres,
radians. People aligned the scans of both moments by hand; nothing is said about where either is in the world.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError, ScanError
from tempog.ros.transforms import MOST_TILT_RAD
from tempog.scans.clock import UNUSABLE_STAMP_NS, seconds_to_ns
from tempog.scans.scan import MAX_STAMP_S, BadRows, Scan
from tempog.scans.trajectory import apart_s, possible_poses, wrapped
from tempog.scans.trajectory_file import number_rows, text_rows
from tempog.times import NS_PER_S

N_FIELDS = 8
WITHIN_S = 1e-6  # stamps have six decimals in these files
WANTED = "Wanted: rows of 8 numbers, t1 t2 x y z roll pitch yaw."


@dataclass(frozen=True, eq=False)
class Relations:
    """True moves between pairs of moments.

    Attributes
    ----------
    first_ns, second_ns : (n,) int64, nanoseconds
    moves : (n, 3) float64
        x, y, theta at the second moment, seen from the first; metres, metres, radians.
    source : str
        Path of the file.
    notes : tuple of str
        What was skipped.
    n_skipped : int
    """

    first_ns: NDArray[np.int64]
    second_ns: NDArray[np.int64]
    moves: NDArray[np.float64]
    source: str = ""
    notes: tuple[str, ...] = field(default=())
    n_skipped: int = 0

    def __post_init__(self) -> None:
        for name, kind in (("first_ns", np.int64), ("second_ns", np.int64), ("moves", np.float64)):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=kind))

    def __len__(self) -> int:
        return len(self.first_ns)


class RelationError(NamedTuple):
    """How far poses disagree with relations: means over those relations that fit scans.

    Attributes
    ----------
    translation_m, rotation_rad : float
        Mean length and mean absolute angle of what is left, metres and radians: the benchmark's two figures.
    translation_sd_m, rotation_sd_rad : float
        Their standard deviations.
    n_used, n : int
        Relations of which both moments are those of a scan, and all there are.
    """

    translation_m: float
    rotation_rad: float
    translation_sd_m: float
    rotation_sd_rad: float
    n_used: int
    n: int

    def __str__(self) -> str:
        return (
            f"{self.translation_m:.3f} ± {self.translation_sd_m:.3f} m and"
            f" {math.degrees(self.rotation_rad):.2f} ± {math.degrees(self.rotation_sd_rad):.2f} degrees"
            f" over {self.n_used} of {self.n} relations"
        )


def read_relations(path: str | Path, *, skip_bad: bool = False) -> Relations:
    """Read a file of relations.

    Parameters
    ----------
    path : path of the file
    skip_bad : bool
        Leave unusable rows out, counted and noted, instead of stopping at the first.

    Raises
    ------
    ScanError
        A file that cannot be read, or an unusable row.
    """
    rows = text_rows(Path(path), WANTED)
    bad = BadRows(str(path), skip_bad)
    lines, values = number_rows(rows, N_FIELDS, bad)
    first_ns, second_ns = seconds_to_ns(values[:, 0]), seconds_to_ns(values[:, 1])
    moves = values[:, [2, 3, 7]]
    timeless = (first_ns == UNUSABLE_STAMP_NS) | (second_ns == UNUSABLE_STAMP_NS)
    tilted = np.array((~(np.abs(values[:, 5:7]) <= MOST_TILT_RAD)).any(axis=1), dtype=np.bool_)
    usable = np.array(~(timeless | tilted) & possible_poses(moves), dtype=np.bool_)
    for i in np.flatnonzero(~usable).tolist():
        if timeless[i]:
            reason = f"the stamps are {values[i, 0]:.10g} and {values[i, 1]:.10g}; wanted usable seconds"
        elif tilted[i]:
            reason = f"roll and pitch are {values[i, 5]:.4g} and {values[i, 6]:.4g} rad; wanted a move in the plane"
        else:
            reason = f"the move is {tuple(moves[i].tolist())}; wanted finite metres, metres, radians"
        bad.add(f"line {lines[i]}", reason)
    if not usable.any():
        raise ScanError(f"{path} holds no usable relation; {''.join(bad.notes()) or 'it is empty'}.\n  {WANTED}")
    return Relations(first_ns[usable], second_ns[usable], moves[usable], str(path), tuple(bad.notes()), bad.n)


def relation_error(
    scans: Sequence[Scan], relations: Relations, *, offset_s: float = 0.0, within_s: float = WITHIN_S
) -> RelationError:
    """How far the poses of scans disagree with reference relations, as the benchmark counts it.

    Parameters
    ----------
    scans : sequence of Scan, such as a ScanLog
    relations : Relations
    offset_s : float, seconds
        Added to the stamps of the relations, whose clock may be another than the log's.
    within_s : float, seconds
        A relation counts if a scan lies so close to each of its moments. Interpolated poses would blur the answer:
        the relations are between scans.

    Raises
    ------
    ScanError
        No scans, or no relation fits them.
    ConfigError
        An `offset_s` or `within_s` that is no usable number.

    Notes
    -----
    With the told poses ``p1, p2`` and the relation ``d``, what is left is ``(p1^-1 p2) - d`` seen from d: its length,
    and its angle. Kuemmerle et al., "On measuring the accuracy of SLAM algorithms", 2009; means of absolute values.

    Examples
    --------
    >>> scans = [Scan(t, (t, 0.0, 0.0), [0.0], [2.0]) for t in (0.0, 1.0, 2.0)]
    >>> true = Relations(np.array([0]), np.array([2 * 10**9]), np.array([[1.9, 0.0, 0.0]]))
    >>> print(relation_error(scans, true))
    0.100 ± 0.000 m and 0.00 ± 0.00 degrees over 1 of 1 relations
    """
    if not (abs(offset_s) < MAX_STAMP_S and 0 <= within_s < math.inf):
        raise ConfigError(f"offset_s = {offset_s!r} and within_s = {within_s!r}; wanted seconds, within_s from 0")
    if not len(scans):
        raise ScanError("no scans were given; wanted at least two")
    order = np.argsort([scan.stamp_ns for scan in scans], kind="stable")
    stamps_ns = np.array([scans[i].stamp_ns for i in order], dtype=np.int64)
    poses = np.array([(scans[i].x, scans[i].y, scans[i].theta) for i in order])
    (one, one_s), (two, two_s) = (
        _nearest(stamps_ns, at_ns, offset_s) for at_ns in (relations.first_ns, relations.second_ns)
    )
    fits = (one_s <= within_s) & (two_s <= within_s)
    if not fits.any():
        since, until = (int(stamps_ns[i]) / NS_PER_S for i in (0, -1))
        early = min(int(relations.first_ns.min()), int(relations.second_ns.min())) / NS_PER_S + offset_s
        late = max(int(relations.first_ns.max()), int(relations.second_ns.max())) / NS_PER_S + offset_s
        raise ScanError(
            f"no relation of {relations.source or 'these'} fits the scans: they are of {early:.3f} to {late:.3f} s,"
            f" the scans of {since:.3f} to {until:.3f} s, and none has both moments within {within_s:g} s of scans.\n"
            "  Give offset_s if the clocks differ, or a larger within_s."
        )
    left = _between(relations.moves[fits], _between(poses[one[fits]], poses[two[fits]]))
    lengths, angles = np.hypot(left[:, 0], left[:, 1]), np.abs(wrapped(left[:, 2]))
    return RelationError(
        float(lengths.mean()),
        float(angles.mean()),
        float(lengths.std()),
        float(angles.std()),
        int(np.count_nonzero(fits)),
        len(relations),
    )


def _nearest(
    stamps_ns: NDArray[np.int64], at_ns: NDArray[np.int64], offset_s: float
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Number of the scan nearest to each moment, and how far off it is in seconds."""
    wanted = at_ns + round(offset_s * NS_PER_S)
    right = np.clip(np.searchsorted(stamps_ns, wanted), 0, len(stamps_ns) - 1)
    left = np.maximum(right - 1, 0)
    apart = [apart_s(np.minimum(stamps_ns[i], wanted), np.maximum(stamps_ns[i], wanted)) for i in (left, right)]
    return np.where(apart[0] < apart[1], left, right), np.minimum(*apart)


def _between(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 3) seen from others."""
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    x, y, theta = (second - first).T
    return np.stack([cos * x + sin * y, cos * y - sin * x, theta], axis=-1)
