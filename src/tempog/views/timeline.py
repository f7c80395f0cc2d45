"""Where each object was when."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from tempog.analysis.configurations import Configuration
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.objects import MovingObject
from tempog.grid.history import History
from tempog.times import NS_PER_S
from tempog.views.canvas import LONGEST_SIDE_INCHES, Sheet, figure_of, paler
from tempog.views.objects import as_found, counts, object_colour
from tempog.views.time_axis import set_time_axis

ROW_INCHES = 0.22
DPI = 160
NOT_SEEN: dict[str, Any] = {"facecolor": "0.96", "edgecolor": "0.75", "hatch": "////", "linewidth": 0}
PALE = 0.25  # how much of an object's colour its free places have


def strip_sheet(inches: float, axes: Axes | None) -> Sheet:
    """Given axes, or new ones as wide as a map's and so high, for what goes along time."""
    if axes is not None:
        return Sheet(figure_of(axes), axes, own=False)
    figure = Figure(figsize=(LONGEST_SIDE_INCHES, inches), dpi=DPI, layout="constrained")
    return Sheet(figure, figure.add_subplot(), own=True)


def draw_timeline(found: FoundObjects | History, *, title: str = "", axes: Axes | None = None) -> Figure:
    """When each place of each object was occupied, when free, and when nobody looked.

    A row per place, the rows of one object beside each other in its colour: full where it was occupied, pale where
    it was free, and hatched grey where it was not seen. At the right, the share of the time the object was seen in
    which it was there, and how often it moved. Times are from the log's start, in windows too; long pauses without
    scans, between sessions, are narrow and white, and times are dates then, if the log has any. Parameters as of
    `draw_objects`.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> axes = draw_timeline(build_grid(simulate(corridor()).scans)).axes[0]
    >>> [label.get_text() for label in axes.get_yticklabels()]
    ['object 1, place 1 (7.0, 2.5)', 'object 1, place 2 (7.4, 3.2)']
    """
    found = as_found(found)
    rows = [(k, one, place) for k, one in enumerate(found.objects) for place in one.configurations]
    start_ns = int(found.history.stamps_ns[0])
    first_s, stop_s = (
        (int(found.history.stamps_ns[k]) - start_ns) / NS_PER_S
        for k in (found.history.first_scan, found.history.last_scan)
    )
    stop_s = max(stop_s, first_s + 1e-3)
    sheet = strip_sheet(1.2 + ROW_INCHES * max(len(rows), 5), axes)
    axes = sheet.axes
    for y, (k, _, place) in enumerate(rows):
        axes.broken_barh([(first_s, stop_s - first_s)], (y - 0.4, 0.8), **NOT_SEEN)
        for state, pale in (("occupied", 1.0), ("free", PALE)):
            spans = [
                ((start - start_ns) / NS_PER_S, (stop - start) / NS_PER_S)
                for start, stop, at in place.periods
                if at == state
            ]
            axes.broken_barh(spans, (y - 0.4, 0.8), facecolor=paler(object_colour(k), pale), linewidth=0)
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
    if rows:
        axes.set_title("share of the time the object was seen, moves", fontsize=7, loc="right")
    else:
        nothing = "No objects were found, so there are no times to show."
        axes.text(0.5, 0.5, nothing, transform=axes.transAxes, ha="center", va="center", fontsize=9)
    colour = object_colour(0)
    states = [(colour, "occupied"), (paler(colour, PALE), "free")]
    return sheet.label([title, counts(found)], states, [Patch(**NOT_SEEN, label="not seen")])


def _course_text(one: MovingObject, place: Configuration) -> str:
    """Share of the time seen in a place; for the first place also how often the object moved."""
    text = f"{one.shares[place.id]:.0%}"
    if place is one.configurations[0]:
        text += f", {one.n_moves} move{'s' * (one.n_moves != 1)}"
    return f"{text}, hypothesis" if place.hypothesis else text
