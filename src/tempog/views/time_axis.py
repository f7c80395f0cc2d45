"""An axis of time that leaves out most of the hours in which no robot drove."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tempog.times import NS_PER_S, is_unix_time

PAUSE_S = 60.0  # shorter breaks belong to the drive
LONG_SHARE = 0.1  # of the time driven: shorter pauses leave enough room for the rest
WIDTH_SHARE = 0.02  # of the time driven, that a pause is drawn as
MOST_WIDTH_SHARE = 0.3  # that all pauses together are drawn as
MOST_LABELS = 9


def pauses_s(stamps_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(n, 2)`` seconds: begin and end of the long periods without a scan.

    >>> pauses_s(np.array([0.0, 50.0, 100.0, 86_400.0, 86_450.0])).tolist()
    [[100.0, 86400.0]]
    """
    lengths = np.diff(stamps_s)
    driven_s = float(lengths[lengths <= PAUSE_S].sum())
    before = np.flatnonzero(lengths > max(PAUSE_S, LONG_SHARE * driven_s))
    return np.stack([stamps_s[before], stamps_s[before + 1]], axis=-1)


def set_time_axis(axes: Axes, stamps_ns: NDArray[np.int64], start_ns: int) -> None:
    """Seconds from `start_ns` on x, over the period of some scans; long pauses are white and narrow."""
    stamps_s = (stamps_ns - start_ns) / NS_PER_S
    first_s, stop_s = float(stamps_s[0]), max(float(stamps_s[-1]), float(stamps_s[0]) + 1e-3)
    axes.tick_params(axis="x", labelsize=8)
    pauses = pauses_s(stamps_s)
    if not len(pauses):
        axes.set(xlabel="seconds since the log's start", xlim=(first_s, stop_s))
        return
    driven_s = (stop_s - first_s) - float((pauses[:, 1] - pauses[:, 0]).sum())
    width = max(driven_s, 1e-3) * min(WIDTH_SHARE, MOST_WIDTH_SHARE / len(pauses))
    knots = np.array([first_s, *pauses.ravel(), stop_s])
    steps = np.diff(knots)
    steps[1::2] = width
    places = np.concatenate([[0.0], np.cumsum(steps)])
    axes.set_xscale(
        "function", functions=(lambda x: np.interp(x, knots, places), lambda x: np.interp(x, places, knots))
    )
    for begin, end in pauses.tolist():
        axes.axvspan(begin, end, facecolor="white", linewidth=0, zorder=3)
    begins = knots[::2][:: math.ceil((len(pauses) + 1) / MOST_LABELS)]
    dated = is_unix_time(start_ns)
    axes.set_xticks(begins, [_label(start_ns, begin, dated) for begin in begins.tolist()])
    axes.minorticks_off()
    unit = "UTC" if dated else "seconds since the log's start"
    axes.set(xlabel=f"{unit}; white: a pause without scans", xlim=(first_s, stop_s))


def _label(start_ns: int, offset_s: float, dated: bool) -> str:
    if not dated:
        return f"{offset_s:.0f}"
    return f"{datetime.fromtimestamp(start_ns // NS_PER_S + math.floor(offset_s), UTC):%m-%d\n%H:%M}"
