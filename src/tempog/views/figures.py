"""Pictures of a map: one Matplotlib figure per layer, with scale bar, legend and the time in the title.

Static is black, free white and unexplored grey throughout, as in the paper's figures.
"""

from __future__ import annotations

import math
from typing import NamedTuple, get_args

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.occupancy import CLAMP_PROB_HIGH, CLAMP_PROB_LOW, occupancy_grid
from tempog.analysis.static import CellClass, static_map
from tempog.errors import ConfigError
from tempog.grid.history import History
from tempog.sensing.grid_spec import Extent
from tempog.times import Moment
from tempog.views.layers import MOMENT_LAYERS, Layer

BLACK, WHITE, GREY, ORANGE = (0.07, 0.07, 0.09), (1.0, 1.0, 1.0), (0.74, 0.75, 0.77), (0.95, 0.55, 0.1)
MARGIN_SHARE = 0.02  # of the longer side, unexplored space left around what was seen
PIXELS_PER_CELL = 3
LONGEST_SIDE_PX = (900, 3600)  # a small map is still readable, a large one still a picture
LONGEST_SIDE_INCHES = 9.0  # text keeps its size relative to the picture, whatever the resolution
MAX_DYNAMICS = 0.5
# Dynamics below the first are left uncoloured, from the second on drawn in full colour, so that what moves
# stands out from walls and floor. 0.1 is a cell in its rarer state for 7 % of the time, 0.3 for 25 %.
FAINT_DYNAMICS, FULL_DYNAMICS = 0.1, 0.3

Rgb = NDArray[np.float32]


class _Drawing(NamedTuple):
    """What a layer puts on the axes."""

    rgb: Rgb
    title: str
    legend: list[tuple[tuple[float, float, float], str]]
    colours: ScalarMappable | None = None
    colours_label: str = ""


def draw_layer(
    history: History,
    layer: Layer = "occupancy",
    *,
    at: Moment | None = None,
    hold: float = math.inf,
    title: str = "",
) -> Figure:
    """One layer of a map as a figure.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    layer : "occupancy", "static", "dynamics", "classic" or "age"
        ``occupancy`` and ``age`` show one moment; the others the whole of `history`.
    at : moment, optional
        For the layers of a moment; default: the last scan.
    hold : float, seconds
        For the layers of a moment: how long a cell keeps its last known state.
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
    is_moment = layer in MOMENT_LAYERS
    drawing = _moment_drawing(history, layer, at, hold) if is_moment else _period_drawing(history, layer)
    rgb, extent = _cropped(drawing.rgb, history.extent)
    figure, axes = _canvas(*extent.shape, has_bar=drawing.colours is not None)
    axes.imshow(rgb, origin="lower", extent=extent.bounds, interpolation="nearest")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.set_title(" · ".join(part for part in (title, drawing.title) if part), fontsize=9, loc="left")
    axes.tick_params(labelsize=8)
    _add_scale_bar(axes, rgb, extent)
    handles = [
        Patch(facecolor=colour, edgecolor="0.4", linewidth=0.5, label=label) for colour, label in drawing.legend
    ]
    # Below the picture, so that no part of the map is covered.
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)
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
        rgb = _shades((snapshot.value - free) / (hit - free))
        return _Drawing(rgb, f"occupancy at {when}, {known}", [(BLACK, "occupied"), (WHITE, "free"), _UNEXPLORED])
    age_s = snapshot.age_s.astype(np.float64)
    longest_s = max(10.0, float(np.nanmax(age_s))) if np.isfinite(age_s).any() else 10.0
    colours = ScalarMappable(LogNorm(1.0, longest_s), colormaps["viridis_r"])
    rgb = colours.to_rgba(np.nan_to_num(np.maximum(age_s, 1.0), nan=1.0))[..., :3].astype(np.float32)
    rgb[np.isnan(age_s)] = GREY
    return _Drawing(rgb, f"age at {when}", [_UNEXPLORED], colours, "seconds since last seen (1 s or less: lightest)")


def _period_drawing(history: History, layer: str) -> _Drawing:
    first, last = (history.format_moment(int(history.stamps_ns[k])) for k in (history.first_scan, history.last_scan))
    period = f"{first} to {last}"
    if layer == "classic":
        share = (occupancy_grid(history) - CLAMP_PROB_LOW) / (CLAMP_PROB_HIGH - CLAMP_PROB_LOW)
        rgb = _shades(share)
        legend = [(BLACK, "occupied"), (WHITE, "free"), _UNEXPLORED]
        return _Drawing(rgb, f"classic occupancy grid, {period}", legend)
    rgb = _static_base(history)
    if layer == "static":
        legend = [(BLACK, "static"), (WHITE, "free"), (ORANGE, "changing"), _UNEXPLORED]
        return _Drawing(rgb, f"static map, {period}", legend)
    rgb[np.all(rgb == _rgb(ORANGE), axis=-1)] = WHITE
    dynamics = map_dynamics(history).astype(np.float64)
    rgb = _tinted(rgb, np.nan_to_num(dynamics))
    scale = np.linspace(0, MAX_DYNAMICS, 256)
    as_on_floor = _tinted(np.tile(_rgb(WHITE), (256, 1)), scale)
    colours = ScalarMappable(Normalize(0, MAX_DYNAMICS), ListedColormap(as_on_floor))
    legend = [(BLACK, "static"), (WHITE, "free"), _UNEXPLORED]
    label = f"mean absolute deviation of P(occupied); under {FAINT_DYNAMICS:g} uncoloured"
    return _Drawing(rgb, f"dynamics, {period}", legend, colours, label)


_UNEXPLORED = (GREY, "unexplored")


def _rgb(colour: tuple[float, float, float]) -> Rgb:
    return np.array(colour, dtype=np.float32)


def _shades(occupied: NDArray[np.float32]) -> Rgb:
    """White for 0 to black for 1; grey for NaN."""
    share = np.clip(occupied, 0, 1)[..., None]
    rgb = _rgb(WHITE) * (1 - share) + _rgb(BLACK) * share
    rgb[np.isnan(occupied)] = GREY
    return rgb


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


def _cropped(rgb: Rgb, extent: Extent) -> tuple[Rgb, Extent]:
    """The part of a picture that holds something, in a grey margin, and where that part lies."""
    seen = np.any(rgb != _rgb(GREY), axis=-1)
    if not seen.any():
        seen = np.ones_like(seen)
    rows, cols = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    part = rgb[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    margin = math.ceil(MARGIN_SHARE * max(part.shape)) + 1
    framed = np.empty((part.shape[0] + 2 * margin, part.shape[1] + 2 * margin, 3), dtype=np.float32)
    framed[:] = GREY
    framed[margin:-margin, margin:-margin] = part
    row0, col0 = extent.row0 + int(rows[0]) - margin, extent.col0 + int(cols[0]) - margin
    return framed, Extent(row0, col0, framed.shape[0], framed.shape[1], extent.resolution_m)


def _canvas(n_rows: int, n_cols: int, has_bar: bool) -> tuple[Figure, Axes]:
    """A figure whose axes fit the picture, with room for labels."""
    longest_px = min(max(max(n_rows, n_cols) * PIXELS_PER_CELL, LONGEST_SIDE_PX[0]), LONGEST_SIDE_PX[1])
    inches_per_cell = LONGEST_SIDE_INCHES / max(n_rows, n_cols)
    size = (max(n_cols * inches_per_cell, 4.5) + 0.8 + 0.9 * has_bar, max(n_rows * inches_per_cell, 1.5) + 1.2)
    figure = Figure(figsize=size, dpi=longest_px / LONGEST_SIDE_INCHES, layout="constrained")
    return figure, figure.add_subplot()


def _add_scale_bar(axes: Axes, rgb: Rgb, extent: Extent) -> None:
    """A bar of a round length, in the corner that hides least of the map."""
    x_min, x_max, y_min, y_max = extent.bounds
    width, height = x_max - x_min, y_max - y_min
    wanted = width / 6
    decade = 10 ** math.floor(math.log10(wanted))
    length = max(step * decade for step in (1, 2, 5) if step * decade <= wanted)
    seen = np.any(rgb != _rgb(GREY), axis=-1)
    n_rows, n_cols = max(extent.n_rows // 8, 1), max(round(1.2 * length / extent.resolution_m), 1)
    corners = {
        (0.015, 0.03): seen[:n_rows, :n_cols],
        (0.985 - length / width, 0.03): seen[:n_rows, -n_cols:],
        (0.015, 0.9): seen[-n_rows:, :n_cols],
        (0.985 - length / width, 0.9): seen[-n_rows:, -n_cols:],
    }
    across, up = min(corners, key=lambda corner: float(corners[corner].mean()))
    x, y = x_min + across * width, y_min + up * height
    axes.plot([x, x + length], [y, y], color="black", linewidth=3, solid_capstyle="butt")
    axes.annotate(
        f"{length:g} m",
        (x + length / 2, y),
        xytext=(0, 4),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5},
    )
    axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max))
