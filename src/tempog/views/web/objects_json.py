"""Found objects as the page reads them: times in seconds since the map's first scan, cells by row and col."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, tzinfo
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.objects import MovingObject, ObjectPeriod
from tempog.times import NS_PER_S, is_unix_time

QUARTER_NS = 15 * 60 * NS_PER_S  # zones differ from UTC by multiples of it, so that no quarter is of two hours
MOST_QUARTERS = 2_000_000  # 57 years; longer histories have no hours
LEAST_S = 1e-6


def objects_entry(
    found: FoundObjects, version: str, start_ns: int, stop_ns: int, zone: tzinfo = UTC
) -> dict[str, Any]:
    """All objects and lone places.

    Parameters
    ----------
    found : FoundObjects
    version : str
        Of the map they were found in.
    start_ns, stop_ns : int
        Of the map's first and last scan.
    zone : tzinfo
        In which hours and weekdays are told.
    """
    hours = Hours(start_ns, stop_ns, zone)
    return {
        "state": "ready",
        "version": version,
        "method": found.method,
        "dated": hours.known,
        "tz": str(zone) if hours.known else None,
        "objects": [_object(one, start_ns, hours) for one in found.objects],
        "places": [
            {
                **_place(place),
                "timeline": [
                    [_t(since, start_ns), _t(until, start_ns), state] for since, until, state in place.periods
                ],
            }
            for place in found.unassociated
        ],
    }


def _object(one: MovingObject, start_ns: int, hours: Hours) -> dict[str, Any]:
    last = one.last_stay
    return {
        "id": one.id,
        "n_moves": one.n_moves,
        "confidence": one.confidence,
        "rivals": list(one.rivals),
        "seen_s": one.seen_s,
        "shares": {"none" if place is None else str(place): share for place, share in one.shares.items()},
        "states": [{"place": place.id, **_place(place)} for place in one.configurations],
        "timeline": [[_t(since, start_ns), _t(until, start_ns), place] for since, until, place in one.timeline],
        "gaps": [[_t(since, start_ns), _t(until, start_ns)] for since, until in one.gaps],
        "stays": [
            [_t(stay.start_ns, start_ns), _t(stay.stop_ns, start_ns), stay.configuration, stay.seen_s]
            for stay in one.stays
        ],
        "by_hour": hours.shares(one, 24) if hours.known else None,
        "by_weekday": hours.shares(one, 7) if hours.known else None,
        "last": last
        and {
            "place": last.configuration,
            "since_t": _t(last.start_ns, start_ns),
            "seen_t": _t(last.stop_ns, start_ns),
        },
    }


def _place(place: Configuration) -> dict[str, Any]:
    x, y = place.centre_m
    return {
        "id": place.id,
        "cells": place.cells.tolist(),
        "centre": [round(x, 6), round(y, 6)],
        "hypothesis": place.hypothesis,
    }


def _t(stamp_ns: int, start_ns: int) -> float:
    return (stamp_ns - start_ns) / NS_PER_S


class Hours:
    """Which hour and weekday it was when, from one moment to another.

    Attributes
    ----------
    known : bool
        Whether the clock tells: it looks like Unix time, and the history is not longer than decades.
    """

    def __init__(self, start_ns: int, stop_ns: int, zone: tzinfo) -> None:
        self._first = start_ns // QUARTER_NS
        n = stop_ns // QUARTER_NS - self._first + 1
        self.known = is_unix_time(start_ns) and n <= MOST_QUARTERS
        self._of_quarter: dict[int, NDArray[np.int64]] = {}
        if self.known:
            seconds = (np.arange(self._first, self._first + n) * (QUARTER_NS // NS_PER_S)).tolist()
            moments = [datetime.fromtimestamp(second, zone) for second in seconds]
            self._of_quarter[24] = np.array([moment.hour for moment in moments])
            self._of_quarter[7] = np.array([moment.weekday() for moment in moments])

    def lasted_s(self, periods: Sequence[ObjectPeriod], n: int) -> NDArray[np.float64]:
        """``(n,)`` seconds of some periods in each hour (n = 24) or on each weekday (n = 7, Monday first)."""
        since, until = (np.array([period[k] for period in periods], dtype=np.int64) for k in (0, 1))
        first, last = since // QUARTER_NS, (until - 1) // QUARTER_NS
        each = np.maximum(last - first + 1, 0)
        quarter = np.arange(int(each.sum())) - np.repeat(np.cumsum(each) - each - first, each)
        begin = np.maximum(np.repeat(since, each), quarter * QUARTER_NS)
        end = np.minimum(np.repeat(until, each), (quarter + 1) * QUARTER_NS)
        of_quarter = self._of_quarter[n]
        which = of_quarter[np.clip(quarter - self._first, 0, len(of_quarter) - 1)]
        return np.bincount(which, weights=(end - begin) / NS_PER_S, minlength=n).astype(np.float64)

    def shares(self, one: MovingObject, n: int) -> dict[str, list[float | None]]:
        """For each place, its share of the observed time in each hour or on each weekday; None where unobserved."""
        observed_s = self.lasted_s(one.timeline, n)
        shares = {}
        for place in one.configurations:
            there_s = self.lasted_s([period for period in one.timeline if period.configuration == place.id], n)
            shares[str(place.id)] = [
                round(there / observed, 6) if observed > LEAST_S else None
                for there, observed in zip(there_s.tolist(), observed_s.tolist(), strict=True)
            ]
        return shares
