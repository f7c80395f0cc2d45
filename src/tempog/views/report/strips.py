"""Rows along the time of a map: where each object was, and when each session drove."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Self

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from tempog.analysis.objects import MovingObject
from tempog.grid.history import History
from tempog.times import NS_PER_S, is_unix_time
from tempog.views.canvas import Colour, paler
from tempog.views.markup import Html, tag
from tempog.views.time_axis import driven_time
from tempog.views.timeline import PALE

N_COLUMNS = 600  # that the time is divided into: what is shorter is drawn as wide as one
LANE = 10  # height of the row of one place
STRIP_STYLE = (  # hatched where nothing is drawn
    "display:block;width:100%;border-radius:2px;"
    "background:repeating-linear-gradient(45deg,#fff 0 3px,#d4d6da 3px 4px);"
)


class Strips:
    """A time axis for rows that belong together: the period of some scans, with long pauses between them narrow."""

    def __init__(self, stamps: NDArray[np.int64], start_ns: int) -> None:
        self.start_ns, self.period_ns = start_ns, (int(stamps[0]), int(stamps[-1]))
        self.dated = is_unix_time(self.start_ns)
        self._days_apart = self._day(self.period_ns[0]) != self._day(self.period_ns[1])
        self._axis = driven_time((stamps - self.start_ns) / NS_PER_S)
        self.pauses_ns = [
            (self.start_ns + round(a * NS_PER_S), self.start_ns + round(b * NS_PER_S)) for a, b in self._axis.pauses_s
        ]

    @classmethod
    def of(cls, history: History) -> Self:
        """The axis of a history's period."""
        return cls(history.stamps_ns[history.first_scan : history.last_scan + 1], history.start_ns)

    def moment(self, stamp_ns: int | None) -> str:
        """A stamp in a table: a time of day, with the date if the period has several; "-" for never."""
        if stamp_ns is None:
            return "–"
        if not self.dated:
            return f"{(stamp_ns - self.start_ns) / NS_PER_S:+.1f} s"
        when = datetime.fromtimestamp(stamp_ns // NS_PER_S, UTC)
        return f"{when:%Y-%m-%d %H:%M:%S}" if self._days_apart else f"{when:%H:%M:%S}"

    def of_object(self, one: MovingObject, colour: Colour) -> Html:
        """A lane for each place: full while the object was in it, pale while it was seen elsewhere."""
        lanes = {place.id: k for k, place in enumerate(one.configurations)}
        where = np.full(N_COLUMNS, -1)  # hatched: nobody looked
        for start, stop, place in one.timeline:
            begin, end = self._columns(start, stop)
            where[begin:end] = len(lanes) if place is None else lanes[place]
        height = LANE * len(lanes)
        seen = _path(_stretches(where >= 0), 0, height)
        shapes = [tag("path", d=seen, fill=to_hex(paler(colour, PALE)))]
        shapes += [
            tag("path", d=_path(_stretches(where == k), LANE * k, LANE), fill=to_hex(colour)) for k in lanes.values()
        ]
        places = "; ".join(f"{self.moment(stay.start_ns)} place {stay.configuration}" for stay in one.stays[:20])
        more = " ..." if len(one.stays) > 20 else ""
        return self._strip(shapes, height, f"object {one.id}: {places}{more}")

    def of_periods(self, periods: Iterable[tuple[int, int]], text: str) -> Html:
        """A lane that is filled during some periods, given in nanoseconds."""
        filled = np.zeros(N_COLUMNS, dtype=np.bool_)
        for start, stop in periods:
            begin, end = self._columns(start, stop)
            filled[begin:end] = True
        return self._strip([tag("path", d=_path(_stretches(filled), 0, LANE), fill="#0072b2")], LANE, text)

    def axis(self) -> Html:
        """Times below the rows."""
        first_s, stop_s = self._axis.knots_s[0], self._axis.knots_s[-1]
        marks = self._axis.begins_s.tolist() if len(self._axis.pauses_s) else [first_s]
        shown = [(float(self._place(mark)), mark) for mark in [*marks, stop_s]]
        kept = [at for k, at in enumerate(shown) if k in (0, len(shown) - 1) or 0.18 < at[0] < 0.82]
        labels = [
            tag(
                "span",
                self.moment(self.start_ns + round(second * NS_PER_S)),
                style=f"left:{at:.1%}",
                class_="end" if at > 0.99 else "begin" if at < 0.01 else None,
            )
            for at, second in kept
        ]
        return tag("div", *labels, class_="axis", aria_hidden="true")

    def _strip(self, shapes: Sequence[Html], height: int, text: str) -> Html:
        pauses = np.zeros(N_COLUMNS, dtype=np.bool_)
        for start, stop in self.pauses_ns:
            begin, end = self._columns(start, stop)
            pauses[begin:end] = True
        if pauses.any():
            shapes = [*shapes, tag("path", d=_path(_stretches(pauses), 0, height), fill="#fff")]
        return tag(
            "svg",
            tag("title", text),
            *shapes,
            class_="strip tinted",
            viewBox=f"0 0 {N_COLUMNS} {height}",
            preserveAspectRatio="none",
            style=f"{STRIP_STYLE}height:{height / LANE * 0.6:.1f}rem",
            role="img",
        )

    def _columns(self, start_ns: int, stop_ns: int) -> tuple[int, int]:
        """The columns of a period; at least one, if it is in the axis at all."""
        since, until = (max(self.period_ns[0], min(self.period_ns[1], ns)) for ns in (start_ns, stop_ns))
        if until <= since:
            return 0, 0
        begin, end = (float(self._place((ns - self.start_ns) / NS_PER_S)) * N_COLUMNS for ns in (since, until))
        first = min(round(begin), N_COLUMNS - 1)
        return first, max(round(end), first + 1)

    def _place(self, second: float) -> NDArray[np.float64]:
        axis = self._axis
        return np.asarray(np.interp(second, axis.knots_s, axis.places) / axis.places[-1])

    def _day(self, stamp_ns: int) -> int:
        return stamp_ns // (86_400 * NS_PER_S)


def _stretches(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """``(n, 2)``: first and after the last of each run of True.

    >>> _stretches(np.array([True, True, False, True])).tolist()
    [[0, 2], [3, 4]]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)


def _path(stretches: NDArray[np.int64], top: int, height: int) -> str:
    return "".join(f"M{a} {top}h{b - a}v{height}H{a}z" for a, b in stretches.tolist())
