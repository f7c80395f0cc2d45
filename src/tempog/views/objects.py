"""What was found, drawn: walls, places in colours and lines between those of one object (Fig. 13), and trails."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.objects import MovingObject
from tempog.analysis.static import CellClass
from tempog.grid.history import History
from tempog.sensing.grid_spec import Extent
from tempog.views.canvas import (
    BLACK,
    GREY,
    UNEXPLORED,
    WHITE,
    Colour,
    Rgb,
    as_rgb,
    cropped,
    figure_of,
    sheet_for,
    show_map,
)
from tempog.views.maps import Drawing

# Okabe and Ito's colours, which colour-blind people can tell apart, without black, the colour of lone places, and sky
# blue, which looks like that of glass; then a purple and a brown that differ from them in brightness too.
OBJECT_COLOURS: tuple[Colour, ...] = (
    (0.0, 0.45, 0.70),
    (0.84, 0.37, 0.0),
    (0.0, 0.62, 0.45),
    (0.80, 0.47, 0.65),
    (0.45, 0.0, 0.70),
    (0.42, 0.17, 0.05),
)
LABEL_POINTS = (13, 10)  # width and height of a number of two digits
LABEL_STEPS = sorted(((right, up) for right in range(-2, 6) for up in range(6)), key=lambda step: math.hypot(*step))
SHORT_S = 0.1  # shorter than anybody takes to cross a cell
SIGN: dict[str, Any] = {"color": "0.35", "marker": "o", "markersize": 3}  # grey for objects of any colour
FAINTEST_TRAIL = 0.2  # where the scale of trails begins: what is paler cannot be told from the floor
LONE_COLOUR: Colour = (0.90, 0.62, 0.0)
UNCERTAIN_COLOUR: Colour = (0.0, 0.8, 1.0)
BASE_LEGEND = [(BLACK, "static"), (WHITE, "free"), UNEXPLORED]


def draw_objects(found: FoundObjects | History, *, title: str = "", axes: Axes | None = None) -> Figure:
    """Walls, places and objects: each object has a colour, a number, and a line from place to place (Fig. 13).

    Parameters
    ----------
    found : FoundObjects or History
        In a history, objects are found first, by the method ``evidence``.
    title : str
        Put before what is shown.
    axes : matplotlib.axes.Axes, optional
        Where to draw, with the legend below. Default: axes that fit, in a figure of their own.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up. Places that are part of no object have a colour of their own. A dotted line
        leads to a place that was hardly ever seen free (`Configuration.hypothesis`).

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor()).scans)
    >>> draw_objects(grid, title="corridor").axes[0].get_title(loc="left")
    'corridor · 1 object, method evidence'
    """
    found = as_found(found)
    _, extent = cropped(object_cells(found), found.extent)
    sheet = sheet_for(extent.shape, axes)
    paint_objects(sheet.axes, found)
    return sheet.label([title, counts(found)], [*base_legend([found]), *lone_legend([found])], object_signs([found]))


def as_found(found: FoundObjects | History) -> FoundObjects:
    """What was found, or is found now."""
    return found if isinstance(found, FoundObjects) else find_objects(found)


def draw_people(found: FoundObjects | History, *, title: str = "", axes: Axes | None = None) -> Figure:
    """Where things were on the move, and for how long: the trails of people (Fig. 11, over a whole period).

    Each cell shows the time for which it was occupied by what is neither static nor in a place of its own. Parameters
    and result as of `draw_objects`.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> draw_people(grid).axes[1].get_ylabel()  # of the scale of colours
    'seconds occupied by something on the move'
    """
    return people_drawing(as_found(found)).draw(title, axes)


def people_drawing(found: FoundObjects) -> Drawing:
    """What `draw_people` draws."""
    extent = found.history.extent
    seconds = np.zeros(extent.shape)
    for measured in found.high_dynamics():
        seconds[measured.cells[:, 0] - extent.row0, measured.cells[:, 1] - extent.col0] += 1
    period_s = found.history.scan_period_s
    seconds *= period_s if period_s > 0 else 1.0
    walls = found.walls_over(extent)
    rgb = _base(walls)
    longest_s = max(float(seconds.max()), SHORT_S * 10)
    trails = ListedColormap(colormaps["YlOrRd"](np.linspace(FAINTEST_TRAIL, 1, 256)))
    colours = ScalarMappable(LogNorm(SHORT_S, longest_s), trails)
    moving = (seconds > 0) & (walls != CellClass.STATIC)
    rgb[moving] = colours.to_rgba(np.maximum(seconds[moving], SHORT_S))[:, :3]
    what = f"on the move, method {found.method}"
    return Drawing(rgb, extent, what, base_legend([found]), colours, "seconds occupied by something on the move")


def paint_objects(axes: Axes, found: FoundObjects) -> None:
    """`draw_objects` on given axes, without title and legend."""
    rgb, extent = cropped(object_cells(found), found.extent)
    show_map(axes, rgb, extent)
    centres_m = [np.mean([place.centre_m for place in one.configurations], axis=0) for one in found.objects]
    offsets = label_offsets(axes, centres_m, extent)
    for k, one in enumerate(found.objects):
        colour = object_colour(k)
        centres = np.array([place.centre_m for place in one.configurations])
        # A line along the shortest way through them; an object of one place has its number alone.
        order = chain(centres)
        style = ":" if any(place.hypothesis for place in one.configurations) else "-"
        axes.plot(*centres[order].T, color=colour, linewidth=1.6, linestyle=style, marker="o", markersize=3)
        axes.annotate(
            str(one.id),
            centres.mean(axis=0),
            xytext=offsets[k],
            textcoords="offset points",
            fontsize=8,
            color=colour,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],  # a box would hide leaves
        )


def counts(found: FoundObjects) -> str:
    """How much was found, for a title."""
    n_objects, n_others = len(found.objects), len(found.unassociated)
    objects, others = "object" + "s" * (n_objects != 1), "place" + "s" * (n_others != 1)
    lone = f", {n_others} {others} in no object" if n_others else ""
    return f"{n_objects} {objects}{lone}, method {found.method}"


def place_text(one: MovingObject, place: int | None) -> str:
    """A state of an object, in words."""
    if place is None:
        return "away" if len(one.configurations) == 1 else "unclear"
    return f"place {place}"


def label_offsets(axes: Axes, centres_m: Sequence[NDArray[np.float64]], extent: Extent) -> list[tuple[float, float]]:
    """Where numbers stand, in points from their objects: the nearest place that is free, towards the map's middle."""
    x_min, x_max, y_min, y_max = extent.bounds
    box, (width, height) = axes.get_position(), figure_of(axes).get_size_inches()
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


def _base(walls: NDArray[np.int8]) -> Rgb:
    rgb = np.empty((*walls.shape, 3), dtype=np.float32)
    rgb[:] = as_rgb(WHITE)
    rgb[walls == CellClass.UNEXPLORED] = as_rgb(GREY)
    rgb[walls == CellClass.STATIC] = as_rgb(BLACK)
    rgb[walls == CellClass.UNCERTAIN] = as_rgb(UNCERTAIN_COLOUR)
    return rgb


def base_legend(pictures: Sequence[FoundObjects]) -> list[tuple[Colour, str]]:
    """What the map under the objects shows: glass only if there is any."""
    return [*BASE_LEGEND, *uncertain_legend(pictures)]


def uncertain_legend(pictures: Sequence[FoundObjects]) -> list[tuple[Colour, str]]:
    """The colour of uncertain cells, if there are any."""
    anywhere = any(bool((found.walls == CellClass.UNCERTAIN).any()) for found in pictures)
    return [(UNCERTAIN_COLOUR, "uncertain, as glass is")] if anywhere else []


def lone_legend(pictures: Sequence[FoundObjects]) -> list[tuple[Colour, str]]:
    """The colour of places in no object, if there are any."""
    return [(LONE_COLOUR, "place in no object")] if any(found.unassociated for found in pictures) else []


def object_signs(pictures: Sequence[FoundObjects]) -> list[Artist]:
    """The lines of objects, those kinds that there are."""
    objects = [one for found in pictures for one in found.objects]
    guessed = any(place.hypothesis for one in objects for place in one.configurations)
    signs: list[Artist] = []
    if objects:
        signs.append(Line2D([], [], linestyle="-", **SIGN, label="places of one object, with its number"))
    if guessed:
        signs.append(Line2D([], [], linestyle=":", **SIGN, label="one of them hardly ever seen free"))
    return signs


def object_cells(found: FoundObjects) -> Rgb:
    """A colour for each cell: the static map with the places of objects."""
    rgb = _base(found.walls)
    coloured = [(place, LONE_COLOUR) for place in found.unassociated]
    coloured += [(place, object_colour(k)) for k, one in enumerate(found.objects) for place in one.configurations]
    for place, colour in coloured:
        rgb[_rows_cols(found, place)] = as_rgb(colour)
    return rgb


def _rows_cols(found: FoundObjects, place: Configuration) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    extent = found.extent
    return place.cells[:, 0] - extent.row0, place.cells[:, 1] - extent.col0


def chain(centres: NDArray[np.float64]) -> list[int]:
    """Points in the order of a walk that goes from each to the nearest one left, from the first on."""
    order, left = [0], list(range(1, len(centres)))
    while left:
        nearest = min(left, key=lambda k: float(np.hypot(*(centres[k] - centres[order[-1]]))))
        order.append(nearest)
        left.remove(nearest)
    return order
