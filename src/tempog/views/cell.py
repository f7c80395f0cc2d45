"""The history of one cell."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from tempog.errors import TimeError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.times import NS_PER_S
from tempog.views.canvas import BLACK
from tempog.views.time_axis import set_time_axis
from tempog.views.timeline import NOT_SEEN, strip_sheet

INCHES = 2.4
FREE_GREY = "0.85"


def draw_cell(history: History, x: float, y: float, *, title: str = "", axes: Axes | None = None) -> Figure:
    """Every state of the cell at a point, as high as its P(occupied), and when nobody looked (Fig. 1).

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    x, y : float, metres
        In the map frame.
    title : str
        Put before what is shown.
    axes : matplotlib.axes.Axes, optional
        Where to draw, with the legend below. Default: axes of a figure of their own.

    Returns
    -------
    matplotlib.figure.Figure
        Seconds from the log's start on x, P(occupied) on y; long pauses without scans are narrow.

    Raises
    ------
    TimeError
        Nothing was ever seen there, in this period.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=60.0).scans)
    >>> draw_cell(grid, 6.98, 2.53).axes[0].get_title(loc="left")
    'cell at (6.98, 2.53) m · 3 intervals'
    """
    states = history.history(x, y)
    if not len(states):
        raise TimeError(f"the cell at ({x:g}, {y:g}) m was not seen in this period, so there is nothing to draw")
    stamps = history.stamps_ns[history.first_scan : history.last_scan + 1]
    start_ns = history.start_ns
    sheet = strip_sheet(INCHES, axes)
    axes = sheet.axes
    first_s, stop_s = ((int(stamp) - start_ns) / NS_PER_S for stamp in (stamps[0], stamps[-1]))
    axes.axvspan(first_s, max(stop_s, first_s + 1e-3), **NOT_SEEN)
    # Looks that follow each other closely are one view: what is between them is drawn as what was seen before.
    since_s, until_s = ((ends - start_ns) / NS_PER_S for ends in (states.start_ns, states.stop_ns))
    close = np.append(since_s[1:] - until_s[:-1] <= history.gap_s, False)
    until_s = np.where(close, np.append(since_s[1:], 0.0), until_s)
    width = np.maximum(until_s - since_s, (stop_s - first_s) / 2000)  # a single look is a line
    colours = [BLACK if value > OCCUPIED_ABOVE else FREE_GREY for value in states.value.tolist()]
    axes.bar(since_s, np.ones(len(states)), width, align="edge", color="white", linewidth=0)
    axes.bar(since_s, states.value, width, align="edge", color=colours, linewidth=0)
    axes.axhline(OCCUPIED_ABOVE, color="0.5", linewidth=0.8, linestyle=":")
    axes.set(ylim=(0, 1), ylabel="P(occupied)")
    set_time_axis(axes, stamps, start_ns)
    signs = [
        Patch(facecolor=BLACK, edgecolor="0.4", linewidth=0.5, label="occupied"),
        Patch(facecolor=FREE_GREY, edgecolor="0.4", linewidth=0.5, label="free"),
        Patch(**NOT_SEEN, label="not seen"),
    ]
    plural = "s" * (len(states) != 1)
    return sheet.label([title, f"cell at ({x:g}, {y:g}) m", f"{len(states)} interval{plural}"], [], signs)
