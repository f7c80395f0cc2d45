"""Trajectories in text files, as SLAM systems and benchmarks write them -> Trajectory.

========= =================================== ====================================================
format    a row                               stamps
========= =================================== ====================================================
TUM       t x y z qx qy qz qw                 the first column, seconds
KITTI     r11 r12 r13 x r21 .. r33 z          a second file with one number a row, or those of the
          (3 x 4 matrix, row by row)          scans, one row for each
========= =================================== ====================================================

Fields stand apart by blanks or commas; ``#`` begins a comment. z goes up and is left out, as small tilts are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ScanError
from tempog.ros.transforms import MAX_POSITION_M, MOST_TILT_RAD, flatten
from tempog.scans.clock import UNUSABLE_STAMP_NS, seconds_to_ns
from tempog.scans.scan import MAX_STAMP_S, BadRows
from tempog.scans.trajectory import FAST_M_PER_S, Trajectory, apart_s, possible_poses

N_TUM_FIELDS, N_KITTI_FIELDS = 8, 12
NORM_TOLERANCE = 0.01  # of a quaternion; rounded to three digits it is off by less
MAX_FIELD_CHARS = 40  # shown of a field that is no number
FLOORS_APART_M = 1.5  # heights that differ by more are noted: several floors make no 2D map
WANTED = (
    "Wanted: TUM (8 numbers a row: t x y z qx qy qz qw) or KITTI (12 numbers a row: the upper three rows of a 4 x 4"
    " matrix)."
)
WANTED_TIMES = "Wanted: the time of each pose in seconds, one a row."


def read_trajectory(
    path: str | Path,
    *,
    times: str | Path | None = None,
    scan_stamps_ns: Sequence[int] | NDArray[np.int64] | None = None,
    skip_bad: bool = False,
) -> Trajectory:
    """Read a TUM or KITTI trajectory, recognised by how many numbers its rows have.

    Parameters
    ----------
    path : path of the file
    times : path, optional
        For KITTI: a file with the stamp of each row, in seconds.
    scan_stamps_ns : (n,) int64, nanoseconds, optional
        For KITTI without `times`: the stamps of the scans that its rows are the poses of.
    skip_bad : bool
        Leave unusable rows out, counted and noted, instead of stopping at the first.

    Raises
    ------
    ScanError
        A file that cannot be read or is of neither format, an unusable row, or rows without stamps.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "run.tum")
    ...     _ = path.write_text("# t x y z qx qy qz qw\\n10.0 0 0 0 0 0 0 1\\n10.5 1 0 0 0 0 0.7071 0.7071\\n")
    ...     trajectory = read_trajectory(path)
    >>> trajectory.format, trajectory.poses[1].round(3)
    ('TUM trajectory, 2 poses', array([1.   , 0.   , 1.571]))
    """
    rows = text_rows(Path(path), WANTED)
    n_fields = _usual_length(rows)
    if n_fields == N_TUM_FIELDS:
        if times is not None:
            raise ScanError(f"{path} is a TUM trajectory, which has its own stamps; leave the file of times out")
        return _tum(str(path), rows, skip_bad)
    if n_fields == N_KITTI_FIELDS:
        return _kitti(str(path), rows, times, scan_stamps_ns, skip_bad)
    seen = rows[0][1][:60]
    raise ScanError(f"{path} is no trajectory: its rows have {n_fields} fields, the first is {seen!r}.\n  {WANTED}")


def read_tum(path: str | Path, *, skip_bad: bool = False) -> Trajectory:
    """Read a TUM trajectory: rows of t x y z qx qy qz qw, seconds and metres; see `read_trajectory`."""
    return _tum(str(path), text_rows(Path(path), WANTED), skip_bad)


def read_kitti(
    path: str | Path,
    *,
    times: str | Path | None = None,
    scan_stamps_ns: Sequence[int] | NDArray[np.int64] | None = None,
    skip_bad: bool = False,
) -> Trajectory:
    """Read a KITTI trajectory: rows of 12 numbers, with stamps from elsewhere; see `read_trajectory`.

    z is taken to go up. KITTI's own files are of a camera (z ahead, y down): they are refused where they turn, since
    that is about another axis.
    """
    return _kitti(str(path), text_rows(Path(path), WANTED), times, scan_stamps_ns, skip_bad)


# ---- formats -------------------------------------------------------------------------------------


def _tum(source: str, rows: list[tuple[int, str]], skip_bad: bool) -> Trajectory:
    bad = BadRows(source, skip_bad)
    lines, values = number_rows(rows, N_TUM_FIELDS, bad)
    quaternions = values[:, 4:8]
    stamps_ns = seconds_to_ns(values[:, 0])
    with np.errstate(all="ignore"):  # any numbers may stand in a file; what comes of them is looked at below
        norms = np.linalg.norm(quaternions, axis=1)
        turns = quaternions / norms[:, None]
        poses, upside_down, level = flatten(values[:, 1:4], turns)
        up = 1 - 2 * (turns[:, 0] ** 2 + turns[:, 1] ** 2)
    reasons = {
        "stamp": stamps_ns == UNUSABLE_STAMP_NS,
        "norm": ~(np.abs(norms - 1) <= NORM_TOLERANCE),
        "tilt": upside_down | ~level,
        "pose": ~possible_poses(poses),
    }
    usable = np.ones(len(lines), dtype=bool)
    for i in np.flatnonzero(np.any(list(reasons.values()), axis=0)).tolist():
        usable[i] = False
        if reasons["stamp"][i]:
            bad.add(f"line {lines[i]}", _stamp_reason(float(values[i, 0])))
        elif reasons["norm"][i]:
            bad.add(
                f"line {lines[i]}",
                f"the quaternion {_told(quaternions[i])} has length {norms[i]:.3g}; wanted 1, as qx qy qz qw",
            )
        elif reasons["tilt"][i]:
            hint = "; is qw the last of the four, and z up?"
            bad.add(f"line {lines[i]}", _tilt_reason(float(up[i])) + hint)
        else:
            bad.add(
                f"line {lines[i]}",
                f"the position is {_told(values[i, 1:4])}; wanted metres within ±{MAX_POSITION_M:g}",
            )
    labels = [f"line {number}" for number in lines]
    return _made(source, "TUM", stamps_ns, poses, values[:, 3], usable, labels, bad, [])


def _kitti(
    source: str,
    rows: list[tuple[int, str]],
    times: str | Path | None,
    scan_stamps_ns: Sequence[int] | NDArray[np.int64] | None,
    skip_bad: bool,
) -> Trajectory:
    bad = BadRows(source, skip_bad)
    # A row that is left out still stands for its stamp, so rows that cannot be read stay, as NaN.
    lines, values = number_rows(rows, N_KITTI_FIELDS, bad, keep=True)
    notes = []
    if times is not None:
        stamps_ns = _times(Path(times))
        whose = f"{times} has {len(stamps_ns)} times"
    elif scan_stamps_ns is not None:
        stamps_ns = np.asarray(scan_stamps_ns, dtype=np.int64)
        whose = f"the log has {len(stamps_ns)} scans"
        notes.append("KITTI rows have no stamps: taken for the poses of the scans, one each, in order of time")
    else:
        raise ScanError(
            f"{source} is a KITTI trajectory, whose rows have no stamps; wanted the times as well.\n"
            "  Use --pose-times FILE, one number a row; or read_trajectory(times=...)."
        )
    if len(stamps_ns) != len(lines):
        raise ScanError(
            f"{source} has {len(lines)} poses, but {whose}; wanted as many.\n"
            "  Use --pose-times FILE with the time of each pose, one number a row."
        )
    matrices = values.reshape(-1, 3, 4)
    rotations = matrices[:, :, :3]
    with np.errstate(all="ignore"):
        skew = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        across = np.cross(rotations[:, 0], rotations[:, 1])
        mirrored = (across * rotations[:, 2]).sum(axis=1) < 0
    up = rotations[:, 2, 2]
    poses = np.stack(
        [matrices[:, 0, 3], matrices[:, 1, 3], np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])], axis=-1
    )
    unread = np.isnan(values).any(axis=1)
    usable = np.array(~unread, dtype=np.bool_)
    wrong = (~(skew <= 2 * NORM_TOLERANCE)) | mirrored | ~(up >= math.cos(MOST_TILT_RAD)) | ~possible_poses(poses)
    for i in np.flatnonzero(wrong & ~unread).tolist():
        usable[i] = False
        if not skew[i] <= 2 * NORM_TOLERANCE or mirrored[i]:
            what = "mirrors" if mirrored[i] and skew[i] <= 2 * NORM_TOLERANCE else "is no rotation"
            bad.add(f"line {lines[i]}", f"the 3 x 3 part of the matrix {what}; wanted a rotation, row by row")
        elif not up[i] >= math.cos(MOST_TILT_RAD):
            hint = "; KITTI's own poses are a camera's, with z ahead and y down: turn them first"
            bad.add(f"line {lines[i]}", _tilt_reason(float(up[i])) + hint)
        else:
            bad.add(
                f"line {lines[i]}",
                f"the position is {_told(matrices[i, :, 3])}; wanted metres within ±{MAX_POSITION_M:g}",
            )
    labels = [f"line {number}" for number in lines]
    return _made(source, "KITTI", stamps_ns, poses, matrices[:, 2, 3], usable, labels, bad, notes)


def _made(
    source: str,
    kind: str,
    stamps_ns: NDArray[np.int64],
    poses: NDArray[np.float64],
    heights: NDArray[np.float64],
    usable: NDArray[np.bool_],
    labels: list[str],
    bad: BadRows,
    notes: list[str],
) -> Trajectory:
    """The usable rows in order of time, each stamp once."""
    rows = np.flatnonzero(usable)
    if not rows.size:
        raise ScanError(f"{source} holds no usable pose; {''.join(bad.notes()) or 'it is empty'}.\n  {WANTED}")
    stamps_ns, poses, heights = stamps_ns[rows], poses[rows], heights[rows]
    back = np.flatnonzero(stamps_ns[1:] < stamps_ns[:-1])
    notes = [*bad.notes(), *notes]
    if back.size:
        step_s = float(apart_s(stamps_ns[back + 1], stamps_ns[back]).max())
        notes.append(
            f"{back.size} of {len(rows)} poses step back in time, by up to {step_s:.3g} s (first:"
            f" {labels[rows[back[0] + 1]]}): sorted by stamp"
        )
    order = np.argsort(stamps_ns, kind="stable")
    first = np.concatenate([[True], stamps_ns[order[1:]] > stamps_ns[order[:-1]]])
    if not first.all():
        again = labels[rows[order[int(np.flatnonzero(~first)[0])]]]
        notes.append(
            f"{np.count_nonzero(~first)} of {len(rows)} poses repeat a stamp (first: {again}): the first one counts"
        )
    order = order[first]
    stamps_ns, poses = stamps_ns[order], poses[order]
    heights = heights[np.isfinite(heights)]
    with np.errstate(over="ignore"):
        height_m = float(np.ptp(heights)) if heights.size else 0.0
    if height_m > FLOORS_APART_M:
        notes.append(f"heights differ by {height_m:.3g} m and are left out; several floors make no 2D map")
    if len(order) > 1:
        step_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        speed = step_m / apart_s(stamps_ns[:-1], stamps_ns[1:])
        jumps = np.flatnonzero((speed > FAST_M_PER_S) & (step_m > 1.0))
        if jumps.size:
            i = int(jumps[0])
            notes.append(
                f"poses jump {jumps.size} times, faster than {FAST_M_PER_S:g} m/s: first by {step_m[i]:.3g} m to"
                f" {labels[rows[order[i + 1]]]}"
            )
    return Trajectory(
        stamps_ns,
        poses,
        source=source,
        format=f"{kind} trajectory, {len(order)} poses",
        notes=tuple(notes),
        n_skipped=bad.n,
    )


# ---- rows ----------------------------------------------------------------------------------------


def text_rows(path: Path, wanted: str) -> list[tuple[int, str]]:
    """(line number, text) of the lines that say something, with blanks between the fields."""
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        raise ScanError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    if not content:
        raise ScanError(f"{path} is empty.\n  {wanted}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScanError(f"{path} is no text: byte {error.start + 1} is no UTF-8.\n  {wanted}") from None
    rows = []
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        said = line.split("#", 1)[0].replace(",", " ").strip()
        if said:
            rows.append((number, said))
    if not rows:
        raise ScanError(f"{path} holds no rows, only comments.\n  {wanted}")
    return rows


def _usual_length(rows: list[tuple[int, str]]) -> int:
    """The number of fields that most of the first rows have."""
    lengths = [len(text.split()) for _, text in rows[:100]]
    return max(sorted(set(lengths)), key=lengths.count)


def number_rows(
    rows: list[tuple[int, str]], n_fields: int, bad: BadRows, *, keep: bool = False
) -> tuple[list[int], NDArray[np.float64]]:
    """Line numbers and values ``(n_rows, n_fields)``. What cannot be read goes to `bad`, or with `keep` is NaN."""
    lines: list[int] = []
    values: list[list[float]] = []
    for number, text in rows:
        fields = text.split()
        row = [math.nan] * n_fields
        reason = ""
        if len(fields) != n_fields:
            reason = f"has {len(fields)} fields; wanted {n_fields}"
        elif "_" in text:  # Python would read 1_0 as 10
            reason = f"{_shown(next(one for one in fields if '_' in one))} is no number"
        else:
            try:
                row = [float(one) for one in fields]
            except ValueError:
                reason = f"{_shown(next(one for one in fields if not _is_number(one)))} is no number"
        if reason:
            bad.add(f"line {number}", reason)
            if not keep:
                continue
        elif keep and any(map(math.isnan, row)):
            bad.add(f"line {number}", "holds nan; wanted numbers")
        lines.append(number)
        values.append(row)
    return lines, np.array(values, dtype=np.float64).reshape(len(values), n_fields)


def _times(path: Path) -> NDArray[np.int64]:
    """Stamps from a file with a number a row."""
    bad = BadRows(str(path), skip_bad=False)
    lines, values = number_rows(text_rows(path, WANTED_TIMES), 1, bad)
    stamps_ns = seconds_to_ns(values[:, 0])
    for i in np.flatnonzero(stamps_ns == UNUSABLE_STAMP_NS).tolist():
        raise ScanError(f"{path}, line {lines[i]}: {_stamp_reason(float(values[i, 0]))}")
    return stamps_ns


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _shown(text: str) -> str:
    return repr(text if len(text) <= MAX_FIELD_CHARS else text[:MAX_FIELD_CHARS] + "...")


def _told(values: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values.tolist()) + ")"


def _stamp_reason(stamp_s: float) -> str:
    hint = ", not nanoseconds" if abs(stamp_s) >= MAX_STAMP_S else ""
    return f"the stamp {stamp_s:.10g} is no usable time (wanted: seconds within ±{MAX_STAMP_S:g}{hint})"


def _tilt_reason(up: float) -> str:
    tilt_deg = math.degrees(math.acos(min(1.0, max(-1.0, up))))
    return f"the pose is tilted by {tilt_deg:.0f} degrees; wanted at most {math.degrees(MOST_TILT_RAD):.0f}"
