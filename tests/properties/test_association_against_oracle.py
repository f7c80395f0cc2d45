"""Sets of places, glass and hidden leaves of the method ``evidence`` are what slow, obvious Python makes of them."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lattice_groups import LOOK_NS, RESOLUTIONS, SHIFTS, bars, cell_states_of, indices, place_of
from oracle import association as oracle
from oracle import evidence as oracle_evidence
from oracle import places as oracle_places
from tempog.analysis.configurations import Period
from tempog.analysis.evidence import association, find, hidden, kernels, places, shape, views
from tempog.analysis.evidence.association import ChosenSet
from tempog.analysis.evidence.courses import Courses
from tempog.methods import EvidenceConfig

QUICK = settings(max_examples=100, deadline=None, derandomize=True)
SLOT_NS = 4_000_000_000
LEAVES = (shape.LEAF_DEPTH_M, shape.LEAF_LENGTH_M, shape.HINGE_OFF_M, shape.HINGE_GAP_M, shape.LONGER)


def periods(course):
    return tuple(Period(since, until, "occupied" if state else "free") for since, until, state in course)


# Which places are of one thing.


@st.composite
def fans(draw: st.DrawFn) -> list[list[tuple[int, int]]]:
    """Leaves at one hinge, of some of which only the far part is seen."""
    begins = st.lists(st.sampled_from([1, 2, 7]), min_size=5, max_size=5)
    turns = draw(st.lists(st.sampled_from([0, 50, 90, 130, 180]), min_size=3, max_size=5, unique=True))
    way = draw(st.sampled_from([1, -1]))  # lines begin at the hinge, or end there
    groups = []
    for begin, turn in zip(draw(begins), turns, strict=False):
        up, right = way * math.sin(math.radians(turn)), way * math.cos(math.radians(turn))
        groups.append(sorted({(round(r * up), round(r * right)) for r in range(begin, 14)}))
    return groups


@st.composite
def things(draw: st.DrawFn):
    """Groups of cells and their courses: most follow one or two things that are in one of them at a time."""
    anywhere = st.lists(bars().filter(oracle_places.has_direction), min_size=2, max_size=5)
    groups = draw(st.one_of(anywhere, fans()))
    n_slots = draw(st.integers(4, 9))
    slots = st.lists(st.integers(0, len(groups) - 1), min_size=n_slots, max_size=n_slots)
    where = draw(slots), draw(slots)
    courses = []
    for k in range(len(groups)):
        thing = where[draw(st.sampled_from([0, 0, 0, 1]))]
        unseen = draw(st.sets(st.integers(0, n_slots - 1), max_size=2))
        wrong = draw(st.sampled_from([None, None, None, *range(n_slots)]))
        courses.append(
            [
                (SLOT_NS * slot, SLOT_NS * (slot + 1), (thing[slot] == k) != (slot == wrong))
                for slot in range(n_slots)
                if slot not in unseen
            ]
        )
    return groups, courses


def shapes_of(groups, resolution_m, chosen):
    """``{pair: log odds}`` and ``{(place, end): others}`` by the oracle."""
    by_shape, around_hinge = {}, {}
    lines = [oracle_places.fit_line(cells, resolution_m) for cells in groups]
    for i, j in itertools.combinations(range(len(groups)), 2):
        n_hinges = 0
        for a, b in ((i, j), (j, i)):
            for end in oracle_places.hinges(lines[a], lines[b], *LEAVES, shape.LEAST_TURN_RAD):
                around_hinge.setdefault((a, end), set()).add(b)
                n_hinges += 1
        near = oracle_places.near_odds(groups[i], groups[j], resolution_m, chosen)
        by_shape[i, j] = chosen.hinge_bonus if n_hinges else near
    return by_shape, around_hinge


def no_end_is_at_a_middle(groups, resolution_m):
    """An end of one line beside the very middle of another is as far from its one end as from its other."""
    lines = [oracle_places.fit_line(cells, resolution_m) for cells in groups]
    for line, other in itertools.permutations(lines, 2):
        for end in (line.begin, line.end):
            r = sum((line.middle[k] + end * line.along[k] - other.middle[k]) * other.along[k] for k in (0, 1))
            if abs(r - (other.begin + other.end) / 2) < 1e-6:
                return False
    return True


@given(things(), RESOLUTIONS, SHIFTS, st.data())
@settings(QUICK, max_examples=300)
def test_the_sets_chosen_are_the_best_of_all_that_the_oracle_finds(scene, resolution_m, shift, data):
    groups, courses = scene
    assume(no_end_is_at_a_middle(groups, resolution_m))
    chosen = EvidenceConfig(
        within_m=data.draw(st.sampled_from([0.413, 4.0])),
        max_states=data.draw(st.sampled_from([2, 3, 5])),
        hinge_bonus=data.draw(st.sampled_from([0.5, 3.0])),
        link_above=data.draw(st.sampled_from([0.0, 2.0])),
        max_conflict=data.draw(st.sampled_from([0.1, 0.5])),
        conflict_share=data.draw(st.sampled_from([0.3, 0.8])),
    )
    log_odds = data.draw(st.lists(st.sampled_from([-0.8, 0.1, 3.0]), min_size=len(groups), max_size=len(groups)))
    every = [
        replace(place_of(cells, resolution_m, shift, odds), course=places.as_arrays(periods(course)))
        for cells, course, odds in zip(groups, courses, log_odds, strict=True)
    ]
    centres = [tuple(resolution_m * x for x in oracle_places.mean_point(cells)) for cells in groups]
    doubts = [max(0.0, chosen.place_above - odds) for odds in log_odds]
    shapes = shapes_of(groups, resolution_m, chosen)
    limits = association.ELSEWHERE, association.TWICE
    wanted = oracle.sets_of_places(courses, doubts, centres, *shapes, chosen, *limits)
    got = association.associate_places(every, chosen)
    assert {one.members: one.log_odds for one in got} == pytest.approx(
        {one.members: wanted.get(one.members) for one in got}, abs=1e-9
    )
    members = [i for one in got for i in one.members]
    assert len(members) == len(set(members))
    best = {one: odds for one, odds in wanted.items() if odds > 0}
    assert sum(one.log_odds for one in got) == pytest.approx(oracle.best_sum(best), abs=1e-9)


@given(st.lists(st.sampled_from([-0.5, 0.2, 0.21, 4.0]), max_size=9), st.data())
@QUICK
def test_the_places_that_nothing_speaks_for_are_left_out_as_by_the_oracle(log_odds, data):
    shuffled = data.draw(st.permutations(range(len(log_odds))))
    ends = sorted(data.draw(st.sets(st.integers(2, max(2, len(log_odds))), max_size=3)))
    parts = [tuple(sorted(shuffled[a:b])) for a, b in itertools.pairwise([0, *ends])]
    rivals = st.sets(st.sampled_from(range(len(log_odds)))) if log_odds else st.just(set())
    sets = [ChosenSet(part, 1.0, 0.5, tuple(sorted(data.draw(rivals)))) for part in parts if len(part) > 1]
    n_changes = data.draw(st.lists(st.integers(0, 3), min_size=len(log_odds), max_size=len(log_odds)))
    stays = [tuple(places.Stay(k % 2 == 0, k, k + 1, 1.0, 1.0) for k in range(n + 1)) for n in n_changes]
    every = [
        replace(place_of([(k, 0), (k, 1)], 0.05, log_odds=odds), stays=stays[k]) for k, odds in enumerate(log_odds)
    ]
    chosen = EvidenceConfig()
    kept, renumbered = find.without_doubtful(every, sets, chosen)
    linked = [(one.members, one.rivals) for one in sets]
    stay, wanted = oracle.without_doubtful(log_odds, n_changes, linked, chosen.place_above, chosen.once_doubt)
    assert kept == [every[i] for i in stay]
    assert [(list(one.members), list(one.rivals)) for one in renumbered] == wanted
    assert all((one.log_odds, one.margin) == (1.0, 0.5) for one in renumbered)


# Glass.


@st.composite
def drives(draw: st.DrawFn):
    """Stamps and poses of scans about a cell, and when it was seen in which state: by direction, or as it comes."""
    stamps, poses, series = [], [], []
    t = 0
    for _ in range(draw(st.integers(1, 14))):
        direction = draw(st.sampled_from([20.0, 23.0, 100.0, 200.0, 290.0, 345.0]))
        state = draw(st.booleans()) if draw(st.integers(0, 4)) == 0 else direction < 150
        n_scans = draw(st.integers(1, 12))
        turn = draw(st.sampled_from([0.0, 2.9]))
        seen = draw(st.integers(0, 5)) > 0
        begin = t
        for k in range(n_scans):
            angle = math.radians(direction + turn * k)
            stamps.append(t)
            poses.append((1.3 + 2 * math.cos(angle), 0.7 + 2 * math.sin(angle), 0.0))
            t += LOOK_NS
        if seen:
            series.append((begin, t, state))
        t += draw(st.sampled_from([0, 0, 49, 50, 51, 90])) * LOOK_NS
    return stamps, poses, series


@given(drives(), st.sampled_from([-1.0, 0.0, 1.0, 3.0]))
@settings(QUICK, max_examples=200)
def test_what_is_explained_by_the_view_is_what_the_oracle_says(drive, view_above):
    stamps, poses, series = drive
    assume(series)
    start, stop = (np.array([period[k] for period in series], dtype=np.int64) for k in (0, 1))
    state = np.array([period[2] for period in series], dtype=np.uint8)
    courses = Courses(np.array([0, len(series)]), start, stop, state, 1 - state)
    scans = views.Scans(np.array(stamps), np.array(poses), LOOK_NS)
    which, point = np.zeros(1, dtype=np.int64), np.array([[1.3, 0.7]])
    chosen = EvidenceConfig(view_above=max(view_above, 0.0))

    visits = np.zeros((1, views.N_DIRECTIONS, 2), dtype=np.int64)
    steps = np.zeros((1, 2, 2), dtype=np.int64)
    pause = round(views.SAME_PASS_S * 1e9) + LOOK_NS
    kernels.count_views(*courses.measured, which, point, *scans, 3, pause, visits, steps)
    wanted = oracle.visits_of(series, point[0], stamps, poses, LOOK_NS, 3, pause, views.N_DIRECTIONS)
    counted = np.zeros_like(visits)
    for direction, occupied in wanted:
        counted[0, direction, int(occupied)] += 1
    np.testing.assert_array_equal(visits, counted)
    advantage = oracle.advantage_of_view(wanted)
    assume(abs(advantage - chosen.view_above) > 1e-9)
    seconds = oracle_evidence.seconds_during(series, [(0, stop[-1])])
    explained = min(seconds) >= chosen.least_stay_s and advantage > chosen.view_above
    assert views.explained_by_view(courses, which, point, scans, chosen).tolist() == [explained]


# Hidden leaves.


@st.composite
def doors(draw: st.DrawFn):
    """A closed door, and what is seen only while it is open; a wall seen always; courses by cell."""
    resolution_m = draw(RESOLUTIONS)
    length, upright = draw(st.integers(6, 14) if resolution_m == 0.1 else st.integers(11, 20)), draw(st.booleans())
    thick = draw(st.sampled_from([1, 1, 2]))
    turn = math.radians(draw(st.sampled_from([90, 90, -90, 45, 60])))
    begin, end = (
        draw(st.integers(0, 3)),
        draw(st.sampled_from([length - 3, length, length + 1, length + 2, length + 8])),
    )
    width = draw(st.sampled_from([1, 1, 2]))
    door = {(off, k) for k in range(length) for off in range(thick)}
    leaf = {
        (round(r * math.sin(turn)), round(r * math.cos(turn)) + off)
        for r in range(begin, max(end, begin + 2))
        for off in range(width)
    }
    gone = draw(st.sets(st.sampled_from(sorted(leaf)), max_size=3))
    stray = draw(st.sets(st.tuples(st.integers(-20, 20), st.integers(-4, 22)), max_size=2))
    states = draw(st.lists(st.booleans(), min_size=2, max_size=6))
    course = [(SLOT_NS * k, SLOT_NS * (k + 1), state) for k, state in enumerate(states)]
    while_open = [(since, until, True) for since, until, state in course if not state]
    assume(any(states) and while_open)
    smoothed = {cell: [(0, SLOT_NS * len(states), True)] for cell in stray}
    smoothed |= dict.fromkeys(leaf - gone, while_open)
    smoothed |= dict.fromkeys(door, course)
    if upright:
        smoothed = {(col, row): one for (row, col), one in smoothed.items()}
        door = {(col, row) for row, col in door}
    return sorted(door), smoothed, resolution_m


@given(doors(), SHIFTS)
@settings(QUICK, max_examples=300)
def test_the_leaf_behind_a_door_is_one_of_the_best_that_the_oracle_finds(scene, shift):
    door, smoothed, resolution_m = scene
    chosen = EvidenceConfig()
    states = cell_states_of(smoothed, smoothed, resolution_m, chosen.worth_s, shift)
    place = places.measure(states, indices(door, smoothed), chosen)
    assume(oracle_places.has_direction(door))
    course = oracle_evidence.course_of_group([smoothed[cell] for cell in door], chosen.seen_share)
    others = oracle.behind(door, course, smoothed, resolution_m, chosen, hidden.SEEN_WHILE_CLOSED)
    assert hidden._behind(states, place, chosen).tolist() == indices(others, smoothed).tolist()
    leaves = oracle.leaves_behind(door, others, resolution_m, hidden)
    length_m, depth_m = oracle_places.size(door, resolution_m), oracle_places.fit_line(door, resolution_m).depth
    is_door = hidden.LEAF_M[0] <= length_m <= hidden.LEAF_M[1] and depth_m <= hidden.STRAIGHT_M
    best = max(score for score, _ in leaves) if leaves and is_door else 0.0
    wanted = [indices(cells, smoothed).tolist() for score, cells in leaves if is_door and score >= best - 1e-9]
    got = [one.place.cells.tolist() for one in hidden.hidden_places(states, [place], [0], chosen)]
    assert bool(got) == bool(wanted)
    assert all(cells in wanted for cells in got)
