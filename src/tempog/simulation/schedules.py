"""When doors and boxes move: listed, by chance, by the clock, or as a real door did.

A schedule answers one question: at which times should the thing start for which place? Times are seconds
since the simulation starts. Whether it can go at once is the simulation's business: doors wait for people.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from tempog.errors import WorldError
from tempog.simulation.tracks import read_recording

DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
DAY_S = 86_400.0
WEEK_S = 7 * DAY_S

Move = tuple[float, str]


class Schedule(Protocol):
    """Anything that can say when a thing should move, and where to."""

    def moves(self, places: Sequence[str], initial: str, duration_s: float, rng: np.random.Generator) -> list[Move]:
        """The moves from 0 to `duration_s` in time order, each to another place than the one before."""
        ...

    def named(self) -> Sequence[str]:
        """The places that the schedule names, so that misspelt ones are found before anything runs."""
        ...

    def rests_at(self, initial: str) -> str | None:
        """Where the thing finally stays for good; None if it goes on moving."""
        ...


@dataclass(frozen=True)
class Never:
    """The thing stays where it is."""

    def moves(self, places: Sequence[str], initial: str, duration_s: float, rng: np.random.Generator) -> list[Move]:
        return []

    def named(self) -> Sequence[str]:
        return ()

    def rests_at(self, initial: str) -> str | None:
        return initial


@dataclass(frozen=True)
class Listed:
    """Moves at the listed times.

    Examples
    --------
    >>> Listed(((5.0, "open"), (8.0, "open"), (9.0, "closed"))).moves(("open", "closed"), "closed", 60.0, None)
    [(5.0, 'open'), (9.0, 'closed')]
    """

    times: tuple[Move, ...]

    def __post_init__(self) -> None:
        previous = 0.0
        for t, place in self.times:
            if not previous <= t < math.inf:
                raise WorldError(
                    f"moves: {place!r} is at {t!r} s, after {previous!r} s; wanted seconds of 0 or more, in"
                    " time order"
                )
            previous = t

    def moves(self, places: Sequence[str], initial: str, duration_s: float, rng: np.random.Generator) -> list[Move]:
        return _changes(self.times, initial, duration_s)

    def named(self) -> Sequence[str]:
        return [place for _, place in self.times]

    def rests_at(self, initial: str) -> str | None:
        return self.times[-1][1] if self.times else initial


@dataclass(frozen=True)
class Dwell:
    """Stays at each place for an exponentially distributed time, then moves to another, all alike likely.

    Attributes
    ----------
    mean_s : dict of place -> seconds
        Mean stay. Places without one are never gone to.
    """

    mean_s: dict[str, float] = field(hash=False)

    def __post_init__(self) -> None:
        for place, mean in self.mean_s.items():
            if not 0 < mean < math.inf:
                raise WorldError(f"dwell_s.{place} = {mean!r}; wanted seconds above 0")

    def moves(self, places: Sequence[str], initial: str, duration_s: float, rng: np.random.Generator) -> list[Move]:
        t, place = 0.0, initial
        moves: list[Move] = []
        while True:
            others = [other for other in self.mean_s if other != place]
            if not others:
                return moves
            t += rng.exponential(self.mean_s.get(place, np.mean(list(self.mean_s.values()))))
            if t >= duration_s:
                return moves
            place = others[rng.integers(len(others))]
            moves.append((t, place))

    def named(self) -> Sequence[str]:
        return list(self.mean_s)

    def rests_at(self, initial: str) -> str | None:
        return next(iter(self.mean_s), initial) if len(self.mean_s) < 2 else None


@dataclass(frozen=True)
class Weekly:
    """The same moves every week; a daily pattern is a weekly one with the same moves on each day.

    Attributes
    ----------
    times : tuple of (s, place)
        Seconds since Monday 00:00, in time order.
    start_s : float, seconds
        When in the week the simulation starts.

    Examples
    --------
    >>> opening = Weekly(((8 * 3600.0, "open"), (17 * 3600.0, "closed")), start_s=7.5 * 3600)
    >>> opening.moves(("open", "closed"), "closed", 12 * 3600.0, None)
    [(1800.0, 'open'), (34200.0, 'closed')]
    """

    times: tuple[Move, ...]
    start_s: float = 0.0

    def __post_init__(self) -> None:
        for t, place in self.times:
            if not 0 <= t < WEEK_S:
                raise WorldError(f"weekly: {place!r} is {t!r} s into the week; wanted 0 to {WEEK_S:g}")

    def moves(self, places: Sequence[str], initial: str, duration_s: float, rng: np.random.Generator) -> list[Move]:
        moves: list[Move] = []
        for week in range(int((self.start_s + duration_s) // WEEK_S) + 1):
            moves += [(week * WEEK_S + t - self.start_s, place) for t, place in self.times]
        return _changes([(t, place) for t, place in sorted(moves) if t >= 0], initial, duration_s)

    def named(self) -> Sequence[str]:
        return [place for _, place in self.times]

    def rests_at(self, initial: str) -> str | None:
        places = set(self.named())
        return None if len(places) > 1 else next(iter(places), initial)


@dataclass(frozen=True)
class Recorded:
    """As a real door went: one value after another.

    Attributes
    ----------
    values : tuple of str
        The place at each sample.
    times_s : tuple of float, seconds
        When each was taken, since the first.
    speed : float
        How many recorded seconds pass in one simulated second.
    """

    values: tuple[str, ...]
    times_s: tuple[float, ...]
    speed: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.speed < math.inf:
            raise WorldError(f"speed = {self.speed!r}; wanted a number above 0")
        if len(self.values) != len(self.times_s):
            raise WorldError(f"a series of {len(self.values)} values and {len(self.times_s)} times; wanted as many")

    def moves(self, places: Sequence[str], initial: str, duration_s: float, rng: np.random.Generator) -> list[Move]:
        samples = [(t / self.speed, place) for t, place in zip(self.times_s, self.values, strict=True)]
        return _changes(samples, initial, duration_s)

    def named(self) -> Sequence[str]:
        return sorted(set(self.values))

    def rests_at(self, initial: str) -> str | None:
        return self.values[-1]


def read_series(path: Path, values: Sequence[str], period_s: float, speed: float) -> Recorded:
    """Read a recorded door: a value a line, or "Unix seconds, value"; plain or gzip.

    Value 0 stands for the first of `values`, 1 for the second, and so on.
    """
    try:
        text = read_recording(path)
    except WorldError as error:
        raise WorldError(f"series: {error}") from error
    times: list[float] = []
    states: list[str] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        try:
            t = float(words[0]) if len(words) == 2 else len(states) * period_s
            index = int(words[-1])
            if len(words) > 2 or not 0 <= index < len(values) or (times and t <= times[-1]):
                raise ValueError
        except ValueError:
            raise WorldError(
                f"series: {path}, line {number} is {line[:40]!r}; wanted a value from 0 to {len(values) - 1},"
                " or rising seconds and a value"
            ) from None
        times.append(t)
        states.append(values[index])
    if not states:
        raise WorldError(f"series: {path} is empty; wanted a value a line")
    return Recorded(tuple(states), tuple(t - times[0] for t in times), speed)


def _changes(moves: Sequence[Move], initial: str, duration_s: float) -> list[Move]:
    """The moves before `duration_s` that lead to another place than the one before."""
    changes: list[Move] = []
    place = initial
    for t, target in moves:
        if t < duration_s and target != place:
            changes.append((float(t), target))
            place = target
    return changes
