"""Known objects that are elsewhere at one moment than at an earlier one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tempog.analysis.configurations import Configuration
from tempog.analysis.objects import CLEAR_AFTER_S, MovingObject
from tempog.times import NS_PER_S


class Whereabouts(NamedTuple):
    """Where an object was last seen, up to a moment.

    Attributes
    ----------
    configuration : int, optional
        Id of the place; None if it was seen in none of its places.
    since_ns, last_seen_ns : int
        From when on it was seen so, and until just before when.
    n_moves : int
        How often it was found in another state up to then.
    """

    configuration: int | None
    since_ns: int
    last_seen_ns: int
    n_moves: int


@dataclass(frozen=True, eq=False)
class Move:
    """A known object that was seen in one state last, up to the first moment, and in another up to the second.

    Attributes
    ----------
    one : MovingObject
    before, after : Whereabouts
    """

    one: MovingObject
    before: Whereabouts
    after: Whereabouts

    @property
    def n_moves(self) -> int:
        """How often it was found in another state in between; it may have moved more."""
        return max(1, self.after.n_moves - self.before.n_moves)

    def place(self, where: Whereabouts) -> Configuration | None:
        """The configuration of either state."""
        return next((place for place in self.one.configurations if place.id == where.configuration), None)


def whereabouts(one: MovingObject, stamp_ns: int) -> Whereabouts | None:
    """Where an object was last seen, up to a moment; None if it was never clear until then.

    A place it was in and that was then seen free for `CLEAR_AFTER_S` it has left, wherever it is.

    Examples
    --------
    >>> from tempog.analysis.configurations import Period
    >>> from tempog.analysis.objects import timeline_of
    >>> s = 10**9
    >>> nowhere = np.empty((0, 2))
    >>> closed = Configuration(1, nowhere, nowhere, (Period(0, 20 * s, "occupied"), Period(20 * s, 60 * s, "free")))
    >>> opened = Configuration(2, nowhere, nowhere, (Period(40 * s, 50 * s, "occupied"),))
    >>> timeline, *seconds = timeline_of([closed, opened])
    >>> door = MovingObject(1, (closed, opened), timeline, *seconds, confidence=None)
    >>> [whereabouts(door, at * s).configuration for at in (10, 21, 30, 45, 60)]
    [1, 1, None, 2, 2]
    """
    k = int(np.searchsorted([stay.start_ns for stay in one.stays], stamp_ns, side="right")) - 1
    if k < 0:
        return None
    stay = one.stays[k]
    last_seen_ns = max(
        min(period.stop_ns, stamp_ns)
        for period in one.timeline
        if period.configuration == stay.configuration and stay.start_ns <= period.start_ns <= stamp_ns
    )
    for place in one.configurations:
        if place.id == stay.configuration:
            left = _free_after(place, last_seen_ns, stamp_ns)
            if sum(stop - start for start, stop in left) >= CLEAR_AFTER_S * NS_PER_S:
                return Whereabouts(None, left[0][0], left[-1][1], k + 1)
    return Whereabouts(stay.configuration, stay.start_ns, last_seen_ns, k)


def _free_after(place: Configuration, since_ns: int, until_ns: int) -> list[tuple[int, int]]:
    """When a place was seen free between two moments."""
    return [
        (max(start, since_ns), min(stop, until_ns))
        for start, stop, state in place.periods
        if state == "free" and stop > since_ns and start < until_ns
    ]


def moved_objects(
    objects: Sequence[MovingObject], before_ns: int, after_ns: int, hold_s: float
) -> tuple[list[Move], list[int]]:
    """Objects in other states than before, and the ids of those that were not seen since."""
    moved, unseen = [], []
    for one in objects:
        before, after = whereabouts(one, before_ns), whereabouts(one, after_ns)
        if before is None or after is None or (before_ns - before.last_seen_ns) / NS_PER_S > hold_s:
            continue
        if after.last_seen_ns <= before_ns or (after_ns - after.last_seen_ns) / NS_PER_S > hold_s:
            unseen.append(one.id)
        elif before.configuration != after.configuration:
            moved.append(Move(one, before, after))
    return moved, unseen
