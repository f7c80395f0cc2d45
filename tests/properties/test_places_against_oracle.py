"""What the method ``evidence`` makes of groups of cells is what slow, obvious Python makes of them.

Groups lie anywhere on the lattice for the fast code, and about its origin for the oracle: where that is says nothing.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lattice_groups import LOOK_NS, RESOLUTIONS, SHIFTS, bars, cell_states_of, indices, place_of, points_of, series
from oracle import evidence as oracle_evidence
from oracle import places as oracle
from tempog.analysis.evidence import places, scorecard, shape
from tempog.methods import EvidenceConfig

QUICK = settings(max_examples=150, deadline=None, derandomize=True)


# Lines, and what they say of two places.


@given(bars(), RESOLUTIONS, SHIFTS)
@QUICK
def test_the_line_through_cells_is_that_of_the_oracle(cells, resolution_m, shift):
    assume(oracle.has_direction(cells))
    got, wanted = (
        shape.fit_line(points_of(cells, resolution_m, shift), resolution_m),
        oracle.fit_line(cells, resolution_m),
    )
    way = got.along @ wanted.along
    assert abs(way) == pytest.approx(1)
    begin_end = (wanted.begin, wanted.end) if way > 0 else (-wanted.end, -wanted.begin)
    assert (got.begin_m, got.end_m) == pytest.approx(begin_end)
    assert got.depth_m == pytest.approx(wanted.depth, abs=1e-7)
    offset = np.array(wanted.middle) + np.array(shift[::-1]) * resolution_m
    np.testing.assert_allclose(got.middle, offset, atol=1e-9)
    assert place_of(cells, resolution_m, shift).size_m == pytest.approx(oracle.size(cells, resolution_m))


@given(bars(), bars(), RESOLUTIONS, SHIFTS)
@QUICK
def test_ends_about_which_a_leaf_may_turn_are_those_of_the_oracle(cells, others, resolution_m, shift):
    line, other = (oracle.fit_line(of, resolution_m) for of in (cells, others))
    assume(oracle.has_direction(cells) and oracle.has_direction(others))
    for end in (line.begin, line.end):  # an end beside the middle of the other line is an end beside neither end
        r = sum((line.middle[k] + end * line.along[k] - other.middle[k]) * other.along[k] for k in (0, 1))
        assume(abs(r - (other.begin + other.end) / 2) > 1e-6)
    limits = (shape.LEAF_DEPTH_M, shape.LEAF_LENGTH_M, shape.HINGE_OFF_M, shape.HINGE_GAP_M, shape.LONGER)
    wanted = oracle.hinges(line, other, *limits, shape.LEAST_TURN_RAD)
    first, second = (shape.fit_line(points_of(of, resolution_m, shift), resolution_m) for of in (cells, others))
    turned = first.along @ line.along < 0
    got = shape.hinges(first, second)
    assert sorted(1 - k for k in got) == list(wanted) if turned else got == wanted


@given(bars(), bars(), RESOLUTIONS, SHIFTS, st.sampled_from([0.3, 0.25, 0.0]))
@QUICK
def test_the_odds_of_being_near_are_those_of_the_oracle_anywhere_on_the_map(
    cells, others, resolution_m, shift, hinge_m
):
    chosen = EvidenceConfig(hinge_m=hinge_m)
    ratio = oracle.size(cells, resolution_m) / oracle.size(others, resolution_m)
    got = shape.near_odds(*(points_of(of, resolution_m, shift) for of in (cells, others)), ratio, chosen)
    assert got == pytest.approx(oracle.near_odds(cells, others, resolution_m, chosen), abs=1e-9)


# Traits.


@st.composite
def corners(draw: st.DrawFn) -> list[list[tuple[int, int]]]:
    """The long side of a box, and a short one that begins at its corner."""
    long, short = draw(st.integers(5, 14)), draw(st.integers(3, 9))
    return [[(0, col) for col in range(long)], [(row, long) for row in range(short)]]


@st.composite
def scenes(draw: st.DrawFn, most: int = 3):
    """Groups of cells close to each other, with what stands around; and courses as smoothed and as measured."""
    groups, taken = [], set()
    for cells in draw(st.one_of(st.lists(bars(), min_size=1, max_size=most), corners())):
        free = [cell for cell in cells if cell not in taken]
        taken.update(free)
        if len(free) > 1:
            groups.append(free)
    assume(groups)
    around = draw(st.sets(st.tuples(st.integers(-8, 8), st.integers(-8, 8)), max_size=12)) - taken
    courses = [*draw(st.lists(series(), min_size=2, max_size=3)), [(0, 300 * LOOK_NS, True)]]
    which = st.sampled_from(range(len(courses)))
    smoothed = {cell: courses[draw(which)] for cell in sorted(around)}
    alike = draw(st.one_of(st.none(), which))
    for cells in groups:
        mostly = draw(which) if alike is None else alike
        smoothed |= {cell: courses[draw(which) if draw(st.integers(0, 9)) == 0 else mostly] for cell in cells}
    stray = draw(st.sets(st.sampled_from(sorted(smoothed)), max_size=5))
    measured = {
        cell: [
            (start, stop, state != (cell in stray and k % 2 == 0)) for k, (start, stop, state) in enumerate(course)
        ]
        for cell, course in smoothed.items()
    }
    return groups, smoothed, measured


@given(scenes(), RESOLUTIONS, SHIFTS, st.data())
@settings(QUICK, max_examples=300)
def test_the_traits_of_a_place_are_those_of_the_oracle(scene, resolution_m, shift, data):
    groups, smoothed, measured = scene
    chosen = EvidenceConfig(
        ring_m=data.draw(st.sampled_from([0.05, 0.1, 0.15])),
        echo_m=data.draw(st.sampled_from([0.1, 0.25])),
        seen_share=data.draw(st.sampled_from([0.0, 0.3, 0.75])),
        long_stay_s=data.draw(st.sampled_from([4.0, 20.0])),
    )
    comes_back = data.draw(st.sets(st.sampled_from(sorted(smoothed)), max_size=4))
    assume(oracle.has_direction(groups[0]))
    states = cell_states_of(smoothed, measured, resolution_m, chosen.worth_s, shift)
    place = places.measure(states, indices(groups[0], smoothed), chosen)
    stays = oracle.stays_of_group([smoothed[cell] for cell in groups[0]], chosen.seen_share, chosen.least_stay_s)
    assert [tuple(stay) for stay in place.stays] == [pytest.approx(tuple(stay)) for stay in stays]
    assume(place.occupied)
    back = np.zeros(len(smoothed), dtype=np.bool_)
    back[indices(comes_back, smoothed)] = True
    evidence_free = {cell: oracle_evidence.state_evidence(smoothed[cell], chosen.worth_s)[0][0] for cell in smoothed}
    wanted = oracle.traits(groups[0], smoothed, measured, evidence_free, comes_back, resolution_m, chosen)
    got = places.traits_of(states, place, back, chosen)
    assert got._asdict() == pytest.approx(wanted, abs=1e-7, rel=1e-9)


@given(st.tuples(*(st.floats(-0.2, 1.2) for _ in scorecard.Traits._fields)))
@QUICK
def test_the_odds_of_a_place_are_those_of_the_oracle(shares):
    tables = scorecard.WEIGHTS
    assert set(tables) == set(scorecard.Traits._fields)
    values = {
        name: tables[name][0][0] + share * (tables[name][0][-1] - tables[name][0][0])
        for name, share in zip(scorecard.Traits._fields, shares, strict=True)
    }
    got = scorecard.place_odds(scorecard.Traits(**values))
    assert got == pytest.approx(oracle.place_odds(values, scorecard.BASE, tables), abs=1e-9)


# Groups that lie along each other.


@given(scenes(most=6), RESOLUTIONS, SHIFTS, st.data())
@settings(QUICK, max_examples=300)
def test_faces_are_joined_as_by_the_oracle_and_in_the_same_order(scene, resolution_m, shift, data):
    groups, smoothed, measured = scene
    chosen = EvidenceConfig(
        worth_s=data.draw(st.sampled_from([0.5, 2.0])),
        fragment_m=data.draw(st.sampled_from([0.2, 0.45])),
        face_m=data.draw(st.sampled_from([0.11, 0.15, 0.2])),
    )
    states = cell_states_of(smoothed, measured, resolution_m, chosen.worth_s, shift)
    pieces = [places.measure(states, indices(cells, smoothed), chosen) for cells in groups]
    joined = places.join_faces(states, pieces, chosen)
    shares = places.FACE, places.SAME_PLACE, places.FRAGMENT
    wanted = oracle.join_faces(groups, smoothed, resolution_m, chosen, *shares)
    assert [place.cells.tolist() for place in joined] == [indices(cells, smoothed).tolist() for cells in wanted]
    for place, cells in zip(joined, wanted, strict=True):
        course = oracle_evidence.course_of_group([smoothed[cell] for cell in cells], chosen.seen_share)
        assert [[p.start_ns, p.stop_ns, p.state == "occupied"] for p in place.periods] == course


@given(st.lists(bars(), min_size=1, max_size=6), RESOLUTIONS, SHIFTS, st.data())
@settings(QUICK, max_examples=300)
def test_of_places_along_each_other_the_oracle_keeps_the_same(groups, resolution_m, shift, data):
    groups = sorted(groups)
    assume(len({min(cells) for cells in groups}) == len(groups))
    log_odds = data.draw(st.lists(st.sampled_from([0.0, 1.0, 2.0]), min_size=len(groups), max_size=len(groups)))
    face_m = data.draw(st.sampled_from([0.11, 0.15]))
    every = [
        place_of(cells, resolution_m, shift, odds, 100 * k)
        for k, (cells, odds) in enumerate(zip(groups, log_odds, strict=True))
    ]
    kept = places.without_doubles(every, face_m)
    wanted = oracle.without_doubles(groups, log_odds, resolution_m, face_m, places.SAME_PLACE)
    assert [int(place.cells[0]) // 100 for place in kept] == wanted
