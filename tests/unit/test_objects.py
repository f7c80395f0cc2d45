"""Doors by hand, and the simulated corridor, as the paper's algorithms see them."""

from __future__ import annotations

import numpy as np
import pytest

from fed_grid import grid_of
from strategies import STREAM_START_NS, Stream
from tempog import Scan, build_grid
from tempog.analysis.configurations import find_configurations
from tempog.analysis.find_objects import find_objects
from tempog.analysis.high_dynamic import high_dynamic, high_dynamics
from tempog.analysis.objects import associate
from tempog.analysis.static import CellClass, static_map
from tempog.errors import ConfigError, TimeError
from tempog.methods import PaperConfig
from tempog.simulation import corridor, simulate

NS = 1_000_000_000
PERIOD_S = 0.1
WALL = [(0, col) for col in range(-6, 0)]
CLOSED = [(0, col) for col in range(3)]  # the leaf lies along a row,
OPEN = [(row, 4) for row in range(1, 4)]  # or along a column; they do not touch
AJAR = [(row, 9) for row in range(1, 4)]
FLOOR = [(6, 6), (6, 7)]


def told(timeline: list[tuple[float, dict[str, list[tuple[int, int]]]]]) -> Stream:
    """For so many seconds at a time, what is occupied and what is free; other cells are not seen."""
    now, stamps, statements = STREAM_START_NS, [], []
    for seconds, said in timeline:
        for _ in range(round(seconds / PERIOD_S)):
            stamps.append(now)
            hits = [(cell, 0.9) for cell in said["occupied"]]
            statements.append(hits + [(cell, 0.1) for cell in said["free"]])
            now += round(PERIOD_S * NS)
    return Stream(stamps, statements, NS, 0.2)


def door(*states: str, seconds: float = 10.0) -> list[tuple[float, dict[str, list[tuple[int, int]]]]]:
    """A wall, and a door in each of the states in turn: closed, open, ajar, or open with somebody in it."""
    occupied = {"closed": CLOSED, "open": OPEN, "ajar": AJAR, "somebody": CLOSED + OPEN, "away": [], "unseen": []}
    every = CLOSED + OPEN + AJAR + FLOOR
    timeline = []
    for state in states:
        free = [cell for cell in every if cell not in occupied[state]] if state != "unseen" else []
        timeline.append((seconds, {"occupied": WALL + occupied[state], "free": free}))
    return timeline


def places(configurations) -> list[list[tuple[int, int]]]:
    return [[tuple(cell) for cell in place.cells.tolist()] for place in configurations]


def states(place) -> list[str]:
    return [period.state for period in place.periods]


def test_a_door_is_two_configurations_and_one_object() -> None:
    found = find_configurations(grid_of(told(door("closed", "open", "closed"))))
    assert places(found) == [CLOSED, OPEN]
    assert states(found[0]) == ["occupied", "free", "occupied"]
    assert states(found[1]) == ["free", "occupied", "free"]
    (one,) = associate(found)
    assert [place.id for place in one.configurations] == [1, 2]
    assert [period.configuration for period in one.timeline] == [1, 2, 1]
    assert one.confidence == 1
    assert one.common_s == pytest.approx(30.0)


def test_centres_of_cells_are_in_metres() -> None:
    closed, _ = find_configurations(grid_of(told(door("closed", "open", "closed"))))
    np.testing.assert_allclose(closed.points_map, [[0.025, 0.025], [0.075, 0.025], [0.125, 0.025]])
    assert closed.centre_m == pytest.approx((0.075, 0.025))


def test_somebody_in_the_open_door_is_tolerated_for_a_share_of_the_time() -> None:
    timeline = [*door("closed", "open"), *door("somebody", seconds=2.0), *door("open", "closed")]
    found = find_configurations(grid_of(told(timeline)))
    (one,) = associate(found)
    assert one.both_s == pytest.approx(2.0)
    assert one.confidence == pytest.approx(1 - 2 / 42)
    assert None in [period.configuration for period in one.timeline]
    assert associate(found, both_share=0.0) == []


def test_a_time_with_no_place_occupied_breaks_the_object_unless_tolerated() -> None:
    found = find_configurations(grid_of(told([*door("closed"), *door("away", seconds=1.0), *door("open")])))
    assert associate(found) == []
    assert len(associate(found, none_share=0.1)) == 1


def test_two_doors_that_move_in_step_are_confused_as_the_paper_says() -> None:
    def both(timeline):
        def and_beside(cells):
            return cells + [(row + 12, col) for row, col in cells]

        return [(seconds, {kind: and_beside(cells) for kind, cells in said.items()}) for seconds, said in timeline]

    found = find_configurations(grid_of(told(both(door("closed", "open", "closed")))))
    assert len(found) == 4
    linked = [[place.id for place in one.configurations] for one in associate(found, max_states=2)]
    assert linked == [[1, 2], [1, 4], [2, 3], [3, 4]]
    near = associate(found, max_states=2, within_m=0.3)  # nearness tells them apart where time cannot
    assert [[place.id for place in one.configurations] for one in near] == [[1, 2], [3, 4]]


def test_a_door_with_three_states_is_one_object_of_three() -> None:
    found = find_configurations(grid_of(told(door("closed", "open", "ajar", "closed", "ajar"))))
    assert places(found) == [CLOSED, OPEN, AJAR]
    (one,) = associate(found)
    assert [period.configuration for period in one.timeline] == [1, 2, 3, 1, 3]
    assert associate(found, max_states=2) == []


def test_times_without_a_look_are_left_out() -> None:
    found = find_configurations(grid_of(told(door("closed", "unseen", "open", "unseen", "closed"))))
    (one,) = associate(found)
    assert one.common_s == pytest.approx(30.0)
    assert [period.configuration for period in one.timeline] == [1, 2, 1]
    assert one.timeline[1].start_ns - one.timeline[0].stop_ns == pytest.approx(10 * NS, abs=0.2 * NS)


def test_places_never_seen_together_are_not_associated() -> None:
    timeline = []
    for seconds, said in door("closed", "open", "closed", "open"):
        timeline.append((seconds, {kind: [c for c in cells if c not in OPEN] for kind, cells in said.items()}))
        timeline.append((seconds, {kind: [c for c in cells if c in OPEN] for kind, cells in said.items()}))
    found = find_configurations(grid_of(told(timeline)))
    assert places(found) == [CLOSED, OPEN]
    assert associate(found) == []


def test_a_place_seen_only_while_occupied_looks_static_as_the_papers_d8() -> None:
    timeline = [
        (s, {kind: [c for c in cells if c not in OPEN or kind == "occupied"] for kind, cells in said.items()})
        for s, said in door("closed", "open", "closed")
    ]
    grid = grid_of(told(timeline))
    assert places(find_configurations(grid)) == [CLOSED]
    classes = static_map(grid, weight="interval")
    extent = grid.extent
    assert all(classes[row - extent.row0, col - extent.col0] == CellClass.STATIC for row, col in OPEN)


def test_a_window_knows_only_its_own_period() -> None:
    grid = grid_of(told(door("closed", "open", "closed")))
    window = grid.window("+2", "+18")
    (one,) = associate(find_configurations(window))
    assert [period.configuration for period in one.timeline] == [1, 2]
    assert one.common_s == pytest.approx(16.1)  # 161 looks
    assert find_configurations(grid.window("+1", "+8")) == []  # nothing changes in it: all static


def test_high_dynamic_cells_are_neither_wall_nor_configuration() -> None:
    timeline = [*door("closed", "open", "closed")]
    seconds, said = door("open", seconds=0.1)[0]
    person = FLOOR[:1]
    free = [cell for cell in said["free"] if cell not in person]
    timeline.append((seconds, {"occupied": said["occupied"] + person, "free": free}))
    grid = grid_of(told(timeline))
    found = find_configurations(grid)
    moving = high_dynamic(grid, configurations=found)
    assert [tuple(cell) for cell in moving.cells.tolist()] == person
    np.testing.assert_allclose(moving.points_map, [[0.325, 0.325]])
    assert len(high_dynamic(grid, "+25", configurations=found).cells) == 0
    assert len(high_dynamic(grid, "+25").cells) == len(CLOSED)
    with pytest.raises(TimeError, match="no measurement"):
        high_dynamic(grid, grid.start_ns / NS - 10)


def test_settings_that_cannot_work_are_refused() -> None:
    grid = grid_of(told(door("closed", "open")))
    for settings in (
        {"threshold": 0},
        {"min_common_s": -1},
        {"neighbourhood": 6},
        {"seen_share": 2},
        {"smallest_m": -1},
    ):
        with pytest.raises(ConfigError, match=next(iter(settings))):
            find_configurations(grid, **settings)
    with pytest.raises(ConfigError, match="extent"):
        find_configurations(grid, np.zeros((2, 2), dtype=np.int8))
    for settings in ({"max_states": 1}, {"within_m": 0}, {"none_share": 2}, {"both_share": -1}):
        with pytest.raises(ConfigError, match=next(iter(settings))):
            associate([], **settings)


def test_places_smaller_than_asked_are_dropped() -> None:
    grid = grid_of(told(door("closed", "open", "closed")))
    reach_m = float(np.hypot(3, 1)) * 0.05  # of three cells in a row, corner to corner
    assert places(find_configurations(grid, smallest_m=reach_m - 1e-6)) == [CLOSED, OPEN]
    assert find_configurations(grid, smallest_m=reach_m + 1e-6) == []


def test_with_all_cells_the_floor_is_one_configuration() -> None:
    grid = grid_of(told(door("closed", "open", "closed")))
    assert FLOOR in places(find_configurations(grid, candidates="all"))
    assert FLOOR not in places(find_configurations(grid))


def test_cells_that_are_seldom_occupied_are_no_candidates_if_so_wanted() -> None:
    grid = grid_of(told(door("closed", "open", "closed")))  # the open place for a third of the time
    assert places(find_configurations(grid, least_occupied=0.3)) == [CLOSED, OPEN]
    assert places(find_configurations(grid, least_occupied=0.4)) == [CLOSED]


def test_what_is_occupied_for_just_the_share_wanted_is_a_candidate() -> None:
    grid = grid_of(told(door("closed", "open")))  # half of the time each
    unknown = np.zeros(grid.extent.shape, dtype=np.int8)
    assert places(find_configurations(grid, unknown, least_occupied=0.5)) == [WALL, CLOSED, OPEN]
    assert places(find_configurations(grid, unknown, least_occupied=0.51)) == [WALL]
    assert places(find_configurations(grid, unknown, least_occupied=1.0)) == [WALL]


def test_somebody_beside_the_door_is_on_the_move_unless_near_is_asked_for() -> None:
    timeline = door("closed", "open", "closed")
    for seconds, said in timeline[:-1]:
        assert seconds == 10.0
        said["free"].append((5, 4))
    timeline[-1][1]["occupied"].append((5, 4))  # two cells beyond the open leaf, for the last ten seconds
    grid = grid_of(told(timeline))
    found = find_objects(grid, "paper")
    assert places(found.configurations) == [CLOSED, OPEN]
    assert found.high_dynamic().cells.tolist() == [[5, 4]]
    assert [len(one.cells) for one in found.high_dynamics(every_s=5.0)] == [0, 0, 0, 0, 1, 1]
    further = find_objects(grid, "paper", PaperConfig(near_m=0.1))
    assert further.high_dynamic().cells.tolist() == []


@pytest.mark.parametrize(
    ("every_s", "wanted_s"),
    [
        (0.0, [0.0, 0.4, 1.9, 2.0, 2.8996, 30.0]),
        (1e-300, [0.0, 0.4, 1.9, 2.0, 2.8996, 30.0]),
        (1.0, [0.0, 1.9, 2.8996, 30.0]),  # 2.0 s is too soon after 1.9 s; 2.8996 s is late enough, but for rounding
        (2.0, [0.0, 2.0, 30.0]),
        (1e300, [0.0]),
    ],
)
def test_looks_for_what_is_on_the_move_are_so_far_apart_in_time(every_s, wanted_s) -> None:
    stamps_s = (0.0, 0.4, 1.9, 2.0, 2.8996, 30.0)
    grid = build_grid([Scan(t, (0.0, 0.0, 0.0), [0.0], [1.0], 8.0) for t in stamps_s])
    assert [one.stamp_ns / NS for one in high_dynamics(grid, every_s)] == wanted_s


def test_somebody_in_the_open_door_is_on_the_move_if_free_places_count() -> None:
    timeline = door("closed", "open", "closed", "open")
    seconds, said = timeline.pop()
    somebody = {
        "occupied": [*said["occupied"], CLOSED[0]],
        "free": [cell for cell in said["free"] if cell != CLOSED[0]],
    }
    grid = grid_of(told([*timeline, (seconds, said), (1.0, somebody)]))  # one cell of the closed leaf's three
    found = find_objects(grid, "paper")
    assert places(found.configurations) == [CLOSED, OPEN]
    explained = {"walls": found.walls, "configurations": found.configurations}
    assert high_dynamic(grid, **explained).cells.tolist() == []
    assert high_dynamic(grid, **explained, in_free_places=True).cells.tolist() == [list(CLOSED[0])]
    by_scan = high_dynamics(grid, **explained, in_free_places=True)
    assert [len(one.cells) for one in by_scan] == [0] * 400 + [1] * 10  # the leaf itself never counts


def test_the_tuned_method_is_the_same_with_other_settings() -> None:
    found = find_objects(grid_of(told(door("closed", "open", "closed"))), "paper-tuned", PaperConfig())
    assert (len(found.objects), found.unassociated) == (1, ())
    assert found.document()["method"] == "paper-tuned"
    with pytest.raises(ConfigError, match="evidence, paper, paper-tuned"):
        find_objects(found.history, "magic")


@pytest.fixture(scope="module")
def driven():
    """The corridor as mapped, with its configurations."""
    world = simulate(corridor(seed=0), seed=0)
    grid = build_grid(world.scans)
    return world, grid, find_configurations(grid)


def test_the_corridors_closed_and_open_places_are_found(driven) -> None:
    world, _, found = driven
    got = [{tuple(cell) for cell in place} for place in places(found)]
    overlap = {}
    for state in ("closed", "open"):
        truth = {tuple(cell) for cell in world.cells("D1", state, 0.05).tolist()}
        overlap[state] = max(len(cells & truth) for cells in got)
    # Measured: 22 of the closed leaf's 38 cells, in one piece with 78 others; 13 of the open leaf's 38 are among
    # these, and 5 are a piece of their own.
    assert overlap["closed"] >= 18
    assert overlap["open"] >= 5


def test_the_corridor_has_more_configurations_than_a_door_has_places(driven) -> None:
    # What the paper's algorithms give on a world with one door and one walking person, not what one would want:
    # the person's way along the corridor is one large configuration, for its cells are free nearly all the time.
    _, _, found = driven
    assert len(found) > 2
    assert max(len(place.cells) for place in found) > 1000
    assert associate(found) == []
