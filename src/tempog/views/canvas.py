"""What all pictures share: colours, a canvas that fits the map, a frame around what was seen, a scale bar."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.transforms import offset_copy
from numpy.typing import NDArray

from tempog.sensing.grid_spec import Extent

Colour = tuple[float, float, float]
Rgb = NDArray[np.float32]

BLACK, WHITE, GREY, ORANGE = (0.07, 0.07, 0.09), (1.0, 1.0, 1.0), (0.74, 0.75, 0.77), (0.95, 0.55, 0.1)
UNEXPLORED = (GREY, "unexplored")
MARGIN_SHARE = 0.02  # of the longer side, unexplored space left around what was seen
PIXELS_PER_CELL = 3
LONGEST_SIDE_PX = (900, 3600)  # a small map is still readable, a large one still a picture
LEGEND_INCHES = (0.6, 0.068)  # of an entry: its patch with the gaps, and each character of its text
LONGEST_SIDE_INCHES = 9.0  # text keeps its size relative to the picture, whatever the resolution
TITLE_POINTS = 9
TITLE_CHARACTERS = 20  # of a line, however narrow axes are
BELOW_AXES_POINTS = 28  # what the labels of an axis take up


class Sheet(NamedTuple):
    """Axes to draw on, and whether they make up a figure of their own or are a part of somebody's."""

    figure: Figure
    axes: Axes
    own: bool

    def label(
        self, titles: Sequence[str], entries: Sequence[tuple[Colour, str]], signs: Sequence[Artist] = ()
    ) -> Figure:
        """What is shown, and below the picture, so that nothing is covered, colours and signs with their meaning."""
        title = " · ".join(part for part in titles if part)
        if self.own:
            self.axes.set_title(title, fontsize=TITLE_POINTS, loc="left")
            add_legend(self.figure, entries, signs)
            return self.figure
        width_inches = float(self.axes.get_position().width * self.figure.get_figwidth())
        lines = textwrap.wrap(title, max(int(width_inches / LEGEND_INCHES[1]), TITLE_CHARACTERS))
        self.axes.set_title("\n".join(lines), fontsize=TITLE_POINTS, loc="left")  # beside other axes
        handles = legend_handles(entries, signs)
        n_columns = legend_columns([str(handle.get_label()) for handle in handles], width_inches)
        below = offset_copy(self.axes.transAxes, self.figure, y=-BELOW_AXES_POINTS, units="points")
        self.axes.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(0, 0),
            bbox_transform=below,
            ncols=n_columns,
            fontsize=8,
            frameon=False,
        )
        return self.figure

    def add_colour_bar(self, colours: ScalarMappable, label: str) -> None:
        """A scale of colours at the right."""
        bar = self.figure.colorbar(colours, ax=self.axes, shrink=0.8, pad=0.015, aspect=30, format="%g")
        bar.set_label(label, fontsize=8)
        bar.ax.tick_params(labelsize=8)


def sheet_for(shape: tuple[int, int], axes: Axes | None, *, has_bar: bool = False) -> Sheet:
    """Given axes, or new ones that fit a picture of so many rows and columns."""
    if axes is None:
        return Sheet(*canvas(*shape, has_bar=has_bar), own=True)
    return Sheet(figure_of(axes), axes, own=False)


def figure_of(axes: Axes) -> Figure:
    """The figure that holds some axes, also where they are in a part of it."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return figure


def as_rgb(colour: Colour) -> Rgb:
    return np.array(colour, dtype=np.float32)


def as_shades(occupied: NDArray[np.float32]) -> Rgb:
    """White for 0 to black for 1; grey for NaN."""
    share = np.clip(occupied, 0, 1)[..., None]
    rgb = as_rgb(WHITE) * (1 - share) + as_rgb(BLACK) * share
    rgb[np.isnan(occupied)] = GREY
    return rgb


def paler(colour: Colour, share: float) -> Colour:
    """A colour mixed with white, so that a share of it is left."""
    red, green, blue = (1 - share * (1 - part) for part in colour)
    return red, green, blue


def cropped(rgb: Rgb, extent: Extent) -> tuple[Rgb, Extent]:
    """The part of a picture that holds something, in a grey margin, and where that part lies."""
    seen = np.any(rgb != as_rgb(GREY), axis=-1)
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


def canvas(n_rows: int, n_cols: int, has_bar: bool) -> tuple[Figure, Axes]:
    """A figure whose axes fit the picture, with room for labels."""
    longest_px = min(max(max(n_rows, n_cols) * PIXELS_PER_CELL, LONGEST_SIDE_PX[0]), LONGEST_SIDE_PX[1])
    inches_per_cell = LONGEST_SIDE_INCHES / max(n_rows, n_cols)
    size = (max(n_cols * inches_per_cell, 4.5) + 0.8 + 0.9 * has_bar, max(n_rows * inches_per_cell, 1.5) + 1.2)
    figure = Figure(figsize=size, dpi=longest_px / LONGEST_SIDE_INCHES, layout="constrained")
    return figure, figure.add_subplot()


def round_length(wanted: float) -> float:
    """The longest of 1, 2, 5, 10, 20, ... and 0.5, 0.2, ... that is no longer than what is wanted.

    >>> round_length(7.3), round_length(0.3)
    (5.0, 0.2)
    """
    decade: float = 10.0 ** math.floor(math.log10(wanted))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= wanted)


def add_scale_bar(axes: Axes, rgb: Rgb, extent: Extent) -> None:
    """A bar of a round length, in the corner that hides least of the map."""
    x_min, x_max, y_min, y_max = extent.bounds
    width, height = x_max - x_min, y_max - y_min
    length = round_length(width / 6)
    seen = np.any(rgb != as_rgb(GREY), axis=-1)
    n_rows, n_cols = max(extent.n_rows // 8, 1), max(round(1.2 * length / extent.resolution_m), 1)
    corners = {
        (0.015, 0.03): seen[:n_rows, :n_cols],
        (0.985 - length / width, 0.03): seen[:n_rows, -n_cols:],
        (0.015, 0.9): seen[-n_rows:, :n_cols],
        (0.985 - length / width, 0.9): seen[-n_rows:, -n_cols:],
    }
    across, up = min(corners, key=lambda corner: float(corners[corner].mean()))
    x, y = x_min + across * width, y_min + up * height
    rim = withStroke(linewidth=6, foreground="white")  # beside a wall it would look like one
    axes.plot([x, x + length], [y, y], color="black", linewidth=3, solid_capstyle="butt", path_effects=[rim])
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


def thinned(rgb: Rgb, extent: Extent, most_cells: int = LONGEST_SIDE_PX[1]) -> tuple[Rgb, Extent]:
    """A picture with at most so many cells along a side, of larger cells if need be.

    The darkest of the cells that become one is kept, so that a wall of a single cell stays closed; grey only where
    nothing else is.

    >>> rgb = np.ones((4, 6, 3), dtype=np.float32)
    >>> rgb[:, 3] = BLACK
    >>> fewer, extent = thinned(rgb, Extent(-4, 2, 4, 6, 0.05), most_cells=3)
    >>> (fewer[:, :, 0] == 1).tolist(), extent
    ([[True, False, True], [True, False, True]], Extent(row0=-2, col0=1, n_rows=2, n_cols=3, resolution_m=0.1))
    """
    step = math.ceil(max(extent.shape) / most_cells)
    if step <= 1:
        return rgb, extent
    # Blocks of whole cells of a lattice that begins at the map's origin, as the cells do.
    row0, col0 = extent.row0 // step, extent.col0 // step
    n_rows = -(-(extent.row0 + extent.n_rows) // step) - row0
    n_cols = -(-(extent.col0 + extent.n_cols) // step) - col0
    part = Extent(row0 * step, col0 * step, n_rows * step, n_cols * step, extent.resolution_m)
    padded = np.empty((*part.shape, 3), dtype=np.float32)
    padded[:] = GREY
    padded[extent.part_of(part)] = rgb
    blocks = padded.reshape(n_rows, step, n_cols, step, 3).swapaxes(1, 2).reshape(n_rows, n_cols, step * step, 3)
    brightness = blocks.sum(axis=-1)
    brightness[np.all(blocks == as_rgb(GREY), axis=-1)] = np.inf
    darkest = np.argmin(brightness, axis=-1)[..., None, None]
    fewer = np.take_along_axis(blocks, darkest, axis=2)[:, :, 0]
    return fewer, Extent(row0, col0, n_rows, n_cols, extent.resolution_m * step)


def show_map(axes: Axes, rgb: Rgb, extent: Extent) -> None:
    """A picture of cells in metres, with a scale bar."""
    rgb, extent = thinned(rgb, extent)
    # "none" is "nearest" in pixels; PDF and SVG get every cell once, sharp, instead of a picture made of pixels.
    axes.imshow(rgb, origin="lower", extent=extent.bounds, interpolation="none")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.tick_params(labelsize=8)
    add_scale_bar(axes, rgb, extent)


def add_legend(figure: Figure, entries: Sequence[tuple[Colour, str]], signs: Sequence[Artist] = ()) -> None:
    """Colours and what they mean, then other signs with labels, below the picture, so that nothing is covered."""
    handles = legend_handles(entries, signs)
    n_columns = legend_columns([str(handle.get_label()) for handle in handles], float(figure.get_figwidth()))
    figure.legend(handles=handles, loc="outside lower center", ncols=n_columns, fontsize=8, frameon=False)


def legend_handles(entries: Sequence[tuple[Colour, str]], signs: Sequence[Artist]) -> list[Artist]:
    """Patches of colours and other signs, as a legend takes them."""
    patches = [Patch(facecolor=colour, edgecolor="0.4", linewidth=0.5, label=label) for colour, label in entries]
    return [*patches, *signs]


def legend_columns(labels: Sequence[str], width_inches: float) -> int:
    """Most columns of a legend, filled one after the other, that a width has room for.

    >>> legend_columns(["static", "free", "unexplored"], 10.0), legend_columns(["static", "free", "unexplored"], 2.5)
    (3, 2)
    """
    patch, character = LEGEND_INCHES
    for n_columns in range(len(labels), 1, -1):
        n_rows, n_longer = divmod(len(labels), n_columns)  # the first columns have one more
        sizes = [n_rows + (k < n_longer) for k in range(n_columns)]
        starts = np.cumsum([0, *sizes]).tolist()
        columns = [labels[start:stop] for start, stop in pairwise(starts)]
        if sum(patch + character * max(map(len, column)) for column in columns) <= width_inches:
            return n_columns
    return 1
