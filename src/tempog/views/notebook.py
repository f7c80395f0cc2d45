"""How maps and objects show themselves in a notebook: a small picture and the most important facts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from tempog.sensing.grid_spec import Extent
from tempog.texts import count_text, counted, duration_text
from tempog.times import NS_PER_S
from tempog.views.canvas import GREY, Rgb, as_rgb, cropped, thinned
from tempog.views.maps import occupancy_drawing
from tempog.views.markup import Html, joined, tag
from tempog.views.objects import counts, object_cells, object_colour, place_text
from tempog.views.report.pictures import png_address, swatch
from tempog.views.report.strips import Strips

if TYPE_CHECKING:
    from tempog.analysis.find_objects import FoundObjects
    from tempog.analysis.objects import MovingObject
    from tempog.grid.history import History

LONGEST_SIDE_CELLS = 360  # of a picture
MOST_CELLS = 4_000_000  # of a map that is drawn unasked: more take a second
MOST_OBJECTS = 12  # listed
ROW = "text-align:left;padding:0.1em 0.8em 0.1em 0;vertical-align:top;"
SWATCH = "display:inline-block;width:0.8em;height:0.8em;"
BESIDE = "display:flex;flex-wrap:wrap;gap:1.2em;align-items:flex-start;"


Shown = TypeVar("Shown")


def shown(thing: Shown, html_of: Callable[[Shown], Html]) -> str:
    """What a notebook shows of a thing: its picture and facts, or its name alone where these cannot be had."""
    try:
        return html_of(thing)
    except Exception:  # a map that another process prunes meanwhile, or a damaged one: to be shown must never fail
        return tag("code", repr(thing))


def history_html(history: History) -> Html:
    """The map as last known, and from when to when and how far it goes."""
    name = type(history).__name__
    if history.n_scans == 0:
        return _beside(name, Html(""), {"scans": "none yet"})
    stamps = history.stamps_ns
    rows = {
        "scans": f"{count_text(history.n_scans)} in {duration_text(history.duration_s)}",
        "from": history.format_moment(int(stamps[history.first_scan])),
        "to": history.format_moment(int(stamps[history.last_scan])),
        "area": bounds_text(history.extent),
        "cells": f"{history.tiles.spec.resolution_m:g} m wide",
    }
    sessions = getattr(history, "sessions", None)
    if sessions:
        robots = sorted({one.robot for one in sessions if one.robot})
        rows["sessions"] = count_text(len(sessions)) + (f" by {', '.join(robots)}" if robots else "")
    path = getattr(history, "path", None)
    heading = name if path is None else f"{name} {path}"
    if history.extent.n_rows * history.extent.n_cols > MOST_CELLS:
        return _beside(heading, Html(""), rows)
    drawing = occupancy_drawing(history)
    known = np.count_nonzero(np.any(drawing.rgb != as_rgb(GREY), axis=-1))
    rows["cells"] = f"{count_text(int(known))} seen, {history.tiles.spec.resolution_m:g} m wide"
    return _beside(heading, _image(drawing.rgb, drawing.extent, drawing.title), rows)


def found_html(found: FoundObjects) -> Html:
    """Walls and objects, and a line on each of the objects that moved most."""
    order = sorted(range(len(found.objects)), key=lambda k: (-found.objects[k].n_moves, found.objects[k].id))
    head = ("object", "places", "moves", "last seen in", "seen for")
    lines = []
    for k in order[:MOST_OBJECTS]:
        one = found.objects[k]
        cells = (
            joined(swatch(object_colour(k), SWATCH), f" {one.id}"),
            ", ".join(str(place.id) for place in one.configurations),
            str(one.n_moves),
            place_text(one, one.last_stay.configuration) if one.last_stay else "unclear",
            duration_text(one.seen_s),
        )
        lines.append(tag("tr", *(tag("td", cell, style=ROW) for cell in cells)))
    n_more = len(order) - len(lines)
    if n_more:
        lines.append(tag("tr", tag("td", f"and {counted(n_more, 'other', 'others')}", colspan=len(head), style=ROW)))
    table = tag("table", tag("tr", *(tag("th", name, style=ROW) for name in head)), *lines)
    image = _image(object_cells(found), found.extent, counts(found)) if found.walls.size <= MOST_CELLS else Html("")
    return tag("div", _heading(f"FoundObjects: {counts(found)}"), tag("div", image, table, style=BESIDE))


def object_html(one: MovingObject) -> Html:
    """Its places, how often it moved, where it is now, and its time line."""
    places = "; ".join(
        f"{place.id} at ({place.centre_m[0]:.1f}, {place.centre_m[1]:.1f}) m, {one.shares[place.id]:.0%} of the time"
        for place in one.configurations
    )
    last = one.last_stay
    rows = {
        "places": places,
        "moves": count_text(one.n_moves),
        "seen for": duration_text(one.seen_s),
        "last seen in": place_text(one, last.configuration) if last else "unclear",
    }
    if one.confidence is not None:
        rows["sure"] = f"{one.confidence:.2f}"
    if not one.timeline:
        return _beside(f"MovingObject {one.id}", Html(""), rows)
    since, until = one.timeline[0].start_ns, max(one.timeline[-1].stop_ns, one.timeline[0].start_ns + NS_PER_S)
    strips = Strips(np.linspace(since, until, 1000).astype(np.int64), since)
    rows["from, to"] = f"{strips.moment(since)}, {strips.moment(until)}"
    strip = tag("div", strips.of_object(one, object_colour(one.id - 1)), style="max-width:40em;margin-top:0.4em")
    return tag("div", _beside(f"MovingObject {one.id}", Html(""), rows), strip)


def bounds_text(extent: Extent) -> str:
    """What a map reaches over."""
    x_min, x_max, y_min, y_max = extent.bounds
    return f"x {x_min:.1f} to {x_max:.1f} m, y {y_min:.1f} to {y_max:.1f} m"


def _beside(heading: str, image: Html, rows: Mapping[str, str]) -> Html:
    lines = [tag("tr", tag("th", name, style=ROW), tag("td", text, style=ROW)) for name, text in rows.items()]
    return tag("div", _heading(heading), tag("div", image, tag("table", *lines), style=BESIDE))


def _heading(text: str) -> Html:
    return tag("div", tag("b", text), style="margin-bottom:0.3em")


def _image(rgb: Rgb, extent: Extent, alt: str) -> Html:
    shown, where = thinned(*cropped(rgb, extent), LONGEST_SIDE_CELLS)
    return tag(
        "img",
        src=png_address(shown, transparent=False),
        alt=alt,
        style=f"width:{min(2 * where.n_cols, LONGEST_SIDE_CELLS)}px;max-width:100%;image-rendering:auto",
    )
