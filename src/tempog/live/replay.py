"""A log played as the robot that recorded it, for tests and demonstrations."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from tempog.errors import ConfigError, ScanError
from tempog.live.transport import Publisher, Transport
from tempog.ros.bag_writers import OutMessage
from tempog.ros.messages import LASER_SCAN, TF_MESSAGE, Codec
from tempog.scans.bag_writer import Frames, Mount, messages_of, static_messages
from tempog.scans.scan import Scan, scan_period_s
from tempog.times import NS_PER_S

EVEN_RAD = 1e-5  # rad; as the messages are written
LONGEST_SLEEP_S = 0.1  # s; then it is looked whether to go on


class Replay:
    """Publishes the LaserScans and transforms that the robot of a log would.

    Parameters
    ----------
    transport : Transport
    scans : sequence of Scan
        In time order; a `ScanLog`, for example. Where beams are not evenly spaced, as when motion during a sweep was
        compensated, each reading moves to the nearest of as many beams that are; of two the shorter stays.
    mount, frames : Mount and Frames, optional
        What topics and frames are called.
    rate : float
        How many times faster than it was; ``inf`` for as fast as it goes.
    start_ns : int, nanoseconds, optional
        Stamp of the first scan. Default: that of the log.
    sleep, clock : callable
        For tests.

    Attributes
    ----------
    n_scans : int
        Published so far.
    n_spaced : int
        Of these, with beams that were not evenly spaced.

    Raises
    ------
    ScanError
        No scans.
    ConfigError
        A rate that is not above 0.
    """

    def __init__(
        self,
        transport: Transport,
        scans: Sequence[Scan],
        *,
        mount: Mount | None = None,
        frames: Frames | None = None,
        rate: float = 1.0,
        start_ns: int | None = None,
        sleep: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not len(scans):
            raise ScanError("there are no scans to play; wanted at least one")
        if not rate > 0:
            raise ConfigError(f"rate = {rate!r} cannot work; wanted a number above 0, or max")
        self.n_scans = self.n_spaced = 0
        self._scans, self._rate = scans, rate
        self._mount, self._frames = mount or Mount(), frames or Frames()
        self._codec = Codec(transport.version)
        self._start_ns = scans[0].stamp_ns if start_ns is None else start_ns
        self._sleep, self._clock = sleep, clock
        prefix = self._frames.prefix
        self._publishers: dict[str, Publisher] = {
            f"{prefix}/tf_static": transport.advertise(f"{prefix}/tf_static", TF_MESSAGE, latched=True),
            f"{prefix}/tf": transport.advertise(f"{prefix}/tf", TF_MESSAGE),
            self._mount.topic: transport.advertise(self._mount.topic, LASER_SCAN),
        }

    def run(self, stop: Callable[[], bool] = lambda: False, *, times: float = 1) -> None:
        """Play the log so many times, one after the other, or until `stop` says so.

        Each time begins where the one before ended, so that time never goes back; with ``times=inf`` it never ends.
        """
        shift_ns = self._start_ns - self._scans[0].stamp_ns
        period_s = scan_period_s([scan.stamp_ns for scan in self._scans])
        lasts_ns = self._scans[-1].stamp_ns - self._scans[0].stamp_ns
        lasts_ns += round((period_s if period_s > 0 else 0.1) * NS_PER_S)
        for message in static_messages(self._codec, [self._mount], self._frames, self._start_ns):
            self._publish(message)
        began_s, began_ns = self._clock(), self._start_ns
        previous: Scan | None = None
        played = 0
        while played < times:
            previous = None if played else previous
            for scan in self._scans:
                even = evenly_spaced(scan)
                self.n_spaced += even is not scan
                moved = _shifted(even, shift_ns)
                for message in messages_of(moved, self._codec, self._mount, self._frames, previous):
                    due_s = began_s + (message.stamp_ns - began_ns) / NS_PER_S / self._rate
                    if not self._wait(due_s, stop):
                        return
                    self._publish(message)
                self.n_scans += 1
                previous = moved
            shift_ns += lasts_ns
            played += 1

    def _wait(self, due_s: float, stop: Callable[[], bool]) -> bool:
        """Wait for a moment; False if it is over before."""
        while not stop():
            left_s = due_s - self._clock()
            if left_s <= 0 or math.isinf(self._rate):
                return True
            self._sleep(min(left_s, LONGEST_SLEEP_S))
        return False

    def _publish(self, message: OutMessage) -> None:
        self._publishers[message.topic].publish(self._codec.encode(message.message))


def evenly_spaced(scan: Scan) -> Scan:
    """A scan whose beams a LaserScan can hold; the same one if they are evenly spaced.

    >>> uneven = Scan(0.0, (0.0, 0.0, 0.0), [0.0, 0.1, 0.19, 0.3], [1.0, 2.0, 3.0, 4.0])
    >>> [round(float(angle), 6) for angle in evenly_spaced(uneven).angles]
    [0.0, 0.1, 0.2, 0.3]
    """
    angles = np.unwrap(scan.angles)
    n_beams = len(angles)
    if n_beams < 2 or np.allclose(np.diff(scan.angles), scan.angles[1] - scan.angles[0], atol=EVEN_RAD):
        return scan
    low, high = float(angles.min()), float(angles.max())
    even = np.linspace(low, high, n_beams)
    nearest = np.rint((angles - low) / (high - low) * (n_beams - 1)).astype(np.intp)
    ranges = np.full(n_beams, np.nan, dtype=np.float32)
    for k in np.argsort(scan.ranges)[::-1]:  # what says nothing first, the shortest last
        ranges[nearest[k]] = scan.ranges[k]
    pose = scan.x, scan.y, scan.theta
    return Scan(0.0, pose, even, ranges, scan.max_range, stamp_ns=scan.stamp_ns, label=scan.label)


def _shifted(scan: Scan, by_ns: int) -> Scan:
    if not by_ns:
        return scan
    pose = scan.x, scan.y, scan.theta
    stamp_ns = scan.stamp_ns + by_ns
    return Scan(0.0, pose, scan.angles, scan.ranges, scan.max_range, stamp_ns=stamp_ns, label=scan.label)
