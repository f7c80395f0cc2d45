"""Which places are those of one thing: it is in one at a time, and leaves one for another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Period
from tempog.analysis.evidence.places import Place
from tempog.analysis.series_kernels import connect
from tempog.methods import EvidenceConfig
from tempog.times import NS_PER_S

ELSEWHERE = 0.03  # share of stretches in which a thing is in none of the places it is known in
TWICE = 0.003  # ... in which two of them are occupied: somebody stands in the open door
MAX_TRIES = 20_000  # of the exact choice among overlapping sets, per neighbourhood; then the best found so far
MAX_SETS = 3_000  # of one size
FEW_SETS = 200  # among which every choice is made again as a whole
# Log odds that a link must have over every other one of its places; 1 is three to one.
AMBIGUOUS_BELOW = 1.0


class PlaceSet(NamedTuple):
    """Places of one thing: which, and the log odds that they are."""

    members: tuple[int, ...]
    log_odds: float


class ChosenSet(NamedTuple):
    """A set of the best choice, and how sure it is.

    `margin` is the sum of log odds lost by the best choice without this very set. `rivals` are other places that
    places of this set are linked with, without losing `AMBIGUOUS_BELOW`.
    """

    members: tuple[int, ...]
    log_odds: float
    margin: float
    rivals: tuple[int, ...] = ()


def associate_places(places: Sequence[Place], settings: EvidenceConfig) -> list[ChosenSet]:
    """The sets of places that are best explained as those of one thing each; no place is in two of them.

    The log odds of a set are the sum over its pairs: of exclusion in time, see `exclusion`, and of shape, see
    `shape_odds`. Of sets that share places, the disjoint ones with the largest sum are chosen, exactly where a
    neighbourhood is small.
    """
    from scipy.spatial import cKDTree

    if len(places) < 2:
        return []
    tree = cKDTree([place.centre_m for place in places])
    weight: dict[tuple[int, int], float] = {}
    friends: dict[int, set[int]] = {}
    for i, j in sorted(map(tuple, tree.query_pairs(settings.within_m, output_type="ndarray").tolist())):
        odds, conflict = exclusion(places[i].periods, places[j].periods, settings.worth_s)
        odds += shape_odds(places[i], places[j], settings)
        # Two of three places say little by themselves: the thing was in the third for much of the time.
        if conflict <= settings.max_conflict and odds > settings.grow_above:
            weight[i, j] = odds
            friends.setdefault(i, set()).add(j)
            friends.setdefault(j, set()).add(i)
    sets: dict[tuple[int, ...], float] = dict(weight.items())
    found = _above(settings.link_above, sets)
    for _ in range(3, settings.max_states + 1):
        larger: dict[tuple[int, ...], float] = {}
        for members, odds in sorted(sets.items(), key=lambda one: -one[1])[:MAX_SETS]:
            for another in set.intersection(*(friends[i] for i in members)):
                if another > members[-1]:
                    larger[*members, another] = odds + sum(weight[i, another] for i in members)
        sets = larger
        found += _above(settings.link_above, sets)
    return [chosen for part in _neighbourhoods(found) for chosen in with_rivals(best_disjoint(part), part)]


def _above(odds: float, sets: dict[tuple[int, ...], float]) -> list[PlaceSet]:
    return [PlaceSet(*one) for one in sets.items() if one[1] > odds]


def exclusion(course: Sequence[Period], other: Sequence[Period], worth_s: float) -> tuple[float, float]:
    """Log odds for one thing that is in one of two places at a time, against a thing for each; and conflict.

    One thing is in either place with that place's share of the time, elsewhere for the rest, and hardly ever in
    both. Two things are in theirs independently. Conflict is the evidence for both being occupied at once.

    Examples
    --------
    >>> def course(*states):
    ...     return [Period(10**10 * k, 10**10 * (k + 1), state) for k, state in enumerate(states)]
    >>> closed = course("occupied", "free", "occupied", "free")
    >>> odds, conflict = exclusion(closed, course("free", "occupied", "free", "occupied"), worth_s=1.0)
    >>> odds > 2, conflict
    (True, 0.0)
    >>> odds, conflict = exclusion(closed, closed, worth_s=1.0)
    >>> odds < 0, round(conflict, 2)
    (True, 2.0)
    """
    evidence = joint_periods(course, other, worth_s)
    total = evidence.sum() + 1
    first, second = (evidence[1].sum() + 0.5) / total, (evidence[:, 1].sum() + 0.5) / total
    scale = max(1.0, float(first + second) / (1 - ELSEWHERE))
    one = np.array([[max(1 - (first + second) / scale, ELSEWHERE), second / scale], [first / scale, TWICE]])
    two = np.outer([1 - first, first], [1 - second, second])
    return float((evidence * np.log(one / two)).sum()), float(evidence[1, 1])


def joint_periods(
    course: Sequence[Period], other: Sequence[Period], worth_s: float, one_at_a_time: bool = True
) -> NDArray[np.float64]:
    """Evidence for the joint states of two places: [free or occupied, free or occupied].

    A place that was not seen for a while is taken to have kept its state if it has the same afterwards, but not
    against the other: for places of one thing, not to have stayed occupied while the other was; for parts of one
    place, without `one_at_a_time`, not to have been in another state than the other. Neighbouring stretches of one
    joint state are one, whatever lies between; a stretch known for `worth_s` counts for 0.63.
    """
    courses = (course, other)
    moments = sorted({moment for periods in courses for period in periods for moment in period[:2]})
    at = [0, 0]
    evidence = np.zeros((2, 2))
    current, lasted_s = (-1, -1), 0.0
    for since, until in pairwise(moments):
        state, assumed = [-1, -1], [False, False]
        for i, periods in enumerate(courses):
            while at[i] < len(periods) and periods[at[i]].stop_ns <= since:
                at[i] += 1
            if at[i] < len(periods):
                period = periods[at[i]]
                assumed[i] = period.start_ns > since
                if not assumed[i] or (at[i] > 0 and periods[at[i] - 1].state == period.state):
                    state[i] = int(period.state == "occupied")
        if -1 in state or (any(assumed) and (state == [1, 1] if one_at_a_time else state[0] != state[1])):
            continue
        if (state[0], state[1]) != current:
            if lasted_s:
                evidence[current] += 1 - math.exp(-lasted_s / worth_s)
            current, lasted_s = (state[0], state[1]), 0.0
        lasted_s += (until - since) / NS_PER_S
    if lasted_s:
        evidence[current] += 1 - math.exp(-lasted_s / worth_s)
    return evidence


def shape_odds(place: Place, other: Place, settings: EvidenceConfig) -> float:
    """Log odds by shape that two places are of one thing: a common hinge, or near, and about as large."""
    apart_m = _apart_m(place.points_map, other.points_map)
    odds = settings.hinge_bonus if apart_m <= settings.hinge_m else -settings.distance_cost * apart_m
    return odds - settings.size_cost * max(0.0, abs(math.log(place.size_m / other.size_m)) - 0.3)


def _apart_m(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    return float(np.sqrt(((points[:, None] - others[None]) ** 2).sum(axis=-1).min()))


def _neighbourhoods(sets: Sequence[PlaceSet]) -> list[list[PlaceSet]]:
    """Sets in parts such that no two parts share a place."""
    pairs = np.array([pair for one in sets for pair in pairwise(one.members)], dtype=np.int64).reshape(-1, 2)
    part_of = np.arange(pairs.max(initial=-1) + 1)
    left, right = pairs.T.copy()
    connect(left, right, part_of)
    parts: dict[int, list[PlaceSet]] = {}
    for one in sets:
        parts.setdefault(int(part_of[one.members[0]]), []).append(one)
    return list(parts.values())


def best_disjoint(sets: Sequence[PlaceSet]) -> list[PlaceSet]:
    """Of sets that may share places, the disjoint ones whose log odds sum up to most; branch and bound.

    After `MAX_TRIES` the best so far; the first tried takes the largest odds first.

    >>> best_disjoint([PlaceSet((0, 1), 3.0), PlaceSet((1, 2), 4.0), PlaceSet((2, 3), 3.0)])
    [PlaceSet(members=(0, 1), log_odds=3.0), PlaceSet(members=(2, 3), log_odds=3.0)]
    """
    ordered = sorted((one for one in sets if one.log_odds > 0), key=lambda one: (-one.log_odds, one.members))
    rest = np.cumsum([one.log_odds for one in ordered[::-1]])[::-1].tolist()
    best: list[int] = []
    best_odds = odds = 0.0
    chosen: list[tuple[int, float]] = []  # which, and the odds before it
    taken: set[int] = set()
    k = 0
    for _ in range(MAX_TRIES):
        if k < len(ordered) and odds + rest[k] > best_odds:
            if taken.isdisjoint(ordered[k].members):
                chosen.append((k, odds))
                taken.update(ordered[k].members)
                odds += ordered[k].log_odds
                if odds > best_odds:
                    best, best_odds = [i for i, _ in chosen], odds
        elif chosen:
            k, odds = chosen.pop()
            taken.difference_update(ordered[k].members)
        else:
            break
        k += 1
    return sorted(ordered[i] for i in best)


def with_rivals(chosen: Sequence[PlaceSet], sets: Sequence[PlaceSet]) -> list[ChosenSet]:
    """How sure each set of the best choice is: what is lost without it.

    For each set the choice is made again without it. Of more than `FEW_SETS` only those take part that share places
    with others that share places with it; what was chosen farther off stays, and the margin may come out too large.

    >>> sets = [PlaceSet((0, 1), 3.0), PlaceSet((2, 3), 3.0), PlaceSet((0, 3), 2.8), PlaceSet((1, 2), 2.8)]
    >>> first, second = with_rivals(sets[:2], sets)
    >>> round(first.margin, 1), first.rivals
    (0.4, (2, 3))
    >>> with_rivals(sets[:1], sets[:1])
    [ChosenSet(members=(0, 1), log_odds=3.0, margin=3.0, rivals=())]
    """
    owner = {i: k for k, one in enumerate(chosen) for i in one.members}
    having: dict[int, list[int]] = {}
    for k, one in enumerate(sets):
        for i in one.members:
            having.setdefault(i, []).append(k)
    answer = []
    for one in chosen:
        near = set(having)
        if len(sets) > FEW_SETS:
            near = {i for j in {j for i in one.members for j in having[i]} for i in sets[j].members}
        freed = {owner[i] for i in near if i in owner}
        pool = [sets[j] for j in sorted({j for i in near for j in having[i]})]
        pool = [other for other in pool if freed.issuperset(owner[i] for i in other.members if i in owner)]
        total = sum(chosen[j].log_odds for j in freed)
        without = best_disjoint([other for other in pool if other.members != one.members])
        apart = best_disjoint([other for other in pool if not set(other.members) <= set(one.members)])
        rivals: set[int] = set()
        if total - sum(other.log_odds for other in apart) < AMBIGUOUS_BELOW:
            mine = set(one.members)
            rivals.update(i for other in apart if mine & set(other.members) for i in other.members if i not in mine)
        margin = max(0.0, total - sum(other.log_odds for other in without))
        answer.append(ChosenSet(one.members, one.log_odds, margin, tuple(sorted(rivals))))
    return answer
