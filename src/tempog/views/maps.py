"""Layers of a map: what each cell is coloured, and figures of that.

Static is black, free white and unexplored grey throughout, as in the paper's figures.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.occupancy import CLAMP_PROB_HIGH, CLAMP_PROB_LOW, occupancy_grid
from tempog.analysis.static import CellClass, static_map
from tempog.grid.history import History
from tempog.sensing.grid_spec import Extent
from tempog.times import Moment
from tempog.views.canvas import (
    BLACK,
    GREY,
    ORANGE,
    UNEXPLORED,
    WHITE,
    Colour,
    Rgb,
    as_rgb,
    as_shades,
    cropped,
    sheet_for,
    show_map,
)

MAX_DYNAMICS = 0.5
# Dynamics below the first are left uncoloured, from the second on drawn in full colour, so that what moves
# stands out from walls and floor. 0.1 is a cell in its rarer state for 7 % of the time, 0.3 for 25 %.
FAINT_DYNAMICS, FULL_DYNAMICS = 0.1, 0.3
STATE_LEGEND = [(BLACK, "occupied"), (WHITE, "free"), UNEXPLORED]


class Drawing(NamedTuple):
    """What a layer shows: a colour for each cell of an extent, what it is, and what the colours mean.

    `colours` is a scale, with `colours_label`, for what has no single colour.
    """

    rgb: Rgb
    extent: Extent
    title: str
    legend: list[tuple[Colour, str]]
    colours: ScalarMappable | None = None
    colours_label: str = ""

    def draw(self, title: str, axes: Axes | None) -> Figure:
        """A figure of it, or the figure whose axes it was drawn on."""
        rgb, extent = cropped(self.rgb, self.extent)
        sheet = sheet_for(extent.shape, axes, has_bar=self.colours is not None)
        show_map(sheet.axes, rgb, extent)
        figure = sheet.label([title, self.title], self.legend)
        if self.colours is not None:
            sheet.add_colour_bar(self.colours, self.colours_label)
        return figure


def draw_occupancy(
    history: History,
    *,
    at: Moment | None = None,
    hold: float = math.inf,
    title: str = "",
    axes: Axes | None = None,
) -> Figure:
    """The map at one moment: black occupied, white free, grey unknown, the shades of P(occupied) between.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    at : moment, optional
        See `History.at`. Default: the last scan.
    hold : float, seconds
        How long a cell keeps its last known state; by default for ever.
    title : str
        Put before what is shown.
    axes : matplotlib.axes.Axes, optional
        Where to draw, with the legend below. Default: axes that fit, in a figure of their own.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> draw_occupancy(grid, at="+10").axes[0].get_title(loc="left")
    'occupancy at 2025-06-15 15:06:50 UTC (+10.0 s), last known state'
    """
    return occupancy_drawing(history, at, hold).draw(title, axes)


def draw_age(
    history: History,
    *,
    at: Moment | None = None,
    hold: float = math.inf,
    title: str = "",
    axes: Axes | None = None,
) -> Figure:
    """For how long each cell had not been seen at a moment; parameters and result as of `draw_occupancy`.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> draw_age(grid, title="corridor").axes[0].get_title(loc="left")
    'corridor · age at 2025-06-15 15:06:59 UTC (+19.9 s)'
    """
    return age_drawing(history, at, hold).draw(title, axes)


def draw_static(history: History, *, title: str = "", axes: Axes | None = None) -> Figure:
    """What never moves, what changes, and the floor (Fig. 6, each state weighted by its time; see `static_map`).

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either: the period that counts.
    title : str
        Put before what is shown.
    axes : matplotlib.axes.Axes, optional
        Where to draw, with the legend below. Default: axes that fit, in a figure of their own.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> draw_static(grid.window("+5", "+10")).axes[0].get_title(loc="left").split(", ")[0]
    'static map'
    """
    return static_drawing(history).draw(title, axes)


def draw_dynamics(history: History, *, title: str = "", axes: Axes | None = None) -> Figure:
    """How much each cell changes (Fig. 5), over the static map; parameters and result as of `draw_static`.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> draw_dynamics(grid).axes[1].get_ylabel()  # of the scale of colours
    'mean absolute deviation of P(occupied); under 0.1 uncoloured'
    """
    return dynamics_drawing(history).draw(title, axes)


def draw_classic(history: History, *, title: str = "", axes: Axes | None = None) -> Figure:
    """The ordinary occupancy grid, which the paper compares with (Fig. 14); otherwise as `draw_static`.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> draw_classic(grid).axes[0].get_title(loc="left").split(", ")[0]
    'classic occupancy grid'
    """
    return classic_drawing(history).draw(title, axes)


def occupancy_drawing(history: History, at: Moment | None = None, hold: float = math.inf) -> Drawing:
    """What `draw_occupancy` draws."""
    snapshot = history.at(_moment(history, at), hold)
    known = "last known state" if hold == math.inf else f"seen within {hold:g} s" if hold else "as observed"
    free, hit = history.config.sensing.prob_free, history.config.sensing.prob_hit
    rgb = as_shades((snapshot.value - free) / (hit - free))
    title = f"occupancy at {history.format_moment(snapshot.stamp_ns)}, {known}"
    return Drawing(rgb, snapshot.extent, title, list(STATE_LEGEND))


def age_drawing(history: History, at: Moment | None = None, hold: float = math.inf) -> Drawing:
    """What `draw_age` draws."""
    snapshot = history.at(_moment(history, at), hold)
    age_s = snapshot.age_s.astype(np.float64)
    longest_s = max(10.0, float(np.nanmax(age_s))) if np.isfinite(age_s).any() else 10.0
    colours = ScalarMappable(LogNorm(1.0, longest_s), colormaps["viridis_r"])
    rgb = colours.to_rgba(np.nan_to_num(np.maximum(age_s, 1.0), nan=1.0))[..., :3].astype(np.float32)
    rgb[np.isnan(age_s)] = GREY
    title = f"age at {history.format_moment(snapshot.stamp_ns)}"
    label = "seconds since last seen (1 s or less: lightest)"
    return Drawing(rgb, snapshot.extent, title, [UNEXPLORED], colours, label)


def static_drawing(history: History) -> Drawing:
    """What `draw_static` draws."""
    legend = [(BLACK, "static"), (WHITE, "free"), (ORANGE, "changing"), UNEXPLORED]
    return Drawing(_static_base(history), history.extent, f"static map, {period_text(history)}", legend)


def dynamics_drawing(history: History) -> Drawing:
    """What `draw_dynamics` draws."""
    rgb = _static_base(history)
    rgb[np.all(rgb == as_rgb(ORANGE), axis=-1)] = WHITE
    rgb = _tinted(rgb, np.nan_to_num(map_dynamics(history).astype(np.float64)))
    scale = np.linspace(0, MAX_DYNAMICS, 256)
    as_on_floor = _tinted(np.tile(as_rgb(WHITE), (256, 1)), scale)
    colours = ScalarMappable(Normalize(0, MAX_DYNAMICS), ListedColormap(as_on_floor))
    legend = [(BLACK, "static"), (WHITE, "free"), UNEXPLORED]
    label = f"mean absolute deviation of P(occupied); under {FAINT_DYNAMICS:g} uncoloured"
    return Drawing(rgb, history.extent, f"dynamics, {period_text(history)}", legend, colours, label)


def classic_drawing(history: History) -> Drawing:
    """What `draw_classic` draws."""
    title = f"classic occupancy grid, {period_text(history)}"
    return Drawing(classic_rgb(history), history.extent, title, list(STATE_LEGEND))


def classic_rgb(history: History) -> Rgb:
    """The classic occupancy grid in shades, over the history's extent."""
    return as_shades((occupancy_grid(history) - CLAMP_PROB_LOW) / (CLAMP_PROB_HIGH - CLAMP_PROB_LOW))


def period_text(history: History) -> str:
    """From when to when a history goes."""
    history.require_scans()
    stamps = history.stamps_ns
    return " to ".join(history.format_moment(int(stamps[k])) for k in (history.first_scan, history.last_scan))


def _moment(history: History, at: Moment | None) -> Moment:
    history.require_scans()
    return at if at is not None else np.datetime64(int(history.stamps_ns[history.last_scan]), "ns")


def _tinted(rgb: Rgb, dynamics: NDArray[np.float64]) -> Rgb:
    """Colour cells by their dynamics, the stronger the more they change."""
    strength = np.clip((dynamics - FAINT_DYNAMICS) / (FULL_DYNAMICS - FAINT_DYNAMICS), 0, 1)[..., None]
    tint = colormaps["YlOrRd"](dynamics / MAX_DYNAMICS)[..., :3]
    return (rgb * (1 - strength) + tint * strength).astype(np.float32)


def _static_base(history: History) -> Rgb:
    classes = static_map(history)
    rgb = np.empty((*classes.shape, 3), dtype=np.float32)
    for cell_class, colour in (
        (CellClass.UNEXPLORED, GREY),
        (CellClass.FREE, WHITE),
        (CellClass.STATIC, BLACK),
        (CellClass.CHANGING, ORANGE),
    ):
        rgb[classes == cell_class] = colour
    return rgb
