"""Glass, and what else is seen from some sides only, is no door."""

from __future__ import annotations

import numpy as np
import pytest

from tempog import ObjectTracker, build_grid, find_objects
from tempog.analysis.evidence.kernels import count_views
from tempog.analysis.static import CellClass
from tempog.evaluation import evaluate
from tempog.methods import EvidenceConfig
from tempog.simulation import load_world, simulate
from tempog.simulation.cell_sets import near
from tempog.simulation.truth import Truth

S = 10**9
WORLD = """
duration_s = 420
[robot]
waypoints = [[1.0, 1.5], [9.0, 1.5]]
[laser]
n_beams = 271
fov_deg = 270.0
[[wall]]
line = [[0, 0], [10, 0], [10, 6], [0, 6]]
closed = true
[[wall]]
line = [[0, 3], [10, 3]]
[[glass]]
line = [[2, 3], [3, 3]]
pass_share = 0.2
seen_within_deg = 30.0
[[glass]]
line = [[7, 3], [9, 3]]
pass_share = 0.2
seen_within_deg = 15.0
[door.D]
hinge = [4.2, 3.0]
places = { closed = 0, open = 90 }
schedule.dwell_s = { closed = 60, open = 60 }
"""


@pytest.fixture(scope="module")
def simulation(tmp_path_factory):
    path = tmp_path_factory.mktemp("world") / "glass.toml"
    path.write_text(WORLD)
    return simulate(load_world(str(path)), seed=0)


@pytest.fixture(scope="module")
def drive(simulation):
    return build_grid(simulation.scans), Truth.of(simulation)


def test_glass_that_is_seen_about_square_only_is_uncertain_and_a_door_beside_it_a_door(drive) -> None:
    grid, truth = drive
    found = find_objects(grid)
    scores = evaluate(found.document(), truth)
    places = scores.configurations
    assert places.precision.n == places.precision.of == places.recall.of == 1  # the leaf's open place is never free
    assert scores.uncertain.precision.value > 0.95
    assert scores.uncertain.recall.value > 0.9
    assert len(found.uncertain_points_map) == np.count_nonzero(found.walls == CellClass.UNCERTAIN)


def test_without_the_rule_a_pane_where_the_robot_turns_is_taken_for_a_door(drive) -> None:
    grid, truth = drive
    found = find_objects(grid, settings=EvidenceConfig(view_above=1e9))
    glass = truth.static_cells(0.05, glass=True)
    assert any(near(place.cells.astype(np.int64), glass).mean() > 0.5 for place in found.configurations)
    assert not (found.walls == CellClass.UNCERTAIN).any()


def test_what_is_hit_on_glass_is_not_on_the_move(drive) -> None:
    grid, truth = drive
    glass = truth.static_cells(0.05, glass=True)

    def on_glass(found) -> int:
        return sum(int(near(one.cells.astype(np.int64), glass).sum()) for one in found.high_dynamics(1.0))

    without = find_objects(grid, settings=EvidenceConfig(view_above=1e9))
    assert on_glass(find_objects(grid)) < 0.2 * on_glass(without)


def test_an_analysis_of_an_area_knows_from_where_it_was_seen(drive) -> None:
    grid, _ = drive
    whole, part = (find_objects(history).uncertain_points_map for history in (grid, grid.area(6.5, 9.5, 2.5, 3.5)))
    assert len(part) > 20
    assert set(map(tuple, part.tolist())) <= set(map(tuple, whole.tolist()))


def test_hits_on_glass_give_a_tracker_nothing_to_learn(simulation, drive) -> None:
    grid, truth = drive
    glass = truth.static_cells(0.05, glass=True)

    def hits_and_areas(settings):
        tracker = ObjectTracker(find_objects(grid, settings=settings))
        n_hits = 0
        for scan in simulation.scans:
            tracker.update(scan)
            n_hits += int(near(tracker.high_dynamic.cells.astype(np.int64), glass).sum())
        return n_hits, sum(area.holds((glass[:, ::-1] + 0.5) * 0.05).any() for area in tracker.due())

    assert hits_and_areas(EvidenceConfig()) == (0, 0)
    assert min(hits_and_areas(EvidenceConfig(view_above=1e9))) > 0


def counted(looks):
    """Visits and steps of one cell at (1, 1), seen at so many seconds from (x, y), free or occupied; or not seen."""
    stamps = np.array([round(t * S) for t, *_ in looks])
    poses = np.array([[x, y, 0.0] for _, x, y, _ in looks])
    seen = np.array([now is not None for *_, now in looks])
    state = np.array([bool(now) for *_, now in looks], dtype=np.uint8)[seen]
    offsets, point = np.array([0, len(state)]), np.array([[1.0, 1.0]])
    visits, steps = np.zeros((1, 4, 2), dtype=np.int64), np.zeros((1, 2, 2), dtype=np.int64)
    periods = (offsets, stamps[seen], stamps[seen] + S // 10, state)
    first = np.zeros(1, dtype=np.int64)
    count_views(*periods, first, point, stamps, poses, S // 10, 1, 5 * S, visits, steps)
    return visits[0].tolist(), steps[0].tolist()


def test_a_visit_is_a_time_from_one_direction_and_has_the_state_of_most_looks() -> None:
    south_west, north_east = (0.0, 0.5), (2.0, 1.5)
    looks = [(t, *south_west, t > 1) for t in range(6)]  # one visit: 2 free, 4 occupied
    looks += [(6, *north_east, 0), (7, *north_east, 0)]
    looks += [(20, *north_east, 0)]  # again, since it was not seen for long
    looks += [(21, *south_west, 1)]
    visits, steps = counted(looks)
    assert visits == [[0, 2], [0, 0], [2, 0], [0, 0]]
    assert steps == [[1, 1], [1, 0]]


def test_a_scan_soon_after_the_last_look_at_a_cell_is_no_look_at_it() -> None:
    visits, steps = counted([(0, 0.0, 0.5, 1), (0.05, 2.0, 1.5, None)])
    assert visits == [[0, 1], [0, 0], [0, 0], [0, 0]]
    assert steps == [[0, 0], [0, 0]]
