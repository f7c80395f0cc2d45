"""Figures for papers and reports: a function for each thing that can be shown, returning the Matplotlib figure.

====================  ==================================================  =============================
function              shows                                               of
====================  ==================================================  =============================
`draw_occupancy`      the map at a moment                                 a history
`draw_age`            for how long each cell had not been seen            a history
`draw_static`         what never moves (Fig. 6)                           a history
`draw_dynamics`       how much each cell changes (Fig. 5)                 a history
`draw_classic`        the ordinary occupancy grid (Fig. 14)               a history
`draw_objects`        walls, places and objects (Fig. 13)                 a history, or found objects
`draw_people`         where things were on the move (Fig. 11)             a history, or found objects
`draw_timeline`       where each object was when                          a history, or found objects
`draw_cell`           every state of one cell                             a history
`draw_diff`           what changed between two moments                    a `MapDiff`
`draw_world`          a simulated world (Fig. 12)                         a simulation
`draw_table_1`        world, map and classic grid side by side (Table I)  experiments
`draw_layer`          one of those of a history, by name                  a history
====================  ==================================================  =============================

A history is a `TemporalGrid`, a `SavedMap`, a `LiveMap`, or a window or area of one. All but the last two take
``title``, which is put before what is shown, and ``axes``, to draw on axes of your own. `save_figure` writes a file
that journals take. Colours can be told apart by colour-blind people. Figures are no part of pyplot: nothing needs to
be closed.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import get_args

from matplotlib import rc_context
from matplotlib.figure import Figure

from tempog._files import whole_file
from tempog.analysis.find_objects import find_objects
from tempog.errors import ConfigError
from tempog.grid.history import History
from tempog.methods import Method
from tempog.times import Moment
from tempog.views.cell import draw_cell
from tempog.views.diff import draw_diff
from tempog.views.layers import FOUND_LAYERS, MOMENT_LAYERS, Layer
from tempog.views.maps import draw_age, draw_classic, draw_dynamics, draw_occupancy, draw_static
from tempog.views.objects import draw_objects, draw_people
from tempog.views.side_by_side import Row, draw_table_1
from tempog.views.timeline import draw_timeline
from tempog.views.worlds import draw_world

__all__ = [
    "Row",
    "draw_age",
    "draw_cell",
    "draw_classic",
    "draw_diff",
    "draw_dynamics",
    "draw_layer",
    "draw_objects",
    "draw_occupancy",
    "draw_people",
    "draw_static",
    "draw_table_1",
    "draw_timeline",
    "draw_world",
    "save_figure",
]

WITHOUT_DATE = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}


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
        Axes in metres, map frame, y up. Save it with `save_figure`.

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
        of_found = {"objects": draw_objects, "high-dynamic": draw_people, "timeline": draw_timeline}[layer]
        return of_found(find_objects(history, method), title=title)
    if layer in MOMENT_LAYERS:
        of_moment = {"occupancy": draw_occupancy, "age": draw_age}[layer]
        return of_moment(history, at=at, hold=hold, title=title)
    of_period = {"static": draw_static, "dynamics": draw_dynamics, "classic": draw_classic}[layer]
    return of_period(history, title=title)


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: float | None = None) -> None:
    """Write a figure to a file, all of it or nothing: PNG, PDF, SVG, or what else Matplotlib knows by its ending.

    In PDF and SVG, lines and letters stay lines and letters, and each cell of a map is one sharp pixel of a picture.
    Fonts are embedded so that journals take the file. The same figure gives the same file.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path
    dpi : float, optional
        Pixels per inch. Default: as many as show each cell of the map.

    Examples
    --------
    >>> import tempfile
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> save_figure(draw_static(grid), tempfile.mkdtemp() + "/walls.pdf")
    """
    path = Path(path)
    # Journals refuse fonts of type 3, which Matplotlib embeds by default; with a salt, a file is the same each time.
    settings = rc_context({"pdf.fonttype": 42, "ps.fonttype": 42, "svg.hashsalt": "tempog"})
    with whole_file(path) as unfinished, settings:
        figure.savefig(
            unfinished, dpi="figure" if dpi is None else dpi, metadata=WITHOUT_DATE.get(path.suffix.lower())
        )
