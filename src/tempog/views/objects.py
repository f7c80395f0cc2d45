"""What was found, drawn: walls, places in colours and lines between those of one object (Fig. 13), trails, times."""

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
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.objects import MovingObject
from tempog.analysis.static import CellClass
from tempog.sensing.grid_spec import Extent
from tempog.times import NS_PER_S
from tempog.views.canvas import (
    BLACK,
    GREY,
    LONGEST_SIDE_INCHES,
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
from tempog.views.time_axis import set_time_axis

# Okabe and Ito's colours, which colour-blind people can tell apart, without black, the colour of lone places, and sky
# blue, which looks like that of glass.
OBJECT_COLOURS: tuple[Colour, ...] = (
    (0.0, 0.45, 0.70),
    (0.84, 0.37, 0.0),
    (0.0, 0.62, 0.45),
    (0.80, 0.47, 0.65),
    (0.40, 0.18, 0.58),
    (0.55, 0.34, 0.29),
)
LABEL_POINTS = (13, 10)  # width and height of a number of two digits
LABEL_STEPS = sorted(((right, up) for right in range(-2, 6) for up in range(6)), key=lambda step: math.hypot(*step))
SHORT_S = 0.1  # shorter than anybody takes to cross a cell
ROW_INCHES = 0.22
SIGN: dict[str, Any] = {"color": "0.35", "marker": "o", "markersize": 3}  # grey for objects of any colour
FAINTEST_TRAIL = 0.2  # where the scale of trails begins: what is paler cannot be told from the floor
NOT_SEEN: dict[str, Any] = {"facecolor": "0.96", "edgecolor": "0.75", "hatch": "////", "linewidth": 0}
PALE = 0.25  # how much of an object's colour its free places have
LONE_COLOUR: Colour = (0.90, 0.62, 0.0)
UNCERTAIN_COLOUR: Colour = (0.0, 0.85, 0.85)
BASE_LEGEND = [(BLACK, "static"), (WHITE, "free"), UNEXPLORED]


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
        Axes in metres, map frame, y up. Places that are part of no object have a colour of their own. A dotted line
        leads to a place that was hardly ever seen free (`Configuration.hypothesis`).
    """
    _, extent = cropped(_cells(found), found.extent)
    figure, axes = canvas(*extent.shape, has_bar=False)
    paint_objects(axes, found)
    axes.set_title(" · ".join(part for part in (title, counts(found)) if part), fontsize=9, loc="left")
    add_legend(figure, [*base_legend([found]), *lone_legend([found])], object_signs([found]))
    return figure


def draw_high_dynamic(found: FoundObjects, *, title: str = "") -> Figure:
    """Where things were on the move, and for how long: the trails of people (Fig. 11, over a whole period).

    Each cell shows the time for which it was occupied by what is neither static nor in a place of its own.
    """
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
    rgb, shown = cropped(rgb, extent)
    figure, axes = canvas(*shown.shape, has_bar=True)
    show_map(axes, rgb, shown)
    what = f"on the move, method {found.method}"
    axes.set_title(" · ".join(part for part in (title, what) if part), fontsize=9, loc="left")
    bar = figure.colorbar(colours, ax=axes, shrink=0.8, pad=0.015, aspect=30, format="%g")
    bar.set_label("seconds occupied by something on the move", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    add_legend(figure, base_legend([found]))
    return figure


def draw_timeline(found: FoundObjects, *, title: str = "") -> Figure:
    """When each place of each object was occupied, when free, and when nobody looked.

    A row per place, the rows of one object beside each other in its colour: full where it was occupied, pale where
    it was free, and hatched grey where it was not seen. At the right, the share of the time the object was seen in
    which it was there, and how often it moved. Times are from the log's start, in windows too; long pauses without
    scans, between sessions, are narrow and white, and times are dates then, if the log has any.
    """
    rows = [(k, one, place) for k, one in enumerate(found.objects) for place in one.configurations]
    start_ns = int(found.history.stamps_ns[0])
    first_s, stop_s = (
        (int(found.history.stamps_ns[k]) - start_ns) / NS_PER_S
        for k in (found.history.first_scan, found.history.last_scan)
    )
    stop_s = max(stop_s, first_s + 1e-3)
    figure = Figure(
        figsize=(LONGEST_SIDE_INCHES, 1.2 + ROW_INCHES * max(len(rows), 5)), dpi=160, layout="constrained"
    )
    axes = figure.add_subplot()
    for y, (k, _, place) in enumerate(rows):
        axes.broken_barh([(first_s, stop_s - first_s)], (y - 0.4, 0.8), **NOT_SEEN)
        for state, pale in (("occupied", 1.0), ("free", PALE)):
            spans = [
                ((start - start_ns) / NS_PER_S, (stop - start) / NS_PER_S)
                for start, stop, at in place.periods
                if at == state
            ]
            axes.broken_barh(spans, (y - 0.4, 0.8), facecolor=_paler(object_colour(k), pale), linewidth=0)
    labels = [
        f"object {one.id}, place {place.id} ({place.centre_m[0]:.1f}, {place.centre_m[1]:.1f})"
        for _, one, place in rows
    ]
    axes.set_yticks(range(len(rows)), labels, fontsize=7)
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    set_time_axis(axes, found.history.stamps_ns[found.history.first_scan : found.history.last_scan + 1], start_ns)
    summary = axes.secondary_yaxis("right")
    summary.set_yticks(range(len(rows)), [_course_text(one, place) for _, one, place in rows], fontsize=7)
    summary.tick_params(length=0)
    axes.set_title(" · ".join(part for part in (title, counts(found)) if part), fontsize=9, loc="left")
    if rows:
        axes.set_title("share of the time the object was seen, moves", fontsize=7, loc="right")
    else:
        nothing = "No objects were found, so there are no times to show."
        axes.text(0.5, 0.5, nothing, transform=axes.transAxes, ha="center", va="center", fontsize=9)
    colour = object_colour(0)
    states = [(colour, "occupied"), (_paler(colour, PALE), "free")]
    add_legend(figure, states, [Patch(**NOT_SEEN, label="not seen")])
    return figure


def _course_text(one: MovingObject, place: Configuration) -> str:
    """Share of the time seen in a place; for the first place also how often the object moved."""
    text = f"{one.shares[place.id]:.0%}"
    if place is one.configurations[0]:
        text += f", {one.n_moves} move{'s' * (one.n_moves != 1)}"
    return f"{text}, hypothesis" if place.hypothesis else text


def paint_objects(axes: Axes, found: FoundObjects) -> None:
    """`draw_objects` on given axes, without title and legend."""
    rgb, extent = cropped(_cells(found), found.extent)
    show_map(axes, rgb, extent)
    centres_m = [np.mean([place.centre_m for place in one.configurations], axis=0) for one in found.objects]
    offsets = label_offsets(axes, centres_m, extent)
    for k, one in enumerate(found.objects):
        colour = object_colour(k)
        centres = np.array([place.centre_m for place in one.configurations])
        # A line along the shortest way through them; an object of one place has its number alone.
        order = _chain(centres)
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


def _paler(colour: Colour, share: float) -> Colour:
    red, green, blue = (1 - share * (1 - part) for part in colour)
    return red, green, blue


def _cells(found: FoundObjects) -> Rgb:
    rgb = _base(found.walls)
    coloured = [(place, LONE_COLOUR) for place in found.unassociated]
    coloured += [(place, object_colour(k)) for k, one in enumerate(found.objects) for place in one.configurations]
    for place, colour in coloured:
        rgb[_rows_cols(found, place)] = as_rgb(colour)
    return rgb


def _rows_cols(found: FoundObjects, place: Configuration) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    extent = found.extent
    return place.cells[:, 0] - extent.row0, place.cells[:, 1] - extent.col0


def _chain(centres: NDArray[np.float64]) -> list[int]:
    """Points in the order of a walk that goes from each to the nearest one left, from the first on."""
    order, left = [0], list(range(1, len(centres)))
    while left:
        nearest = min(left, key=lambda k: float(np.hypot(*(centres[k] - centres[order[-1]]))))
        order.append(nearest)
        left.remove(nearest)
    return order
