"""Bags of ROS 1 and ROS 2 -> Scans, without a ROS installation."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError, MessageError, ScanError, TempogError, TransformError
from tempog.ros.messages import LASER_SCAN, POINT_CLOUD, StampedTransform, Sweep, stamp_ns_of
from tempog.ros.transforms import MOST_TILT_RAD, TransformBuffer, flatten
from tempog.scans.bag_choice import BagChoice
from tempog.scans.bag_contents import (
    Contents,
    Progress,
    Recording,
    open_recording,
    read_clouds,
    read_contents,
)
from tempog.scans.bag_frames import (
    FRAME_OF_POSES,
    Laser,
    Placement,
    base_of,
    check_topics,
    choose_lasers,
    place,
    transforms_for,
)
from tempog.scans.clock import ClockPolicy, mend_clock, parse_clock
from tempog.scans.clouds import BEAM_DEG, frame_of, sweep_of_cloud
from tempog.scans.laser_geometry import check_sensor_max_range
from tempog.scans.scan import Scan, ScanLog
from tempog.scans.sweep import scans_of
from tempog.times import NS_PER_S

LEANS = "leans by up to"


def open_bag(
    paths: str | Path | Iterable[str | Path],
    choice: BagChoice | None = None,
    *,
    clock: str = "auto",
    skip_bad: bool = False,
    sensor_max_range: float | None = None,
    progress: Progress | None = None,
) -> list[ScanLog]:
    """Read the scans of a recording: ROS 1 bags, MCAP files, ROS 2 bags in SQLite, or folders of them.

    Parameters
    ----------
    paths : path or paths
        Several are one recording, and share their transforms.
    choice : BagChoice, optional
        Topics and frames, where what is chosen by itself is not what is wanted.
    clock : "auto", "sort" or "rate=HZ"
        What to do about time stamps out of order; see `tempog.scans.clock`. Poses are looked up at the stamps as
        recorded.
    skip_bad : bool
        Use what is intact of damaged bags, and leave out messages that are broken and scans without a pose, counted
        and noted; instead of stopping at the first.
    sensor_max_range : float, metres, optional
        Overrides the maximum range that the messages say.
    progress : callable, optional
        Called now and then with how many bytes were dealt with, and how many there are.

    Returns
    -------
    list of ScanLog
        One for each laser. `format` and `notes` say what was chosen; labels are "/scan message 17".

    Raises
    ------
    ScanError
        Files that are no bags or damaged, no scans, or topics that contradict each other.
    TransformError
        Nothing says where the lasers were, or not at all times.
    ClockError
        Stamps that make no usable time axis.
    ConfigError
        A topic or a frame that is not there, or holds something else.
    ExtraError
        The packages rosbags and mcap are not installed.

    Examples
    --------
    >>> import tempfile
    >>> from tempog.scans.bag_writer import write_bag
    >>> scans = [Scan(0.1 * k, (0.1 * k, 0.0, 0.0), [-1.0, 0.0, 1.0], [2.0, 2.5, 3.0], 30.0) for k in range(10)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_bag(f"{folder}/run.mcap", scans)
    ...     (log,) = open_bag(f"{folder}/run.mcap")
    >>> log.format
    'MCAP: /scan in laser, 3 beams, sensor maximum 30 m; placed in map by transforms'
    >>> log[3]
    Scan(t=0.3, pose=(0.3, 0.0, 0.0), 3 beams, 3 returns)
    """
    choice, policy = choice or BagChoice(), parse_clock(clock)
    check_sensor_max_range(sensor_max_range)
    recording = open_recording([paths] if isinstance(paths, str | Path) else paths, skip_bad, progress)
    wanted = set(choice.scan_topics)
    contents = read_contents(
        recording, lambda topic: choice.from_cloud is None and (not wanted or topic.name in wanted)
    )
    recording.check()
    try:
        if choice.from_cloud is not None:
            lasers, notes, buffer = _flattened(recording, contents, choice, choice.from_cloud)
        else:
            lasers, notes = choose_lasers(recording, contents, choice)
            buffer = transforms_for(recording, contents, [laser.topic for laser in lasers])
        if sensor_max_range is not None:
            lasers = [_limited(laser, float(sensor_max_range)) for laser in lasers]
        placement = place(recording, buffer, lasers, choice)
        recording.check()
        logs = [_log(recording, laser, placement, policy, skip_bad) for laser in lasers]
    except (TransformError, MessageError) as error:
        text = str(error) + "".join(f"\n  {loss}." for loss in recording.losses)
        raise type(error)(text if recording.source in text else f"{recording.source}: {text}") from None
    return _noted(recording, [*notes, *placement.notes], logs)


def merged(logs: list[ScanLog]) -> ScanLog:
    """Logs of several lasers of one recording as one, by time."""
    if len(logs) == 1:
        return logs[0]
    scans = sorted((scan for log in logs for scan in log), key=lambda scan: scan.stamp_ns)
    return ScanLog(
        scans,
        source=logs[0].source,
        format="; ".join(log.format for log in logs),
        notes=tuple(dict.fromkeys(note for log in logs for note in log.notes)),
        n_skipped=sum(log.n_skipped for log in logs),
        files=logs[0].files,
    )


def _noted(recording: Recording, notes: list[str], logs: list[ScanLog]) -> list[ScanLog]:
    """Logs with what is to be said of the whole recording, in the first."""
    first = logs[0]
    files = tuple(str(file) for file, _ in recording.files)
    said = tuple(dict.fromkeys((*recording.all_notes(), *notes, *first.notes)))
    logs = [replace(first, notes=said, n_skipped=first.n_skipped + recording.bad.n + recording.n_losses), *logs[1:]]
    return [replace(log, source=recording.source, files=files) for log in logs]


def _limited(laser: Laser, max_range: float) -> Laser:
    return replace(laser, sweeps=[(label, replace(sweep, max_range=max_range)) for label, sweep in laser.sweeps])


# ---- sweeps -> scans -----------------------------------------------------------------------------


def _log(recording: Recording, laser: Laser, placement: Placement, policy: ClockPolicy, skip_bad: bool) -> ScanLog:
    labels = [label for label, _ in laser.sweeps]
    mended = mend_clock(laser.stamps_ns, labels, policy, source=recording.source)
    sweeps = [laser.sweeps[k][1] for k in mended.order]
    labels = [labels[k] for k in mended.order]
    found = scans_of(sweeps, placement.buffer, placement.fixed, label=labels.__getitem__)
    without = [sweep for sweep, scan in zip(sweeps, found, strict=True) if scan is None]
    notes = list(mended.notes)
    if without:
        reasons = _why_without(without, laser, placement)
        counted = f"{len(without)} of {len(sweeps)} scans of {laser.topic}"
        if not skip_bad or len(without) == len(sweeps):
            raise TransformError(
                f"{recording.source}: {counted} cannot be placed: {reasons}.\n"
                f"  {_remedy(laser, placement, reasons, len(without) == len(sweeps))}"
            )
        notes.append(f"{counted} left out: {reasons}")
    scans = [
        scan if scan.stamp_ns == stamp_ns else _restamped(scan, int(stamp_ns))
        for scan, stamp_ns in zip(found, mended.stamp_ns.tolist(), strict=True)
        if scan is not None
    ]
    if not any((scan.ranges > 0).any() for scan in scans):  # no returns are infinite, and count
        notes.append(f"no beam of {laser.topic} says anything: all readings are below range_min, or no numbers")
    counts, limits = sorted({len(scan.ranges) for scan in scans}), {sweep.max_range for sweep in sweeps}
    beams = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    limit = max(limits)
    said = f"sensor maximum {limit:g} m" if limit < math.inf else "no sensor maximum"
    return ScanLog(
        scans,
        source=recording.source,
        format=f"{recording.kinds}: {laser.topic} in {laser.frame}, {beams} beams, {said}; placed in"
        f" {placement.fixed} by {placement.source}",
        notes=tuple(notes),
        n_skipped=len(without),
    )


def _restamped(scan: Scan, stamp_ns: int) -> Scan:
    pose = (scan.x, scan.y, scan.theta)
    return Scan(0.0, pose, scan.angles, scan.ranges, scan.max_range, stamp_ns=stamp_ns, label=scan.label)


def _why_without(without: list[Sweep], laser: Laser, placement: Placement) -> str:
    """Why scans have no pose: it is not known then, or the laser leans."""
    stamps = np.array([stamp for sweep in without for stamp in (sweep.stamp_ns, sweep.stop_ns)], dtype=np.int64)
    moved, turned = placement.buffer.poses(placement.fixed, laser.frame, stamps, partial=True)
    unknown = np.isnan(moved[:, 0])
    if unknown.any():
        return placement.buffer.explain(placement.fixed, laser.frame, stamps)
    upright = np.abs(1 - 2 * (turned[:, 0] ** 2 + turned[:, 1] ** 2))
    lean = math.degrees(math.acos(float(np.clip(upright.min(), 0, 1))))
    _, _, level = flatten(moved, turned)
    if level.all():
        return f"where {laser.frame} is in {placement.fixed} is not known all through the sweep"
    return f"{laser.frame} {LEANS} {lean:.0f} degrees, wanted {math.degrees(MOST_TILT_RAD):.0f} at most"


def _remedy(laser: Laser, placement: Placement, reasons: str, all_of_them: bool) -> str:
    if all_of_them and LEANS in reasons:
        return (
            f"If it does not, its transform is wrong: give its poses in the plane with --poses FILE --scan-topic"
            f" {laser.topic}. Of a laser that does, no map in the plane can be made."
        )
    first_s, last_s = (int(stamp) / NS_PER_S for stamp in (laser.stamps_ns.min(), laser.stamps_ns.max()))
    if placement.fixed == FRAME_OF_POSES:
        shift = "--pose-offset S adds S seconds to the stamps of the poses"
        other = f"; {shift}"
    else:
        shift, other = "Use another --fixed-frame, or a --pose-topic", ", or another --fixed-frame or a --pose-topic"
    if all_of_them:
        return f"The scans are from {first_s:.3f} to {last_s:.3f} s. Do both use the same clock? {shift}."
    return f"Use --skip-bad to leave them out{other}."


# ---- clouds --------------------------------------------------------------------------------------


def _flattened(
    recording: Recording, contents: Contents, choice: BagChoice, band_m: tuple[float, float]
) -> tuple[list[Laser], list[str], TransformBuffer]:
    """Sweeps made of one topic's clouds, in a flat frame where the sensor is; and the transforms for them."""
    check_topics(recording, choice.scan_topics, [POINT_CLOUD], "--scan-topic")
    counts = {name: n for name, n in recording.topics(POINT_CLOUD).items() if n}
    names = list(choice.scan_topics) or list(counts)
    if not names:
        raise ScanError(
            f"{recording.source} holds no clouds (--from-cloud): wanted sensor_msgs/PointCloud2, saw"
            f" {recording.listing()}"
            + ("; leave --from-cloud out to use its scans" if recording.topics(LASER_SCAN) else "")
        )
    if len(names) > 1:
        flags = "\n".join(f"  --scan-topic {name}  ({counts.get(name, 0)} clouds)" for name in names)
        raise ConfigError(f"{recording.source} holds several topics of clouds, and one can be used.\n{flags}")
    flat = _FlatFrame(transforms_for(recording, contents, names), choice.base_frame, band_m)
    sweeps: list[tuple[str, Sweep]] = []
    for label, message in read_clouds(recording, names[0]):
        try:
            sweeps.append((label, flat.sweep_of(message)))
        except TempogError as error:
            recording.bad.add(label, str(error))
        except (AttributeError, TypeError, ValueError, OverflowError) as error:
            recording.bad.add(label, f"its cloud lacks something: {error}")
    if not sweeps:
        raise ScanError(
            f"{recording.source}: topic {names[0]} has no usable cloud; {'; '.join(recording.all_notes())}"
        )
    notes = [
        f"scans are the nearest points of {names[0]} from {band_m[0]:g} to {band_m[1]:g} m above {flat.base}, one for"
        f" every {BEAM_DEG:g} degrees; beams without a point say nothing",
        *flat.notes,
    ]
    return [Laser(names[0], flat.name, sweeps)], notes, flat.buffer


class _FlatFrame:
    """A frame above whose origin a sensor is, with the axes of the robot's base; known from the first cloud on."""

    def __init__(self, buffer: TransformBuffer, base: str, band_m: tuple[float, float]) -> None:
        self.buffer, self.base, self.band_m = buffer, base, band_m
        self.name, self.sensor = "", ""
        self.origin_m = (0.0, 0.0)
        self.notes: list[str] = []

    def sweep_of(self, message: Any) -> Sweep:
        frame = frame_of(message)
        if not self.name:
            self._begin(frame)
        if frame != self.sensor:
            raise MessageError(f"it is in frame {frame!r}, others of this topic in {self.sensor!r}")
        if self.name == self.sensor:
            return sweep_of_cloud(message, self.name, self.band_m)
        stamp_ns = stamp_ns_of(message.header.stamp)
        moved, turned = self.buffer.poses(self.base, frame, [stamp_ns])
        return sweep_of_cloud(message, self.name, self.band_m, _matrix(turned[0]), moved[0], self.origin_m)

    def _begin(self, frame: str) -> None:
        self.sensor = frame
        self.base = self.base or base_of(self.buffer, frame)
        if self.base == frame:
            self.name = frame
            self.notes = [f"no transform says where {frame} is on the robot: heights are above {frame} itself"]
            return
        chain = self.buffer.chain(self.base, frame)
        moved, _ = self.buffer.poses(self.base, frame, [0], partial=True)
        if not np.isnan(moved).any() and len(chain) > 1:
            self.origin_m = (float(moved[0, 0]), float(moved[0, 1]))
        self.name = f"{frame} on the ground"
        at = (*self.origin_m, 0.0)
        self.buffer.add(StampedTransform(0, self.base, self.name, at), static=True)


def _matrix(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z, w = quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
