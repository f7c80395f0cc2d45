"""Is the clock of a log a usable time axis? If nearly, mend it; if not, say so.

Pure functions on int64 nanoseconds. The readers collect raw stamps, come here once, and make their
`Scan`s afterwards, so that a log without any usable stamp can still be read with ``rate=HZ``.

========== =======================================================================================
policy     what happens
========== =======================================================================================
"auto"     a few small steps back are sorted and a few repeats kept, both noted; worse is refused
"sort"     any order is sorted; stamps that say too little (constant, rounded, wrapped) are refused
"rate=HZ"  stamps are replaced by first stamp + i / HZ, in file order
========== =======================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ClockError, ConfigError
from tempog.scans.scan import MAX_STAMP_S

UNUSABLE_STAMP_NS = int(np.iinfo(np.int64).min)  # stands for NaN, infinity or a time beyond int64
MAX_MENDED_SHARE = 0.01  # of the scans; the public logs need 0.5 %, a broken clock shows in far more
MAX_STEP_BACK_PERIODS = 5  # network and buffer delays stay within this; a reset clock does not
MAX_GAP_S = 366 * 86400.0  # no log pauses for a year, but a stamp of 0 before Unix time jumps 50
MAX_RATE_HZ = 1e9  # beyond it two scans would share a nanosecond
COUNTER_WRAPS_S = (2.0**32, 2.0**32 / 1e3, 2.0**32 / 1e6)  # 32-bit counters of s, ms and us


@dataclass(frozen=True)
class ClockPolicy:
    """What to do about the clock; made by `parse_clock`."""

    mode: Literal["auto", "sort", "rate"]
    rate_hz: float = math.nan


class MendedClock(NamedTuple):
    """A usable time axis: scan ``order[k]`` of the file is the k-th in time, at ``stamp_ns[k]``."""

    order: NDArray[np.intp]
    stamp_ns: NDArray[np.int64]
    notes: tuple[str, ...]


def parse_clock(clock: str) -> ClockPolicy:
    """Read a clock policy: "auto", "sort" or "rate=HZ".

    Raises
    ------
    ConfigError
        Anything else, or a rate that is not a number of scans per second above 0.

    Examples
    --------
    >>> parse_clock("rate=5")
    ClockPolicy(mode='rate', rate_hz=5.0)
    """
    if clock == "auto" or clock == "sort":
        return ClockPolicy("auto" if clock == "auto" else "sort")
    if isinstance(clock, str) and clock.startswith("rate="):
        try:
            rate_hz = float(clock.removeprefix("rate="))
        except ValueError:
            rate_hz = math.nan
        if 0 < rate_hz <= MAX_RATE_HZ:
            return ClockPolicy("rate", rate_hz)
        raise ConfigError(f"clock = {clock!r} is no rate; wanted scans per second above 0, as in rate=5")
    raise ConfigError(f"clock = {clock!r} is unknown; wanted auto, sort or rate=HZ, as in rate=5")


def seconds_to_ns(stamps_s: ArrayLike) -> NDArray[np.int64]:
    """Seconds to nanoseconds; what does not fit becomes `UNUSABLE_STAMP_NS`.

    Parameters
    ----------
    stamps_s : (n_scans,) float, seconds
        May hold NaN, infinities and numbers of any size.

    Returns
    -------
    (n_scans,) int64, nanoseconds

    Examples
    --------
    >>> seconds_to_ns([1.5, float("nan"), 1e300]) == UNUSABLE_STAMP_NS
    array([False,  True,  True])
    """
    stamps = np.asarray(stamps_s, dtype=np.float64)
    stamp_ns = np.full(stamps.shape, UNUSABLE_STAMP_NS, dtype=np.int64)
    usable = np.abs(stamps) < MAX_STAMP_S
    stamp_ns[usable] = np.rint(stamps[usable] * 1e9).astype(np.int64)
    return stamp_ns


def mend_clock(
    stamp_ns: NDArray[np.int64],
    labels: Sequence[str],
    policy: ClockPolicy,
    *,
    source: str = "log",
) -> MendedClock:
    """Check the stamps of a log, in file order, and mend what the policy allows.

    Parameters
    ----------
    stamp_ns : (n_scans,) int64, nanoseconds
        `UNUSABLE_STAMP_NS` where the log holds no usable number.
    labels : n_scans of str
        Where each scan stands in the file ("line 17"), for messages.
    policy : ClockPolicy
    source : str
        Name of the file, for messages.

    Returns
    -------
    MendedClock
        Stamps that never step back. Scans with one stamp keep their order in the file.

    Raises
    ------
    ClockError
        The stamps make no usable time axis under this policy. The message shows the first bad line and
        the policies that would help.
    ConfigError
        A rate so low that the log would run past the year 2261.

    Notes
    -----
    "auto" sorts if at most `MAX_MENDED_SHARE` of the scans step back, none by more than
    `MAX_STEP_BACK_PERIODS` median periods. The median is taken over forward steps alone, so that
    neither repeats nor steps back shift it.

    Examples
    --------
    >>> stamps = np.arange(200) * 100_000_000
    >>> stamps[7] -= 150_000_000
    >>> mended = mend_clock(stamps, [f"line {i + 1}" for i in range(200)], parse_clock("auto"))
    >>> mended.order[5:9]
    array([5, 7, 6, 8])
    >>> mended.notes
    ('1 of 200 scans steps back in time, by up to 0.05 s (first: line 8): sorted by stamp',)
    """
    stamp_ns = np.asarray(stamp_ns, dtype=np.int64)
    if policy.mode == "rate":
        return _stamps_at_rate(stamp_ns, policy.rate_hz)
    refuse = _Refusal(stamp_ns, labels, source)
    unusable = np.flatnonzero(stamp_ns == UNUSABLE_STAMP_NS)
    if unusable.size:
        raise refuse.unusable(int(unusable[0]), unusable.size)

    order = np.argsort(stamp_ns, kind="stable")
    in_time = stamp_ns[order]
    step_s = np.diff(stamp_ns.astype(np.float64)) / 1e9  # float: the difference of two int64 may not fit
    back = np.flatnonzero(stamp_ns[1:] < stamp_ns[:-1])
    period_s = float(np.median(step_s[step_s > 0])) if (step_s > 0).any() else math.nan
    _refuse_what_sorting_cannot_mend(stamp_ns, step_s, order, refuse)

    notes = []
    if back.size:
        size_s = -step_s[back]
        too_far = back[~(size_s <= MAX_STEP_BACK_PERIODS * period_s)]
        if policy.mode == "auto" and (too_far.size or back.size > MAX_MENDED_SHARE * len(stamp_ns)):
            raise refuse.steps_back(int((too_far if too_far.size else back)[0]) + 1, back.size, period_s)
        notes.append(
            f"{back.size} of {len(stamp_ns)} scans {'steps' if back.size == 1 else 'step'} back in time, by"
            f" up to {size_s.max():.3g} s (first: {labels[back[0] + 1]}): sorted by stamp"
        )
    repeats = np.flatnonzero(in_time[1:] == in_time[:-1])
    if repeats.size:
        notes.append(
            f"{repeats.size} of {len(stamp_ns)} scans {'repeats' if repeats.size == 1 else 'repeat'}"
            f" an earlier stamp (first: {labels[order[repeats + 1].min()]}): kept in file order"
        )
    return MendedClock(order, in_time, tuple(notes))


def _refuse_what_sorting_cannot_mend(
    stamp_ns: NDArray[np.int64],
    step_s: NDArray[np.float64],
    order: NDArray[np.intp],
    refuse: _Refusal,
) -> None:
    """Raise ClockError for constant, wrapped, jumping and rounded stamps."""
    if len(stamp_ns) < 2:
        return
    in_time = stamp_ns[order]
    if in_time[0] == in_time[-1]:
        raise refuse.hopeless(1, f"all {len(stamp_ns)} scans have this one stamp: the clock stands still")
    before_s = stamp_ns[:-1] / 1e9
    for wrap_s in COUNTER_WRAPS_S:
        near = 0.01 * wrap_s
        full = (np.abs(before_s - wrap_s) < near) | (np.abs(before_s - wrap_s / 2) < near)  # unsigned, signed
        wraps = np.flatnonzero((np.abs(step_s + wrap_s) < near) & full)
        if wraps.size:
            raise refuse.hopeless(int(wraps[0]) + 1, f"a 32-bit counter wrapped after {wrap_s:.10g} s")
    jumps = np.flatnonzero(step_s > MAX_GAP_S)
    if jumps.size:
        days = step_s[jumps[0]] / 86400
        raise refuse.hopeless(int(jumps[0]) + 1, f"a jump of {days:,.0f} days; no log pauses for a year")
    repeats = np.flatnonzero(in_time[1:] == in_time[:-1])
    if repeats.size > MAX_MENDED_SHARE * len(step_s):
        what = f"{repeats.size} of {len(stamp_ns)} scans repeat an earlier stamp: the stamps are rounded"
        raise refuse.hopeless(int(order[repeats + 1].min()), what)


def _stamps_at_rate(stamp_ns: NDArray[np.int64], rate_hz: float) -> MendedClock:
    """New stamps: the first usable one + i / rate_hz, in file order."""
    n_scans = len(stamp_ns)
    if max(n_scans - 1, 0) / rate_hz >= MAX_STAMP_S:
        raise ConfigError(f"clock = 'rate={rate_hz:g}': {n_scans} scans would last for centuries; try rate=5")
    usable = stamp_ns[stamp_ns != UNUSABLE_STAMP_NS]
    start_ns = int(usable[0]) if usable.size else 0
    if start_ns / 1e9 + n_scans / rate_hz >= MAX_STAMP_S:
        start_ns = 0  # a first stamp in the year 2261 is damage, too
    stamps = start_ns + np.rint(np.arange(n_scans) * (1e9 / rate_hz)).astype(np.int64)
    note = f"time stamps replaced: {start_ns / 1e9:.10g} s and then {rate_hz:g} scans a second, in file order"
    return MendedClock(np.arange(n_scans), stamps, (note,))


class _Refusal:
    """Words the ClockErrors: the first bad line, what was wanted, and the policies that help."""

    def __init__(self, stamp_ns: NDArray[np.int64], labels: Sequence[str], source: str) -> None:
        self.stamp_ns, self.labels, self.source = stamp_ns, labels, source

    def hopeless(self, i: int, what: str) -> ClockError:
        return ClockError(
            f"{self._place(i)}; {what} (wanted: a stamp of its own for every scan, in one running clock).\n"
            "  Use --clock rate=5 (new stamps in file order; give your sensor's scans per second)."
            " --clock sort cannot mend this."
        )

    def steps_back(self, i: int, n_back: int, period_s: float) -> ClockError:
        limit = f"at most {MAX_MENDED_SHARE:.0%} of the scans, each by at most {MAX_STEP_BACK_PERIODS} periods"
        period = "" if math.isnan(period_s) else f" of {period_s:.3g} s"
        return ClockError(
            f"{self._place(i)}; {n_back} of {len(self.stamp_ns)} scans step back in time"
            f" (wanted: {limit}{period}).\n"
            "  Use --clock sort (order by stamp), or --clock rate=5 (new stamps in file order; give your"
            " sensor's scans per second)."
        )

    def unusable(self, i: int, n_unusable: int) -> ClockError:
        return ClockError(
            f"{self.source}, {self.labels[i]}: the stamp is no usable time, as in {n_unusable} of"
            f" {len(self.stamp_ns)} scans (wanted: seconds within ±{MAX_STAMP_S:g}).\n"
            "  Use --skip-bad to leave such scans out, or --clock rate=5 (new stamps in file order; give"
            " your sensor's scans per second). --clock sort cannot mend this."
        )

    def _place(self, i: int) -> str:
        now_s, before_s = self.stamp_ns[i] / 1e9, self.stamp_ns[i - 1] / 1e9
        return f"{self.source}, {self.labels[i]}: stamp {now_s:.6f} s comes after {before_s:.6f} s"
