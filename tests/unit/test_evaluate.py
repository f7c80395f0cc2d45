"""The judge: the truth scores 1, a small world what was worked out by hand, and damage costs what it should."""

import copy
import json
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise, permutations

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tempog.analysis.objects_schema import SAYS_NOTHING, UNDERSTOOD, check_objects, read_objects, schema
from tempog.errors import AnswerError, EmptyWindowError
from tempog.evaluation import Share, evaluate, truth_document
from tempog.evaluation.matching import MATCH_IOU, match, tolerant_iou
from tempog.simulation import Hit, load_world, simulate
from tempog.simulation.observability import seen_places
from tempog.simulation.truth import ThingTruth, Truth, WallTruth

# A world small enough to count in. Cells are 0.1 m. The laser is at x = 0 and has one beam, along x; in a pass
# it is in the middle of each row once. A wall fills columns 20 and 21 of rows 0 to 9. The door D stands in
# column 10, rows 0 to 4 ("a"), or in column 15, rows 5 to 9 ("b"). The box C stands in column 12, rows 10 to
# 14, and never moves.

CELL_M = 0.1
A, B, C = ([(row, col) for row in range(low, low + 5)] for low, col in ((0, 10), (5, 15), (10, 12)))
ROWS = 15


def rectangle(row, col, n_rows, n_cols):
    x, y = np.round([col * CELL_M, row * CELL_M], 9)
    return np.array([(x, y), (x + 0.1 * n_cols, y), (x + 0.1 * n_cols, y + 0.1 * n_rows), (x, y + 0.1 * n_rows)])


def small_world(door=(0, -1, 1), people=()):
    """A pass over all rows for each state of the door (0 "a", 1 "b", -1 on its way, in columns 12 and 13, row 7).

    people: (pass, row, column) of somebody whose skin is in that cell; the middle is 0.25 m further on.
    """
    n_scans = ROWS * len(door)
    t = np.arange(n_scans) * 0.1
    row = np.arange(n_scans) % ROWS
    state = np.repeat(door, ROWS).astype(np.int16)
    distance = np.where(row < 10, 2.0, 1.2)
    hits = np.where(row < 10, Hit.WALL, Hit.BOX).astype(np.uint8)
    things = np.where(row < 10, -1, 1).astype(np.int16)
    for is_door, reach in (
        ((state == 0) & (row < 5), 1.0),
        ((state == 1) & (row >= 5) & (row < 10), 1.5),
        ((state == -1) & (row == 7), 1.2),
    ):
        distance[is_door], hits[is_door], things[is_door] = reach, Hit.DOOR, 0
    everybody = np.full((n_scans, len(people), 2), np.nan)
    for k, (number, at_row, col) in enumerate(people):
        scan = number * ROWS + at_row
        distance[scan], hits[scan], things[scan] = col * CELL_M + 0.05, Hit.PERSON, -1
        everybody[number * ROWS : (number + 1) * ROWS, k] = col * CELL_M + 0.3, at_row * CELL_M + 0.05
    leaf = {0: rectangle(0, 10, 5, 1), 1: rectangle(5, 15, 5, 1), -1: rectangle(7, 12, 1, 2)}
    box = rectangle(10, 12, 5, 1)
    poses = np.column_stack([0 * t, (row + 0.5) * CELL_M, 0 * t])
    return Truth(
        world="small",
        start_s=1000.0,
        walls=(WallTruth(rectangle(0, 20, 10, 2)),),
        things=(ThingTruth("D", "hinged", {"a": leaf[0], "b": leaf[1]}), ThingTruth("C", "box", {"c": box})),
        angles=np.zeros(1),
        max_range_m=8.0,
        person_radius_m=0.25,
        t=t,
        poses=poses,
        sweep_ends=poses,
        distances=distance[:, None],
        hits=hits[:, None],
        hit_things=things[:, None],
        places=np.column_stack([state, 0 * state]),
        corners=np.array([[leaf[at], box] for at in state.tolist()]),
        people=everybody,
    )


def points(cells):
    return [[(col + 0.5) * CELL_M, (row + 0.5) * CELL_M] for row, col in cells]


def configuration(number, cells):
    return {"id": number, "cells": points(cells), "periods": [], "confidence": None, "hypothesis": False}


def answer(truth, static=(), objects=(), unassociated=(), high_dynamic=()):
    """objects: lists of (id, cells); unassociated: (id, cells); high_dynamic: (scan, cells)."""
    return {
        "format": "tempog-objects",
        "version": 1,
        "method": "paper",
        "settings": {},
        "resolution_m": CELL_M,
        "start_s": float(truth.stamps_s[0]),
        "stop_s": float(truth.stamps_s[-1]),
        "static": points(static),
        "objects": [
            {"id": k + 1, "confidence": None, "configurations": [configuration(*c) for c in one], "timeline": []}
            for k, one in enumerate(objects)
        ],
        "unassociated": [configuration(*one) for one in unassociated],
        "high_dynamic": [{"t": float(truth.stamps_s[scan]), "cells": points(cells)} for scan, cells in high_dynamic],
    }


def test_the_small_world_is_seen_as_it_was_meant():
    truth = small_world()
    places = seen_places(truth, CELL_M)
    assert [[tuple(cell) for cell in place.seen.tolist()] for place in places] == [A, B, C]
    assert [(place.n_occupied, place.n_free, place.observable) for place in places] == [
        (1, 1, True),
        (1, 1, True),
        (1, 0, False),
    ]
    assert truth.static_seen(CELL_M).tolist() == [[row, 20] for row in range(10)]


def test_static_cells_by_hand():
    # Beside the wall: (0, 20) and (3, 22). Beside the box that never moved: (12, 13). False: (3, 23) and (12, 14).
    scores = evaluate(answer(small_world(), static=[(0, 20), (3, 22), (12, 13), (3, 23), (12, 14)]), small_world())
    assert scores.static.precision == Share(2, 4)
    assert scores.static.recall == Share(2, 10)  # rows 0 and 1; (3, 22) is two columns from column 20
    assert scores.static.f1 == pytest.approx(2 * 0.5 * 0.2 / 0.7)
    assert scores.static.n_neutral == 1


def test_glass_counts_neither_way():
    truth = small_world()
    truth = replace(truth, walls=(*truth.walls, WallTruth(rectangle(0, 5, 5, 1), glass=True)))
    scores = evaluate(answer(truth, static=[(0, 5), (2, 6), (2, 7), (0, 20)]), truth)
    assert (scores.static.precision, scores.static.n_neutral) == (Share(1, 2), 2)
    assert scores.static.recall == Share(2, 10)
    got = evaluate(answer(truth, unassociated=[(1, [(0, 4), (1, 4)])]), truth).configurations
    assert (got.n_at_walls, got.n_in_free_space) == (1, 0)


def test_uncertain_cells_are_held_against_glass():
    truth = small_world()
    pane = rectangle(0, 5, 5, 1)
    truth = replace(truth, walls=(*truth.walls, WallTruth(pane, glass=True)))
    seen = replace(truth, hits=np.full_like(truth.hits, Hit.GLASS), distances=np.full_like(truth.distances, 0.55))
    n_seen = len(seen.glass_seen(CELL_M))
    assert n_seen == 5
    document = answer(truth) | {"uncertain": points([(0, 6), (3, 5), (3, 9)])}
    scores = evaluate(document, seen).uncertain
    assert (scores.precision, scores.recall) == (Share(2, 3), Share(5, 5))
    assert evaluate(answer(truth), seen).uncertain.recall == Share(0, 5)
    perfect = evaluate(truth_document(seen, CELL_M), seen).uncertain
    assert (perfect.precision, perfect.recall) == (Share(5, 5), Share(5, 5))
    assert evaluate(answer(truth), truth).uncertain.recall == Share(0, 0)


def test_cells_are_counted_once_however_often_they_are_reported():
    scores = evaluate(answer(small_world(), static=[(0, 20), (0, 20), (3, 23)]), small_world())
    assert scores.static.precision == Share(1, 2)


def test_a_place_that_nobody_saw_is_no_wall_either():
    truth = small_world(door=(0, 0))
    assert evaluate(answer(truth, static=A), truth).static.n_neutral == 5  # seen, never free
    assert evaluate(answer(truth, static=B), truth).static.precision == Share(0, 5)


@pytest.mark.parametrize(
    ("looks", "n_occupied", "observable"),
    [
        ([(0, 1, 2), range(15)], 2, True),  # 3 of 15 cells, but 0.3 m
        ([(0, 0, 1), range(15)], 1, True),  # 2 of 15 cells
        ([(0, 1), range(15)], 1, True),
        ([(0, 1), (0, 1, 1)], 1, True),  # all that was ever seen, by three beams
        ([(0, 1)], 0, False),  # by two
        ([(3, 3, 3)], 1, False),  # a speck
    ],
)
def test_what_counts_as_seen_occupied(looks, n_occupied, observable):
    """A leaf of 15 cells; which rows are looked at in each of its periods. In between it is away, and beams pass."""
    rows, stands_at = [], []
    for look in looks:
        rows += [*look, *range(15), *range(15), *range(15)]
        stands_at += [0] * len(look) + [1] * 45
    at = np.array(stands_at)
    n = len(rows)
    leaf = {"here": rectangle(0, 10, 15, 1), "hidden": rectangle(0, 50, 15, 1)}
    poses = np.column_stack([np.zeros(n), (np.array(rows) + 0.5) * CELL_M, np.zeros(n)])
    truth = replace(
        small_world(),
        things=(ThingTruth("D", "sliding", leaf),),
        t=np.arange(n) * 0.1,
        poses=poses,
        sweep_ends=poses,
        distances=np.where(at == 0, 1.0, 2.0)[:, None],
        hits=np.where(at == 0, Hit.DOOR, Hit.WALL).astype(np.uint8)[:, None],
        hit_things=np.where(at == 0, 0, -1).astype(np.int16)[:, None],
        places=at.astype(np.int16)[:, None],
        corners=np.array([[list(leaf.values())[k]] for k in stands_at]),
        people=np.empty((n, 0, 2)),
    )
    here, hidden = seen_places(truth, CELL_M)
    assert (here.n_occupied, here.n_free, here.observable) == (n_occupied, len(looks), observable)
    assert (len(hidden.seen), hidden.observable) == (0, False)


@pytest.mark.parametrize(("without_return", "n_free"), [((), 1), ((0, 1), 1), ((0, 1, 2), 0)])
def test_beams_without_return_show_no_place_free(without_return, n_free):
    """Rows 0 to 4 of the pass in which the door stands in "b" look through "a"; three must end on the wall."""
    truth = small_world()
    distances = truth.distances.copy()
    distances[[2 * ROWS + row for row in without_return]] = np.inf
    a = seen_places(replace(truth, distances=distances), CELL_M)[0]
    assert (a.n_occupied, a.n_free, a.observable) == (1, n_free, n_free > 0)


def test_a_place_that_is_observable_is_no_wall():
    scores = evaluate(answer(small_world(), static=A), small_world())
    assert scores.static.precision == Share(0, 5)
    assert scores.static.f1 == 0.0


def test_configurations_by_hand():
    truth = small_world()
    found = [
        (1, A),  # IoU 1
        (2, B[:2]),  # 2 of its cells near b, rows 5 to 7 of b near it: i = 2.5, IoU = 2.5 / (2 + 5 - 2.5)
        (3, C),  # never seen free
        (4, [(row, 22) for row in range(5)]),  # beside the wall
        (5, [(4, 10), (4, 11), (4, 13)]),  # a corner of a
        (6, [(0, 3), (0, 4)]),  # nothing there
        (7, []),
    ]
    scores = evaluate(answer(truth, unassociated=found), truth)
    assert [(place.configuration, place.iou) for place in scores.places] == [(1, 1.0), (2, 2.5 / 4.5), (3, 1.0)]
    got = scores.configurations
    assert got.precision == Share(2, 6)
    assert got.recall == Share(2, 2)
    assert got.recall_twice == Share(0, 0)
    assert (got.n_neutral, got.n_at_walls, got.n_at_things, got.n_in_free_space) == (1, 1, 1, 2)


def test_a_third_of_a_place_is_not_the_place():
    truth = small_world()
    # 1 cell near a; rows 0 and 1 of a near it: i = 1.5, IoU = 1.5 / (1 + 5 - 1.5) = 1/3
    scores = evaluate(answer(truth, unassociated=[(1, A[:1])]), truth)
    assert scores.configurations.recall == Share(0, 2)
    assert scores.configurations.precision == Share(0, 1)


def test_recall_of_what_was_seen_twice_counts_periods_not_scans():
    truth = small_world(door=(0, 0, 1, -1, 0, 1, 1))  # a in two periods, b in two
    scores = evaluate(answer(truth, unassociated=[(1, A)]), truth)
    assert scores.configurations.recall_twice == Share(1, 2)
    truth = small_world(door=(0, -1, 0, 1, 1))  # back where it was: still one period
    assert evaluate(answer(truth), truth).configurations.recall_twice == Share(0, 0)


@pytest.mark.parametrize(
    ("objects", "alone", "associated", "precision", "recall", "n_neutral"),
    [
        ([[(1, A), (2, B)]], [(3, C)], 1, Share(1, 1), Share(1, 1), 0),
        ([], [(1, A), (2, B), (3, C)], 0, Share(0, 0), Share(0, 1), 0),
        ([[(1, A)], [(2, B)]], [], 0, Share(0, 0), Share(0, 1), 0),
        ([[(1, A), (2, B), (3, C)]], [], 0, Share(1, 3), Share(1, 1), 0),  # C is another thing's, neutral or not
        ([[(1, A), (2, B)], [(1, A), (2, B)]], [], 1, Share(1, 1), Share(1, 1), 0),  # said twice
        ([[(1, A), (1, A), (2, B)]], [], 1, Share(1, 1), Share(1, 1), 0),
        ([[(1, A), (4, [(0, 3)])], [(1, A), (2, B)]], [], 1, Share(1, 2), Share(1, 1), 0),
        ([[(1, A), (4, [(0, 3)])]], [(2, B)], 0, Share(0, 1), Share(0, 1), 0),
    ],
)
def test_objects_and_links_by_hand(objects, alone, associated, precision, recall, n_neutral):
    truth = small_world()
    scores = evaluate(answer(truth, objects=objects, unassociated=alone), truth)
    assert scores.objects.associated == Share(associated, 1)
    assert scores.objects.two_places == scores.objects.hinged == Share(associated, 1)
    assert scores.objects.alone == scores.objects.box == Share(0, 0)  # C has no observable place
    assert scores.links.precision == precision
    assert scores.links.recall == recall
    assert scores.links.n_neutral == n_neutral


def one_place_observable():
    """While the door is at "a" the beams that would cross "b" end early: "b" is never seen free."""
    truth = small_world(door=(0, 1))
    truth.distances[5:10] = 0.5
    return truth


def test_a_thing_with_one_observable_place_is_right_alone_or_with_its_own_other_place():
    truth = one_place_observable()
    assert [(p.n_occupied, p.n_free) for p in seen_places(truth, CELL_M)] == [(1, 1), (1, 0), (1, 0)]
    for objects, right, links, n_neutral in [
        ([], 1, Share(0, 0), 0),
        ([[(1, A)]], 1, Share(0, 0), 0),
        ([[(1, A), (2, B)]], 1, Share(0, 0), 1),
        ([[(1, A), (3, C)]], 0, Share(0, 1), 0),
        ([[(1, A), (2, B)], [(1, A), (4, [(0, 3)])]], 0, Share(0, 1), 1),
    ]:
        scores = evaluate(answer(truth, objects=objects, unassociated=[] if objects else [(1, A)]), truth)
        assert scores.objects.alone == scores.objects.hinged == Share(right, 1)
        assert scores.objects.associated == Share(0, 0)
        assert scores.links.precision == links
        assert scores.links.recall == Share(0, 0)
        assert scores.links.n_neutral == n_neutral
    assert evaluate(answer(truth), truth).objects.alone == Share(0, 1)


def test_people_by_hand():
    # In pass 1 somebody's skin is in (4, 5), the middle at x = 0.8, y = 0.45 m; the leaf is in (7, 12), (7, 13).
    truth = small_world(people=[(1, 4, 5)])
    scan = ROWS + 4
    reported = [
        (5, 4),  # beside the skin
        (4, 10),  # its centre is 0.25 m from the middle: within radius and a cell
        (4, 12),  # 0.45 m: nobody's, but beside nothing either
        (6, 11),  # beside the leaf
        (0, 0),  # false
    ]
    got = evaluate(answer(truth, high_dynamic=[(scan, reported), (scan + 3, [])]), truth).high_dynamic
    assert got.n_scans == 2
    assert got.precision == Share(2, 4)
    assert got.recall == Share(1, 1)
    assert got.n_neutral == 1
    assert got.false_share == Share(2, 2)  # one beam a scan


def test_where_nobody_is_precision_is_unknown_and_false_cells_are_still_counted():
    truth = small_world()
    got = evaluate(answer(truth, high_dynamic=[(0, [(0, 0), (0, 1)]), (1, [(1, 5)])]), truth).high_dynamic
    assert (got.precision.value, got.recall.value) == (None, None)
    assert got.false_share == Share(3, 2)


def test_a_scan_that_is_told_twice_counts_once():
    truth = small_world(people=[(1, 4, 5)])
    got = evaluate(answer(truth, high_dynamic=[(ROWS + 4, [(4, 5)]), (ROWS + 4, [(4, 5)])]), truth).high_dynamic
    assert (got.n_scans, got.precision, got.recall) == (1, Share(1, 1), Share(1, 1))


def test_an_empty_answer_finds_nothing_and_is_wrong_about_nothing():
    truth = small_world(people=[(1, 4, 5)])
    scores = evaluate(answer(truth), truth)
    assert scores.static.precision.value is None
    assert scores.static.recall == Share(0, 10)
    assert scores.static.f1 is None
    assert scores.configurations.precision.value is None
    assert scores.configurations.recall == Share(0, 2)
    assert scores.objects.associated == Share(0, 1)
    assert scores.links.precision.value is None
    assert scores.links.recall == Share(0, 1)
    assert scores.high_dynamic.recall.value is None
    plain = json.loads(json.dumps(scores.to_dict(), allow_nan=False))
    assert plain["configurations"]["recall"] == {"n": 0, "of": 2, "share": 0.0}
    assert plain["static"]["f1"] is None


def test_only_the_documents_period_counts():
    truth = small_world()
    document = answer(truth, static=[(0, 20)], unassociated=[(1, A)])
    document["stop_s"] = float(truth.stamps_s[ROWS - 1])  # while the door was at "a": seen, but never away
    scores = evaluate(document, truth)
    assert scores.configurations.recall == Share(0, 0)
    assert scores.configurations.n_neutral == 1
    assert scores.static.recall == Share(0, 5)  # rows 5 to 9; the leaf is in front of the others
    document["start_s"] = document["stop_s"] = 5.0
    with pytest.raises(EmptyWindowError, match=r"the truth covers 1000\.000 s"):
        evaluate(document, truth)


def test_scans_that_the_truth_does_not_know_are_refused():
    truth = small_world()
    document = answer(truth, high_dynamic=[(0, [])])
    document["high_dynamic"][0]["t"] = 1000.05
    with pytest.raises(AnswerError, match=r"high_dynamic\[0\]\.t is 1000\.050 s, but no scan .* same log\?"):
        evaluate(document, truth)


@pytest.mark.parametrize(("key", "by_s"), [("start_s", -0.1), ("stop_s", 0.1)])
def test_a_document_of_more_than_the_truth_covers_is_refused(key, by_s):
    truth = small_world()
    document = answer(truth)
    document[key] += by_s / 1000  # a stamp that was rounded
    assert evaluate(document, truth).configurations.recall == Share(0, 2)
    document[key] += by_s
    with pytest.raises(AnswerError, match=r"the truth only about 1000\.000 s to 1004\.400 s"):
        evaluate(document, truth)


@pytest.mark.parametrize("resolution", [1e-9, 1e9])
def test_cells_of_a_size_that_no_map_has_are_refused(resolution):
    document = answer(small_world()) | {"resolution_m": resolution}
    with pytest.raises(AnswerError, match=r"the document: resolution_m = .* from 0\.001 to 100"):
        evaluate(document, small_world())


def test_cells_where_no_map_can_be_are_refused():
    document = answer(small_world())
    document["static"] = [[1e300, 0.0]]
    with pytest.raises(AnswerError, match=r"static: there is no cell at \(1e\+300, 0\) m"):
        evaluate(document, small_world())


def test_two_configurations_with_one_id_are_two():
    truth = small_world()
    scores = evaluate(answer(truth, objects=[[(1, A), (1, B)]]), truth)
    assert scores.configurations.recall == Share(2, 2)
    assert scores.objects.associated == Share(1, 1)


# The hallway.


@pytest.fixture(scope="module")
def hallway():
    return Truth.of(simulate(load_world("hallway"), 300.0, people=20))


@pytest.fixture(scope="module")
def perfect(hallway):
    return truth_document(hallway, 0.05, scans=range(0, 2000, 50))


def all_shares(value, path=""):
    if isinstance(value, dict) and set(value) == {"n", "of", "share"}:
        yield path, value["share"]
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from all_shares(part, f"{path}.{key}")


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_the_truth_scores_one_in_everything(hallway, resolution):
    document = json.loads(json.dumps(truth_document(hallway, resolution, scans=range(0, 2000, 20))))
    jsonschema.Draft202012Validator(schema()).validate(document)
    scores = evaluate(document, hallway)
    shares = dict(all_shares(scores.to_dict()))
    assert shares.pop(".high_dynamic.false_share") == 0.0
    # No door of the hallway slides, nothing in it is glass, and in 300 s nothing has four observable places.
    assert {path for path, share in shares.items() if share is None} <= {
        ".objects.more_places",
        ".objects.sliding",
        ".objects.box",
        ".objects.three_places",
        ".uncertain.precision",
        ".uncertain.recall",
    }
    assert {share for share in shares.values() if share is not None} == {1.0}
    assert (scores.links.n_wrong, scores.configurations.n_neutral, scores.static.n_neutral) == (0, 0, 0)
    assert scores.configurations.recall.of >= 8
    assert scores.objects.associated.of >= 2
    assert scores.high_dynamic.recall.of > 500
    assert {place.iou for place in scores.places if place.observable} == {1.0}


def test_the_truth_of_a_window_scores_one_there(hallway):
    window = hallway.window(hallway.start_s + 50.0, hallway.start_s + 150.0)
    scores = evaluate(truth_document(window, 0.1, scans=[0, 500]), hallway)
    assert scores.configurations.recall.value == scores.configurations.precision.value == 1.0
    assert scores.static.f1 == 1.0
    assert scores.configurations.recall.of < evaluate(truth_document(hallway, 0.1), hallway).configurations.recall.of


def test_periods_of_the_truth_are_those_of_the_simulation(hallway, perfect):
    by_id = {c["id"]: c for one in perfect["objects"] for c in one["configurations"]}
    scores = evaluate(perfect, hallway)
    place = next(place for place in scores.places if place.configuration in by_id)
    thing = next(k for k, thing in enumerate(hallway.things) if thing.name == place.thing)
    starts = [t for t, state in hallway.states(thing) if state == place.place]
    periods = by_id[place.configuration]["periods"]
    assert [start for start, _, state in periods if state == "occupied"] == starts
    assert all(start < stop for start, stop, _ in periods)
    assert all(stop <= start for (_, stop, _), (start, _, _) in pairwise(periods))


def test_two_doors_in_one_object_are_both_wrong(hallway, perfect):
    before = evaluate(perfect, hallway)
    document = copy.deepcopy(perfect)
    second = document["objects"].pop(1)
    n_first, n_second = len(document["objects"][0]["configurations"]), len(second["configurations"])
    document["objects"][0]["configurations"] += second["configurations"]
    scores = evaluate(document, hallway)
    assert scores.objects.associated == Share(before.objects.associated.n - 2, before.objects.associated.of)
    assert scores.links.n_wrong == n_first * n_second
    assert scores.links.recall == before.links.recall
    assert scores.configurations == before.configurations


def plain_cells(configuration, resolution=0.05):
    return {(round(y / resolution - 0.5), round(x / resolution - 0.5)) for x, y in configuration["cells"]}


def plain_near(cells, others):
    return {
        (row, col) for row, col in cells if any((row + a, col + b) in others for a in (-1, 0, 1) for b in (-1, 0, 1))
    }


def plain_iou(cells, others):
    both = (len(plain_near(cells, others)) + len(plain_near(others, cells))) / 2
    return both / (len(cells) + len(others) - both) if both else 0.0


def test_two_places_in_one_configuration_cost_a_place_or_two(hallway, perfect):
    before = evaluate(perfect, hallway)
    for k, one in enumerate(perfect["objects"]):
        document = copy.deepcopy(perfect)
        first, second = document["objects"][k]["configurations"][:2]
        cells = plain_cells(first) | plain_cells(second)
        n_kept = any(plain_iou(cells, plain_cells(place)) >= 0.4 for place in (first, second))
        first["cells"] = first["cells"] + second["cells"]
        del document["objects"][k]["configurations"][1]
        scores = evaluate(document, hallway)
        n_before = before.configurations.recall.n
        assert scores.configurations.recall == Share(n_before - 2 + n_kept, n_before)
        assert scores.configurations.precision == Share(n_before - 2 + n_kept, n_before - 1)
        assert scores.objects.associated.n == before.objects.associated.n - 1
        n_links = len(one["configurations"]) * (len(one["configurations"]) - 1) // 2
        assert scores.links.recall.n == before.links.recall.n - n_links + (n_links == 3 and n_kept)


def test_a_place_in_two_halves_is_found_once_and_false_once(hallway, perfect):
    before = evaluate(perfect, hallway)
    document = copy.deepcopy(perfect)
    one = document["objects"][0]
    assert len(one["configurations"]) == 2
    whole = one["configurations"][0]
    along = int(np.ptp(whole["cells"], axis=0).argmax())
    cells = sorted(whole["cells"], key=lambda point: point[along])
    half = copy.deepcopy(whole)
    whole["cells"], half["cells"], half["id"] = cells[: len(cells) // 2], cells[len(cells) // 2 :], 1000
    one["configurations"].append(half)
    scores = evaluate(document, hallway)
    n = before.configurations.recall.n
    assert scores.configurations.recall == Share(n, n)
    assert scores.configurations.precision == Share(n, n + 1)
    assert scores.configurations.n_at_things + scores.configurations.n_at_walls == 1
    assert scores.objects.associated.n == before.objects.associated.n - 1
    assert scores.links.recall == before.links.recall
    assert scores.links.n_wrong == 2  # of the false half with either of the others


def test_everything_half_a_metre_off_is_nowhere(hallway, perfect):
    document = json.loads(json.dumps(perfect))

    def shift(points):
        return [[round(x + 0.5, 6), round(y + 0.5, 6)] for x, y in points]

    document["static"] = shift(document["static"])
    found = [c for one in document["objects"] for c in one["configurations"]] + document["unassociated"]
    for one in found:
        one["cells"] = shift(one["cells"])
    scores = evaluate(document, hallway)
    n = len(found)
    assert scores.configurations.recall == Share(0, n)
    assert scores.configurations.precision == Share(0, n)
    assert scores.links.precision.n == scores.objects.associated.n == scores.objects.alone.n == 0
    walls = {tuple(cell) for cell in hallway.static_cells(0.05).tolist()}
    seen = {tuple(cell) for cell in hallway.static_seen(0.05).tolist()}
    reported = plain_cells({"cells": document["static"]})
    assert scores.static.recall == Share(len(plain_near(seen, reported)), len(seen))
    assert scores.static.precision.n == len(plain_near(reported, walls))
    assert scores.static.f1 < 0.3


def test_a_place_that_nobody_saw_free_may_be_guessed_or_called_a_wall(hallway, perfect):
    places = seen_places(hallway, 0.05)
    place = next(p for p in places if not p.observable and len(p.seen) > 5 and p.n_occupied)
    cells = [[(col + 0.5) * 0.05, (row + 0.5) * 0.05] for row, col in place.seen.tolist()]
    before = evaluate(perfect, hallway)
    guessed = copy.deepcopy(perfect)
    guess = {"id": 1000, "cells": cells, "periods": [], "confidence": 0.5, "hypothesis": True}
    guessed["unassociated"].append(guess)
    scores = evaluate(guessed, hallway)
    assert scores.configurations.n_neutral == 1
    assert (scores.configurations.precision, scores.configurations.recall) == (
        before.configurations.precision,
        before.configurations.recall,
    )
    walled = copy.deepcopy(perfect)
    walled["static"] += cells
    assert evaluate(walled, hallway).static.precision.value == 1.0
    assert evaluate(walled, hallway).static.n_neutral > 0


# The parts.

CELLS = st.lists(st.tuples(st.integers(0, 6), st.integers(-3, 3)), max_size=6, unique=True)


@settings(deadline=None)
@given(CELLS, CELLS)
def test_tolerant_overlap_is_what_it_says(one, other):
    arrays = (np.array(cells, dtype=np.int64).reshape(-1, 2) for cells in (one, other))
    assert tolerant_iou(*arrays) == plain_iou(set(one), set(other))


@settings(deadline=None)
@given(st.lists(CELLS, max_size=4), st.lists(CELLS, max_size=4))
def test_no_other_choice_matches_more_or_overlaps_more(reported, places):
    iou = [[plain_iou(set(one), set(other)) for other in places] for one in reported]
    best = (0, 0.0)
    for order in permutations([*range(len(places)), *[None] * len(reported)], len(reported)):
        pairs = [iou[i][j] for i, j in enumerate(order) if j is not None and iou[i][j] >= MATCH_IOU]
        best = max(best, (len(pairs), round(sum(pairs), 9)))
    arrays = [[np.array(cells, dtype=np.int64).reshape(-1, 2) for cells in side] for side in (reported, places)]
    got = match(*arrays, [True] * len(places))
    assert len({j for j, _ in got.values()}) == len(got)
    assert all(overlap == iou[i][j] for i, (j, overlap) in got.items())
    assert (len(got), round(sum(overlap for _, overlap in got.values()), 9)) == best


def test_one_more_match_is_worth_more_than_any_overlap():
    # Strips of 20 cells, 9 apart. Each reported one overlaps the next place by 12 / 28; three are places themselves.
    strips = [np.array([[0, col] for col in range(first, first + 20)]) for first in range(0, 45, 9)]
    got = match(strips[:4], strips[1:], [True] * 4)
    assert got == {k: (k, 12 / 28) for k in range(4)}


def test_of_two_equal_places_the_observable_one_is_taken():
    cells = np.array(A)
    for preferred, place in (([False, True], 1), ([True, False], 0)):
        assert match([cells], [cells, cells], preferred) == {0: (place, 1.0)}


def keywords(part):
    if isinstance(part, dict):
        for key, value in part.items():
            yield key
            if key in ("properties", "$defs"):
                for one in value.values():
                    yield from keywords(one)
            elif key in ("items", "prefixItems"):
                yield from keywords(value)
    elif isinstance(part, list):
        for one in part:
            yield from keywords(one)


def test_every_word_of_the_schema_is_understood():
    assert set(keywords(schema())) <= UNDERSTOOD | SAYS_NOTHING


STRANGE_NUMBERS = [True, False, 0, 1, 2, -1, 1.0, 1.5, float("inf"), float("nan"), 10**400]
STRANGE_LISTS = [[], [1], [[1, 2]], [[1, "2"]], [[True, 2]], [[1, 2, 3]], [[0, 1, "free"]], [[0, 1, None]]]
STRANGE = st.sampled_from([None, "", "free", "paper", {}, {"id": 1}, *STRANGE_NUMBERS, *STRANGE_LISTS])


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_a_damaged_document_is_refused_or_scored(data):
    truth = small_world(people=[(1, 4, 5)])
    document = answer(truth, A, [[(1, A), (2, B)]], [(3, C)], [(ROWS + 4, [(4, 5)])])
    document["objects"][0]["configurations"][0]["periods"] = [[1000.0, 1001.0, "free"]]
    document["objects"][0]["timeline"] = [[1000.0, 1001.0, 1], [1001.0, 1002.0, None]]
    for _ in range(data.draw(st.integers(1, 3))):
        at = document
        while True:
            keys = sorted(at) if isinstance(at, dict) else list(range(len(at)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            if isinstance(at[key], dict | list) and at[key] and data.draw(st.booleans()):
                at = at[key]
                continue
            kind = data.draw(st.sampled_from(["set", "delete", "double"]))
            if kind == "set":
                at[key] = copy.deepcopy(data.draw(STRANGE))
            elif kind == "delete":
                del at[key]
            elif isinstance(at, list):
                at.append(copy.deepcopy(at[key]))
            else:
                at["surprise"] = 1
            break
    infinite = any(f"{number}" in repr(document) for number in ("inf", "nan", 10**400))
    valid = jsonschema.Draft202012Validator(schema()).is_valid(document) and not infinite
    try:
        check_objects(document)
    except AnswerError:
        assert not valid
    else:
        assert valid
        with suppress(AnswerError, EmptyWindowError):
            json.dumps(evaluate(document, truth).to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ('{"format": "tempog-objects", "version": NaN}', "NaN is no number that JSON knows"),
        ('{"format": "other", "version": 1}', "format is 'other'; wanted \"tempog-objects\""),
        ('{"format": "tempog-objects", "version": 9}', "version is 9; wanted 1"),
        ("{}", "the document lacks 'format'"),
        ("7", "the document is 7; wanted object"),
    ],
)
def test_what_is_no_document_is_refused(tmp_path, text, words):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(AnswerError, match=words):
        read_objects(tmp_path / "a.json")


def test_the_first_wrong_key_is_named(tmp_path):
    document = answer(small_world(), objects=[[(1, A)]])
    document["objects"][0]["configurations"][0]["cells"][3] = [1.0]
    with pytest.raises(
        AnswerError, match=r"objects\[0\]\.configurations\[0\]\.cells\[3\] is \[1\.0\]; wanted 2 to 2"
    ):
        check_objects(document)
    with pytest.raises(AnswerError, match=r"cannot read .*none\.json: No such file"):
        read_objects(tmp_path / "none.json")
