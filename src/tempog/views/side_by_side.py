"""World, temporal map and classic occupancy grid beside each other, as the paper compares them (Table I)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tempog.analysis.find_objects import FoundObjects
from tempog.simulation import Simulation
from tempog.views.canvas import BLACK, UNEXPLORED, WHITE, add_legend, cropped, show_map
from tempog.views.maps import classic_rgb
from tempog.views.objects import counts, lone_legend, object_signs, paint_objects, uncertain_legend
from tempog.views.worlds import bounds, paint_world, world_legend

PANEL_LONG_INCHES = 6.5
DPI = 160


class Row(NamedTuple):
    """One experiment of the table: what it is called, what was simulated, and what was found."""

    title: str
    simulation: Simulation
    found: FoundObjects


def draw_table_1(rows: Sequence[Row]) -> Figure:
    """The simulated world, the map with objects, and the classic occupancy grid, a row per experiment (Table I).

    A single experiment in a world that is much wider than high has its three pictures below each other.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up.

    Examples
    --------
    >>> from tempog import build_grid, find_objects
    >>> from tempog.simulation import corridor, simulate
    >>> simulation = simulate(corridor())
    >>> row = Row("no people", simulation, find_objects(build_grid(simulation.scans)))
    >>> [axes.get_title(loc="left") for axes in draw_table_1([row]).axes]
    ['no people · simulated world', 'no people · 1 object, method evidence', 'no people · classic occupancy grid']
    """
    low, high = bounds(rows[0].simulation.world)
    width, height = high - low
    inches = PANEL_LONG_INCHES / max(width, height)
    shape = (3, 1) if len(rows) == 1 and width > 1.5 * height else (len(rows), 3)
    size = (shape[1] * (width * inches + 0.7), shape[0] * (height * inches + 0.7) + 0.4)
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    panels = np.array(figure.subplots(*shape)).reshape(len(rows), 3)
    for (title, simulation, found), (left, middle, right) in zip(rows, panels, strict=True):
        paint_world(left, simulation)
        left.set_title(f"{title} · simulated world", fontsize=9, loc="left")
        paint_objects(middle, found)
        middle.set_title(f"{title} · {counts(found)}", fontsize=9, loc="left")
        show_map(right, *cropped(classic_rgb(found.history), found.history.extent))
        right.set_title(f"{title} · classic occupancy grid", fontsize=9, loc="left")
        for axes in (middle, right):
            axes.set(xlim=left.get_xlim(), ylim=left.get_ylim())
            axes.set_facecolor(UNEXPLORED[0])
    pictures = [row.found for row in rows]
    legend = [(BLACK, "wall, static, occupied"), (WHITE, "free"), UNEXPLORED]
    legend += [*uncertain_legend(pictures), *lone_legend(pictures), *world_legend([row.simulation for row in rows])]
    add_legend(figure, legend, object_signs(pictures))
    return figure
