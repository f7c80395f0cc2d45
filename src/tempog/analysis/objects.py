"""Objects with several places: configurations that complement each other (paper, IV.C.1b, Fig. 9 and 10)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.series_kernels import intersect
from tempog.methods import PaperConfig
from tempog.times import NS_PER_S


class ObjectPeriod(NamedTuple):
    """Where an object was from `start_ns` until just before `stop_ns`.

    `configuration` is the id of the one occupied place; None while none or more than one was.
    """

    start_ns: int
    stop_ns: int
    configuration: int | None


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
        That these places are those of one thing. For the paper's method the share of `common_s` in which exactly
        one place was occupied. None for a thing with a single place.
    """

    id: int
    configurations: tuple[Configuration, ...]
    timeline: tuple[ObjectPeriod, ...]
    common_s: float
    none_s: float
    both_s: float
    confidence: float | None


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
        See `tempog.config.PaperConfig`.

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
            found.append((places, _timeline(places, combined), common_s, none_s, both_s, confidence))
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


def _timeline(places: tuple[Configuration, ...], combined: _Combined) -> tuple[ObjectPeriod, ...]:
    place_of = {1 << k: place.id for k, place in enumerate(places)}
    timeline: list[ObjectPeriod] = []
    for start, stop, state in zip(*(column.tolist() for column in combined), strict=True):
        place = place_of.get(state)
        if timeline and timeline[-1].stop_ns == start and timeline[-1].configuration == place:
            timeline[-1] = timeline[-1]._replace(stop_ns=stop)
        else:
            timeline.append(ObjectPeriod(start, stop, place))
    return tuple(timeline)
