"""The temporal map as the paper draws it: walls, places in colours, lines between places of one object (Fig. 13)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.static import CellClass
from tempog.sensing.grid_spec import Extent
from tempog.views.canvas import (
    BLACK,
    GREY,
    UNEXPLORED,
    WHITE,
    Colour,
    Rgb,
    add_legend,
    as_rgb,
    canvas,
    cropped,
    show_map,
)

# Okabe and Ito's colours, which colour-blind people can tell apart, without black and without the next one.
OBJECT_COLOURS: tuple[Colour, ...] = (
    (0.0, 0.45, 0.70),
    (0.84, 0.37, 0.0),
    (0.0, 0.62, 0.45),
    (0.80, 0.47, 0.65),
    (0.34, 0.71, 0.91),
    (0.55, 0.34, 0.29),
)
LABEL_POINTS = (13, 10)  # width and height of a number of two digits
LABEL_STEPS = sorted(((right, up) for right in range(-2, 6) for up in range(6)), key=lambda step: math.hypot(*step))
LONE_COLOUR: Colour = (0.90, 0.62, 0.0)
OBJECTS_LEGEND = [
    (BLACK, "static"),
    (WHITE, "free"),
    UNEXPLORED,
    (LONE_COLOUR, "place in no object"),
]


def draw_objects(found: FoundObjects, *, title: str = "") -> Figure:
    """Walls, places and objects: each object has a colour, a number, and a line from place to place (Fig. 13).

    Parameters
    ----------
    found : FoundObjects
    title : str
        Put before what is shown.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up. Places that are part of no object have a colour of their own.
    """
    _, extent = cropped(_cells(found), found.history.extent)
    figure, axes = canvas(*extent.shape, has_bar=False)
    paint_objects(axes, found)
    axes.set_title(" · ".join(part for part in (title, counts(found)) if part), fontsize=9, loc="left")
    add_legend(figure, OBJECTS_LEGEND)
    return figure


def paint_objects(axes: Axes, found: FoundObjects) -> None:
    """`draw_objects` on given axes, without title and legend."""
    rgb, extent = cropped(_cells(found), found.history.extent)
    show_map(axes, rgb, extent)
    centres_m = [np.mean([place.centre_m for place in one.configurations], axis=0) for one in found.objects]
    offsets = label_offsets(axes, centres_m, extent)
    for k, one in enumerate(found.objects):
        colour = object_colour(k)
        centres = np.array([place.centre_m for place in one.configurations])
        # A line along the shortest way through them; an object of one place has its number alone.
        order = _chain(centres)
        axes.plot(*centres[order].T, color=colour, linewidth=1.6, marker="o", markersize=3)
        axes.annotate(
            str(one.id),
            centres.mean(axis=0),
            xytext=offsets[k],
            textcoords="offset points",
            fontsize=8,
            color=colour,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8},
        )


def counts(found: FoundObjects) -> str:
    """How much was found, for a title."""
    return f"{len(found.objects)} objects, {len(found.unassociated)} other places, method {found.method}"


def label_offsets(axes: Axes, centres_m: Sequence[NDArray[np.float64]], extent: Extent) -> list[tuple[float, float]]:
    """Where numbers stand, in points from their objects: the nearest place that is free, towards the map's middle."""
    x_min, x_max, y_min, y_max = extent.bounds
    figure = axes.get_figure(root=True)
    assert figure is not None
    box, (width, height) = axes.get_position(), figure.get_size_inches()
    points_per_m = 72 * min(box.width * width / (x_max - x_min), box.height * height / (y_max - y_min))
    taken: list[tuple[float, float]] = []
    offsets = []
    for x_m, y_m in centres_m:
        x, y = x_m * points_per_m, y_m * points_per_m
        inwards = (1 if x_m < (x_min + x_max) / 2 else -1, 1 if y_m < (y_min + y_max) / 2 else -1)
        places = [
            (4.0 + inwards[0] * right * LABEL_POINTS[0], 4.0 + inwards[1] * up * LABEL_POINTS[1])
            for right, up in LABEL_STEPS
        ]
        free = (
            (right, up)
            for right, up in places
            if not any(abs(x + right - a) < LABEL_POINTS[0] and abs(y + up - b) < LABEL_POINTS[1] for a, b in taken)
        )
        chosen = next(free, places[0])
        taken.append((x + chosen[0], y + chosen[1]))
        offsets.append(chosen)
    return offsets


def object_colour(k: int) -> Colour:
    """Colour of the object listed at place k."""
    return OBJECT_COLOURS[k % len(OBJECT_COLOURS)]


def _cells(found: FoundObjects) -> Rgb:
    rgb = np.empty((*found.walls.shape, 3), dtype=np.float32)
    rgb[:] = as_rgb(WHITE)
    rgb[found.walls == CellClass.UNEXPLORED] = as_rgb(GREY)
    rgb[found.walls == CellClass.STATIC] = as_rgb(BLACK)
    coloured = [(place, LONE_COLOUR) for place in found.unassociated]
    coloured += [(place, object_colour(k)) for k, one in enumerate(found.objects) for place in one.configurations]
    for place, colour in coloured:
        rgb[_rows_cols(found, place)] = as_rgb(colour)
    return rgb


def _rows_cols(found: FoundObjects, place: Configuration) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    extent = found.history.extent
    return place.cells[:, 0] - extent.row0, place.cells[:, 1] - extent.col0


def _chain(centres: NDArray[np.float64]) -> list[int]:
    """Points in the order of a walk that goes from each to the nearest one left, from the first on."""
    order, left = [0], list(range(1, len(centres)))
    while left:
        nearest = min(left, key=lambda k: float(np.hypot(*(centres[k] - centres[order[-1]]))))
        order.append(nearest)
        left.remove(nearest)
    return order
