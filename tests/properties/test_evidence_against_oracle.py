"""The steps of the method ``evidence`` are what slow, obvious Python makes of their definitions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle import evidence as oracle
from tempog.analysis.configurations import Period
from tempog.analysis.evidence import association, grouping, kernels, places
from tempog.analysis.evidence.association import PlaceSet
from tempog.analysis.evidence.courses import ERRORS_LAST_S, FOR_FREE, FOR_HIT, MAX_LOOKS, Courses, HeldCourses
from tempog.analysis.evidence.states import Alike, CellStates
from tempog.methods import EvidenceConfig

QUICK = settings(max_examples=60, deadline=None, derandomize=True)
NS = 1_000_000_000
LOOK_NS = NS // 10
WORTH_S = st.sampled_from([0.5, 2.0])


def all_series(max_size: int = 8, min_size: int = 0) -> st.SearchStrategy[list[tuple[int, int, bool]]]:
    """Periods in time order: some touch, some leave gaps."""
    tenths = st.tuples(st.sampled_from([0, 0, 0, 1, 60]), st.sampled_from([1, 2, 5, 13, 40, 200]), st.booleans())

    def laid_out(triples: list[tuple[int, int, bool]]) -> list[tuple[int, int, bool]]:
        t, found = 0, []
        for gap, length, state in triples:
            found.append(((t + gap) * LOOK_NS, (t + gap + length) * LOOK_NS, state))
            t += gap + length
        return found

    return st.lists(tenths, min_size=min_size, max_size=max_size).map(laid_out)


def packed(several: list[list[tuple[int, int, bool]]]):
    """Offsets, starts, stops and states of several series, as the kernels take them."""
    offsets = np.cumsum([0, *map(len, several)]).astype(np.int64)
    flat = [period for series in several for period in series]
    start, stop = (np.array([period[k] for period in flat], dtype=np.int64) for k in (0, 1))
    return offsets, start, stop, np.array([period[2] for period in flat], dtype=np.uint8)


def periods(series: list[tuple[int, int, bool]]) -> tuple[Period, ...]:
    return tuple(Period(a, b, "occupied" if state else "free") for a, b, state in series)


@given(st.lists(all_series(max_size=9), min_size=1, max_size=3), st.sampled_from([0.3, 5.0, 30.0]))
@QUICK
def test_smoothed_states_are_the_likeliest_of_all_courses(several, dwell_s):
    offsets, start, stop, hit = packed(several)
    value = np.where(hit, 0.9, 0.1).astype(np.float32)
    state = np.full(len(value), 9, dtype=np.uint8)
    model = (FOR_HIT, FOR_FREE, MAX_LOOKS, ERRORS_LAST_S, dwell_s)
    kernels.smooth_states(offsets, start, stop, value, LOOK_NS, 0.5, *model, state)
    for i, series in enumerate(several):
        course = state[offsets[i] : offsets[i + 1]].tolist()
        assert set(course) <= {0, 1}
        got = oracle.log_odds_of_course(series, course, LOOK_NS, *model)
        assert got == pytest.approx(oracle.log_odds_of_best_course(series, LOOK_NS, *model), abs=1e-9)


@given(st.lists(all_series(), min_size=1, max_size=4), WORTH_S)
@QUICK
def test_the_evidence_of_states_is_that_of_the_oracle(several, worth_s):
    offsets, start, stop, state = packed(several)
    evidence, seconds = np.zeros((2, len(several), 2))
    kernels.state_evidence(offsets, start, stop, state, worth_s, evidence, seconds)
    for i, series in enumerate(several):
        wanted, lasted = oracle.state_evidence(series, worth_s)
        np.testing.assert_allclose(evidence[i], wanted, atol=1e-9)
        np.testing.assert_allclose(seconds[i], lasted, atol=1e-9)


@given(st.lists(all_series(), min_size=2, max_size=4), WORTH_S)
@QUICK
def test_the_joint_evidence_of_two_cells_is_that_of_the_oracle(several, worth_s):
    offsets, start, stop, state = packed(several)
    pairs = np.array(list(itertools.permutations(range(len(several)), 2)), dtype=np.int64)
    left, right = (np.ascontiguousarray(side) for side in pairs.T)
    evidence = np.zeros((len(pairs), 4))
    kernels.joint_evidence(offsets, start, stop, state, left, right, worth_s, evidence)
    wanted = [oracle.joint_evidence(several[a], several[b], worth_s) for a, b in pairs]
    np.testing.assert_allclose(evidence, wanted, atol=1e-9)
    ratios = [oracle.likelihood_ratio(*of_pair, grouping.DISAGREEMENT) for of_pair in wanted]
    np.testing.assert_allclose(grouping.likelihood_ratios(evidence), ratios, atol=1e-9)


@given(st.lists(all_series(), min_size=1, max_size=4), all_series(max_size=4), st.data())
@QUICK
def test_hits_and_states_during_spells_are_those_of_the_oracle(several, spells, data):
    offsets, start, stop, hit = packed(several)
    which = data.draw(st.lists(st.sampled_from(range(len(several))), unique=True))
    since, until = (np.array([spell[k] for spell in spells], dtype=np.int64) for k in (0, 1))
    spells = [spell[:2] for spell in spells]
    seconds = np.zeros((len(which), 2))
    kernels.seconds_during(offsets, start, stop, hit, np.array(which, dtype=np.int64), since, until, seconds)
    wanted = [oracle.seconds_during(several[i], spells) for i in which]
    np.testing.assert_allclose(seconds, np.reshape(wanted, (-1, 2)), atol=1e-9)
    assert seconds[:, 1].sum() == pytest.approx(oracle.hits_during(several, which, spells), abs=1e-9)


@given(st.sets(st.tuples(st.integers(-4, 4), st.integers(-4, 4))), st.integers(1, 3))
@QUICK
def test_pairs_of_cells_within_reach_are_all_and_each_once(cells, reach):
    cells = sorted(cells)
    rows, cols = (np.array([cell[k] for cell in cells], dtype=np.int64) for k in (0, 1))
    left, right = grouping.pairs_within(rows, cols, reach)
    wanted = [
        (i, j)
        for (i, one), (j, other) in itertools.combinations(enumerate(cells), 2)
        if (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 <= reach**2
    ]
    assert list(zip(left.tolist(), right.tolist(), strict=True)) == wanted


@given(st.lists(all_series(min_size=1), min_size=1, max_size=5), st.sampled_from([0.0, 0.3, 0.75]))
@QUICK
def test_the_course_of_a_group_is_that_of_the_oracle(several, seen_share):
    states = cell_states_of(several)
    chosen = EvidenceConfig(seen_share=seen_share, least_stay_s=0.0)
    place = places.measure(states, np.arange(len(several)), chosen)
    wanted = oracle.course_of_group(several, seen_share)
    assert [[p.start_ns, p.stop_ns, p.state == "occupied"] for p in place.periods] == wanted
    stays = [list(stretch) for _, stretch in itertools.groupby(wanted, key=lambda period: period[2])]
    assert [stay[:3] for stay in place.stays] == [(one[0][2], one[0][0], one[-1][1]) for one in stays]
    for stay, stretch in zip(place.stays, stays, strict=True):
        assert stay.observed_s == pytest.approx(sum(stop - start for start, stop, _ in stretch) / NS)
        assert 0.5 <= stay.together <= 1


def cell_states_of(several) -> CellStates:
    """Cells in a row, with states as given."""
    offsets, start, stop, state = packed(several)
    n = len(several)
    row, whole = np.zeros(n, np.int64), np.ones((n, 2))
    nothing = Alike(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    courses = HeldCourses(Courses(offsets, start, stop, state, state))
    numbers = np.arange(n, dtype=np.int32)
    content, by_view = np.zeros(n, np.uint64), np.zeros(n, np.bool_)
    return CellStates(row, np.arange(n), 0.05, numbers, whole, whole, row, nothing, courses, content, by_view)


# Merging.


@st.composite
def weighted_pairs(draw: st.DrawFn) -> tuple[int, dict[tuple[int, int], float]]:
    """A few nodes, and pairs of them with weights of which no two sums are alike."""
    n = draw(st.integers(1, 9))
    every = list(itertools.combinations(range(n), 2))
    pairs = sorted(draw(st.sets(st.sampled_from(every)))) if every else []
    weights = np.random.default_rng(draw(st.integers(0, 10_000))).normal(
        draw(st.sampled_from([-1, 0, 1])), 1, len(pairs)
    )
    return n, dict(zip(pairs, weights.tolist(), strict=True))


def merged(n: int, pairs: dict[tuple[int, int], float], above: float) -> set[frozenset[int]]:
    left, right = (np.array([pair[k] for pair in pairs], dtype=np.int64) for k in (0, 1))
    label = grouping.merge(n, left, right, np.array(list(pairs.values()), dtype=np.float64), above).tolist()
    assert all(label[k] <= k and label[label[k]] == label[k] for k in range(n))  # named by their smallest member
    return {frozenset(k for k in range(n) if label[k] == name) for name in label}


@given(weighted_pairs(), st.sampled_from([-0.5, 0.0, 0.5]))
@QUICK
def test_groups_are_merged_as_when_all_means_are_computed_anew_each_time(graph, above):
    assert merged(*graph, above) == oracle.merge(*graph, above)


def test_groups_that_take_over_so_many_pairs_that_their_table_is_laid_anew_are_merged_alike():
    # Like a tournament of 64, each with four pairs of its own that go over to the winner time and again.
    cup = {(i, i + step): 10.0 - step / 64 for step in (1, 2, 4, 8, 16, 32) for i in range(0, 64, 2 * step)}
    own = {(i // 4, 64 + i): -1 - i / 1000 for i in range(256)}
    groups = merged(320, cup | own, 0.0)
    assert groups == {frozenset(range(64)), *(frozenset({64 + i}) for i in range(256))}


@given(weighted_pairs(), st.data())
@QUICK
def test_the_order_of_pairs_and_of_their_ends_does_not_matter(graph, data):
    n, pairs = graph
    shuffled = data.draw(st.permutations(list(pairs.items())))
    turned = {(pair if data.draw(st.booleans()) else pair[::-1]): weight for pair, weight in shuffled}
    assert merged(n, turned, 0.0) == merged(n, pairs, 0.0)


@given(weighted_pairs())
@QUICK
def test_with_all_weights_positive_groups_are_the_connected_parts(graph):
    n, pairs = graph
    component = {i: {i} for i in range(n)}
    for i, j in pairs:
        whole = component[i] | component[j]
        component.update(dict.fromkeys(whole, whole))
    positive = {pair: abs(weight) + 0.01 for pair, weight in pairs.items()}
    assert merged(n, positive, 0.0) == {frozenset(part) for part in component.values()}


@given(weighted_pairs())
@QUICK
def test_no_two_groups_are_left_that_agree_in_the_mean(graph):
    n, pairs = graph
    for a, b in itertools.combinations(merged(n, pairs, 0.0), 2):
        mean = oracle.mean_across(a, b, pairs)
        assert mean is None or mean <= 0


@given(st.integers(2, 5), st.integers(2, 5), st.integers(0, 10_000))
@QUICK
def test_one_alike_pair_does_not_chain_groups_that_differ_in_the_mean(n_first, n_second, seed):
    rng = np.random.default_rng(seed)
    n = n_first + n_second
    pairs = {}
    for i, j in itertools.combinations(range(n), 2):
        across = i < n_first <= j
        pairs[i, j] = float(rng.uniform(-2, -1) if across else rng.uniform(2, 3))
    pairs[n_first - 1, n_first] = 1.9  # less alike than those within a group, yet well above 0
    assert merged(n, pairs, 0.0) == {frozenset(range(n_first)), frozenset(range(n_first, n))}


# Two places, and which are chosen.


@given(all_series(), all_series(), WORTH_S, st.booleans())
@QUICK
def test_the_joint_states_of_two_places_are_those_of_the_oracle(course, other, worth_s, one_at_a_time):
    got = association.joint_periods(periods(course), periods(other), worth_s, one_at_a_time)
    np.testing.assert_allclose(got, oracle.joint_periods(course, other, worth_s, one_at_a_time), atol=1e-9)
    swapped = association.joint_periods(periods(other), periods(course), worth_s, one_at_a_time)
    np.testing.assert_allclose(swapped, got.T, atol=1e-9)


@given(all_series(), all_series(), WORTH_S)
@QUICK
def test_the_odds_of_exclusion_are_those_of_the_oracle(course, other, worth_s):
    odds, evidence = association.exclusion(periods(course), periods(other), worth_s)
    got = odds, evidence[1, 1]
    wanted = oracle.exclusion(course, other, worth_s, association.ELSEWHERE, association.TWICE)
    assert got == pytest.approx(wanted, abs=1e-9)


PLACE_SETS = st.dictionaries(
    st.sets(st.integers(0, 8), min_size=2, max_size=4).map(lambda members: tuple(sorted(members))),
    st.integers(-400, 900).map(lambda k: k * 0.01),
    max_size=9,
).map(lambda sets: [PlaceSet(members, odds) for members, odds in sets.items()])


@given(PLACE_SETS)
@QUICK
def test_of_all_choices_of_disjoint_sets_the_best_is_taken(sets):
    chosen = association.best_disjoint(sets)
    members = [i for one in chosen for i in one.members]
    assert len(members) == len(set(members))
    assert set(chosen) <= set(sets)
    assert sum(one.log_odds for one in chosen) == pytest.approx(oracle.best_disjoint_sum(sets), abs=1e-9)


@given(PLACE_SETS)
@QUICK
def test_the_margin_of_a_set_is_what_the_best_choice_without_it_loses(sets):
    chosen = association.best_disjoint(sets)
    best = sum(one.log_odds for one in chosen)
    for one in association.with_rivals(chosen, sets):
        others = [other for other in sets if other.members != one.members]
        assert one.margin == pytest.approx(best - oracle.best_disjoint_sum(others), abs=1e-9)
        assert one.margin <= one.log_odds + 1e-9
        assert not set(one.rivals) & set(one.members)


@given(PLACE_SETS)
@QUICK
def test_parts_share_no_place_and_fall_into_no_smaller_ones(sets):
    parts = association._neighbourhoods(sets)
    assert sorted(one for part in parts for one in part) == sorted(sets)
    owned = [{i for one in part for i in one.members} for part in parts]
    assert not any(a & b for a, b in itertools.combinations(owned, 2))
    for part in parts:
        assert len(association._neighbourhoods(part)) == 1


def test_a_long_chain_of_sets_can_be_chosen_from():
    chain = [PlaceSet((i, i + 1), 1.0) for i in range(4000)]
    chosen = association.best_disjoint(chain)
    assert len(chosen) == 2000
    sure = association.with_rivals(chosen, chain)
    assert [one.members for one in sure] == [one.members for one in chosen]
    assert all(0 <= one.margin <= 1 for one in sure)
