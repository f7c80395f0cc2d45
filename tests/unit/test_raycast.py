"""The ray caster against a slow and obvious version, and the cells that polygons cover."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from slow_beams import slow_distances
from tempog.errors import ConfigError
from tempog.simulation import Wall
from tempog.simulation.polygons import covered_cells, outline
from tempog.simulation.raycast import NOTHING, cast_beams

EXACT_M = 1e-9


def cast(x, y, angles, segments, discs, max_range=math.inf):
    distance = np.full(len(angles), np.nan)
    hit = np.full(len(angles), -99, dtype=np.int32)
    segments = np.asarray(segments, dtype=np.float64).reshape(-1, 4)
    discs = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
    x, y = np.broadcast_to(float(x), len(angles)).copy(), np.broadcast_to(float(y), len(angles)).copy()
    glass = np.zeros((0, len(angles)), dtype=np.uint8)
    cast_beams(x, y, np.asarray(angles, dtype=np.float64), segments, discs, glass, float(max_range), distance, hit)
    return distance, hit


# Corners on a coarse lattice, beams from beside it at odd angles: no beam grazes a corner so closely that
# rounding decides, so every disagreement is an error.
lattice = st.integers(-20, 20).map(lambda i: i / 4)
points = st.tuples(lattice, lattice)
segment_lists = st.lists(
    st.tuples(points, points).filter(lambda ends: ends[0] != ends[1]).map(lambda ends: (*ends[0], *ends[1])),
    max_size=12,
)
disc_lists = st.lists(st.tuples(lattice, lattice, st.sampled_from([0.25, 0.4, 1.5])), max_size=5)
odd_angles = st.lists(st.integers(-183, 183).map(lambda i: 0.0171 * i + 0.00519), min_size=1, max_size=8)


@settings(deadline=None, max_examples=300)
@given(points, odd_angles, segment_lists, disc_lists, st.sampled_from([math.inf, 8.0, 3.0]))
@example((0.0, 0.0), [0.00519], [(1.0, -1.0, 1.0, 1.0), (1.0, -1.0, 1.0, 1.0)], [], math.inf)  # a tie
@example((0.0, 0.0), [0.00519], [], [(0.0, 0.0, 1.5)], math.inf)  # inside a disc
def test_beams_reach_as_far_as_the_equations_say(point, angles, segments, discs, max_range):
    x, y = point[0] + 0.01237, point[1] + 0.03713
    distance, hit = cast(x, y, angles, segments, discs, max_range)
    for k, angle in enumerate(angles):
        expected = slow_distances(x, y, angle, segments, discs)
        nearest = expected.min(initial=math.inf)
        if nearest >= max_range:
            assert distance[k] == math.inf
            assert hit[k] == NOTHING
        else:
            assert abs(distance[k] - nearest) <= EXACT_M
            assert hit[k] in np.flatnonzero(expected <= nearest + EXACT_M)


@settings(deadline=None)
@given(st.integers(3, 9), points, st.floats(0.1, 50.0), st.floats(-math.pi, math.pi))
def test_no_beam_leaks_through_a_corner(n_corners, centre, radius, turn):
    corner_angles = turn + 2 * math.pi * np.arange(n_corners) / n_corners
    corners = np.array(centre) + radius * np.column_stack([np.cos(corner_angles), np.sin(corner_angles)])
    angles = np.arctan2(corners[:, 1] - centre[1], corners[:, 0] - centre[0])  # straight at the corners
    for nudged in (angles, np.nextafter(angles, 9.0), np.nextafter(angles, -9.0)):
        distance, _ = cast(*centre, nudged, outline(corners), [])
        np.testing.assert_allclose(distance, radius, rtol=1e-9)


def test_a_segment_seen_edge_on_is_hit_at_its_nearer_end():
    distance, hit = cast(0.0, 0.0, [0.0], [(5.0, 0.0, 3.0, 0.0)], [])
    assert (distance[0], hit[0]) == (3.0, 0)


def test_of_two_things_at_one_distance_the_lower_id_is_hit():
    wall = (2.0, -1.0, 2.0, 1.0)
    _, hit = cast(0.0, 0.0, [0.0], [(5.0, -1.0, 5.0, 1.0), wall, wall], [(3.0, 0.0, 1.0)])
    assert hit[0] == 1


def test_what_lies_behind_or_at_the_maximum_range_is_not_seen():
    behind, at_max_range = (-1.0, -1.0, -1.0, 1.0), (4.0, -1.0, 4.0, 1.0)
    distance, hit = cast(0.0, 0.0, [0.0], [behind, at_max_range], [(-3.0, 0.0, 0.5)], max_range=4.0)
    assert (distance[0], hit[0]) == (math.inf, NOTHING)


def test_a_disc_that_begins_within_the_maximum_range_is_seen():
    distance, hit = cast(0.0, 0.0, [0.0], [], [(4.2, 0.0, 0.5)], max_range=4.0)
    assert distance[0] == pytest.approx(3.7)
    assert hit[0] == 0


def test_what_is_nowhere_is_not_hit():
    nowhere = [math.nan] * 4
    for max_range in (5.0, math.inf):
        _, hit = cast(0.0, 0.0, [0.0], [nowhere, (9.0, -1.0, 9.0, 1.0)], [(math.nan, math.nan, 0.5)], max_range)
        assert hit[0] == (NOTHING if max_range == 5.0 else 1)


# --- cells ---


def test_cells_of_a_slanted_leaf_are_those_it_reaches_into():
    covered = {tuple(cell) for cell in covered_cells([(0.05, 0.0), (1.05, 1.0), (1.0, 1.05), (0.0, 0.05)], 0.2)}
    inside = set()  # points of the leaf, densely
    for along in np.linspace(0.001, 0.999, 400):
        for across in np.linspace(0.001, 0.999, 40):
            x, y = 0.05 * (1 - across) + along, 0.05 * across + along
            inside.add((math.floor(y / 0.2), math.floor(x / 0.2)))
    assert covered == inside


def test_a_wall_that_ends_at_the_edge_of_a_cell_does_not_cover_the_next():
    corners = Wall.box(0.3, -0.1, 0.6, 0.1).corners
    assert covered_cells(corners, 0.1).tolist() == [[-1, 3], [-1, 4], [-1, 5], [0, 3], [0, 4], [0, 5]]


def test_cells_of_no_size_are_refused():
    with pytest.raises(ConfigError, match="wanted metres above 0"):
        covered_cells([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], 0.0)
