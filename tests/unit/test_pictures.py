"""Pictures: what is written in them can be read."""

from __future__ import annotations

import dataclasses
from itertools import combinations

import numpy as np
import pytest
from matplotlib.figure import Figure

from tempog.analysis.find_objects import find_objects
from tempog.analysis.static import CellClass
from tempog.pipeline import build_grid
from tempog.scans.scan import Scan
from tempog.sensing.grid_spec import Extent
from tempog.simulation import corridor, load_world, simulate
from tempog.views.objects import LABEL_POINTS, draw_objects, draw_people, label_offsets
from tempog.views.side_by_side import Row, draw_table_1
from tempog.views.timeline import draw_timeline


@pytest.mark.parametrize("world", ["hallway", "office"])
def test_the_legend_of_compared_pictures_lies_inside_and_names_what_is_drawn(world):
    simulation = simulate(load_world(world), 10.0, people=2)
    found = find_objects(build_grid(simulation.scans))
    figure = draw_table_1([Row("one", simulation, found)])
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width
    assert 0 <= box.y0 < box.y1 <= figure.bbox.height
    labels = [text.get_text() for text in legend.get_texts()]
    assert ("box" in labels) == (world == "office")
    assert {"door", "its other places", "person"} <= set(labels)


def test_numbers_of_objects_at_one_place_stand_beside_each_other():
    figure = Figure(figsize=(9, 6))
    axes = figure.add_subplot()
    centres = [np.array([10.0, 5.0]), np.array([10.0, 5.0]), np.array([10.1, 5.0]), np.array([0.5, 0.5])] * 3
    offsets = label_offsets(axes, centres, Extent(0, 0, 200, 400, 0.05))
    box = axes.get_position()
    points_per_m = 72 * min(box.width * 9 / 20, box.height * 6 / 10)
    stand = [centre * points_per_m + offset for centre, offset in zip(centres, offsets, strict=True)]
    for one, other in combinations(stand, 2):
        assert (np.abs(one - other) >= np.array(LABEL_POINTS) - 1e-9).any()
    assert offsets[0] == offsets[3] == (4.0, 4.0)


def test_a_timeline_is_hatched_where_nobody_looked_and_tells_moves_and_shares():
    found = find_objects(build_grid(simulate(corridor()).scans))
    (one,) = found.objects
    axes = draw_timeline(found).axes[0]
    bands = [bars for bars in axes.collections if bars.get_hatch()]
    assert [len(bars.get_paths()) for bars in bands] == [1] * len(one.configurations)
    width = bands[0].get_paths()[0].get_extents().width
    seen = sum(
        path.get_extents().width for bars in axes.collections[:3] if bars not in bands for path in bars.get_paths()
    )
    (summary,) = axes.child_axes
    told = [label.get_text() for label in summary.get_yticklabels()]
    assert 0 < seen < width
    assert told == [f"{one.shares[1]:.0%}, {one.n_moves} moves", f"{one.shares[2]:.0%}"]


def labels(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_a_timeline_of_a_window_counts_from_the_log_s_start_and_one_of_nothing_says_so():
    grid = build_grid(simulate(corridor(), duration_s=60.0).scans)
    figure = draw_timeline(find_objects(grid.window("+20", "+50")))
    axes = figure.axes[0]
    assert axes.get_xlim() == pytest.approx((20.0, 50.0), abs=0.1)
    assert [text.get_text() for text in axes.texts] == ["No objects were found, so there are no times to show."]
    assert labels(figure) == ["occupied", "free", "not seen"]


@pytest.mark.parametrize(("start_s", "unit"), [(1_750_000_000, "UTC"), (50, "seconds since the log's start")])
def test_a_timeline_of_two_days_has_room_for_the_minutes_driven(start_s, unit):
    scans = simulate(corridor(), duration_s=120.0).scans
    first_s = scans[0].stamp_ns / 1e9
    shifts = [start_s - first_s, start_s - first_s + 86_400]
    days = [
        Scan(s.t + shift, (s.x, s.y, s.theta), s.angles, s.ranges, s.max_range) for shift in shifts for s in scans
    ]
    axes = draw_timeline(find_objects(build_grid(days))).axes[0]
    assert axes.get_xlabel() == f"{unit}; white: a pause without scans"
    assert len(axes.get_xticklabels()) == 2
    ends = axes.transData.transform([(0, 0), (119, 0), (86_400, 0), (86_519, 0)])[:, 0]
    shares = np.diff(ends) / (ends[-1] - ends[0])
    assert shares == pytest.approx([0.49, 0.02, 0.49], abs=0.01)


def test_legends_name_what_a_picture_has_and_nothing_else():
    found = find_objects(build_grid(simulate(corridor()).scans))
    assert not found.unassociated
    plain = ["static", "free", "unexplored"]
    assert labels(draw_objects(found)) == [*plain, "places of one object, with its number"]
    assert labels(draw_people(found)) == plain
    (one,) = found.objects
    guessed = dataclasses.replace(one.configurations[1], hypothesis=True)
    doubtful = dataclasses.replace(one, configurations=(one.configurations[0], guessed))
    walls = found.walls.copy()
    walls[0, 0] = CellClass.UNCERTAIN
    places = (*doubtful.configurations, dataclasses.replace(one.configurations[0], id=9))
    other = dataclasses.replace(found, objects=(doubtful,), walls=walls, configurations=places)
    named = ["uncertain, as glass is", "place in no object"]
    signs = ["places of one object, with its number", "one of them hardly ever seen free"]
    assert labels(draw_objects(other)) == [*plain, *named, *signs]
    simulation = simulate(corridor(), 1.0)
    beside = labels(draw_table_1([Row("one", simulation, found), Row("two", simulation, other)]))
    assert beside[3:5] == named
    assert beside[-2:] == signs
    assert "uncertain, as glass is" not in labels(draw_table_1([Row("one", simulation, found)]))
    right = draw_timeline(other).axes[0].child_axes[0].get_yticklabels()
    assert right[1].get_text().endswith(", hypothesis")
