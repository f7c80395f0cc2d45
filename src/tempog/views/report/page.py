"""A page about a map: pictures, objects, the quality of the data, settings. It needs nothing but itself."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.resources import files

from tempog._version import __version__
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.pose_consistency import PoseConsistency, pose_consistency
from tempog.grid.history import History
from tempog.methods import Method
from tempog.store.saved_map import SavedMap
from tempog.times import Moment
from tempog.views.maps import (
    age_drawing,
    classic_drawing,
    dynamics_drawing,
    occupancy_drawing,
    static_drawing,
)
from tempog.views.markup import Html, joined, tag
from tempog.views.objects import people_drawing
from tempog.views.report.pictures import aspect, objects_picture, picture
from tempog.views.report.strips import Strips
from tempog.views.report.tables import facts, heading, objects_table, quality, sessions_table, settings

SQUARE_BELOW = 1.8  # times as wide as high: with room for a table beside it on a wide screen
# Nothing from elsewhere is loaded, and no script runs, whatever names a map has.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def report_page(
    grid: History,
    start: Moment | None = None,
    stop: Moment | None = None,
    *,
    method: Method = "evidence",
    name: str = "",
) -> str:
    """A report on a map as one HTML page, with all its pictures, that loads nothing from anywhere.

    Parameters
    ----------
    grid : TemporalGrid, SavedMap or LiveMap
    start, stop : moments, optional
        The period to report on, see `History.window`. Default: all of it.
    method : "evidence", "paper" or "paper-tuned"
        How objects are found, see `find_objects`.
    name : str
        Title of the page. Default: the map's file name, if it has one.

    Returns
    -------
    str
        A page for screens of any size, light and dark, and for printers.

    Raises
    ------
    TimeError
        There are no scans, or none in the period.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> page = report_page(grid, "+0", "+10", name="corridor <1>")
    >>> "<h1>corridor &lt;1&gt;</h1>" in page, "://" in page
    (True, False)
    """
    grid.require_scans()
    history = grid if start is None and stop is None else grid.window(start, stop)
    found = find_objects(history, method)
    poses = pose_consistency(grid) if hasattr(grid, "surfaces") else None
    path = getattr(grid, "path", None)
    title = name or (path.stem if path is not None else "map")
    saved = grid if isinstance(grid, SavedMap) else None
    return _document(title, history, saved, found, poses)


def _document(
    title: str, history: History, saved: SavedMap | None, found: FoundObjects, poses: PoseConsistency | None
) -> str:
    strips = Strips.of(history)
    style = (files("tempog.views.report") / "style.css").read_text(encoding="utf-8")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", f"{title} · tempog report"),
        tag("style", Html(style)),
    )
    shape = "square" if aspect(found.extent) < SQUARE_BELOW else ""
    made = f"Made by tempog {__version__}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC."
    body = tag(
        "body",
        heading(history, title, strips),
        tag(
            "main",
            facts(history, found, poses, strips),
            tag(
                "section",
                tag("h2", "Objects"),
                tag("div", objects_picture(found), objects_table(found, strips), class_=f"beside {shape}"),
            ),
            tag("section", tag("h2", "Layers"), tag("div", *_layers(history, found), class_="pictures")),
            tag("section", tag("h2", "Quality of the data"), quality(history, saved, poses, strips)),
            sessions_table(saved, strips),
            tag("section", tag("h2", "Settings"), settings(history, saved, found)),
        ),
        tag("footer", tag("p", made)),
    )
    return joined(Html("<!doctype html>\n"), tag("html", head, body, lang="en"), "\n")


def _layers(history: History, found: FoundObjects) -> list[Html]:
    shown = (
        (
            occupancy_drawing(history),
            "Last known state",
            "What stood where when the period ended; a cell keeps its last known state.",
        ),
        (static_drawing(history), "Static map", "What never moved, and what was now occupied, now free."),
        (dynamics_drawing(history), "Dynamics", "How much each cell changed: doors, chairs, and where people walk."),
        (people_drawing(found), "On the move", "What was in the way and is no known object: the trails of people."),
        (age_drawing(history), "Age", "How long ago each cell was last seen; what is dark may be out of date."),
        (classic_drawing(history), "Classic occupancy grid", "What an ordinary map makes of the same scans."),
    )
    return [picture(drawing, title, caption) for drawing, title, caption in shown]
