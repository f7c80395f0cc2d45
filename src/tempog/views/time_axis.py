"""An axis of time that leaves out most of the hours in which no robot drove."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tempog.times import NS_PER_S, is_unix_time
from tempog.views.pauses import pauses_s

WIDTH_SHARE = 0.02  # of the time driven, that a pause is drawn as
MOST_WIDTH_SHARE = 0.3  # that all pauses together are drawn as
MOST_LABELS = 9


class DrivenTime(NamedTuple):
    """Where seconds stand on an axis on which the periods without scans are narrow.

    Attributes
    ----------
    knots_s, places : (n,) float64
        Seconds at the borders of drives, and where they stand; between two of them it is even.
    pauses_s : (n, 2) float64
        Begin and end of the periods without scans.
    """

    knots_s: NDArray[np.float64]
    places: NDArray[np.float64]
    pauses_s: NDArray[np.float64]

    @property
    def begins_s(self) -> NDArray[np.float64]:
        """Where drives begin, or some of them if they are many."""
        return self.knots_s[::2][:: math.ceil((len(self.pauses_s) + 1) / MOST_LABELS)]


def driven_time(stamps_s: NDArray[np.float64]) -> DrivenTime:
    """An axis for the period of some scans.

    >>> axis = driven_time(np.array([0.0, 50.0, 100.0, 86_400.0, 86_450.0]))
    >>> axis.places.tolist()
    [0.0, 100.0, 103.0, 153.0]
    """
    first_s, stop_s = float(stamps_s[0]), max(float(stamps_s[-1]), float(stamps_s[0]) + 1e-3)
    pauses = pauses_s(stamps_s)
    knots = np.array([first_s, *pauses.ravel(), stop_s])
    steps = np.diff(knots)
    if len(pauses):
        driven_s = (stop_s - first_s) - float((pauses[:, 1] - pauses[:, 0]).sum())
        steps[1::2] = max(driven_s, 1e-3) * min(WIDTH_SHARE, MOST_WIDTH_SHARE / len(pauses))
    return DrivenTime(knots, np.concatenate([[0.0], np.cumsum(steps)]), pauses)


def set_time_axis(axes: Axes, stamps_ns: NDArray[np.int64], start_ns: int) -> None:
    """Seconds from `start_ns` on x, over the period of some scans; long pauses are white and narrow."""
    knots, places, pauses = axis = driven_time((stamps_ns - start_ns) / NS_PER_S)
    first_s, stop_s = float(knots[0]), float(knots[-1])
    axes.tick_params(axis="x", labelsize=8)
    if not len(pauses):
        axes.set(xlabel="seconds since the log's start", xlim=(first_s, stop_s))
        return
    axes.set_xscale(
        "function", functions=(lambda x: np.interp(x, knots, places), lambda x: np.interp(x, places, knots))
    )
    for begin, end in pauses.tolist():
        axes.axvspan(begin, end, facecolor="white", linewidth=0, zorder=3)
    dated = is_unix_time(start_ns)
    axes.set_xticks(axis.begins_s, [_label(start_ns, begin, dated) for begin in axis.begins_s.tolist()])
    axes.minorticks_off()
    unit = "UTC" if dated else "seconds since the log's start"
    axes.set(xlabel=f"{unit}; white: a pause without scans", xlim=(first_s, stop_s))


def _label(start_ns: int, offset_s: float, dated: bool) -> str:
    if not dated:
        return f"{offset_s:.0f}"
    return f"{datetime.fromtimestamp(start_ns // NS_PER_S + math.floor(offset_s), UTC):%m-%d\n%H:%M}"
