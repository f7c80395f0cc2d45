"""What shape says of two places: hinges, and how they count for sets of places."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest

from tempog.analysis.configurations import Period
from tempog.analysis.evidence.association import Links, associate_places
from tempog.analysis.evidence.places import Place, as_arrays, without_doubles
from tempog.analysis.evidence.scorecard import WEIGHTS, Traits, place_odds
from tempog.analysis.evidence.shape import fit_line, hinges
from tempog.methods import EvidenceConfig

CELL_M = 0.05
SETTINGS = EvidenceConfig()
S = 10**9


def leaf(angle_deg: float, begin_m: float = 0.0, end_m: float = 0.9, hinge=(0.0, 0.0)) -> np.ndarray:
    """Centres of the cells of a leaf at a hinge, seen from one distance from it to another."""
    r = np.arange(begin_m + CELL_M / 2, end_m, CELL_M)
    angle = math.radians(angle_deg)
    points = np.stack([hinge[0] + r * math.cos(angle), hinge[1] + r * math.sin(angle)], axis=-1)
    return (np.floor(points / CELL_M) + 0.5) * CELL_M


def line(points):
    return fit_line(points, CELL_M)


def place(points, courses="", log_odds: float = 5.0) -> Place:
    """A place that is occupied (o), free (f) or not seen (.) for 20 s at a time."""
    states = {"o": "occupied", "f": "free"}
    periods = [Period(20 * k * S, 20 * (k + 1) * S, states[state]) for k, state in enumerate(courses) if state != "."]
    return Place(np.arange(len(points)), points, as_arrays(periods), (), CELL_M, log_odds)


@pytest.mark.parametrize("angle_deg", [45, 70, 90, 110, 160, -90])
@pytest.mark.parametrize("turned_deg", [0, 33, 90])
def test_a_leaf_turns_about_one_end_of_where_it_was(angle_deg, turned_deg):
    closed, opened = (line(leaf(turned_deg + angle)) for angle in (0, angle_deg))
    (k,) = hinges(closed, opened)
    assert np.hypot(*closed.ends[k]) < 0.1
    assert len(hinges(opened, closed)) == 1


def test_a_leaf_whose_half_at_the_hinge_is_hidden_still_turns_about_it():
    assert len(hinges(line(leaf(0)), line(leaf(90, begin_m=0.45)))) == 1


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (leaf(5), "along it: a leaf does not turn by 5 degrees and stay"),
        (leaf(90, hinge=(0.45, 0.0)), "begins at its middle"),
        (leaf(90, hinge=(-0.4, 0.0)), "begins beside it"),
        (leaf(90, begin_m=0.9, end_m=1.8), "is as long as a leaf, but begins a leaf away"),
        (leaf(90, end_m=3.0), "is no leaf"),
        (np.vstack([leaf(90), leaf(90, hinge=(0.4, 0.0))]), "is as deep as a box"),
    ],
)
def test_what_does_not_begin_at_an_end_does_not_turn_about_it(points, why):
    assert hinges(line(leaf(0)), line(points)) == (), why


def test_three_places_share_a_hinge_though_two_of_them_are_seen_in_part_and_far_from_each_other():
    places = [place(points) for points in (leaf(180), leaf(90, 0.3, 0.9), leaf(20, 0.5, 0.95))]
    links = Links(dict.fromkeys(combinations(range(3), 2), 0.0), {}, {})
    for i, j in combinations(range(3), 2):
        links.add_shape(i, j, places, SETTINGS)
    assert links.log_odds((0, 1, 2), SETTINGS) == pytest.approx(2 * SETTINGS.hinge_bonus)


def test_the_places_of_two_doors_that_are_never_seen_together_are_no_thing_of_four():
    first, second = ((leaf(a), leaf(a + 90)) for a in (0, 0))
    second = tuple(points + np.array([0.0, 2.0]) for points in second)
    courses = ("of..of..", "fo..fo..", "..of..of", "..fo..fo")
    places = [place(points, course) for points, course in zip((*first, *second), courses, strict=True)]
    assert [one.members for one in associate_places(places, SETTINGS)] == [(0, 1), (2, 3)]


def test_a_doubtful_place_needs_a_link_that_outweighs_the_doubt():
    closed, opened = ("ofof", "fofo")
    for log_odds, n_sets in ((5.0, 1), (-2.0, 1), (-20.0, 0)):
        places = [place(leaf(0), closed), place(leaf(90), opened, log_odds)]
        assert len(associate_places(places, SETTINGS)) == n_sets


def test_people_in_the_doorway_now_and_then_do_not_part_a_leaf_from_itself_but_two_leaves_are_two():
    often = "of" * 10
    busy = place(leaf(90), "fo" * 9 + "oo")
    assert len(associate_places([place(leaf(0), often), busy], SETTINGS)) == 1
    in_step = place(leaf(90), often)
    assert associate_places([place(leaf(0), often), in_step], SETTINGS) == []


def test_of_one_place_that_drifting_poses_show_in_two_the_likelier_is_kept():
    seen = [
        place(leaf(0), log_odds=4.0),
        place(leaf(0) + np.array([0.0, 0.1]), log_odds=3.0),
        place(leaf(90), log_odds=1.0),
    ]
    assert without_doubles(seen, SETTINGS.face_m) == [seen[0], seen[2]]


def test_each_trait_has_its_say_and_a_door_is_a_place_while_people_and_displaced_walls_are_none():
    assert set(WEIGHTS) == set(Traits._fields)
    door = Traits(0.6, 10.0, 0.0, 0.0, 1.0, n_occupied=4, n_long=2, depth_m=0.01, size_m=1.0)
    assert place_odds(door) > 4
    assert place_odds(door._replace(duty=0.02, leak=1.0, together=0.9, depth_m=0.06, n_long=0)) < -4  # somebody
    assert place_odds(door._replace(duty=0.9, echo=1.0, n_occupied=1)) < 0  # a wall, displaced
    for name, (knots, weights) in WEIGHTS.items():
        assert list(knots) == sorted(set(knots)), name
        assert len(knots) == len(weights), name
