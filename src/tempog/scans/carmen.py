"""The classic public laser logs (CARMEN, .log or .clf, plain or gzip) -> Scans.

One message a line. Those read here::

    FLASER n r1..rn x y theta odom_x odom_y odom_theta ipc_time host logger_time
    ROBOTLASER1 laser_type start_angle field_of_view angular_resolution maximum_range accuracy
        remission_mode n r1..rn m e1..em laser_x laser_y laser_theta robot_x robot_y robot_theta
        tv rv forward_safety_dist side_safety_dist turn_axis ipc_time host logger_time
    PARAM robot_front_laser_max 80.99 ...
    PARAM laser_front_laser_resolution 0.5 ...

and, for the rear laser, RLASER, ROBOTLASER2 and the parameters with "rear". Everything else (ODOM,
NEFF, SYNC, TRUEPOS, ...) is passed over.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError, ScanError
from tempog.scans.clock import UNUSABLE_STAMP_NS, mend_clock, parse_clock, seconds_to_ns
from tempog.scans.laser_geometry import beam_angles, check_sensor_max_range, infer_sensor_max
from tempog.scans.scan import BadRows, Scan, ScanLog, usable_poses

GZIP_MAGIC = b"\x1f\x8b"
MAX_LINE_BYTES = 1_000_000  # 100 times the longest known line; a file without line ends stays harmless
N_TAIL_FIELDS = 9  # of FLASER after the ranges: laser pose, odometry pose, time, host, time
MESSAGE_NAME = re.compile(rb"[A-Z][A-Z0-9_]{1,39}")
KNOWN_MESSAGES = frozenset(
    b"PARAM SYNC ODOM NEFF TRUEPOS MARKER SIMULATOR_TRUEPOS GPS NMEAGGA NMEARMC IMU SONAR BUMPER VECTORMOVE"
    b" ROBOTVELOCITY FOLLOWTRAJECTORY BASEVELOCITY POSITION GLOBALPOS FLASER RLASER LASER3 LASER4 LASER5"
    b" RAWLASER1 RAWLASER2 RAWLASER3 RAWLASER4 RAWLASER5 ROBOTLASER0 ROBOTLASER1 ROBOTLASER2".split()
)
MAX_NAMES_COUNTED = 100  # of message types, so that a file of random words fills no memory


class _Laser(NamedTuple):
    """What one laser is called in a log."""

    plain: bytes
    explicit: bytes
    max_param: bytes
    resolution_param: bytes


LASERS = {
    "front": _Laser(b"FLASER", b"ROBOTLASER1", b"robot_front_laser_max", b"laser_front_laser_resolution"),
    "rear": _Laser(b"RLASER", b"ROBOTLASER2", b"robot_rear_laser_max", b"laser_rear_laser_resolution"),
}


class _Sweep(NamedTuple):
    """One laser line as it stands in the file; the last three are None where the line does not say."""

    label: str
    stamp_s: float
    pose: tuple[float, float, float]
    ranges: NDArray[np.float32]
    start_rad: float | None = None
    resolution_rad: float | None = None
    max_range: float | None = None


class _BadLineError(Exception):
    """Why a laser line cannot be used."""


def read_carmen(
    path: str | Path,
    *,
    clock: str = "auto",
    skip_bad: bool = False,
    laser: str = "front",
    sensor_max_range: float | None = None,
) -> ScanLog:
    """Read the scans of one laser from a CARMEN log, plain or gzip (told by content, not by name).

    Parameters
    ----------
    path : path of the log
    clock : "auto", "sort" or "rate=HZ"
        See `tempog.scans.clock`. Stamps are the lines' ipc_time, in seconds.
    skip_bad : bool
        Leave unusable lines out, counted and noted, instead of stopping at the first; of a gzip file
        cut short, keep what can be read.
    laser : "front" or "rear"
        FLASER and ROBOTLASER1, or RLASER and ROBOTLASER2. If a log holds both of a pair, CARMEN wrote
        every sweep twice; the second, whose lines carry their own geometry, is used alone.
    sensor_max_range : float, metres, optional
        Overrides what the log says or lets guess about the sensor's maximum range.

    Returns
    -------
    ScanLog
        Poses are the laser's, labels are "line 17".

    Raises
    ------
    ScanError
        A file that cannot be read, an unusable line, or no line of this laser at all.
    ClockError
        Stamps that make no usable time axis.
    ConfigError
        An unknown `clock` or `laser`, or a `sensor_max_range` not above 0.

    Notes
    -----
    Beam angles. ROBOTLASER: ``start_angle + i * angular_resolution``. FLASER and RLASER name no angles,
    only their number n; as CARMEN does, see `beam_angles`: an even n (180, 360) gives
    ``-90 + i * 180 / n`` degrees, an odd n (181, 361, 541) gives ``-90 + i * 180 / (n - 1)``.
    A ``PARAM laser_front_laser_resolution`` replaces the 180 degrees by n (even) or n - 1 (odd) times
    that resolution, still centred.

    Sensor maximum. ROBOTLASER: ``maximum_range`` of the line. Else ``PARAM robot_front_laser_max``. Else
    the value, from 20 m up, at which readings pile up at the top of the log although the robot moves; else
    80 m, and never more, since such SICK lasers report errors as 81.83 to 81.91 m. Readings at or
    above the maximum are beams without return. What was inferred or assumed is noted.
    """
    policy = parse_clock(clock)
    if laser not in LASERS:
        raise ConfigError(f"laser = {laser!r} is unknown; wanted front or rear")
    check_sensor_max_range(sensor_max_range)
    bad = BadRows(str(path), skip_bad)
    found = _collect(Path(path), LASERS[laser], bad, sensor_max_range)
    sweeps = found.sweeps
    if not sweeps:
        raise ScanError(_no_scans(str(path), laser, found.n_messages, bad))

    stamp_ns = seconds_to_ns([sweep.stamp_s for sweep in sweeps])
    if skip_bad and policy.mode != "rate":
        for i in np.flatnonzero(stamp_ns == UNUSABLE_STAMP_NS):
            bad.add(sweeps[i].label, f"stamp {sweeps[i].stamp_s!r} s is no usable time")
        kept = np.flatnonzero(stamp_ns != UNUSABLE_STAMP_NS)
        sweeps, stamp_ns = [sweeps[i] for i in kept], stamp_ns[kept]
        if not sweeps:
            raise ScanError(_no_scans(str(path), laser, found.n_messages, bad))
    mended = mend_clock(stamp_ns, [sweep.label for sweep in sweeps], policy, source=str(path))

    angles, angle_notes = _angles(sweeps, LASERS[laser], found.params)
    max_ranges, max_notes = _max_ranges(sweeps, LASERS[laser], found.params, sensor_max_range)
    scans = [
        Scan(0.0, sweep.pose, angles[i], sweep.ranges, max_ranges[i], stamp_ns=int(ns), label=sweep.label)
        for i, ns in zip(mended.order, mended.stamp_ns, strict=True)
        for sweep in (sweeps[i],)
    ]
    return ScanLog(
        scans,
        source=str(path),
        format=_describe(found, scans),
        notes=(*found.notes, *bad.notes(), *mended.notes, *angle_notes, *max_notes),
        n_skipped=bad.n,
    )


# ---- lines ---------------------------------------------------------------------------------------


class _Found(NamedTuple):
    """Everything one pass over the file collects."""

    sweeps: list[_Sweep]
    params: dict[bytes, float]
    n_messages: Counter[bytes]
    notes: list[str]
    message: bytes
    gzipped: bool


def _collect(path: Path, laser: _Laser, bad: BadRows, sensor_max_range: float | None) -> _Found:
    """Read the file once, line by line."""
    n_messages: Counter[bytes] = Counter()
    params: dict[bytes, float] = {}
    notes: list[str] = []
    plain: list[_Sweep] = []
    explicit: list[_Sweep] = []
    with _opened(path) as file:
        gzipped = file.peek(2)[:2] == GZIP_MAGIC
        for number, line in _lines(gzip.GzipFile(fileobj=file) if gzipped else file, bad):
            name = next(iter(line.split(None, 1)), b"#")
            if name.startswith(b"#"):
                continue
            if not MESSAGE_NAME.fullmatch(name):
                bad.add(f"line {number}", f"starts with {_show(name)}, which is no CARMEN message")
                continue
            if name in n_messages or len(n_messages) < MAX_NAMES_COUNTED:
                n_messages[name] += 1
            try:
                if name == laser.explicit:
                    explicit.append(_parse_explicit(f"line {number}", line, sensor_max_range))
                elif name == laser.plain:
                    plain.append(_parse_plain(f"line {number}", line))
                elif name == b"PARAM":
                    _parse_param(f"line {number}", line, laser, params, notes)
            except _BadLineError as error:
                bad.add(f"line {number}", str(error))
    use_explicit = 2 * len(explicit) >= len(plain) and bool(explicit)
    if explicit and plain:
        (used, unused), n_unused = (laser.explicit, laser.plain), len(plain)
        why = "they repeat the same sweeps, without beam angles of their own"
        if not use_explicit:
            (used, unused), n_unused, why = (laser.plain, laser.explicit), len(explicit), "they are few"
        notes.append(f"{n_unused} {unused.decode()} lines are left out in favour of {used.decode()}: {why}")
    unknown = [name.decode() for name in n_messages if name not in KNOWN_MESSAGES]
    if unknown:
        notes.append(f"message types unknown to CARMEN are left out: {', '.join(unknown[:5])}")
    sweeps, message = (explicit, laser.explicit) if use_explicit else (plain, laser.plain)
    return _Found(sweeps, params, n_messages, notes, message, gzipped)


def _opened(path: Path) -> io.BufferedReader:
    try:
        return path.open("rb")
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        raise ScanError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error


def _lines(stream: io.BufferedIOBase, bad: BadRows) -> Iterator[tuple[int, bytes]]:
    """(number, line) of a stream, in bounded memory; what cannot be read goes to `bad`."""
    number = 0
    try:
        while line := stream.readline(MAX_LINE_BYTES):
            number += 1
            if len(line) == MAX_LINE_BYTES and not line.endswith(b"\n"):
                while (rest := stream.readline(MAX_LINE_BYTES)) and not rest.endswith(b"\n"):
                    pass
                bad.add(f"line {number}", f"is longer than {MAX_LINE_BYTES:,} bytes")
                continue
            yield number, line.removeprefix(b"\xef\xbb\xbf") if number == 1 else line
    except EOFError:
        bad.add(f"after line {number}", "the gzip file ends early, as after a cut download")
    except (zlib.error, gzip.BadGzipFile) as error:
        bad.add(f"after line {number}", f"the gzip file is damaged ({error})")
    except OSError as error:
        raise ScanError(f"cannot read {bad.source}: {error.strerror or error}") from error


def _parse_plain(label: str, line: bytes) -> _Sweep:
    """A FLASER or RLASER line."""
    fields = _fields(line)
    n_beams = _count(fields, 1, "beams")
    first_after = 2 + n_beams
    _want_fields(fields, first_after + N_TAIL_FIELDS, f"{n_beams} beams")
    return _Sweep(
        label,
        stamp_s=_number(fields[first_after + 6], "the stamp"),
        pose=_pose(fields[first_after : first_after + 3]),
        ranges=_ranges(fields[2:first_after]),
    )


def _parse_explicit(label: str, line: bytes, sensor_max_range: float | None) -> _Sweep:
    """A ROBOTLASER line."""
    fields = _fields(line)
    n_beams = _count(fields, 8, "beams")
    if len(fields) <= 9 + n_beams:
        _want_fields(fields, 24 + n_beams, f"{n_beams} beams")
    n_remissions = _count(fields, 9 + n_beams, "remissions", least=0)
    after = 10 + n_beams + n_remissions
    _want_fields(fields, after + 14, f"{n_beams} beams and {n_remissions} remissions")
    start_rad = _number(fields[2], "start_angle")
    resolution_rad = _number(fields[4], "angular_resolution")
    span_deg = math.degrees((n_beams - 1) * resolution_rad)
    if not (math.isfinite(start_rad) and abs(start_rad) < 100):
        raise _BadLineError(f"start_angle is {start_rad:g}; wanted radians")
    if n_beams > 1 and not 0 < abs(span_deg) < 360.5:
        raise _BadLineError(
            f"{n_beams} beams with angular_resolution {resolution_rad:g} span {span_deg:g} degrees;"
            " wanted radians, and at most a full turn"
        )
    max_range = _number(fields[5], "maximum_range") if sensor_max_range is None else sensor_max_range
    if not max_range > 0:
        raise _BadLineError(
            f"maximum_range is {max_range:g}; wanted metres above 0 (--sensor-max-range overrides it)"
        )
    return _Sweep(
        label,
        stamp_s=_number(fields[after + 11], "the stamp"),
        pose=_pose(fields[after : after + 3]),
        ranges=_ranges(fields[9 : 9 + n_beams]),
        start_rad=start_rad,
        resolution_rad=resolution_rad if n_beams > 1 else 0.0,
        max_range=max_range,
    )


def _parse_param(label: str, line: bytes, laser: _Laser, params: dict[bytes, float], notes: list[str]) -> None:
    """Remember a parameter that matters; the last one wins, as in CARMEN."""
    fields = line.split(None, 3)
    if len(fields) < 3 or fields[1] not in (laser.max_param, laser.resolution_param):
        return
    value = math.nan
    with contextlib.suppress(ValueError):
        value = float(fields[2])
    if 0 < value < math.inf:
        params[fields[1]] = value
    elif len(notes) < MAX_NAMES_COUNTED:
        notes.append(f"{label}: PARAM {fields[1].decode()} is {_show(fields[2])}, no number above 0: ignored")


def _fields(line: bytes) -> list[bytes]:
    try:
        line.decode()
    except UnicodeDecodeError as error:
        raise _BadLineError(f"byte {error.start + 1} is no text (UTF-8)") from None
    return line.split()


def _want_fields(fields: list[bytes], n_wanted: int, why: str) -> None:
    if len(fields) != n_wanted:
        cut = ", as if cut short" if len(fields) < n_wanted else ""
        raise _BadLineError(
            f"{fields[0].decode()} announces {why}, so {n_wanted} fields were wanted; found {len(fields)}{cut}"
        )


def _count(fields: list[bytes], i: int, what: str, least: int = 1) -> int:
    if i >= len(fields):
        raise _BadLineError(f"{fields[0].decode()} ends before its number of {what}")
    # at most 9 digits: Python refuses to read thousands of them, and a line cannot hold more beams
    if not (fields[i].isdigit() and len(fields[i]) < 10 and int(fields[i]) >= least):
        raise _BadLineError(f"the number of {what} is {_show(fields[i])}; wanted {least} or more")
    return int(fields[i])


def _number(field: bytes, what: str) -> float:
    try:
        if b"_" not in field:  # Python would read 1_0 as 10
            return float(field)
    except ValueError:
        pass
    raise _BadLineError(f"{what} is {_show(field)}; wanted a number")


def _pose(fields: list[bytes]) -> tuple[float, float, float]:
    x, y, theta = (_number(field, name) for field, name in zip(fields, ("x", "y", "theta"), strict=True))
    if not usable_poses(np.array([x, y, theta])):
        raise _BadLineError(f"the laser's pose is {(x, y, theta)}; wanted finite metres, metres, radians")
    return x, y, theta


def _ranges(fields: list[bytes]) -> NDArray[np.float32]:
    try:
        if b"_" in b"".join(fields):
            raise ValueError("left to the slow way, which words the error")
        ranges = np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
    except ValueError:
        ranges = np.array([_number(field, f"reading {i + 1}") for i, field in enumerate(fields)])
    with np.errstate(over="ignore"):  # beyond float32 is beyond any sensor: infinity, a beam without return
        return ranges.astype(np.float32)


def _show(field: bytes) -> str:
    text = field[:20].decode("utf-8", "backslashreplace") + ("..." if len(field) > 20 else "")
    return repr(text)


# ---- geometry ------------------------------------------------------------------------------------


def _angles(
    sweeps: Sequence[_Sweep], laser: _Laser, params: dict[bytes, float]
) -> tuple[list[NDArray[np.float64]], list[str]]:
    """The beam angles of every sweep (arrays are shared), and what to note about them."""
    notes: list[str] = []
    cache: dict[tuple[int, float | None, float | None], NDArray[np.float64]] = {}
    angles = []
    for sweep in sweeps:
        n_beams = len(sweep.ranges)
        key = (n_beams, sweep.start_rad, sweep.resolution_rad)
        if key not in cache:
            if sweep.start_rad is None or sweep.resolution_rad is None:
                fov_deg = _field_of_view_deg(n_beams, laser, params, notes)
                cache[key] = beam_angles(n_beams, fov_deg)
            else:
                steps = np.arange(n_beams, dtype=np.float64)
                cache[key] = sweep.start_rad + steps * sweep.resolution_rad
        angles.append(cache[key])
    return angles, notes


def _field_of_view_deg(n_beams: int, laser: _Laser, params: dict[bytes, float], notes: list[str]) -> float:
    resolution_deg = params.get(laser.resolution_param)
    if resolution_deg is None or n_beams == 1:
        return 180.0
    fov_deg = resolution_deg * (n_beams if n_beams % 2 == 0 else n_beams - 1)
    param = f"PARAM {laser.resolution_param.decode()} {resolution_deg:g}"
    said = f"{param} with {n_beams} beams is {fov_deg:g} degrees"
    if fov_deg > 360 + 1e-6:
        notes.append(f"{said}, more than a full turn: ignored, 180 degrees assumed")
        return 180.0
    if abs(fov_deg - 180) < 1e-6:
        return 180.0
    notes.append(f"{said}: used instead of the usual 180")
    return fov_deg


# ---- sensor maximum ------------------------------------------------------------------------------


def _max_ranges(
    sweeps: Sequence[_Sweep], laser: _Laser, params: dict[bytes, float], sensor_max_range: float | None
) -> tuple[list[float], list[str]]:
    """The sensor maximum of every sweep, and what to note about it."""
    if sensor_max_range is not None:
        return [float(sensor_max_range)] * len(sweeps), []
    explicit = [sweep.max_range for sweep in sweeps if sweep.max_range is not None]
    if explicit:
        return explicit, []
    if laser.max_param in params:
        return [params[laser.max_param]] * len(sweeps), []
    max_range, why = infer_sensor_max([s.ranges for s in sweeps], [s.pose[:2] for s in sweeps])
    note = f"no PARAM {laser.max_param.decode()}: sensor maximum taken as {max_range:g} m, {why}"
    return [max_range] * len(sweeps), [f"{note} (--sensor-max-range overrides it)"]


# ---- words ---------------------------------------------------------------------------------------


def _describe(found: _Found, scans: Sequence[Scan]) -> str:
    counts = sorted({len(scan.ranges) for scan in scans})
    limits = sorted({scan.max_range for scan in scans})
    beams = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    limit = f"{limits[0]:g} m" if len(limits) == 1 else f"{limits[0]:g} to {limits[-1]:g} m"
    packed = ", gzip" if found.gzipped else ""
    return f"CARMEN log{packed}: {found.message.decode()}, {beams} beams, sensor maximum {limit}"


def _no_scans(source: str, laser: str, n_messages: Counter[bytes], bad: BadRows) -> str:
    """Why there is nothing to return, and which option would help."""
    wanted = f"{LASERS[laser].plain.decode()} or {LASERS[laser].explicit.decode()}"
    seen = ", ".join(f"{name.decode()} {n}" for name, n in n_messages.most_common(8)) or "no message at all"
    other = "rear" if laser == "front" else "front"
    if any(n_messages[name] for name in (LASERS[other].plain, LASERS[other].explicit)):
        remedy = f"Use --laser {other}: this log has that laser."
    elif any(b"LASER" in name for name in n_messages if name not in LASERS[laser][:2]):
        remedy = "Its other laser messages carry no pose; only the front and the rear laser can be read."
    else:
        remedy = "Is it a CARMEN log with corrected poses?"
    skipped = "".join(f"\n  {note}." for note in bad.notes())
    return f"{source} holds no usable scan: wanted {wanted} lines, saw {seen}.{skipped}\n  {remedy}"
