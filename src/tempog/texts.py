"""Numbers, durations and sizes as people read them."""

from __future__ import annotations


def duration_text(seconds: float) -> str:
    """Seconds for people.

    >>> duration_text(1061.3), duration_text(7384), duration_text(2.25)
    ('17 min 41 s', '2 h 3 min', '2.2 s')
    >>> duration_text(437_340)
    '5 d 1 h'
    """
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    if minutes < 48 * 60:
        return f"{minutes // 60} h {minutes % 60} min"
    hours = round(minutes / 60)
    return f"{hours // 24} d {hours % 24} h"


def bytes_text(count: int) -> str:
    """Bytes for people.

    >>> bytes_text(3_921_233), bytes_text(512)
    ('3.9 MB', '512 bytes')
    """
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} bytes"


def count_text(count: int) -> str:
    """A number with its thousands apart.

    >>> count_text(1923258)
    '1 923 258'
    """
    return f"{count:,}".replace(",", " ")


def counted(count: int, one: str, many: str) -> str:
    """A number and what it counts.

    >>> counted(1, "run", "runs"), counted(2000, "run", "runs")
    ('1 run', '2 000 runs')
    """
    return f"{count_text(count)} {one if count == 1 else many}"
