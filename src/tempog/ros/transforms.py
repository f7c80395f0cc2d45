"""Where frames are in each other: transforms that came one by one, asked for at any time, as tf2 does it."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ConfigError, TransformError
from tempog.ros.messages import StampedTransform
from tempog.times import NS_PER_S

# A sweep, or a driver that is ahead of its odometry, ends a scan's period after the last transform. The pose is held.
EXTRAPOLATE_S = 0.1
# Longer pauses are bridged only if the frame is afterwards where it was before: tf2 itself forgets after 10 s.
MOST_GAP_S = 5.0
SAME_PLACE_M = 0.1
SAME_HEADING_RAD = math.radians(5)
# Lasers level to 3 degrees see a wall 10 m away half a metre higher or lower, which the plane can bear.
MOST_TILT_RAD = math.radians(3)
MAX_POSITION_M = 1e9  # twenty times around the Earth; projected coordinates stay below, a corrupt transform does not
SAME_NUMBER = 1e-9  # m, or of a quaternion; rounding of what is worked out anew with every message
NEARLY_SAME_TURN = 1 - 1e-10  # cosine of half the angle; slerp divides by its sine
LONGEST_S = 9e9  # s; stands for ever, and fits int64 nanoseconds

Translations = NDArray[np.float64]
Quaternions = NDArray[np.float64]


class TransformBuffer:
    """Transforms between frames, interpolated in time: straight lines, and turns at an even rate.

    Parameters
    ----------
    keep_s : float, seconds
        Forget what is older than that against the newest of the same frame. Default: keep all.
    extrapolate_s : float, seconds
        How far before the first and after the last transform of a frame its pose still counts; it is held there.
    max_gap_s : float, seconds
        Between two transforms farther apart nothing is interpolated, unless the frame stayed where it was to 0.1 m
        and 5 degrees.

    Raises
    ------
    ConfigError
        A setting that is negative or no number.

    Examples
    --------
    >>> buffer = TransformBuffer()
    >>> buffer.add(StampedTransform(0, "base_link", "laser", (0.2, 0.0, 0.3)), static=True)
    >>> for second in (0, 1):
    ...     buffer.add(StampedTransform(second * 10**9, "odom", "base_link", (2.0 * second, 0.0, 0.0)))
    >>> flatten(*buffer.poses("odom", "laser", [500_000_000]))[0]
    array([[1.2, 0. , 0. ]])
    """

    def __init__(
        self, keep_s: float = math.inf, *, extrapolate_s: float = EXTRAPOLATE_S, max_gap_s: float = MOST_GAP_S
    ) -> None:
        for name, seen in (("keep_s", keep_s), ("extrapolate_s", extrapolate_s), ("max_gap_s", max_gap_s)):
            if not seen >= 0:
                raise ConfigError(f"{name} = {seen!r} cannot work; wanted seconds from 0")
        self._keep_ns, self._extrapolate_ns, self._max_gap_ns = (
            round(min(seen, LONGEST_S) * NS_PER_S) for seen in (keep_s, extrapolate_s, max_gap_s)
        )
        self._tracks: dict[tuple[str, str], _Track] = {}

    def add(self, transform: StampedTransform, *, static: bool = False) -> None:
        """Keep one transform; of two with the same stamp and frames the first stays, of static ones the last.

        Raises
        ------
        TransformError
            A frame without a name or in itself, or numbers that are no transform.
        """
        stamp_ns, parent, child, translation, quaternion = transform
        if not parent or not child or parent == child:
            raise TransformError(f"a transform of {child!r} in {parent!r} cannot work; wanted two different frames")
        norm = math.sqrt(sum(part * part for part in quaternion))
        if not (all(abs(part) <= MAX_POSITION_M for part in translation) and 1e-6 < norm < 1e6):
            raise TransformError(
                f"the transform of {child} in {parent} at {stamp_ns / NS_PER_S:.3f} s is unusable: it moves by"
                f" {translation} m and turns by the quaternion {quaternion}; wanted metres within"
                f" ±{MAX_POSITION_M:g}, and finite numbers, not all 0"
            )
        track = self._tracks.get((parent, child))
        if track is None:
            track = self._tracks[parent, child] = _Track()
        track.add(stamp_ns, (*translation, *(part / norm for part in quaternion)), static, self._keep_ns)

    def forget(self, parent: str, child: str) -> None:
        """Forget all that was said of a frame in its parent."""
        self._tracks.pop((parent, child), None)

    def frames(self) -> dict[str, str]:
        """The parent of each frame that has one; of several, the one with the most transforms."""
        parents = sorted(self._tracks, key=lambda names: len(self._tracks[names]))
        return {child: parent for parent, child in parents}

    def is_static(self, parent: str, child: str) -> bool:
        """Whether a frame does not move in its parent."""
        return (parent, child) in self._tracks and self._tracks[parent, child].static

    def is_still(self, parent: str, child: str) -> bool:
        """Whether a frame never moved in its parent, as of a static transform that is said again and again on /tf."""
        track = self._tracks.get((parent, child))
        if track is None:
            return False
        values = np.array(track.values).reshape(-1, 7)
        return track.static or bool((np.abs(values - values[0]) <= SAME_NUMBER).all())

    def chain(self, fixed: str, frame: str) -> list[str]:
        """Frames from `frame` to `fixed`, both included; TransformError if nothing connects them."""
        near: dict[str, list[str]] = {fixed: [], frame: []}
        for parent, child in self._tracks:
            near.setdefault(parent, []).append(child)
            near.setdefault(child, []).append(parent)
        before: dict[str, str] = {frame: frame}
        waiting = [frame]
        for one in waiting:
            for other in near[one]:
                if other not in before:
                    before[other] = one
                    waiting.append(other)
        if fixed not in before:
            raise TransformError(self._unconnected(fixed, frame))
        way = [fixed]
        while way[-1] != frame:
            way.append(before[way[-1]])
        return way[::-1]

    def links(self) -> set[tuple[str, str]]:
        """Parents and children that transforms were added for."""
        return set(self._tracks)

    def joined(self, other: TransformBuffer) -> TransformBuffer:
        """The transforms of both; of two that say where a frame is in the same parent, only those of this one."""
        both = self.without_parents("")
        both._tracks = other._tracks | self._tracks
        return both

    def without_parents(self, frame: str) -> TransformBuffer:
        """The same transforms, but for those that place a frame in another; for poses of it from elsewhere."""
        rest = TransformBuffer()
        rest._keep_ns, rest._extrapolate_ns, rest._max_gap_ns = self._keep_ns, self._extrapolate_ns, self._max_gap_ns
        rest._tracks = {names: track for names, track in self._tracks.items() if names[1] != frame}
        return rest

    def span_ns(self, fixed: str, frame: str) -> tuple[int, int] | None:
        """First and last moment at which the frame's pose is known, without extrapolation; None if it always is."""
        tracks = [track for track, _ in self._steps(fixed, frame) if not track.static]
        if not tracks:
            return None
        return max(track.stamps[0] for track in tracks), min(track.stamps[-1] for track in tracks)

    def poses(
        self, fixed: str, frame: str, stamps_ns: ArrayLike, *, partial: bool = False
    ) -> tuple[Translations, Quaternions]:
        """Where a frame is in another at some moments.

        Parameters
        ----------
        fixed, frame : str
        stamps_ns : (n,) int64, nanoseconds
        partial : bool
            Give NaN for moments at which it is not known, instead of raising.

        Returns
        -------
        translations : (n, 3) float64, metres
        quaternions : (n, 4) float64
            x, y, z, w.

        Raises
        ------
        TransformError
            Unknown frames, frames that nothing connects, or moments at which a transform between them is not known.
        """
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        translations, quaternions = np.zeros((len(stamps), 3)), np.tile([0.0, 0.0, 0.0, 1.0], (len(stamps), 1))
        for track, inverted in self._steps(fixed, frame):
            moved, turned = track.at(stamps, self._extrapolate_ns, self._max_gap_ns)
            if inverted:
                turned = turned * [-1.0, -1.0, -1.0, 1.0]
                moved = -_rotated(turned, moved)
            translations = moved + _rotated(turned, translations)
            quaternions = _product(turned, quaternions)
        if not partial and np.isnan(translations).any():
            raise TransformError(self.explain(fixed, frame, stamps))
        return translations, quaternions

    def explain(self, fixed: str, frame: str, stamps_ns: ArrayLike) -> str:
        """Why a frame's pose is not known at some of these moments: which transform lacks, and from when to when."""
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        chain = self.chain(fixed, frame)
        for (track, _), (one, other) in zip(self._steps(fixed, frame), pairwise(chain), strict=True):
            unknown = stamps[np.isnan(track.at(stamps, self._extrapolate_ns, self._max_gap_ns)[0][:, 0])]
            if not len(unknown):
                continue
            first, last = track.stamps[0], track.stamps[-1]
            asked = f"{int(unknown[0]) / NS_PER_S:.3f}"
            if len(unknown) > 1:
                asked += f" to {int(unknown[-1]) / NS_PER_S:.3f}"
            inside = unknown[(unknown > first) & (unknown < last)]
            pause = f", with pauses above {self._max_gap_ns / NS_PER_S:g} s in which it moved" if len(inside) else ""
            return (
                f"where {frame} is in {fixed} is not known at {asked} s: {one} and {other} are connected from"
                f" {first / NS_PER_S:.3f} to {last / NS_PER_S:.3f} s{pause}"
            )
        return f"where {frame} is in {fixed} is known at all of these moments"

    def _steps(self, fixed: str, frame: str) -> list[tuple[_Track, bool]]:
        """Tracks from `frame` to `fixed`, and whether each is followed from the parent to the child."""
        chain = self.chain(fixed, frame)
        return [
            (self._tracks[other, one], False) if (other, one) in self._tracks else (self._tracks[one, other], True)
            for one, other in pairwise(chain)
        ]

    def _unconnected(self, fixed: str, frame: str) -> str:
        known = sorted({name for names in self._tracks for name in names})
        if not known:
            return f"there are no transforms at all, so that {frame} has no place in {fixed}"
        for name in (fixed, frame):
            if name not in known:
                return f"there is no frame {name!r}; there are {', '.join(known)}"
        groups = [", ".join(self.connected(name)) for name in (fixed, frame)]
        return f"nothing connects {frame} with {fixed}: on one side are {groups[0]}, on the other {groups[1]}"

    def connected(self, name: str) -> list[str]:
        """The frame and all that transforms connect with it, at whatever time."""
        group = {name}
        while grown := {one for names in self._tracks for one in names if group & set(names)} - group:
            group |= grown
        return sorted(group)


class _Track:
    """One frame in its parent over time."""

    def __init__(self) -> None:
        self.stamps = array("q")
        self.values = array("d")  # 7 numbers each: translation, quaternion
        self.static = False

    def __len__(self) -> int:
        return len(self.stamps)

    def add(self, stamp_ns: int, values: tuple[float, ...], static: bool, keep_ns: int) -> None:
        if static or self.static:
            if static or not self.stamps:
                self.static = True
                self.stamps, self.values = array("q", [stamp_ns]), array("d", values)
            return
        if not self.stamps or stamp_ns > self.stamps[-1]:
            self.stamps.append(stamp_ns)
            self.values.extend(values)
            # Half of it at a time, so that forgetting costs little.
            if self.stamps[0] < stamp_ns - 2 * keep_ns:
                n = bisect_left(self.stamps, stamp_ns - keep_ns)
                del self.stamps[:n]
                del self.values[: 7 * n]
            return
        k = bisect_left(self.stamps, stamp_ns)
        if self.stamps[k] != stamp_ns:
            self.stamps.insert(k, stamp_ns)
            self.values[7 * k : 7 * k] = array("d", values)

    def at(self, stamps: NDArray[np.int64], extrapolate_ns: int, max_gap_ns: int) -> tuple[Translations, Quaternions]:
        """Translations (n, 3) and quaternions (n, 4); NaN where they are not known."""
        values = np.array(self.values).reshape(-1, 7) if self.static else np.frombuffer(self.values).reshape(-1, 7)
        if self.static:
            return np.tile(values[:, :3], (len(stamps), 1)), np.tile(values[:, 3:], (len(stamps), 1))
        known = np.frombuffer(self.stamps, dtype=np.int64)
        held = np.clip(stamps, known[0], known[-1])
        after = np.searchsorted(known, held, side="left")
        before = np.where(known[after] == held, after, after - 1)
        gap = (known[after] - known[before]).astype(np.float64)
        share = np.where(gap > 0, (held - known[before]) / np.maximum(gap, 1.0), 0.0)[:, None]
        moved = values[before, :3] + share * (values[after, :3] - values[before, :3])
        turned = _slerp(values[before, 3:], values[after, 3:], share)
        unknown = np.abs(stamps - held) > extrapolate_ns
        wide = gap > max_gap_ns
        if wide.any():
            apart = np.linalg.norm(values[after, :3] - values[before, :3], axis=-1)
            half_turn = np.abs((values[after, 3:] * values[before, 3:]).sum(axis=-1))
            unknown |= wide & ((apart > SAME_PLACE_M) | (half_turn < math.cos(SAME_HEADING_RAD / 2)))
        moved[unknown] = np.nan
        return moved, turned


def flatten(
    translations: Translations, quaternions: Quaternions, max_tilt_rad: float = MOST_TILT_RAD
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Poses in space as poses in the plane.

    Parameters
    ----------
    translations, quaternions : (n, 3) and (n, 4)
        As `TransformBuffer.poses` gives them.
    max_tilt_rad : float, radians
        How far a frame's z axis may lean away from the vertical.

    Returns
    -------
    poses : (n, 3) float64
        x, y (m), and the heading of the frame's x axis (rad).
    upside_down : (n,) bool
        The z axis points down, as of a laser mounted head first: angles run the other way round.
    level : (n,) bool
        Whether it leans no farther than `max_tilt_rad`, up or down. A pose that is not should not be used.

    Examples
    --------
    >>> poses, upside_down, level = flatten(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
    >>> upside_down, level
    (array([ True]), array([ True]))
    """
    x, y, z, w = quaternions.T
    heading = np.arctan2(2 * (x * y + z * w), 1 - 2 * (y * y + z * z))
    upright = 1 - 2 * (x * x + y * y)
    poses = np.column_stack([translations[:, :2], heading])
    return poses, upright < 0, np.abs(upright) >= math.cos(max_tilt_rad)


def buffer_of(transforms: Iterable[StampedTransform], static: Iterable[StampedTransform] = ()) -> TransformBuffer:
    """A buffer that keeps all of some transforms."""
    buffer = TransformBuffer()
    for one in static:
        buffer.add(one, static=True)
    for one in transforms:
        buffer.add(one)
    return buffer


def _rotated(quaternions: Quaternions, vectors: Translations) -> Translations:
    axis, w = quaternions[:, :3], quaternions[:, 3:]
    twice = 2 * np.cross(axis, vectors)
    rotated: Translations = vectors + w * twice + np.cross(axis, twice)
    return rotated


def _product(first: Quaternions, second: Quaternions) -> Quaternions:
    """The rotation `second`, then `first`."""
    ax, ay, az, aw = first.T
    bx, by, bz, bw = second.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def _slerp(first: Quaternions, second: Quaternions, share: NDArray[np.float64]) -> Quaternions:
    """Between two rotations, the shorter way, at an even rate."""
    cosine = (first * second).sum(axis=-1, keepdims=True)
    second = np.where(cosine < 0, -second, second)
    half = np.arccos(np.clip(np.abs(cosine), 0, 1))
    near = np.abs(cosine) > NEARLY_SAME_TURN
    sine = np.where(near, 1.0, np.sin(half))
    mixed = np.where(
        near,
        first + share * (second - first),
        (np.sin((1 - share) * half) * first + np.sin(share * half) * second) / sine,
    )
    return np.asarray(mixed / np.linalg.norm(mixed, axis=-1, keepdims=True), dtype=np.float64)
