"""What became of the messages, in numbers and in lines for people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields


@dataclass
class Counts:
    """What became of the messages.

    Attributes
    ----------
    received, mapped : int
        Scans.
    too_fast : int
        Scans that were dropped because they came faster than they could be mapped.
    unplaced : int
        Scans whose transforms did not come in time.
    earlier : int
        Scans from before what is mapped: time has jumped back.
    shifted : int
        Scans that were mapped with the stamp of the one before, as they came a moment out of order.
    unusable : int
        Messages that could not be read, and scans that could not be mapped.
    unsaved : int
        Scans that the disk had no room for.
    events : int
    """

    received: int = 0
    mapped: int = 0
    too_fast: int = 0
    unplaced: int = 0
    earlier: int = 0
    shifted: int = 0
    unusable: int = 0
    unsaved: int = 0
    events: int = 0

    @property
    def lost(self) -> int:
        """Scans that are not in the map."""
        return self.too_fast + self.unplaced + self.earlier + self.unusable + self.unsaved


class Notes:
    """Lines for people about what goes wrong: the first of each kind at once, then one in a while.

    Parameters
    ----------
    note : callable
    clock : callable
    every_s : float, seconds
        Between two lines of one kind.

    Examples
    --------
    >>> notes = Notes(print, lambda: 0.0)
    >>> for k in range(3):
    ...     notes.say("unusable", f"message {k} holds no scan")
    message 0 holds no scan
    """

    def __init__(self, note: Callable[[str], None], clock: Callable[[], float], every_s: float = 30.0) -> None:
        self._note, self._clock, self._every_s = note, clock, every_s
        self._next_s: dict[str, float] = {}

    def say(self, kind: str, text: str) -> None:
        """Say it, unless something of that kind was said a moment ago."""
        now_s = self._clock()
        if now_s >= self._next_s.get(kind, now_s):
            self._next_s[kind] = now_s + self._every_s
            self._note(text)


def lost_text(counts: Counts) -> str:
    """What was lost, for people; empty if nothing was.

    >>> lost_text(Counts(received=10, mapped=7, too_fast=2, unplaced=1))
    '2 came too fast, 1 without transforms'
    """
    words = {
        "too_fast": "came too fast",
        "unplaced": "without transforms",
        "earlier": "from before",
        "unusable": "unusable",
        "unsaved": "without room on the disk",
    }
    return ", ".join(
        f"{getattr(counts, one.name)} {words[one.name]}"
        for one in fields(counts)
        if one.name in words and getattr(counts, one.name)
    )
