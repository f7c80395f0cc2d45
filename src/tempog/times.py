"""Moments as people write them, as int64 nanoseconds."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, timedelta

import numpy as np

from tempog.errors import MomentError

Moment = float | int | str | datetime | np.datetime64
NS_PER_S = 1_000_000_000
MAX_NS = 2**63 - 1
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def parse_moment(moment: Moment, start_ns: int) -> int:
    """A moment in nanoseconds of the log's own clock.

    Parameters
    ----------
    moment : float, str, datetime or numpy.datetime64
        A number is seconds as in the log (Unix seconds in most logs). Text may be such a number, ``"+120"``
        (seconds after the first scan; ``"+90min"``, ``"+36h"`` and ``"+2d"`` work too), or ISO 8601. A date without
        a time zone is UTC.
    start_ns : int, nanoseconds
        Stamp of the first scan.

    Raises
    ------
    MomentError
        Anything else.

    Examples
    --------
    >>> parse_moment("+120", start_ns=5_000_000_000)
    125000000000
    >>> parse_moment("+1.5h", start_ns=0) == parse_moment("+90min", start_ns=0) == parse_moment(5400, start_ns=0)
    True
    >>> parse_moment("2003-12-10T17:51:58Z", start_ns=0) == parse_moment(1071078718, start_ns=0)
    True
    """
    if isinstance(moment, np.datetime64):
        coarse_us = int(moment.astype("datetime64[us]").astype(np.int64))  # NaT is the smallest int64
        _in_range(coarse_us * 1000, moment)  # before the finer unit could overflow
        return _in_range(int(moment.astype("datetime64[ns]").astype(np.int64)), moment)
    if isinstance(moment, datetime):
        aware = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        return _in_range((aware - EPOCH) // timedelta(microseconds=1) * 1000, moment)
    if isinstance(moment, str):
        return _parse_text(moment, start_ns)
    if isinstance(moment, int):
        return _in_range(moment * NS_PER_S, moment)
    if not isinstance(moment, float | np.floating | np.integer):
        raise MomentError(f"{moment!r} is not a moment; wanted seconds, text, a datetime or a numpy.datetime64")
    return _from_seconds(float(moment), moment)


UNITS_S = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0, "w": 604_800.0}


def parse_duration(text: str | float) -> float:
    """Seconds, from text like ``"24h"``, ``"30d"``, ``"90min"``, ``"2w"``, ``"10s"`` or a number of seconds.

    Raises
    ------
    MomentError
        Anything else, or a duration that is not above 0.

    Examples
    --------
    >>> parse_duration("24h"), parse_duration(90)
    (86400.0, 90.0)
    """
    match = re.fullmatch(r"\s*([0-9.eE+-]+?)\s*([a-z]*)\s*", str(text))
    try:
        seconds = float(match[1]) * UNITS_S[match[2] or "s"] if match else math.nan
    except (ValueError, KeyError):
        seconds = math.nan
    if not 0 < seconds < math.inf:
        raise MomentError(f"{text!r} is not a duration; wanted for example 30d, 24h, 90min or 10s")
    return seconds


def format_moment(stamp_ns: int, start_ns: int) -> str:
    """A stamp for people: ``+12.3 s``, with the UTC date where the clock looks like Unix time.

    >>> format_moment(1071078728500000000, 1071078718000000000)
    '2003-12-10 17:52:08 UTC (+10.5 s)'
    >>> format_moment(12_500_000_000, 0)
    '+12.5 s'
    """
    offset = f"{(stamp_ns - start_ns) / NS_PER_S:+.1f} s"
    if not is_unix_time(start_ns):
        return offset
    date = datetime.fromtimestamp(stamp_ns // NS_PER_S, UTC)
    return f"{date:%Y-%m-%d %H:%M:%S} UTC ({offset})"


def is_unix_time(start_ns: int) -> bool:
    """Whether a clock that a log begins at looks like Unix time; before 1973, it counts from power-on."""
    return start_ns >= 10**8 * NS_PER_S


def _parse_text(text: str, start_ns: int) -> int:
    trimmed = text.strip()
    relative = trimmed.startswith("+")
    number, unit_s = trimmed, 1.0
    if relative and (match := re.fullmatch(r"(.*?)\s*(s|min|h|d|w)", trimmed)):
        number, unit_s = match[1], UNITS_S[match[2]]
    try:
        seconds = float(number) * unit_s
    except ValueError:
        pass
    else:
        return _in_range((start_ns if relative else 0) + _from_seconds(seconds, text), text)
    try:
        date = datetime.fromisoformat(trimmed)
    except ValueError:
        raise MomentError(
            f"{text!r} is not a moment; wanted seconds as in the log (1071078718.5), +120 for seconds (or +36h,"
            " +2d) after the first scan, or a date like 2003-12-10T17:51:58Z"
        ) from None
    return parse_moment(date, start_ns)


def _from_seconds(seconds: float, shown: object) -> int:
    if not math.isfinite(seconds):
        raise MomentError(f"{shown!r} is not a moment; wanted a finite number of seconds")
    nanoseconds = seconds * NS_PER_S
    return _in_range(round(nanoseconds) if math.isfinite(nanoseconds) else MAX_NS + 1, shown)


def _in_range(nanoseconds: int, shown: object) -> int:
    if abs(nanoseconds) > MAX_NS:
        raise MomentError(f"{shown!r} is outside what can be stored, the years 1678 to 2262")
    return nanoseconds
