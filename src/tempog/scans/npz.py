"""Scans in a NumPy archive (.npz) with named arrays: the way in and out for everything else.

=========== ======================== ==========================================
array       shape                    what
=========== ======================== ==========================================
t           (n_scans,)               seconds
x, y, theta (n_scans,) each          pose of the laser: metres, metres, radians
angles      (n_beams,)               radians, 0 ahead, positive to the left
ranges      (n_scans, n_beams)       metres
max_range   () or (1,)               the sensor's maximum range, metres
=========== ======================== ==========================================
"""

from __future__ import annotations

import math
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from tempog._files import whole_file
from tempog.errors import ScanError
from tempog.scans.clock import UNUSABLE_STAMP_NS, mend_clock, parse_clock, seconds_to_ns
from tempog.scans.laser_geometry import check_sensor_max_range
from tempog.scans.scan import MAX_ANGLE_RAD, BadRows, Scan, ScanLog, usable_poses

WANTED = "wanted: t, x, y, theta (n_scans,), angles (n_beams,), ranges (n_scans, n_beams), max_range ()"
MAX_DEFLATE_RATIO = 1100  # deflate packs at most 1032:1; an archive that claims more is damaged


def read_npz(
    path: str | Path,
    *,
    clock: str = "auto",
    skip_bad: bool = False,
    sensor_max_range: float | None = None,
) -> ScanLog:
    """Read scans from an .npz archive with the arrays named at the top of this module.

    Parameters
    ----------
    path : path of the archive
    clock : "auto", "sort" or "rate=HZ"
        See `tempog.scans.clock`.
    skip_bad : bool
        Leave rows with an unusable pose or stamp out, counted and noted, instead of stopping.
    sensor_max_range : float, metres, optional
        Used instead of the array max_range, which may then be absent.

    Returns
    -------
    ScanLog
        Labels are "row 3", counted from 0 as NumPy does.

    Raises
    ------
    ScanError
        No archive, an array that is missing or has another shape, or an unusable row.
    ClockError
        Stamps that make no usable time axis.
    ConfigError
        An unknown `clock`, or a `sensor_max_range` not above 0.

    Notes
    -----
    Pickled objects are never loaded. Shapes are compared before any large array is read.
    """
    policy = parse_clock(clock)
    check_sensor_max_range(sensor_max_range)
    arrays = _load(Path(path), with_max_range=sensor_max_range is None)
    max_range = float(arrays["max_range"].item()) if sensor_max_range is None else float(sensor_max_range)
    if not max_range > 0:
        raise ScanError(
            f"{path}: array max_range is {max_range!r}; wanted metres above 0.\n  --sensor-max-range overrides it."
        )
    angles = arrays["angles"]
    usable_angles = np.abs(angles) <= MAX_ANGLE_RAD
    if not usable_angles.all():
        beam = int(np.flatnonzero(~usable_angles)[0])
        raise ScanError(f"{path}: array angles holds {float(angles[beam])!r} at beam {beam}; wanted radians")

    bad = BadRows(str(path), skip_bad)
    poses = np.column_stack([arrays[name].astype(np.float64) for name in ("x", "y", "theta")])
    stamp_ns = seconds_to_ns(arrays["t"])
    usable = usable_poses(poses)
    for i in np.flatnonzero(~usable):
        bad.add(f"row {i}", f"the pose is {tuple(poses[i].tolist())}; wanted finite metres, metres, radians")
    if skip_bad and policy.mode != "rate":
        for i in np.flatnonzero(usable & (stamp_ns == UNUSABLE_STAMP_NS)):
            bad.add(f"row {i}", f"stamp {float(arrays['t'][i])!r} s is no usable time")
            usable[i] = False
    rows = np.flatnonzero(usable)
    if not rows.size:
        raise ScanError(f"{path} holds no usable scan; {''.join(bad.notes()) or 'its arrays are empty'}")

    mended = mend_clock(stamp_ns[rows], [f"row {i}" for i in rows], policy, source=str(path))
    scans = []
    for row, ns in zip(rows[mended.order], mended.stamp_ns, strict=True):
        x, y, theta = poses[row].tolist()
        ranges = arrays["ranges"][row]
        scans.append(Scan(0.0, (x, y, theta), angles, ranges, max_range, stamp_ns=int(ns), label=f"row {row}"))
    return ScanLog(
        scans,
        source=str(path),
        format=f"npz arrays: {len(angles)} beams, sensor maximum {max_range:g} m",
        notes=(*bad.notes(), *mended.notes),
        n_skipped=bad.n,
    )


def write_npz(path: str | Path, scans: Sequence[Scan]) -> None:
    """Write scans as an .npz archive that `read_npz` reads.

    The archive appears whole or not at all: it is written beside `path` and then renamed.

    Parameters
    ----------
    path : path of the archive
        Taken as it is; no ending is added.
    scans : sequence of Scan
        All with the same beam angles and the same maximum range.

    Raises
    ------
    ScanError
        No scans, scans of different sensors, or a place that cannot be written.

    Notes
    -----
    t is float64 seconds, so stamps of this century come back within 0.2 microseconds.

    Examples
    --------
    >>> import tempfile
    >>> scan = Scan(t=12.5, pose=(0.0, 1.0, 0.0), angles=[-0.5, 0.5], ranges=[2.0, 2.2], max_range=30.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_npz(f"{folder}/scans.npz", [scan])
    ...     read_npz(f"{folder}/scans.npz")[0]
    Scan(t=12.5, pose=(0.0, 1.0, 0.0), 2 beams, 2 returns)
    """
    path = Path(path)
    if not scans:
        raise ScanError(f"no scans to write to {path}; wanted at least one")
    first = scans[0]
    for i, scan in enumerate(scans):
        if not np.array_equal(scan.angles, first.angles) or scan.max_range != first.max_range:
            raise ScanError(
                f"scan {i} ({scan.label or 'no label'}) has {len(scan.angles)} beams up to"
                f" {scan.max_range:g} m, scan 0 has {len(first.angles)} up to {first.max_range:g} m,"
                " or at other angles.\n"
                "  An .npz holds scans of one sensor; write one file per sensor."
            )
    try:
        with whole_file(path) as unfinished, unfinished.open("wb") as file:  # given a name, NumPy would append .npz
            np.savez_compressed(
                file,
                t=np.array([scan.t for scan in scans]),
                x=np.array([scan.x for scan in scans]),
                y=np.array([scan.y for scan in scans]),
                theta=np.array([scan.theta for scan in scans]),
                angles=first.angles,
                ranges=np.stack([scan.ranges for scan in scans]),
                max_range=np.float64(first.max_range),
            )
    except OSError as error:
        raise ScanError(f"cannot write {path}: {error.strerror or error}") from error


def _load(path: Path, *, with_max_range: bool) -> dict[str, NDArray[np.float64] | NDArray[np.float32]]:
    """The arrays, checked for shape and kind; ranges as float32, all else as float64."""
    names = ["t", "x", "y", "theta", "angles", "ranges", *(["max_range"] if with_max_range else [])]
    try:
        file = path.open("rb")
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        raise ScanError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    try:
        with file, zipfile.ZipFile(file) as archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy warns about headers of Python 2; they read well
            shapes = {name: _shape(path, archive, name) for name in names}
            _check_shapes(path, shapes)
            arrays = {name: _values(archive, name) for name in names}
    except ScanError:
        raise
    except Exception as error:
        # Neither zipfile nor NumPy lists what a damaged file can raise: BadZipFile, zlib.error, OSError,
        # ValueError, EOFError, RuntimeError, NotImplementedError, MemoryError ...
        raise ScanError(
            f"{path} cannot be read as .npz: {type(error).__name__}: {error}.\n"
            "  The file is damaged or cut short; write it again with numpy.savez."
        ) from error
    return arrays


def _shape(path: Path, archive: zipfile.ZipFile, name: str) -> tuple[int, ...]:
    """Shape of one array, from its header alone."""
    try:
        info = archive.getinfo(f"{name}.npy")
    except KeyError:
        held = ", ".join(sorted(n.removesuffix(".npy")[:40] for n in archive.namelist())[:20]) or "nothing"
        option = " (or give --sensor-max-range)" if name == "max_range" else ""
        raise ScanError(f"{path}: no array {name}{option}; the archive holds {held}.\n  {WANTED}.") from None
    with archive.open(info) as member:
        version = npy_format.read_magic(member)
        read_header = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, _, dtype = read_header(member)
        n_bytes = info.file_size - member.tell()
    if dtype.kind not in "iuf":
        raise ScanError(f"{path}: array {name} holds {dtype}; wanted real numbers")
    if math.prod(shape) * dtype.itemsize != n_bytes or n_bytes > MAX_DEFLATE_RATIO * path.stat().st_size:
        raise ScanError(f"{path}: array {name} claims shape {shape}, but its data do not fit; it is damaged")
    return tuple(shape)


def _check_shapes(path: Path, shapes: dict[str, tuple[int, ...]]) -> None:
    """Raise ScanError that names the first array whose shape does not fit."""
    for name in ("t", "angles"):
        if len(shapes[name]) != 1 or shapes[name][0] == 0:
            raise ScanError(f"{path}: array {name} has shape {shapes[name]}; {WANTED}.")
    (n_scans,), (n_beams,) = shapes["t"], shapes["angles"]
    wanted: dict[str, tuple[int, ...]] = dict.fromkeys(("x", "y", "theta"), (n_scans,))
    wanted["ranges"] = (n_scans, n_beams)
    for name, shape in wanted.items():
        if shapes[name] != shape:
            raise ScanError(
                f"{path}: array {name} has shape {shapes[name]}; wanted {shape}, since t has {n_scans} scans"
                f" and angles {n_beams} beams"
            )
    if math.prod(shapes.get("max_range", ())) != 1:
        raise ScanError(f"{path}: array max_range has shape {shapes['max_range']}; wanted one number, shape ()")


def _values(archive: zipfile.ZipFile, name: str) -> NDArray[np.float64] | NDArray[np.float32]:
    with archive.open(f"{name}.npy") as member:
        values: NDArray[np.generic] = npy_format.read_array(member, allow_pickle=False)
    with np.errstate(over="ignore", invalid="ignore"):
        if name == "ranges":
            return values.astype(np.float32)
        return values.astype(np.float64)
