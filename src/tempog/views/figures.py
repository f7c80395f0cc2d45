"""Pictures of a map: one Matplotlib figure per layer, with scale bar, legend and the time in the title.

Static is black, free white and unexplored grey throughout, as in the paper's figures.
"""

from __future__ import annotations

import math
from typing import NamedTuple, get_args

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.find_objects import find_objects
from tempog.analysis.occupancy import CLAMP_PROB_HIGH, CLAMP_PROB_LOW, occupancy_grid
from tempog.analysis.static import CellClass, static_map
from tempog.errors import ConfigError
from tempog.grid.history import History
from tempog.methods import Method
from tempog.times import Moment
from tempog.views.canvas import (
    BLACK,
    GREY,
    ORANGE,
    UNEXPLORED,
    WHITE,
    Colour,
    Rgb,
    add_legend,
    as_rgb,
    as_shades,
    canvas,
    cropped,
    show_map,
)
from tempog.views.layers import FOUND_LAYERS, MOMENT_LAYERS, Layer
from tempog.views.objects import draw_high_dynamic, draw_objects, draw_timeline

MAX_DYNAMICS = 0.5
# Dynamics below the first are left uncoloured, from the second on drawn in full colour, so that what moves
# stands out from walls and floor. 0.1 is a cell in its rarer state for 7 % of the time, 0.3 for 25 %.
FAINT_DYNAMICS, FULL_DYNAMICS = 0.1, 0.3


class _Drawing(NamedTuple):
    """What a layer puts on the axes."""

    rgb: Rgb
    title: str
    legend: list[tuple[Colour, str]]
    colours: ScalarMappable | None = None
    colours_label: str = ""


def draw_layer(
    history: History,
    layer: Layer = "occupancy",
    *,
    at: Moment | None = None,
    hold: float = math.inf,
    method: Method = "evidence",
    title: str = "",
) -> Figure:
    """One layer of a map as a figure.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    layer : "occupancy", "static", "dynamics", "classic", "age", "objects", "high-dynamic" or "timeline"
        ``occupancy`` and ``age`` show one moment; the others the whole of `history`.
    at : moment, optional
        For the layers of a moment; default: the last scan.
    hold : float, seconds
        For the layers of a moment: how long a cell keeps its last known state.
    method : "evidence", "paper" or "paper-tuned"
        For the objects, see `find_objects`; to draw objects that are found already, use `draw_objects`.
    title : str
        Put before what is shown.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up. Save it with ``figure.savefig("map.png")``.

    Raises
    ------
    ConfigError
        An unknown layer, or a moment for a layer of a period.
    """
    if layer not in get_args(Layer):
        raise ConfigError(f"layer = {layer!r} cannot work; wanted one of {', '.join(get_args(Layer))}")
    if at is not None and layer not in MOMENT_LAYERS:
        raise ConfigError(f"the {layer} layer shows a period, not a moment; use a window instead of at")
    history.require_scans()
    if layer in FOUND_LAYERS:
        draw = {"objects": draw_objects, "high-dynamic": draw_high_dynamic, "timeline": draw_timeline}[layer]
        return draw(find_objects(history, method), title=title)
    is_moment = layer in MOMENT_LAYERS
    drawing = _moment_drawing(history, layer, at, hold) if is_moment else _period_drawing(history, layer)
    rgb, extent = cropped(drawing.rgb, history.extent)
    figure, axes = canvas(*extent.shape, has_bar=drawing.colours is not None)
    show_map(axes, rgb, extent)
    axes.set_title(" · ".join(part for part in (title, drawing.title) if part), fontsize=9, loc="left")
    add_legend(figure, drawing.legend)
    if drawing.colours is not None:
        bar = figure.colorbar(drawing.colours, ax=axes, shrink=0.8, pad=0.015, aspect=30)
        bar.set_label(drawing.colours_label, fontsize=8)
        bar.ax.tick_params(labelsize=8)
    return figure


def _moment_drawing(history: History, layer: str, at: Moment | None, hold: float) -> _Drawing:
    moment = at if at is not None else np.datetime64(int(history.stamps_ns[history.last_scan]), "ns")
    snapshot = history.at(moment, hold)
    when = history.format_moment(snapshot.stamp_ns)
    known = "last known state" if hold == math.inf else f"seen within {hold:g} s" if hold else "as observed"
    if layer == "occupancy":
        free, hit = history.config.sensing.prob_free, history.config.sensing.prob_hit
        rgb = as_shades((snapshot.value - free) / (hit - free))
        return _Drawing(rgb, f"occupancy at {when}, {known}", [(BLACK, "occupied"), (WHITE, "free"), UNEXPLORED])
    age_s = snapshot.age_s.astype(np.float64)
    longest_s = max(10.0, float(np.nanmax(age_s))) if np.isfinite(age_s).any() else 10.0
    colours = ScalarMappable(LogNorm(1.0, longest_s), colormaps["viridis_r"])
    rgb = colours.to_rgba(np.nan_to_num(np.maximum(age_s, 1.0), nan=1.0))[..., :3].astype(np.float32)
    rgb[np.isnan(age_s)] = GREY
    return _Drawing(rgb, f"age at {when}", [UNEXPLORED], colours, "seconds since last seen (1 s or less: lightest)")


def _period_drawing(history: History, layer: str) -> _Drawing:
    first, last = (history.format_moment(int(history.stamps_ns[k])) for k in (history.first_scan, history.last_scan))
    period = f"{first} to {last}"
    if layer == "classic":
        legend = [(BLACK, "occupied"), (WHITE, "free"), UNEXPLORED]
        return _Drawing(classic_rgb(history), f"classic occupancy grid, {period}", legend)
    rgb = _static_base(history)
    if layer == "static":
        legend = [(BLACK, "static"), (WHITE, "free"), (ORANGE, "changing"), UNEXPLORED]
        return _Drawing(rgb, f"static map, {period}", legend)
    rgb[np.all(rgb == as_rgb(ORANGE), axis=-1)] = WHITE
    dynamics = map_dynamics(history).astype(np.float64)
    rgb = _tinted(rgb, np.nan_to_num(dynamics))
    scale = np.linspace(0, MAX_DYNAMICS, 256)
    as_on_floor = _tinted(np.tile(as_rgb(WHITE), (256, 1)), scale)
    colours = ScalarMappable(Normalize(0, MAX_DYNAMICS), ListedColormap(as_on_floor))
    legend = [(BLACK, "static"), (WHITE, "free"), UNEXPLORED]
    label = f"mean absolute deviation of P(occupied); under {FAINT_DYNAMICS:g} uncoloured"
    return _Drawing(rgb, f"dynamics, {period}", legend, colours, label)


def classic_rgb(history: History) -> Rgb:
    """The classic occupancy grid in shades, over the history's extent."""
    return as_shades((occupancy_grid(history) - CLAMP_PROB_LOW) / (CLAMP_PROB_HIGH - CLAMP_PROB_LOW))


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
