"""Sweeps that wait for their transforms, and become scans."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from tempog.errors import ScanError, TransformError
from tempog.ros.messages import StampedTransform, Sweep
from tempog.ros.transforms import MOST_TILT_RAD, TransformBuffer
from tempog.scans.scan import Scan
from tempog.scans.sweep import scan_of
from tempog.times import NS_PER_S

KEEP_S = 30.0  # of transforms; sweeps wait for a fraction of a second
FIXED_FRAMES = ("map", "odom")  # where nobody says which: the first that the laser is connected with
CHOOSE_S = 5.0  # s; a localisation that has just started connects map and odom by then
MOST_WAITING = 1000  # sweeps; a bound for who sets `wait_s` to minutes
MOST_OLD = 20  # transforms of a frame that come from before; then they are what counts
MOST_MOVING = 2000  # frames; some nodes name a new one for every person they see


class Waiting(NamedTuple):
    """A sweep that waits: since when, by our clock, and for which topic it came."""

    stamp_ns: int
    number: int
    since_s: float
    sweep: Sweep
    topic: str


class Placing:
    """Gives sweeps their poses once the transforms for that are there.

    A sweep waits until the laser's pose is known up to its last ray. After `wait_s` it is placed by the latest pose,
    if that is within the buffer's `extrapolate_s` of it, or else dropped. No laser waits for another.

    Parameters
    ----------
    fixed_frame : str
        To map in; empty for the first of `frames` that turns out to be there.
    wait_s : float, seconds
    buffer : TransformBuffer, optional
    frames : tuple of str
        Other than the first are taken only after `CHOOSE_S`.

    Attributes
    ----------
    fixed_frame : str
        Empty until it is known.
    n_dropped : int
        Sweeps that could not be placed.
    why : str
        Why the last of them could not.
    """

    def __init__(
        self,
        fixed_frame: str = "",
        wait_s: float = 0.2,
        buffer: TransformBuffer | None = None,
        frames: tuple[str, ...] = FIXED_FRAMES,
    ) -> None:
        self.fixed_frame = fixed_frame
        self._frames = frames
        self.buffer = TransformBuffer(keep_s=KEEP_S) if buffer is None else buffer
        self.n_dropped = 0
        self.why = ""
        self._wait_s = wait_s
        self._waiting: list[Waiting] = []
        self._n = 0
        self._first_s = math.nan
        self._newest_ns: dict[tuple[str, str], int] = {}
        self._n_old: dict[tuple[str, str], int] = {}  # that came one after the other

    def __len__(self) -> int:
        return len(self._waiting)

    def add_transforms(self, transforms: Iterable[StampedTransform], *, static: bool) -> None:
        """Take transforms in; those from long before the latest are of a time that is over, and are not kept.

        Unless no others come: then the latest was wrong, or a clock was put back, and that frame begins anew.
        """
        for one in transforms:
            names = one.parent, one.child
            newest_ns = self._newest_ns.get(names, one.stamp_ns)
            if not static:
                if one.stamp_ns < newest_ns - KEEP_S * NS_PER_S:
                    self._n_old[names] = self._n_old.get(names, 0) + 1
                    if self._n_old[names] < MOST_OLD:
                        continue
                    self._forget(names)
                    newest_ns = one.stamp_ns
                self._n_old.pop(names, None)
                self._newest_ns.pop(names, None)
                self._newest_ns[names] = max(newest_ns, one.stamp_ns)  # behind all others: last heard of
                if len(self._newest_ns) > MOST_MOVING:
                    self._forget(next(iter(self._newest_ns)))
            try:
                self.buffer.add(one, static=static)
            except TransformError as error:
                self.why = str(error)

    def _forget(self, names: tuple[str, str]) -> None:
        del self._newest_ns[names]
        self._n_old.pop(names, None)
        if not self.buffer.is_static(*names):
            self.buffer.forget(*names)

    def add_sweep(self, sweep: Sweep, topic: str, now_s: float) -> None:
        """Let a sweep wait."""
        if math.isnan(self._first_s):
            self._first_s = now_s
        self._n += 1
        bisect.insort(self._waiting, Waiting(sweep.stamp_ns, self._n, now_s, sweep, topic))
        if len(self._waiting) > MOST_WAITING:
            del self._waiting[0]
            self._drop(f"more than {MOST_WAITING} scans wait for transforms")

    def ready(self, now_s: float) -> Iterator[tuple[str, Scan]]:
        """Topics and scans that can be placed by now, in the order of their stamps."""
        left: list[Waiting] = []
        waiting, self._waiting = self._waiting, left
        until_ns: dict[str, float] = {}
        for one in waiting:
            overdue = now_s - one.since_s >= self._wait_s
            frame = one.sweep.frame
            if not overdue and frame not in until_ns:
                until_ns[frame] = self._known_until_ns(frame, now_s)
            if not overdue and one.sweep.stop_ns > until_ns[frame]:
                left.append(one)
            elif (scan := self._placed(one.sweep, now_s)) is not None:
                yield one.topic, scan

    def _known_until_ns(self, frame: str, now_s: float) -> float:
        """To when a laser's pose is known: waiting brings no more to sweeps that ended by then."""
        fixed = self._fixed(frame, now_s)
        if not fixed:
            return -math.inf
        try:
            span_ns = self.buffer.span_ns(fixed, frame)
        except TransformError:
            return -math.inf
        return math.inf if span_ns is None else span_ns[1]

    def _placed(self, sweep: Sweep, now_s: float) -> Scan | None:
        fixed = self._fixed(sweep.frame, now_s)
        if not sweep.frame:
            self._drop("LaserScans come without a frame: their header.frame_id is empty; the laser's driver sets it")
            return None
        if not fixed:
            self._drop(self._no_frame(sweep))
            return None
        try:
            scan = scan_of(sweep, self.buffer, fixed, label=f"the scan of {sweep.frame}")
            if scan is None:
                self._drop(self._no_pose(fixed, sweep))
        except (TransformError, ScanError) as error:
            self._drop(str(error))
            return None
        return scan

    def _fixed(self, frame: str, now_s: float) -> str:
        if self.fixed_frame:
            return self.fixed_frame
        patient = now_s - self._first_s < CHOOSE_S
        for name in self._frames[:1] if patient else self._frames:
            try:
                self.buffer.chain(name, frame)
            except TransformError:
                continue
            self.fixed_frame = name
            return name
        return ""

    def _no_pose(self, fixed: str, sweep: Sweep) -> str:
        stamps_ns = [sweep.stamp_ns, sweep.stop_ns]
        moved, _ = self.buffer.poses(fixed, sweep.frame, stamps_ns, partial=True)
        if np.isfinite(moved).all():
            return f"{sweep.frame} leans by more than {math.degrees(MOST_TILT_RAD):g} degrees in {fixed}"
        return self.buffer.explain(fixed, sweep.frame, stamps_ns)

    def _no_frame(self, sweep: Sweep) -> str:
        known = sorted({name for pair in self.buffer.frames().items() for name in pair})
        if not known:
            return f"no transforms have come yet, so that {sweep.frame} has no place"
        return (
            f"{sweep.frame} is not connected with {' or '.join(self._frames)}; there are {', '.join(known)}."
            f" Choose: {' or '.join(f'--fixed-frame {name}' for name in _roots(self.buffer.frames()))}"
        )

    def _drop(self, why: str) -> None:
        self.n_dropped += 1
        self.why = why


def _roots(parents: dict[str, str]) -> list[str]:
    """Frames that have no parent."""
    return sorted(set(parents.values()) - set(parents))
