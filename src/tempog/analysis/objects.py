"""Objects with several places: configurations that complement each other (paper, IV.C.1b, Fig. 9 and 10)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.series_kernels import intersect
from tempog.methods import PaperConfig
from tempog.texts import counted
from tempog.times import NS_PER_S

GAP_S = 1.0  # shorter, some beams missed what was in view
CLEAR_AFTER_S = 2.0  # a swing takes a second, somebody a second to walk through


class ObjectPeriod(NamedTuple):
    """Where an object was from `start_ns` until just before `stop_ns`.

    `configuration` is the id of the one occupied place; None while none or more than one was.
    """

    start_ns: int
    stop_ns: int
    configuration: int | None


class ObjectStay(NamedTuple):
    """An object in one state, from when it was first seen so until just before `stop_ns`, when it was so last.

    `configuration` is the id of the place it was in; None for a thing of one place that was not in it. It was looked
    at for `seen_s` of that time; whether it went away and came back in the rest, nobody knows.
    """

    start_ns: int
    stop_ns: int
    configuration: int | None
    seen_s: float


@dataclass(frozen=True, eq=False)
class MovingObject:
    """Something that is now in one place, now in another.

    Attributes
    ----------
    id : int
    configurations : tuple of Configuration
        Its places, by id.
    timeline : tuple of ObjectPeriod
        Where it was, for the time all its places were seen. By the method ``evidence`` also while only some
        were, if it was in one of these.
    common_s, none_s, both_s : float, seconds
        For how long all its places were seen; how long of it no place was occupied, and how long several.
    confidence : float, 0..1, optional
        That these places, and no others, are those of one thing: ``1 / (1 + exp(-margin))``, the margin being the
        log odds that the best choice of objects without this one loses. For the paper's method the share of
        `common_s` in which exactly one place was occupied. None for a thing with a single place.
    rivals : tuple of int
        Places of other objects that may as well be places of this one: time and shape do not say which, as of two
        doors that move in step. Empty by the paper's method, which lets a place be part of several objects.
    """

    id: int
    configurations: tuple[Configuration, ...]
    timeline: tuple[ObjectPeriod, ...]
    common_s: float
    none_s: float
    both_s: float
    confidence: float | None
    rivals: tuple[int, ...] = ()

    def __repr__(self) -> str:
        places, moves = counted(len(self.configurations), "place", "places"), counted(self.n_moves, "move", "moves")
        return f"<MovingObject {self.id}: {places}, {moves}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from tempog.views.notebook import object_html, shown

        return shown(self, object_html)

    @cached_property
    def stays(self) -> tuple[ObjectStay, ...]:
        """What it did: neighbouring periods of `timeline` in one place, as one.

        Gaps do not end a stay, and neither do periods of no clear place, as while a leaf swings or somebody stands
        in a doorway. Of a thing with one place, to be away is a state too.

        Examples
        --------
        >>> s = 10**9
        >>> course = [(0, 9, 1), (9, 10, None), (10, 20, 1), (50, 60, 1), (60, 61, None), (61, 70, 2)]
        >>> timeline = tuple(ObjectPeriod(a * s, b * s, place) for a, b, place in course)
        >>> places = tuple(Configuration(k, np.empty((0, 2)), np.empty((0, 2)), ()) for k in (1, 2))
        >>> door = MovingObject(1, places, timeline, common_s=50.0, none_s=2.0, both_s=0.0, confidence=None)
        >>> [(stay.start_ns // s, stay.stop_ns // s, stay.configuration, stay.seen_s) for stay in door.stays]
        [(0, 60, 1, 29.0), (61, 70, 2, 9.0)]
        >>> door.n_moves, [(a // s, b // s) for a, b in door.gaps], door.seen_s, door.shares
        (1, [(20, 50)], 40.0, {1: 0.725, 2: 0.225, None: 0.05})
        """
        stays: list[ObjectStay] = []
        for start, stop, place in self.timeline:
            if place is None and len(self.configurations) > 1:
                continue
            lasted_s = (stop - start) / NS_PER_S
            if stays and stays[-1].configuration == place:
                stays[-1] = stays[-1]._replace(stop_ns=stop, seen_s=stays[-1].seen_s + lasted_s)
            else:
                stays.append(ObjectStay(start, stop, place, lasted_s))
        return tuple(stays)

    @property
    def n_moves(self) -> int:
        """How often it was found in another state than before: one less than its `stays`. It may have moved more."""
        return max(0, len(self.stays) - 1)

    @property
    def gaps(self) -> tuple[tuple[int, int], ...]:
        """(start, stop) ns of times between periods of `timeline`, `GAP_S` or longer, in which nothing is known."""
        return tuple(
            (one.stop_ns, later.start_ns)
            for one, later in pairwise(self.timeline)
            if later.start_ns - one.stop_ns >= GAP_S * NS_PER_S
        )

    @cached_property
    def seen_s(self) -> float:
        """How long `timeline` covers without its gaps, seconds."""
        return sum(stop - start for start, stop, _ in self.timeline) / NS_PER_S

    @cached_property
    def shares(self) -> dict[int | None, float]:
        """Share of `seen_s` in each place: its periods in `timeline` / `seen_s`. Under None, while in none clearly.

        Places by id, also those it was not seen in; None last, and only if there was such time.
        """
        lasted_ns: dict[int | None, int] = dict.fromkeys((place.id for place in self.configurations), 0)
        for start, stop, place in self.timeline:
            lasted_ns[place] = lasted_ns.get(place, 0) + stop - start
        total_ns = max(1, sum(lasted_ns.values()))
        return {place: lasted / total_ns for place, lasted in lasted_ns.items()}

    @property
    def last_stay(self) -> ObjectStay | None:
        """The state it is in now, as far as anybody knows: the last of `stays`, since when, and when last seen so.

        None if it was never clear, and if it was seen later without being clear for longer than `CLEAR_AFTER_S`.
        """
        if not self.stays:
            return None
        unclear_ns = sum(stop - start for start, stop, _ in self.timeline if start >= self.stays[-1].stop_ns)
        return self.stays[-1] if unclear_ns <= CLEAR_AFTER_S * NS_PER_S else None


def timeline_of(
    places: Sequence[Configuration], *, all_seen: bool = False
) -> tuple[tuple[ObjectPeriod, ...], float, float, float]:
    """What `MovingObject` says of a thing with some places: its `timeline`, `common_s`, `none_s` and `both_s`.

    With `all_seen`, as the paper has it, the timeline covers only the time in which all places were seen.
    """
    moments = sorted({moment for place in places for period in place.periods for moment in period[:2]})
    at = [0] * len(places)
    timeline: list[ObjectPeriod] = []
    common_ns = none_ns = both_ns = 0
    for since, until in pairwise(moments):
        known, there = 0, []
        for k, place in enumerate(places):
            periods = place.periods
            while at[k] < len(periods) and periods[at[k]].stop_ns <= since:
                at[k] += 1
            if at[k] < len(periods) and periods[at[k]].start_ns <= since:
                known += 1
                if periods[at[k]].state == "occupied":
                    there.append(place.id)
        if known == len(places):
            common_ns += until - since
            none_ns += (until - since) * (not there)
            both_ns += (until - since) * (len(there) > 1)
        elif all_seen or not there:
            continue  # it may be in a place that was not seen
        where = there[0] if len(there) == 1 else None
        if timeline and timeline[-1].stop_ns == since and timeline[-1].configuration == where:
            timeline[-1] = timeline[-1]._replace(stop_ns=until)
        else:
            timeline.append(ObjectPeriod(since, until, where))
    return tuple(timeline), common_ns / NS_PER_S, none_ns / NS_PER_S, both_ns / NS_PER_S


class _Combined(NamedTuple):
    """The combined time series of some configurations (Fig. 9): bit k of `state` is set where the kth is occupied."""

    start_ns: NDArray[np.int64]
    stop_ns: NDArray[np.int64]
    state: NDArray[np.int64]


def associate(
    configurations: Sequence[Configuration],
    *,
    max_states: int = PaperConfig.max_states,
    within_m: float | None = PaperConfig.within_m,
    none_share: float = PaperConfig.none_share,
    both_share: float = PaperConfig.both_share,
    min_common_s: float = PaperConfig.min_common_s,
) -> list[MovingObject]:
    """Sets of configurations of which one is occupied at any time (Fig. 10), as the paper does it.

    Parameters
    ----------
    configurations : sequence of Configuration
    max_states, within_m, none_share, both_share, min_common_s
        See `tempog.methods.PaperConfig`.

    Returns
    -------
    list of MovingObject
        Those of two configurations first. A configuration may be part of several: two doors that move in step
        cannot be told apart (section IV.C.1b).

    Raises
    ------
    ConfigError
        A setting that cannot work.

    Notes
    -----
    Times at which not all configurations of a set were seen are left out. Beyond the figure, each configuration
    must be the occupied one at some of the remaining times; else any place that stayed empty could be added to
    any object.
    """
    PaperConfig(
        max_states=max_states,
        within_m=within_m,
        none_share=none_share,
        both_share=both_share,
        min_common_s=min_common_s,
    )
    near = _later_neighbours(configurations, within_m)
    series = [_series(configuration) for configuration in configurations]
    found = []
    for members, combined in _sets(near, series, max_states, min_common_s):
        lasted_ns = combined.stop_ns - combined.start_ns
        n_occupied = np.bitwise_count(combined.state)
        common_s, none_s, both_s = (
            int(lasted_ns[where].sum()) / NS_PER_S for where in (slice(None), n_occupied == 0, n_occupied > 1)
        )
        if none_s <= none_share * common_s and both_s <= both_share * common_s:
            places = tuple(configurations[i] for i in members)
            confidence = 1 - (none_s + both_s) / common_s
            found.append((places, timeline_of(places, all_seen=True)[0], common_s, none_s, both_s, confidence))
    found.sort(key=lambda answer: (len(answer[0]), [place.id for place in answer[0]]))
    return [MovingObject(k + 1, *answer) for k, answer in enumerate(found)]


def _series(configuration: Configuration) -> _Combined:
    periods = configuration.periods
    start_ns, stop_ns = (np.array([period[k] for period in periods], dtype=np.int64) for k in (0, 1))
    return _Combined(start_ns, stop_ns, np.array([period.state == "occupied" for period in periods], dtype=np.int64))


def _later_neighbours(configurations: Sequence[Configuration], within_m: float | None) -> list[list[int]]:
    """For each configuration the later ones that are near; found through bins as wide as the distance."""
    if within_m is None:
        return [list(range(i + 1, len(configurations))) for i in range(len(configurations))]
    centres = [configuration.centre_m for configuration in configurations]
    bins: dict[tuple[int, int], list[int]] = {}
    near: list[list[int]] = [[] for _ in configurations]
    for i, (x, y) in enumerate(centres):
        column, row = int(x // within_m), int(y // within_m)
        for place in [(column + a, row + b) for a in (-1, 0, 1) for b in (-1, 0, 1)]:
            for j in bins.get(place, []):
                if np.hypot(x - centres[j][0], y - centres[j][1]) <= within_m:
                    near[j].append(i)
        bins.setdefault((column, row), []).append(i)
    return near


def _sets(
    near: list[list[int]], series: list[_Combined], max_states: int, min_common_s: float
) -> Iterator[tuple[list[int], _Combined]]:
    """Sets of 2 to `max_states` configurations near each other, each occupied at some commonly seen time.

    A set that lacks the common time, or in which one is never occupied, lacks it with any further member too.
    """
    min_common_ns = min_common_s * NS_PER_S
    waiting = [([i], near[i], series[i]) for i in range(len(near)) if series[i].state.any()]
    while waiting:
        members, candidates, combined = waiting.pop()
        for i in candidates:
            grown = _combine(combined, series[i], len(members))
            common_ns = int((grown.stop_ns - grown.start_ns).sum())
            seen_occupied = int(np.bitwise_or.reduce(grown.state, initial=0))
            if not common_ns or common_ns < min_common_ns or seen_occupied != (2 << len(members)) - 1:
                continue
            yield [*members, i], grown
            if len(members) + 1 < max_states:
                near_all = set(near[i]).intersection(candidates)
                waiting.append(([*members, i], sorted(near_all), grown))


def _combine(combined: _Combined, another: _Combined, bit: int) -> _Combined:
    """The combined series of a set and another configuration, whose state is bit `bit` of it."""
    capacity = len(combined.state) + len(another.state)
    start_ns, stop_ns, state = (np.empty(capacity, dtype=np.int64) for _ in range(3))
    shifted = _Combined(another.start_ns, another.stop_ns, another.state << bit)
    n = intersect(*combined, *shifted, start_ns, stop_ns, state)
    return _Combined(start_ns[:n], stop_ns[:n], state[:n])
