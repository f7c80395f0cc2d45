"""Scans -> a bag, as a robot records it: LaserScan messages and the transforms that say where the laser was."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from heapq import merge
from itertools import pairwise
from pathlib import Path

import numpy as np

from tempog.errors import ScanError
from tempog.ros.bag_writers import Compression, OutMessage, open_bag_writer
from tempog.ros.messages import Codec, StampedTransform, Sweep, laser_scan, tf_message, yawed
from tempog.scans.scan import Scan
from tempog.times import NS_PER_S

TF_HZ = 50.0  # what odometry of most robots says


@dataclass(frozen=True)
class Mount:
    """A laser on a robot: what its messages say, and where it sits on the base.

    Attributes
    ----------
    topic, frame : str
    x_m, y_m, z_m : float, metres
        In the base frame.
    theta : float, radians
    upside_down : bool
        Turned over by its own x axis, as of a laser that hangs head first; its beams run the other way.
    sweep_s : float, seconds
        How long a sweep took from its first ray to its last; the scans' rays were taken while the robot drove on.
    """

    topic: str = "/scan"
    frame: str = "laser"
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.2
    theta: float = 0.0
    upside_down: bool = False
    sweep_s: float = 0.0


@dataclass(frozen=True)
class Frames:
    """What a robot calls its frames, and how often it says where they are.

    Attributes
    ----------
    fixed, odom, base : str
        Of the map, of the odometry and of the robot. With `odom` empty, the base is placed in the map directly.
    odom_in_map : (x, y, theta)
        Metres, metres, radians; what localisation says, here without change.
    tf_hz : float
        Transforms a second between scans; 0 gives one with every scan alone.
    prefix : str
        Before the topics tf and tf_static, as "/r1".
    """

    fixed: str = "map"
    odom: str = "odom"
    base: str = "base_link"
    odom_in_map: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tf_hz: float = TF_HZ
    prefix: str = ""


def messages_of(
    scan: Scan,
    codec: Codec,
    mount: Mount | None = None,
    frames: Frames | None = None,
    previous: Scan | None = None,
) -> list[OutMessage]:
    """What a robot says with one scan: where it was since the scan before, and the sweep.

    Parameters
    ----------
    scan : Scan
        Of evenly spaced beams.
    codec : Codec
    mount : Mount, optional
    frames : Frames, optional
    previous : Scan, optional
        The scan before, of the same laser. Transforms since then are interpolated; without it there is one, at the
        scan.

    Raises
    ------
    ScanError
        Beams that are not evenly spaced.
    MessageError
        A stamp that the ROS version has no bits for.

    Examples
    --------
    >>> scan = Scan(2.0, (1.0, 0.0, 0.0), [-1.0, 0.0, 1.0], [2.0, 2.5, 3.0])
    >>> [(one.topic, one.stamp_ns) for one in messages_of(scan, Codec("ros2"))]
    [('/tf', 2000000000), ('/scan', 2000000000)]
    """
    mount, frames = mount or Mount(), frames or Frames()
    before = [] if previous is None else [(previous.stamp_ns, _base_pose(previous, mount))]
    track = [*before, (scan.stamp_ns, _base_pose(scan, mount))]
    return [*_moving(codec, frames, track, with_first=previous is None), _sweep_message(scan, codec, mount)]


def static_messages(
    codec: Codec, mounts: Sequence[Mount] = (Mount(),), frames: Frames | None = None, stamp_ns: int = 0
) -> list[OutMessage]:
    """Where the lasers sit on the base, for ``/tf_static``; latched."""
    frames = frames or Frames()
    placed = []
    for mount in mounts:
        turned = yawed(mount.theta)
        if mount.upside_down:  # half a turn about x comes first
            _, _, sin, cos = turned
            turned = (cos, sin, 0.0, 0.0)
        at = (mount.x_m, mount.y_m, mount.z_m)
        placed.append(StampedTransform(stamp_ns, frames.base, mount.frame, at, turned))
    return [OutMessage(f"{frames.prefix}/tf_static", stamp_ns, tf_message(codec, placed), latched=True)]


def write_bag(
    path: str | Path,
    scans: Sequence[Scan] | Mapping[Mount, Sequence[Scan]],
    *,
    frames: Frames | None = None,
    compression: Compression = "none",
) -> None:
    """Write scans as a bag: LaserScan messages, /tf and /tf_static.

    The bag appears whole or not at all.

    Parameters
    ----------
    path : path of the bag
        By its ending: .mcap (ROS 2), .bag (ROS 1), .db3 (ROS 2, a file alone); without an ending a folder with
        metadata.yaml, as ``ros2 bag record`` makes it.
    scans : sequence of Scan, or a mapping from `Mount` to such
        Of one laser on the base, or of several. All are of one robot.
    frames : Frames, optional
    compression : "none", "lz4", "zstd" or "bz2"
        .mcap: none, lz4, zstd. .bag: none, lz4, bz2. A folder: none, zstd. .db3: none.

    Raises
    ------
    ScanError
        No scans, beams that are not evenly spaced, or a place that cannot be written.
    ConfigError
        An ending or a compression that no bag has.
    ExtraError
        The packages rosbags and mcap are not installed.

    Examples
    --------
    >>> import tempfile
    >>> scans = [Scan(0.1 * k, (0.1 * k, 0.0, 0.0), [-1.0, 0.0, 1.0], [2.0, 2.5, 3.0]) for k in range(10)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_bag(f"{folder}/run.mcap", scans)
    ...     Path(folder, "run.mcap").read_bytes()[:5]
    b'\\x89MCAP'
    """
    path = Path(path)
    lasers = scans if isinstance(scans, Mapping) else {Mount(): scans}
    if not any(lasers.values()):
        raise ScanError(f"no scans to write to {path}; wanted at least one")
    frames = frames or Frames()
    with open_bag_writer(path, compression=compression) as bag:
        start_ns = min(one.stamp_ns for laser in lasers.values() for one in laser)
        for message in static_messages(bag.codec, list(lasers), frames, start_ns):
            bag.write(message)
        poses = {one.stamp_ns: _base_pose(one, mount) for mount, laser in lasers.items() for one in laser}
        streams = [
            map(partial(_sweep_message, codec=bag.codec, mount=mount), laser) for mount, laser in lasers.items()
        ]
        for message in merge(_moving(bag.codec, frames, sorted(poses.items())), *streams, key=_sent_at):
            bag.write(message)


def _sent_at(message: OutMessage) -> int:
    return message.stamp_ns


def _base_pose(scan: Scan, mount: Mount) -> tuple[float, float, float]:
    theta = scan.theta - mount.theta
    cos, sin = math.cos(theta), math.sin(theta)
    return scan.x - cos * mount.x_m + sin * mount.y_m, scan.y - sin * mount.x_m - cos * mount.y_m, theta


def _sweep_message(scan: Scan, codec: Codec, mount: Mount) -> OutMessage:
    angles = -scan.angles if mount.upside_down else scan.angles
    steps = np.diff(angles)
    if not (len(angles) and np.allclose(steps, steps[:1], atol=1e-5)):
        raise ScanError(
            f"{scan.label or f'the scan at {scan.t:.3f} s'} has {len(angles)} beams that are not evenly spaced; a"
            " LaserScan can hold others alone.\n  Write an .npz instead."
        )
    increment_s = mount.sweep_s / max(1, len(angles) - 1)
    sweep = Sweep(scan.stamp_ns, mount.frame, angles, scan.ranges, scan.max_range, increment_s)
    return OutMessage(mount.topic, scan.stamp_ns, laser_scan(codec, sweep))


def _moving(
    codec: Codec, frames: Frames, track: Sequence[tuple[int, tuple[float, float, float]]], with_first: bool = True
) -> Iterator[OutMessage]:
    """Transforms of the base along a track of stamps and poses in the map."""
    if with_first:
        yield _moved(codec, frames, *track[0])
    step_ns = NS_PER_S / frames.tf_hz if frames.tf_hz > 0 else math.inf
    for (start_ns, start), (stop_ns, stop) in pairwise(track):
        n_steps = max(1, min(1000, round((stop_ns - start_ns) / step_ns)))
        turn = math.remainder(stop[2] - start[2], 2 * math.pi)
        for step in range(1, n_steps + 1):
            share = step / n_steps
            x, y = (a + share * (b - a) for a, b in zip(start[:2], stop[:2], strict=True))
            pose = stop if step == n_steps else (x, y, start[2] + share * turn)
            yield _moved(codec, frames, start_ns + (stop_ns - start_ns) * step // n_steps, pose)


def _moved(codec: Codec, frames: Frames, stamp_ns: int, pose: tuple[float, float, float]) -> OutMessage:
    x, y, theta = pose
    parents = []
    if frames.odom:
        dx, dy, turn = frames.odom_in_map
        parents = [_flat(stamp_ns, frames.fixed, frames.odom, dx, dy, turn)]
        cos, sin = math.cos(turn), math.sin(turn)
        x, y, theta = cos * (x - dx) + sin * (y - dy), cos * (y - dy) - sin * (x - dx), theta - turn
    base = _flat(stamp_ns, frames.odom or frames.fixed, frames.base, x, y, theta)
    return OutMessage(f"{frames.prefix}/tf", stamp_ns, tf_message(codec, [*parents, base]))


def _flat(stamp_ns: int, parent: str, child: str, x: float, y: float, theta: float) -> StampedTransform:
    return StampedTransform(stamp_ns, parent, child, (x, y, 0.0), yawed(theta))
