"""Scans -> a CARMEN log, for programs that read nothing else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tempog._files import whole_file
from tempog.errors import ScanError
from tempog.scans.scan import Scan


def write_carmen(path: str | Path, scans: Sequence[Scan]) -> None:
    """Write scans as a CARMEN log of ROBOTLASER1 lines, which carry their own beam angles.

    The log appears whole or not at all. A beam without return is written as the maximum range, ranges in
    millimetres and stamps in microseconds.

    Parameters
    ----------
    path : path of the log
    scans : sequence of Scan
        With evenly spaced beams and a finite maximum range.

    Raises
    ------
    ScanError
        No scans, beams that are not evenly spaced, no maximum range, or a place that cannot be written.
    """
    path = Path(path)
    if not scans:
        raise ScanError(f"no scans to write to {path}; wanted at least one")
    lines = []
    for i, scan in enumerate(scans):
        steps = np.diff(scan.angles)
        if not (len(scan.angles) and math.isfinite(scan.max_range) and np.allclose(steps, steps[:1], atol=1e-9)):
            raise ScanError(
                f"scan {i} has {len(scan.angles)} beams up to {scan.max_range:g} m; a CARMEN log can hold evenly"
                " spaced beams with a finite maximum range alone.\n  Write an .npz instead."
            )
        step = float(scan.angles[-1] - scan.angles[0]) / len(steps) if len(steps) else 0.0
        there = np.isfinite(scan.ranges) & (scan.ranges < scan.max_range)
        ranges = " ".join(f"{r:.3f}" for r in np.where(there, scan.ranges, scan.max_range).tolist())
        pose = f"{scan.x:.6f} {scan.y:.6f} {scan.theta:.9f}"
        seconds, rest_ns = divmod(scan.stamp_ns, 1_000_000_000)
        stamp = f"{seconds}.{rest_ns // 1000:06d}"
        lines.append(
            f"ROBOTLASER1 0 {float(scan.angles[0])!r} {step * len(steps)!r} {step!r} {scan.max_range:g} 0.01 0"
            f" {len(scan.angles)} {ranges} 0 {pose} {pose} 0 0 0 0 0 {stamp} tempog {stamp}\n"
        )
    try:
        with whole_file(path) as unfinished:
            unfinished.write_text("".join(lines), encoding="ascii")
    except OSError as error:
        raise ScanError(f"cannot write {path}: {error.strerror or error}") from error
