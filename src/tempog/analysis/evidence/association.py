"""Which places are those of one thing: it is in one at a time, and leaves one for another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Period
from tempog.analysis.evidence.kernels import joint_stretches
from tempog.analysis.evidence.places import PeriodArrays, Place, as_arrays
from tempog.analysis.evidence.shape import hinges, near_odds
from tempog.analysis.series_kernels import connect
from tempog.methods import EvidenceConfig

ELSEWHERE = 0.03  # share of stretches in which a thing is in none of the places it is known in
TWICE = 0.02  # ... in which two of them are occupied: somebody stands in the open door
MAX_TRIES = 20_000  # of the exact choice among overlapping sets, per neighbourhood; then the best found so far
MAX_SETS = 3_000  # of one size, per neighbourhood
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

    What is doubtful as a place counts against a set: the link must outweigh what its traits say.

    For the log odds of a set see `Links.log_odds`, for those of a pair `exclusion` and `shape.py`.
    Of sets that share places, the disjoint ones with the largest sum are chosen, exactly where a
    neighbourhood is small.
    """
    from scipy.spatial import cKDTree

    if len(places) < 2:
        return []
    tree = cKDTree([place.centre_m for place in places])
    links = Links({}, {}, {})
    friends: dict[int, set[int]] = {}
    for i, j in sorted(map(tuple, tree.query_pairs(settings.within_m, output_type="ndarray").tolist())):
        odds, evidence = exclusion(places[i].course, places[j].course, settings.worth_s)
        shape = links.add_shape(i, j, places, settings)
        conflict, moves = evidence[1, 1], min(evidence[0, 1], evidence[1, 0])
        # Two of three places say little by themselves: the thing was in the third for much of the time.
        if conflict <= max(settings.max_conflict, settings.conflict_share * moves) and (
            odds > settings.grow_above and odds + shape > settings.grow_above
        ):
            links.in_time[i, j] = odds
            friends.setdefault(i, set()).add(j)
            friends.setdefault(j, set()).add(i)
    sets: list[tuple[int, ...]] = list(links.in_time)
    part_of = _part_of(sets)
    found = []
    for _ in range(2, settings.max_states + 1):
        odds_of = {
            members: links.log_odds(members, settings)
            + sum(min(0.0, places[i].log_odds - settings.place_above) for i in members)
            for members in sets
        }
        found += [PlaceSet(*one) for one in odds_of.items() if one[1] > settings.link_above]
        sets = [
            (*members, another)
            for members in _best_of_each_part(odds_of, part_of)
            for another in sorted(set.intersection(*(friends[i] for i in members)))
            if another > members[-1]
        ]
    return [chosen for part in _neighbourhoods(found) for chosen in with_rivals(best_disjoint(part), part)]


class Links(NamedTuple):
    """What speaks for pairs of places being of one thing: in time, by shape, and which share which hinge."""

    in_time: dict[tuple[int, int], float]
    by_shape: dict[tuple[int, int], float]
    around_hinge: dict[tuple[int, int], set[int]]  # by place and end of it

    def add_shape(self, i: int, j: int, places: Sequence[Place], settings: EvidenceConfig) -> float:
        """Log odds by shape of one more pair: a common hinge, or near, and about as large."""
        place, other = places[i], places[j]
        about = [(i, k, j) for k in hinges(place.line, other.line)] + [
            (j, k, i) for k in hinges(other.line, place.line)
        ]
        for a, k, b in about:
            self.around_hinge.setdefault((a, k), set()).add(b)
        odds = settings.hinge_bonus
        if not about:
            odds = near_odds(place.points_map, other.points_map, place.size_m / other.size_m, settings)
        self.by_shape[i, j] = odds
        return odds

    def log_odds(self, members: tuple[int, ...], settings: EvidenceConfig) -> float:
        """Of a set of places being those of one thing.

        In time, the sum over its pairs. By shape, the mean of the pairs, once for each place but the first; or as
        much for each as a hinge counts that all of them share.
        """
        pairs = list(combinations(members, 2))
        by_shape = sum(self.by_shape[pair] for pair in pairs) / len(pairs)
        if any(
            self.around_hinge.get((i, k), set()).issuperset(j for j in members if j != i)
            for i in members
            for k in (0, 1)
        ):
            by_shape = max(by_shape, settings.hinge_bonus)
        return sum(self.in_time[pair] for pair in pairs) + (len(members) - 1) * by_shape


def exclusion(
    course: Sequence[Period] | PeriodArrays, other: Sequence[Period] | PeriodArrays, worth_s: float
) -> tuple[float, NDArray[np.float64]]:
    """Log odds for one thing that is in one of two places at a time, against a thing for each; and `joint_periods`.

    One thing is in either place with that place's share of the time, elsewhere for the rest, and hardly ever in
    both. Two things are in theirs independently.

    Examples
    --------
    >>> def course(*states):
    ...     return [Period(10**10 * k, 10**10 * (k + 1), state) for k, state in enumerate(states)]
    >>> closed = course("occupied", "free", "occupied", "free")
    >>> odds, evidence = exclusion(closed, course("free", "occupied", "free", "occupied"), worth_s=1.0)
    >>> odds > 2, evidence.round().tolist()
    (True, [[0.0, 2.0], [2.0, 0.0]])
    >>> odds, evidence = exclusion(closed, closed, worth_s=1.0)
    >>> odds < 0, evidence.round().tolist()
    (True, [[2.0, 0.0], [0.0, 2.0]])
    """
    evidence = joint_periods(course, other, worth_s)
    total = evidence.sum() + 1
    first, second = (evidence[1].sum() + 0.5) / total, (evidence[:, 1].sum() + 0.5) / total
    scale = max(1.0, float(first + second) / (1 - ELSEWHERE))
    one = np.array([[max(1 - (first + second) / scale, ELSEWHERE), second / scale], [first / scale, TWICE]])
    two = np.outer([1 - first, first], [1 - second, second])
    return float((evidence * np.log(one / two)).sum()), evidence


def joint_periods(
    course: Sequence[Period] | PeriodArrays,
    other: Sequence[Period] | PeriodArrays,
    worth_s: float,
    one_at_a_time: bool = True,
) -> NDArray[np.float64]:
    """Evidence for the joint states of two places: [free or occupied, free or occupied].

    A place that was not seen for a while is taken to have kept its state if it has the same afterwards, but not
    against the other: for places of one thing, not to have stayed occupied while the other was; for parts of one
    place, without `one_at_a_time`, not to have been in another state than the other. Neighbouring stretches of one
    joint state are one, whatever lies between; a stretch known for `worth_s` counts for 0.63.
    """
    evidence = np.zeros((2, 2))
    joint_stretches(*as_arrays(course), *as_arrays(other), worth_s, one_at_a_time, evidence)
    return evidence


def _part_of(sets: Sequence[tuple[int, ...]]) -> NDArray[np.int64]:
    """For each place, the smallest one that a chain of sets connects it with."""
    pairs = np.array([pair for members in sets for pair in pairwise(members)], dtype=np.int64).reshape(-1, 2)
    part_of = np.arange(pairs.max(initial=-1) + 1)
    left, right = pairs.T.copy()
    connect(left, right, part_of)
    return part_of


def _best_of_each_part(
    odds_of: Mapping[tuple[int, ...], float], part_of: NDArray[np.int64]
) -> Iterator[tuple[int, ...]]:
    """The best sets first, `MAX_SETS` of each part at most: what is far away takes none of a part's chances."""
    n_taken: Counter[int] = Counter()
    for members in sorted(odds_of, key=lambda members: (-odds_of[members], members)):
        part = int(part_of[members[0]])
        if n_taken[part] < MAX_SETS:
            n_taken[part] += 1
            yield members


def _neighbourhoods(sets: Sequence[PlaceSet]) -> list[list[PlaceSet]]:
    """Sets in parts such that no two parts share a place."""
    part_of = _part_of([one.members for one in sets])
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
