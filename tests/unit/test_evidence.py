"""The method ``evidence`` on histories made by hand: doors, boxes, people, walls."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from fed_grid import grid_of
from strategies import STREAM_START_NS, Stream
from tempog.analysis.evidence import association
from tempog.analysis.evidence.association import PlaceSet, with_rivals
from tempog.analysis.evidence.blocks import cell_states
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.static import CellClass
from tempog.analysis.tracker import ObjectTracker
from tempog.errors import ConfigError, TimeError
from tempog.methods import EvidenceConfig
from tempog.sensing.grid_spec import Bounds

NS = 1_000_000_000
PERIOD_S = 0.2
Cells = list[tuple[int, int]]
Course = list[tuple[float, Cells, Cells]]  # for so many seconds: what is occupied, and what is not seen


def box(x_m: float, y_m: float, width_m: float, depth_m: float, resolution_m: float = 0.05) -> Cells:
    """Cells of a rectangle; x_m and y_m are its lower left corner."""
    row, col, n_rows, n_cols = (round(length / resolution_m) for length in (y_m, x_m, depth_m, width_m))
    return [(row + up, col + right) for up in range(max(n_rows, 1)) for right in range(max(n_cols, 1))]


# A leaf of 0.8 m on a hinge at the origin, thin as a laser sees it, beside a wall.
WALL = box(-1.0, 0.0, 0.8, 0.05)
CLOSED = box(0.05, 0.0, 0.8, 0.05)
OPEN = box(0.0, 0.05, 0.05, 0.8)
AJAR = [(-(k + 1) * 2 // 3 - 1, k + 2) for k in range(14)]  # the other way, by a third of a right angle
LEAF = {"closed": CLOSED, "open": OPEN, "ajar": AJAR, "away": []}


def told(course: Course, floor: Cells, resolution_m: float = 0.05) -> Stream:
    """Everything that is ever occupied, and some floor, is seen all the time but for what is said not to be."""
    every = sorted({cell for _, occupied, _ in course for cell in occupied} | set(floor))
    stamps, statements = [], []
    for seconds, occupied, unseen in course:
        hits, hidden = set(occupied), set(unseen)
        said = [(cell, 0.9 if cell in hits else 0.1) for cell in every if cell not in hidden]
        for _ in range(round(seconds / PERIOD_S)):
            stamps.append(STREAM_START_NS + round(len(stamps) * PERIOD_S * NS))
            statements.append(said)
    return Stream(stamps, statements, NS, 0.2)


def found_in(course: Course, settings: EvidenceConfig | None = None, floor: Cells | None = None) -> FoundObjects:
    return find_objects(grid_of(told(course, floor or [])), "evidence", settings)


def door(*states: str, seconds: float = 20.0, also: Cells | None = None) -> Course:
    return [(seconds, WALL + LEAF[state] + (also or []), []) for state in states]


def cells_of(place) -> Cells:
    return [tuple(cell) for cell in place.cells.tolist()]


def cells_by_place(found: FoundObjects) -> list[Cells]:
    return [cells_of(place) for place in found.configurations]


def ids(found: FoundObjects) -> list[list[int]]:
    return [[place.id for place in one.configurations] for one in found.objects]


def ids_of(one) -> list[int]:
    return [place.id for place in one.configurations]


def seconds_of(timeline) -> list[tuple[float, float, int | None]]:
    """Since the start, to a tenth."""
    return [
        (round((p.start_ns - STREAM_START_NS) / NS, 1), round((p.stop_ns - STREAM_START_NS) / NS, 1), p.configuration)
        for p in timeline
    ]


def static_of(found: FoundObjects) -> Cells:
    extent = found.history.extent
    rows, cols = np.nonzero(found.walls == CellClass.STATIC)
    return sorted(zip((rows + extent.row0).tolist(), (cols + extent.col0).tolist(), strict=True))


def test_a_door_is_two_configurations_and_one_object() -> None:
    found = found_in(door("closed", "open", "closed"))
    assert cells_by_place(found) == [CLOSED, OPEN]
    assert ids(found) == [[1, 2]]
    (leaf,) = found.objects
    assert seconds_of(leaf.timeline) == [(0, 20, 1), (20, 40, 2), (40, 60, 1)]
    assert (leaf.common_s, leaf.none_s, leaf.both_s) == pytest.approx((60, 0, 0))
    assert 0.9 < leaf.confidence < 1
    assert static_of(found) == WALL


def test_a_door_with_three_states_is_one_object_of_three() -> None:
    found = found_in(door("closed", "open", "ajar", "closed", "ajar", "open"))
    assert sorted(map(sorted, cells_by_place(found))) == sorted(map(sorted, (AJAR, CLOSED, OPEN)))
    assert ids(found) == [[1, 2, 3]]
    where = {place.id: cells_of(place) for place in found.configurations}
    told_where = [sorted(where[period.configuration]) for period in found.objects[0].timeline]
    assert told_where == [sorted(LEAF[state]) for state in ("closed", "open", "ajar", "closed", "ajar", "open")]


def test_a_door_that_opens_while_it_is_watched_without_a_break_was_open() -> None:
    stream = told(door("closed", "open", "closed"), [])
    states = cell_states(grid_of(stream), EvidenceConfig())
    cells = list(zip(states.rows, states.cols, strict=True))
    leaf = [np.array([cells.index(cell)]) for cell in CLOSED]
    assert {tuple(states.courses.of(one).state.tolist()) for one in leaf} == {(1, 0, 1)}


def test_no_object_has_more_places_than_asked_for() -> None:
    found = found_in(door("closed", "open", "ajar", "closed", "ajar", "open"), EvidenceConfig(max_states=2))
    assert len(found.configurations) == 3
    assert sorted(map(len, ids(found))) == [1, 2]


def test_somebody_in_the_open_door_for_a_moment_changes_nothing() -> None:
    course = [*door("closed", "open"), *door("open", seconds=3.0, also=CLOSED[4:12]), *door("open", "closed")]
    found = found_in(course)
    assert ids(found) == [[1, 2]]
    assert found.objects[0].timeline[0].configuration == 1


def passing(n_times: int) -> Course:
    """Somebody walks along the row y = 2 m at 1 m/s, so many times."""
    steps = [(PERIOD_S, WALL + box(0.2 * k, 2.0, 0.4, 0.1), []) for k in range(20)]
    return [(10.0, WALL, []), *([*steps, (15.0, WALL, [])] * n_times)]


def test_who_passes_leaves_no_place() -> None:
    for n_times in (1, 3):
        found = found_in(passing(n_times))
        assert (found.configurations, found.objects) == ((), ())
        assert static_of(found) == WALL


CRATE = box(0.5, 1.0, 0.6, 0.05)  # the side of it


def test_what_stands_once_for_4_s_is_no_place_and_for_a_minute_is_one() -> None:
    for seconds, wanted in ((4.0, []), (60.0, [CRATE])):
        course = [(15.0, WALL, []), (seconds, WALL + CRATE, []), (15.0, WALL, [])]
        assert cells_by_place(found_in(course)) == wanted


def test_a_box_put_down_for_a_minute_is_an_object_of_its_own() -> None:
    found = found_in([(40.0, WALL, []), (60.0, WALL + CRATE, []), (40.0, WALL, [])])
    assert ids(found) == [[1]]
    (crate,) = found.objects
    assert crate.confidence is None
    assert seconds_of(crate.timeline) == [(0, 40, None), (40, 100, 1), (100, 140, None)]
    assert found.unassociated == ()


def arc(radius_m: float) -> Cells:
    """The near side of somebody round, who stands at (1, 2)."""
    angles = np.linspace(math.pi, 2 * math.pi, 60)
    x, y = 1 + radius_m * np.cos(angles), 2 + radius_m * np.sin(angles)
    return sorted({(math.floor(b / 0.05), math.floor(a / 0.05)) for a, b in zip(x, y, strict=True)})


def test_somebody_round_who_stands_there_once_for_seconds_is_no_place_but_who_stays_and_comes_back_is_one() -> None:
    assert cells_by_place(found_in([(90.0, WALL, []), (6.0, WALL + arc(0.25), []), (90.0, WALL, [])])) == []
    once = [(30.0, WALL, []), (30.0, WALL + arc(0.25), []), (30.0, WALL, [])]
    assert cells_by_place(found_in(once * 2)) == [arc(0.25)]


FACES = [box(0.0, 1.0, 0.8, 0.05), box(0.0, 1.1, 0.8, 0.05)]
BOTH_FACES = sorted(FACES[0] + FACES[1])


def passes() -> Course:
    """A leaf from one side, from the other, again, and both places when it is gone."""
    sides = [(10.0, WALL + FACES[0], FACES[1]), (10.0, WALL + FACES[1], FACES[0])]
    return [*sides, *sides, (15.0, WALL, [])]


def test_two_faces_of_a_leaf_that_are_seen_in_different_passes_are_one_place() -> None:
    found = found_in(passes() * 2)
    assert cells_by_place(found) == [BOTH_FACES]
    assert cells_by_place(found_in(passes() * 2, EvidenceConfig(face_m=0.0))) == FACES


def test_places_that_contradict_each_other_are_no_faces_of_one_thing_but_a_wall_seen_displaced() -> None:
    course = [(20.0, WALL + FACES[0], []), (20.0, WALL + FACES[1], [])] * 3
    assert cells_by_place(found_in(course)) == []
    assert len(found_in(course, EvidenceConfig(echo_m=0.0)).configurations) == 1  # the likelier of the two
    far = [(row + 6, col) for row, col in FACES[0]]  # 0.3 m away, a thing of its own
    course = [(20.0, WALL + FACES[0], []), (20.0, WALL + far, [])] * 3
    assert cells_by_place(found_in(course)) == [FACES[0], far]


def test_what_changed_once_must_have_been_seen_for_a_while_in_both_states() -> None:
    leaf = box(0.5, 1.0, 0.9, 0.05)
    for seconds, wanted in ((3.0, []), (30.0, [leaf])):
        course = [(60.0, WALL + leaf, []), (seconds, WALL, [])]
        assert cells_by_place(found_in(course)) == wanted
    assert cells_by_place(found_in(course, EvidenceConfig(once_doubt=6.0))) == []


def test_a_wall_with_stray_free_readings_is_static_and_no_place() -> None:
    rng = np.random.default_rng(1)
    statements = [[(cell, 0.1 if rng.random() < 0.15 else 0.9) for cell in WALL] for _ in range(300)]
    stamps = [STREAM_START_NS + round(k * PERIOD_S * NS) for k in range(300)]
    found = find_objects(grid_of(Stream(stamps, statements, NS, 0.2)))
    assert found.configurations == ()
    assert static_of(found) == WALL


def test_a_door_that_is_closed_nine_tenths_of_the_time_is_no_wall() -> None:
    course = [*door("closed", seconds=135), *door("open", seconds=15)] * 2
    found = found_in(course)
    assert CLOSED in cells_by_place(found)
    assert static_of(found) == WALL


def test_two_doors_that_move_in_step_are_told_apart_by_their_hinges() -> None:
    def beside(cells: Cells) -> Cells:
        return [(row, col + 40) for row, col in cells]

    course = [(20.0, occupied + beside(occupied), []) for _, occupied, _ in door("closed", "open", "closed", "open")]
    found = found_in(course)
    assert cells_by_place(found) == [CLOSED, beside(CLOSED), OPEN, beside(OPEN)]
    assert ids(found) == [[1, 3], [2, 4]]
    assert [one.rivals for one in found.objects] == [(), ()]
    assert all(one.confidence > 0.95 for one in found.objects)


def test_doors_far_away_do_not_keep_a_door_from_being_found_whole(monkeypatch) -> None:
    monkeypatch.setattr(association, "MAX_SETS", 3)  # as many as one door has pairs of places
    doors = 4

    def in_a_row(cells: Cells) -> Cells:
        return [(row, col + 200 * k) for k in range(doors) for row, col in cells]

    course = door("closed", "open", "ajar", "closed", "ajar", "open", "closed")
    found = found_in([(seconds, in_a_row(occupied), unseen) for seconds, occupied, unseen in course])
    assert [len(one.configurations) for one in found.objects] == [3] * doors


def test_two_crates_that_move_in_step_along_the_sides_of_a_square_are_ambiguous() -> None:
    south_west, south_east, north_west, north_east = (
        box(x_m, y_m, 0.4, 0.05) for y_m in (1.0, 2.2) for x_m in (1.0, 2.2)
    )
    course = [(20.0, WALL + south_west + north_east, []), (20.0, WALL + south_east + north_west, [])] * 3
    found = found_in(course)
    assert cells_by_place(found) == [south_west, south_east, north_west, north_east]
    assert sorted(place for one in found.objects for place in ids_of(one)) == [1, 2, 3, 4]
    for one, other in (found.objects, found.objects[::-1]):
        assert one.rivals == tuple(ids_of(other))
        assert 0.5 <= one.confidence < 0.75
    assert [one["rivals"] for one in found.document()["objects"]] == [list(one.rivals) for one in found.objects]


def test_learning_an_area_names_rivals_by_the_ids_that_they_have_in_the_whole_map() -> None:
    far = box(0.0, -40.0, 0.8, 0.05), box(0.0, -39.0, 0.8, 0.05)  # takes the ids that the crates have in their area
    south_west, south_east, north_west, north_east = (
        box(x_m, y_m, 0.4, 0.05) for y_m in (1.0, 2.2) for x_m in (1.0, 2.2)
    )
    course = [
        (20.0, WALL + south_west + north_east + far[0], []),
        (20.0, WALL + south_east + north_west + far[1], []),
    ] * 3
    found = found_in(course)
    rivals = {one.id: one.rivals for one in found.objects}
    assert sorted(i for of in rivals.values() for i in of) == [3, 4, 5, 6]
    tracker = ObjectTracker(found)
    tracker.learn(found.history, Bounds(0.9, 2.7, 0.9, 2.4))
    assert {one.id: one.rivals for one in tracker.found.objects} == rivals


def test_a_place_that_may_be_the_third_of_either_of_two_things_is_told_of_the_one_that_got_it() -> None:
    sets = [PlaceSet((0, 1), 4.0), PlaceSet((2, 3), 4.0), PlaceSet((0, 1, 4), 5.0), PlaceSet((2, 3, 4), 4.9)]
    first, second = with_rivals([sets[2], sets[1]], sets)
    assert (first.margin, first.rivals) == (pytest.approx(0.1), ())
    assert (second.margin, second.rivals) == (pytest.approx(0.1), (4,))


def test_times_without_a_look_stay_unknown() -> None:
    everything = WALL + CLOSED + OPEN
    unseen = [(20.0, [], everything)]
    found = found_in([*door("closed"), *unseen, *door("open"), *unseen, *door("open", "closed")])
    assert ids(found) == [[1, 2]]
    (leaf,) = found.objects
    assert seconds_of(leaf.timeline) == [(0, 20, 1), (40, 60, 2), (80, 100, 2), (100, 120, 1)]
    assert leaf.common_s == pytest.approx(80)
    periods = found.configurations[0].periods
    assert [(p.start_ns - STREAM_START_NS) // NS for p in periods] == [0, 40, 80, 100]


def test_a_stay_goes_on_over_gaps_and_over_somebody_in_the_doorway() -> None:
    everything = WALL + CLOSED + OPEN
    unseen = [(20.0, [], everything)]
    somebody = [(1.0, everything, [])]
    (leaf,) = found_in(
        [*door("closed"), *somebody, *door("closed"), *unseen, *door("closed", "open"), *unseen]
    ).objects
    assert seconds_of(leaf.timeline) == [(0, 20, 1), (20, 21, None), (21, 41, 1), (61, 81, 1), (81, 101, 2)]
    assert [(*one, stay.seen_s) for one, stay in zip(seconds_of(leaf.stays), leaf.stays, strict=True)] == [
        (0, 81, 1, pytest.approx(60)),
        (81, 101, 2, pytest.approx(20)),
    ]
    assert leaf.n_moves == 1
    assert [((a - STREAM_START_NS) // NS, (b - STREAM_START_NS) // NS) for a, b in leaf.gaps] == [(41, 61)]
    assert leaf.last_stay == leaf.stays[-1]
    assert leaf.shares == pytest.approx({1: 60 / 81, 2: 20 / 81, None: 1 / 81})


def test_where_a_thing_was_last_is_not_said_while_that_is_unclear() -> None:
    (leaf,) = found_in([*door("closed", "open", "closed", "open", "closed"), *door("away", seconds=5.0)]).objects
    assert [stay.configuration for stay in leaf.stays] == [1, 2, 1, 2, 1]
    assert leaf.last_stay is None


def test_a_thing_of_one_place_is_there_or_away() -> None:
    crate = box(1.0, 1.0, 0.4, 0.05)
    course = [(40.0, WALL, []), (60.0, WALL + crate, []), (40.0, WALL, [])]
    (one,) = found_in(course).objects
    assert [stay.configuration for stay in one.stays] == [None, 1, None]
    assert (one.n_moves, one.gaps, one.seen_s) == (2, (), pytest.approx(140))
    assert one.shares == pytest.approx({1: 60 / 140, None: 80 / 140})
    assert one.last_stay == one.stays[-1]


def test_where_one_place_is_seen_free_and_the_other_not_at_all_nothing_is_known() -> None:
    course = [*door("closed", "open", "closed"), (20.0, WALL, OPEN), *door("open")]
    (leaf,) = found_in(course).objects
    assert seconds_of(leaf.timeline) == [(0, 20, 1), (20, 40, 2), (40, 60, 1), (80, 100, 2)]
    assert leaf.common_s == pytest.approx(80)


def test_a_window_knows_only_its_own_period() -> None:
    grid = grid_of(told(door("closed", "open", "closed", "closed", "closed"), []))
    found = find_objects(grid.window("+5", "+50"))
    assert cells_by_place(found) == [CLOSED, OPEN]
    assert seconds_of(found.objects[0].timeline) == [(5, 20, 1), (20, 40, 2), (40, 50.2, 1)]
    later = find_objects(grid.window("+45", "+95"))
    assert (later.configurations, later.objects) == ((), ())
    assert static_of(later) == sorted(WALL + CLOSED)


def test_an_empty_history_is_refused() -> None:
    with pytest.raises(TimeError, match="no scans yet"):
        find_objects(grid_of(Stream([], [], NS, 0.2)), "evidence")


def test_one_scan_is_all_wall() -> None:
    found = find_objects(grid_of(Stream([STREAM_START_NS], [[((0, 0), 0.9), ((0, 1), 0.1)]], NS, 0.2)))
    assert (found.configurations, found.objects) == ((), ())
    assert static_of(found) == [(0, 0)]
    assert [int(value) for value in found.walls[0, :2]] == [CellClass.STATIC, CellClass.FREE]


def test_scans_that_say_nothing_or_only_free_have_no_wall() -> None:
    for said in ([], [((3, -4), 0.1)]):
        found = find_objects(grid_of(Stream([STREAM_START_NS, STREAM_START_NS + NS // 5], [said, said], NS, 0.2)))
        assert (found.configurations, found.objects, static_of(found)) == ((), (), [])


def test_where_nothing_ever_changes_all_is_wall_or_free() -> None:
    floor = box(3.0, 3.0, 0.2, 0.2)
    found = found_in(door("closed", "closed"), floor=floor)
    assert (found.configurations, found.objects) == ((), ())
    assert static_of(found) == sorted(WALL + CLOSED)
    assert np.count_nonzero(found.walls == CellClass.FREE) == len(floor)
    assert np.count_nonzero(found.walls == CellClass.CHANGING) == 0


def test_scans_of_one_moment_do_no_harm() -> None:
    stream = told(door("closed", "open", "closed"), [])
    stamps = [stream.stamps_ns[k - k % 2] for k in range(len(stream.stamps_ns))]
    found = find_objects(grid_of(Stream(stamps, stream.statements, NS, 0.2)))
    assert cells_by_place(found) == [CLOSED, OPEN]


def test_cells_of_5_and_of_10_cm_give_the_same_answer() -> None:
    answers = []
    for resolution_m in (0.05, 0.1):
        wall = box(-1.0, 0.0, 0.8, 0.1, resolution_m)
        closed, opened = box(0.1, 0.0, 0.8, 0.1, resolution_m), box(0.0, 0.1, 0.1, 0.8, resolution_m)
        crate = box(1.5, 1.0, 0.4, 0.4, resolution_m)
        course = [
            (30.0, wall + closed, []),
            (30.0, wall + opened + crate, []),
            (30.0, wall + closed + crate, []),
            (30.0, wall + opened, []),
        ]
        found = find_objects(grid_of(told(course, [], resolution_m), resolution_m))
        centres = [place.centre_m for place in found.configurations]
        timelines = [seconds_of(one.timeline) for one in found.objects]
        answers.append((np.round(centres, 9).tolist(), ids(found), timelines))
        assert len(static_of(found)) == len(wall)
    assert answers[0] == answers[1]
    assert answers[0][0] == [[0.5, 0.05], [0.05, 0.5], [1.7, 1.2]]
    assert answers[0][1] == [[1, 2], [3]]


MAY_BE_NEGATIVE = ("alike_above", "grow_above", "doubt_above", "place_above")
SETTINGS = [field.name for field in dataclasses.fields(EvidenceConfig)]


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("value", [math.nan, math.inf, "much", -1])
def test_settings_out_of_range_are_refused_by_their_name(name, value) -> None:
    if value == -1 and name in MAY_BE_NEGATIVE:
        assert getattr(EvidenceConfig(**{name: value}), name) == -1
        return
    with pytest.raises(ConfigError, match=rf"^{name} = "):
        EvidenceConfig(**{name: value})


@pytest.mark.parametrize(
    "name",
    [*(n for n in SETTINGS if n.endswith(("_share", "_duty"))), "together", "max_states"],
)
def test_shares_above_1_and_too_many_states_are_refused_by_their_name(name) -> None:
    with pytest.raises(ConfigError, match=rf"^{name} = "):
        EvidenceConfig(**{name: 1.01 if name != "max_states" else 9})


def behind_a_door(open_wall: Cells, *states: str) -> Course:
    """A door whose open place, or what else is behind it, is seen only while it is open."""
    behind = open_wall + OPEN
    return [
        (20.0, WALL + (CLOSED if state == "closed" else behind), behind if state == "closed" else [])
        for state in states
    ]


def test_an_open_leaf_that_is_seen_only_while_the_door_is_open_is_a_hypothesis() -> None:
    found = found_in(behind_a_door([], "closed", "open", "closed", "open", "closed"))
    assert cells_by_place(found) == [CLOSED, OPEN]
    assert [place.hypothesis for place in found.configurations] == [False, True]
    assert ids(found) == [[1, 2]]
    assert found.objects[0].confidence == 0.5
    assert not set(OPEN) & set(static_of(found))
    (one,) = found.document()["objects"]
    assert [place["hypothesis"] for place in one["configurations"]] == [False, True]


def test_a_wall_behind_a_door_goes_on_and_is_no_hypothesis() -> None:
    wall = box(0.0, 0.85, 0.05, 1.6)  # from where the open leaf would end
    found = found_in(behind_a_door(wall, "closed", "open", "closed", "open", "closed"))
    assert cells_by_place(found) == [CLOSED]
    assert set(wall) <= set(static_of(found))


def test_what_is_seen_while_the_door_is_closed_is_no_open_leaf() -> None:
    course = [
        (seconds, occupied + OPEN, []) for seconds, occupied, _ in behind_a_door([], "closed", "open", "closed")
    ]
    found = found_in([(seconds, sorted(set(occupied)), []) for seconds, occupied, _ in course])
    assert not any(place.hypothesis for place in found.configurations)
