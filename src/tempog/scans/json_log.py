"""Scans in JSON, as a few 2D SLAM repositories keep the classic logs -> Scans.

::

    {"map": {"976052890.244111": {"range": [1.09, 1.08, ...], "theta": -0.46, "x": 0.70, "y": -0.02}, ...}}

A key is a stamp in seconds; x, y, theta are the laser's pose in metres and radians; beams fan out as CARMEN has it.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ScanError
from tempog.scans.clock import UNUSABLE_STAMP_NS, mend_clock, parse_clock, seconds_to_ns
from tempog.scans.laser_geometry import beam_angles, check_sensor_max_range, infer_sensor_max
from tempog.scans.scan import BadRows, Scan, ScanLog, usable_poses

WANTED = 'Wanted: {"map": {"STAMP": {"range": [...], "x": 0.0, "y": 0.0, "theta": 0.0}, ...}}.'


def read_json(
    path: str | Path,
    *,
    clock: str = "auto",
    skip_bad: bool = False,
    sensor_max_range: float | None = None,
) -> ScanLog:
    """Read scans from JSON of the form at the top of this module.

    Parameters
    ----------
    path : path of the file
    clock : "auto", "sort" or "rate=HZ"
        See `tempog.scans.clock`. Keys of JSON have no order of their own, so scans are taken in that of their stamps.
    skip_bad : bool
        Leave unusable scans out, counted and noted, instead of stopping at the first.
    sensor_max_range : float, metres, optional
        Overrides what the readings let guess about the sensor's maximum range; see `read_carmen`.

    Raises
    ------
    ScanError
        A file that cannot be read or is of another form, or an unusable scan.
    ClockError
        Stamps that make no usable time axis.
    ConfigError
        An unknown `clock`, or a `sensor_max_range` not above 0.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "intel_gfs")
    ...     _ = path.write_text('{"map": {"12.5": {"range": [2, 3], "theta": 0, "x": 1, "y": 0}}}')
    ...     read_json(path)[0]
    Scan(t=12.5, pose=(1.0, 0.0, 0.0), 2 beams, 2 returns)
    """
    policy = parse_clock(clock)
    check_sensor_max_range(sensor_max_range)
    bad = BadRows(str(path), skip_bad)
    rows: list[tuple[str, int, tuple[float, float, float], NDArray[np.float32]]] = []
    for stamp, row in _scans(Path(path)).items():
        label = f"scan {stamp[:40]!r}"
        stamp_ns = int(seconds_to_ns([_number(stamp)])[0])
        reason, pose, ranges = _parts(row)
        if stamp_ns == UNUSABLE_STAMP_NS and policy.mode != "rate":
            reason = reason or "the key is no usable time in seconds"
        if reason:
            bad.add(label, reason)
        else:
            rows.append((label, stamp_ns, pose, ranges))
    if not rows:
        raise ScanError(f"{path} holds no usable scan; {''.join(bad.notes()) or 'its map is empty'}.\n  {WANTED}")
    rows.sort(key=lambda row: row[1])
    mended = mend_clock(
        np.array([row[1] for row in rows], dtype=np.int64), [row[0] for row in rows], policy, source=str(path)
    )
    notes = []
    max_range = sensor_max_range
    if max_range is None:
        max_range, why = infer_sensor_max([row[3] for row in rows], [row[2][:2] for row in rows])
        notes = [f"sensor maximum taken as {max_range:g} m, {why} (--sensor-max-range overrides it)"]
    angles = {n: beam_angles(n) for n in {len(row[3]) for row in rows}}
    scans = []
    for i, stamp_ns in zip(mended.order.tolist(), mended.stamp_ns.tolist(), strict=True):
        label, _, pose, ranges = rows[i]
        scans.append(Scan(0.0, pose, angles[len(ranges)], ranges, max_range, stamp_ns=stamp_ns, label=label))
    beams = "to".join(f" {n} " for n in sorted({min(angles), max(angles)}))
    return ScanLog(
        scans,
        source=str(path),
        format=f"JSON log:{beams}beams, sensor maximum {max_range:g} m",
        notes=(*bad.notes(), *mended.notes, *notes),
        n_skipped=bad.n,
    )


def _scans(path: Path) -> dict[str, Any]:
    """What the file calls its map."""
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        raise ScanError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    try:
        document = json.loads(content.decode("utf-8-sig"), object_pairs_hook=_each_once)
    except _TwiceError as error:
        raise ScanError(f"{path} says {error} twice; wanted a stamp of its own for every scan") from None
    except RecursionError:
        raise ScanError(f"{path} is nested too deeply.\n  {WANTED}") from None
    except ValueError as error:  # also what is no UTF-8, and numbers of thousands of digits
        raise ScanError(f"{path} is no JSON: {error}.\n  {WANTED}") from None
    scans = document.get("map") if isinstance(document, dict) else None
    if not isinstance(scans, dict):
        held = (
            ", ".join(sorted(repr(key[:20]) for key in document)[:8]) if isinstance(document, dict) else "no object"
        )
        raise ScanError(f'{path} is JSON without an object "map"; it holds {held or "nothing"}.\n  {WANTED}')
    return scans


class _TwiceError(Exception):
    """A key that an object has twice."""


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        seen: set[str] = set()
        raise _TwiceError(next(repr(key[:40]) for key, _ in pairs if key in seen or seen.add(key)))  # type: ignore[func-returns-value]
    return made


def _parts(row: Any) -> tuple[str, tuple[float, float, float], NDArray[np.float32]]:
    """What is wrong with one scan, if anything, its pose and its ranges."""
    pose, ranges = (math.nan, math.nan, math.nan), np.empty(0, dtype=np.float32)
    missing = [key for key in ("x", "y", "theta", "range") if not isinstance(row, dict) or key not in row]
    if missing:
        return f"has no {', '.join(missing)}", pose, ranges
    pose = (_number(row["x"]), _number(row["y"]), _number(row["theta"]))
    if not usable_poses(np.array(pose)):
        seen = ", ".join(repr(row[key])[:20] for key in ("x", "y", "theta"))
        return f"the pose is {seen}; wanted finite metres, metres, radians", pose, ranges
    readings = row["range"]
    if not isinstance(readings, list) or not readings:
        return f"range is {str(readings)[:20]!r}; wanted a list of readings", pose, ranges
    if not all(type(one) in (int, float) for one in readings):
        odd = next(one for one in readings if type(one) not in (int, float))
        return f"a reading is {str(odd)[:20]!r}; wanted metres", pose, ranges
    with np.errstate(over="ignore"):  # beyond float32 is beyond any sensor: infinity, a beam without return
        return "", pose, np.array([_number(one) for one in readings]).astype(np.float32)


def _number(value: Any) -> float:
    """NaN for what is no number."""
    try:
        if isinstance(value, bool) or (isinstance(value, str) and "_" in value):
            return math.nan
        return float(value)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return math.nan
