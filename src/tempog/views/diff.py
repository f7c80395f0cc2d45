"""What changed between two moments, drawn over the map as it is at the second."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from tempog.analysis.map_diff import MapDiff
from tempog.analysis.moved_objects import Move
from tempog.analysis.patches import Patch
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.sensing.grid_spec import Extent
from tempog.times import NS_PER_S
from tempog.views.canvas import GREY, UNEXPLORED, WHITE, Colour, Rgb, as_rgb, cropped, sheet_for, show_map
from tempog.views.objects import label_offsets

OCCUPIED: Colour = (0.45, 0.45, 0.47)  # so that what changed stands out
# Okabe and Ito's vermilion and blue, which colour-blind people can tell apart; moved things have both.
APPEARED: Colour = (0.84, 0.37, 0.0)
VANISHED: Colour = (0.0, 0.45, 0.70)
LINE: Colour = (0.1, 0.1, 0.1)
NOT_SEEN_AGAIN: Colour = (0.93, 0.90, 0.72)
NOT_SEEN_WALL: Colour = (0.62, 0.58, 0.40)
ARROW: dict[str, Any] = {
    "arrowstyle": "-|>",
    "mutation_scale": 7,
    "color": LINE,
    "linewidth": 1.2,
    "shrinkA": 0,
    "shrinkB": 0,
}
GROWN_CELLS = 1  # changed cells are drawn with their neighbours, since lines of single cells are hard to see


def draw_diff(diff: MapDiff, *, title: str = "", axes: Axes | None = None) -> Figure:
    """The map at the second moment in grey, and in colours what appeared, vanished or moved, each with its number.

    Parameters
    ----------
    diff : MapDiff
    title : str
        Put before what is shown.
    axes : matplotlib.axes.Axes, optional
        Where to draw, with the legend below. Default: axes that fit, in a figure of their own.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up. An arrow leads from where an object was to where it is. What was not seen
        since the first moment is yellowish.

    Examples
    --------
    >>> from tempog import build_grid, map_diff
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor()).scans)
    >>> draw_diff(map_diff(grid, "+66", "+100")).axes[0].get_title(loc="left")
    '+66.0 s to +100.0 s · 1 moved, 0 appeared, 0 vanished'
    """
    history = diff.history
    full, extent = cropped(_picture(diff), history.extent)
    sheet = sheet_for(extent.shape, axes)
    show_map(sheet.axes, full, extent)
    _paint_signs(sheet.axes, diff, extent)
    start_ns = int(history.stamps_ns[0])
    moments = " to ".join(f"{(stamp - start_ns) / NS_PER_S:+.1f} s" for stamp in (diff.before_ns, diff.after_ns))
    counts = f"{len(diff.moved)} moved, {len(diff.appeared)} appeared, {len(diff.vanished)} vanished"
    entries = [(APPEARED, "there only now"), (VANISHED, "there only before"), (OCCUPIED, "occupied")]
    entries += [(WHITE, "free"), UNEXPLORED]
    if diff.not_seen_again.any():
        entries.append((NOT_SEEN_AGAIN, "not seen again"))
    return sheet.label([title, moments, counts], entries, _signs(diff))


def _signs(diff: MapDiff) -> list[Artist]:
    if not diff.moved:
        return []
    return [Line2D([], [], color=LINE, linewidth=1.2, marker=">", markersize=4, label="moved")]


def _picture(diff: MapDiff) -> Rgb:
    history = diff.history
    value = history.at(np.datetime64(diff.after_ns, "ns"), diff.hold_s).value
    rgb = np.empty((*value.shape, 3), dtype=np.float32)
    rgb[:] = as_rgb(GREY)
    taken = value > OCCUPIED_ABOVE
    rgb[~np.isnan(value)] = as_rgb(WHITE)
    rgb[taken] = as_rgb(OCCUPIED)
    unseen = np.zeros(value.shape, dtype=np.bool_)
    unseen[diff.extent.part_of(history.extent)] = diff.not_seen_again[history.extent.part_of(diff.extent)]
    rgb[unseen] = as_rgb(NOT_SEEN_AGAIN)
    rgb[unseen & taken] = as_rgb(NOT_SEEN_WALL)
    for colour, several in _coloured(diff):
        for cells in several:
            _fill(rgb, history.extent, cells, colour)
    return rgb


def _coloured(diff: MapDiff) -> list[tuple[Colour, list[NDArray[np.int32]]]]:
    """Cells by colour; what is there now is drawn last."""
    was = [place.cells for move in diff.moved if (place := move.place(move.before)) is not None]
    now = [place.cells for move in diff.moved if (place := move.place(move.after)) is not None]
    return [
        (VANISHED, was + [patch.cells for patch in diff.vanished]),
        (APPEARED, now + [patch.cells for patch in diff.appeared]),
    ]


def _fill(rgb: Rgb, extent: Extent, cells: NDArray[np.int32], colour: Colour) -> None:
    steps = np.arange(-GROWN_CELLS, GROWN_CELLS + 1)
    rows = (cells[:, 0, None, None] + steps[:, None] - extent.row0).clip(0, extent.n_rows - 1)
    cols = (cells[:, 1, None, None] + steps - extent.col0).clip(0, extent.n_cols - 1)
    rgb[rows, cols] = as_rgb(colour)


def _paint_signs(axes: Axes, diff: MapDiff, extent: Extent) -> None:
    rim = [withStroke(linewidth=2.5, foreground="white")]
    centres = [_middle(change) for change in diff.changes]
    offsets = label_offsets(axes, centres, extent)
    for k, change in enumerate(diff.changes):
        if isinstance(change, Move):
            ends = [place.centre_m for where in (change.before, change.after) if (place := change.place(where))]
            if len(ends) == 2:
                axes.annotate(
                    "",
                    ends[1],
                    xytext=ends[0],
                    arrowprops=ARROW,
                )
        axes.annotate(
            str(k + 1),
            (float(centres[k][0]), float(centres[k][1])),
            xytext=offsets[k],
            textcoords="offset points",
            fontsize=9,
            fontweight="bold",
            color=LINE,
            path_effects=rim,  # a box would hide leaves
        )


def _middle(change: Move | Patch) -> NDArray[np.float64]:
    """Where a change's number belongs: at the middle of a patch, or of the places that an arrow joins."""
    if isinstance(change, Patch):
        return np.array(change.centre_m)
    places = [place for where in (change.before, change.after) if (place := change.place(where)) is not None]
    return np.asarray(np.mean([place.centre_m for place in places], axis=0))
