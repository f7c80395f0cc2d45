"""What could be seen, by the kernel and by the oracle: the same, whatever the beams did."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import event, given, settings
from hypothesis import strategies as st

from oracle.observability import crosses, seen_place
from tempog.simulation import Hit
from tempog.simulation.crossing import count_crossings
from tempog.simulation.observability import seen_places
from tempog.simulation.truth import ThingTruth, Truth, WallTruth


@st.composite
def truths(draw):
    """A laser that stands among boxes, which are now here, now there; most beams end on them or pass them."""
    n_scans, n_beams = draw(st.integers(1, 12)), draw(st.integers(6, 24))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    things = []
    for k in range(draw(st.integers(1, 2))):
        places = {}
        for p in range(draw(st.integers(1, 3))):
            corner = np.array([1.013 + 0.41 * p, 0.37 * k + 0.21 * p - 0.3])
            turn = rng.uniform(0, math.pi)
            along = np.array([math.cos(turn), math.sin(turn)]) * rng.uniform(0.1, 0.6)
            across = np.array([-math.sin(turn), math.cos(turn)]) * rng.uniform(0.02, 0.3)
            places[f"p{p}"] = corner + np.array([(0.0, 0.0), along, along + across, across])
        things.append(ThingTruth(f"T{k}", "box", places))
    steps = [rng.integers(-1, len(thing.places), n_scans) for thing in things]
    stay = rng.random((n_scans, len(things))) < 0.6
    at = np.column_stack(steps)
    for i in range(1, n_scans):
        at[i, stay[i]] = at[i - 1, stay[i]]
    angles = np.sort(rng.uniform(-0.5, 0.5, n_beams))
    poses = np.column_stack([rng.uniform(-0.2, 0.2, (n_scans, 2)), rng.uniform(-0.3, 0.3, n_scans)])
    moved = rng.uniform(-0.05, 0.05, (n_scans, 3)) * draw(st.booleans())
    sweep_ends = poses + moved
    distances = rng.uniform(1.2, 3.0, (n_scans, n_beams))
    distances[rng.random(distances.shape) < 0.2] = np.inf
    hit_things = np.full(distances.shape, -1, dtype=np.int16)
    for i in range(n_scans):
        for j in range(n_beams):
            start = poses[i] + moved[i] * j / (n_beams - 1)
            direction = start[2] + angles[j]
            for k, thing in enumerate(things):
                if at[i, k] >= 0:
                    reach = along_beam(start[:2], direction, list(thing.places.values())[at[i, k]])
                    if reach < min(distances[i, j], 3.0):
                        distances[i, j], hit_things[i, j] = reach, k
    return Truth(
        world="",
        start_s=0.0,
        walls=(WallTruth(np.array([(5.0, 0.0), (6.0, 0.0), (6.0, 1.0)])),),
        things=tuple(things),
        angles=angles,
        max_range_m=3.0,
        person_radius_m=0.25,
        t=np.arange(n_scans) * 0.1,
        poses=poses,
        sweep_ends=sweep_ends,
        distances=distances,
        hits=np.where(hit_things >= 0, Hit.BOX, Hit.NOTHING).astype(np.uint8),
        hit_things=hit_things,
        places=at.astype(np.int16),
        corners=np.full((n_scans, len(things), 4, 2), np.nan),
        people=np.empty((n_scans, 0, 2)),
    )


def along_beam(start, direction, corners):
    """How far a polygon is along a beam; inf if the beam misses it."""
    way = np.array([math.cos(direction), math.sin(direction)])
    nearest = math.inf
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        matrix = np.column_stack([way, p - q])
        if abs(np.linalg.det(matrix)) > 1e-9:
            reach, u = np.linalg.solve(matrix, p - start)
            if reach > 0 and 0 <= u <= 1:
                nearest = min(nearest, float(reach))
    return nearest


@settings(max_examples=150, deadline=None)
@given(truths(), st.sampled_from([0.05, 0.1, 0.23]))
def test_what_could_be_seen_is_what_the_oracle_says(truth, resolution):
    found = seen_places(truth, resolution)
    assert [(one.thing, one.place) for one in found] == [
        (k, p) for k, thing in enumerate(truth.things) for p in range(len(thing.places))
    ]
    for one in found:
        seen, n_occupied, n_free, observable = seen_place(truth, one.thing, one.place, resolution)
        assert {tuple(cell) for cell in one.seen.tolist()} == seen
        assert (one.n_occupied, one.n_free, one.observable) == (n_occupied, n_free, observable)
        event(f"observable: {observable}, occupied {min(n_occupied, 2)}, free {min(n_free, 2)}")


@settings(max_examples=60, deadline=None)
@given(truths(), st.sampled_from([0.05, 0.1, 0.23]))
def test_a_beam_crosses_the_cells_that_the_oracle_says(truth, resolution):
    rows, cols = np.mgrid[-3:4, 7:13]
    cells = np.column_stack([rows.ravel(), cols.ravel()])
    x, y, angle = truth.beams()
    reach = np.where(np.isfinite(truth.distances), truth.distances, 0.0)
    n_scans = len(truth.t)
    crossed, n_beams = np.zeros((n_scans, len(cells)), dtype=bool), np.zeros(n_scans, dtype=np.int64)
    low = cells[:, ::-1] * resolution
    middle = (low.min(axis=0) + low.max(axis=0) + resolution) / 2
    radius = float(np.hypot(*(low.max(axis=0) + resolution - middle))) * 1.001
    args = (x, y, np.cos(angle), np.sin(angle), reach, np.arange(n_scans), low, resolution, middle, radius)
    count_crossings(*args, crossed, n_beams)
    for i in range(n_scans):
        by_beam = [
            {k for k, cell in enumerate(cells.tolist()) if crosses(truth, i, j, cell, resolution)}
            for j in range(len(truth.angles))
        ]
        assert set(np.flatnonzero(crossed[i]).tolist()) == set().union(*by_beam)
        assert n_beams[i] == sum(map(bool, by_beam))
