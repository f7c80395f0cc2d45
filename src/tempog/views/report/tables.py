"""What a report says in words: facts, objects, the quality of the data, sessions, settings."""

from __future__ import annotations

import dataclasses
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from tempog._version import __version__
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.pose_consistency import PoseConsistency
from tempog.grid.history import History
from tempog.store.manifest import FORMAT_VERSION
from tempog.store.saved_map import SavedMap
from tempog.texts import bytes_text, count_text, counted, duration_text
from tempog.times import NS_PER_S, format_moment
from tempog.views.markup import Html, joined, tag
from tempog.views.objects import object_colour, place_text
from tempog.views.report.pictures import swatch
from tempog.views.report.strips import Strips

MOST_OBJECTS = 200  # of a table; a page with thousands of rows helps nobody
MOST_PAUSES = 20
LEAST_SHARE = 0.005  # of the time an object was seen; less rounds to 0 %
OBJECT_COLUMNS = (
    "object",
    "places",
    "moves",
    "last seen in",
    "since",
    "until",
    "seen for",
    "sure",
    "where it was when",
)
LISTED_PACKAGES = ("numpy", "numba", "scipy", "pyarrow", "matplotlib")


def facts(history: History, found: FoundObjects, poses: PoseConsistency | None, strips: Strips) -> Html:
    """The most important numbers, side by side."""
    area_m2 = history.n_cells * history.tiles.spec.resolution_m**2
    driven_s = history.duration_s - sum(stop - start for start, stop in strips.pauses_ns) / NS_PER_S
    n_moves = sum(one.n_moves for one in found.objects)
    entries = {
        "scans": count_text(history.n_scans),
        "driven": duration_text(driven_s),
        "area seen": f"{count_text(round(area_m2))} m²",
        "intervals": count_text(history.n_intervals),
        "objects": count_text(len(found.objects)),
        "moves seen": count_text(n_moves),
    }
    if poses is not None:
        entries["poses"] = {True: "agree", False: "disagree", None: "unknown"}[poses.consistent]
    items = [tag("div", tag("dt", name), tag("dd", value)) for name, value in entries.items()]
    return tag("dl", *items, class_="facts")


def objects_table(found: FoundObjects, strips: Strips) -> Html:
    """Each object: its places and shares, its moves, where it is now, and its time line."""
    if not found.objects:
        return tag("p", "No object was found that stands now here, now there.")
    order = sorted(range(len(found.objects)), key=lambda k: (-found.objects[k].n_moves, found.objects[k].id))
    last = tag("th", OBJECT_COLUMNS[-1], strips.axis(), scope="col", class_="when")
    head = tag("thead", tag("tr", *(tag("th", name, scope="col") for name in OBJECT_COLUMNS[:-1]), last))
    rows = [_object_row(found, k, strips) for k in order[:MOST_OBJECTS]]
    n_more = len(order) - len(rows)
    note = (
        f"Only the {MOST_OBJECTS} that moved most are listed, {counted(n_more, 'object', 'objects')} left out. "
        if n_more
        else ""
    )
    text = (
        f"{note}Full colour: in that place; a row per place, from top to bottom as listed. Pale: seen, and elsewhere"
        " or unclear. Hatched: nobody looked. It may have moved more often than it was seen to."
    )
    table = tag("table", head, tag("tbody", *rows), class_="objects")
    return tag("div", tag("div", table, class_="scroll"), tag("p", text, class_="note"))


def _object_row(found: FoundObjects, k: int, strips: Strips) -> Html:
    one, colour = found.objects[k], object_colour(k)
    last, last_ns = one.last_stay, max((period.stop_ns for period in one.timeline), default=None)
    places = [
        tag("li", f"{place.id} at {_point_text(place.centre_m)}: {one.shares[place.id]:.0%}")
        for place in one.configurations
    ]
    rest = one.shares.get(None, 0.0)
    if rest >= LEAST_SHARE:
        places.append(tag("li", f"{place_text(one, None)}: {rest:.0%}"))
    guessed = [str(place.id) for place in one.configurations if place.hypothesis]
    if guessed:
        places.append(tag("li", f"place {', '.join(guessed)}: hardly ever seen free, a hypothesis", class_="doubt"))
    values = (
        joined(swatch(colour), f" {one.id}"),
        tag("ul", *places),
        str(one.n_moves),
        place_text(one, last.configuration) if last else "unclear",
        strips.moment(last.start_ns if last else None),
        strips.moment(last.stop_ns if last else last_ns),
        duration_text(one.seen_s),
        "–" if one.confidence is None else f"{one.confidence:.2f}",
        strips.of_object(one, colour),
    )
    kinds = {"places": "places", "moves": "count", "seen for": "count", "sure": "count", "where it was when": "when"}
    return tag(
        "tr",
        *(
            tag("th" if name == "object" else "td", value, data_label=name, class_=kinds.get(name))
            for name, value in zip(OBJECT_COLUMNS, values, strict=True)
        ),
    )


def _point_text(point_m: tuple[float, float]) -> str:
    """Coordinates without the minus of what rounds to zero.

    >>> _point_text((1.26, -0.04))
    '(1.3, 0.0) m'
    """
    x, y = (round(value, 1) + 0.0 for value in point_m)
    return f"({x:.1f}, {y:.1f}) m"


def quality(history: History, saved: SavedMap | None, poses: PoseConsistency | None, strips: Strips) -> Html:
    """What may be wrong with the data: poses, pauses, clocks, what was skipped, pruned or repaired."""
    parts = [_poses_row(poses), _pauses_row(history, strips)]
    if saved is not None:
        parts += _map_rows(saved)
    return tag("dl", *parts, class_="quality")


def _poses_row(poses: PoseConsistency | None) -> Html:
    if poses is None:
        return _row("poses", "", "no hit points are kept, so nobody can say whether poses agree")
    verdict = {True: ("good", "consistent"), False: ("bad", "inconsistent"), None: ("", "unknown")}[poses.consistent]
    more = ""
    if poses.consistent is False:
        more = "; objects found along walls may be wrong, so map a log with corrected poses if there is one"
    pieces = f" ({count_text(poses.n_pieces)} pieces of surface, the whole map)"
    return _row("poses", *verdict, text=f"{str(poses)[0].upper()}{str(poses)[1:]}{more}{pieces}.")


def _pauses_row(history: History, strips: Strips) -> Html:
    stamps = history.stamps_ns[history.first_scan : history.last_scan + 1]
    steps_s = np.diff(stamps) / NS_PER_S
    if not len(steps_s):
        return _row("time", "", "", text="A single scan.")
    usual_s, longest_s = float(np.median(steps_s)), float(steps_s.max())
    text = f"A scan each {usual_s:.3g} s (median), at most {duration_text(longest_s)} apart."
    pauses = [
        tag("li", f"{strips.moment(start)} to {strips.moment(stop)}: {duration_text((stop - start) / NS_PER_S)}")
        for start, stop in strips.pauses_ns[:MOST_PAUSES]
    ]
    n_more = len(strips.pauses_ns) - len(pauses)
    if n_more:
        pauses.append(tag("li", f"and {counted(n_more, 'more', 'more')}"))
    n_all = len(strips.pauses_ns)
    verdict = counted(n_all, "long pause", "long pauses") if n_all else "no long pause"
    return _row("time", "" if n_all else "good", verdict, text=text, more=pauses)


def _map_rows(saved: SavedMap) -> Iterable[Html]:
    sources = [source for session in saved.sessions for source in session.sources]
    notes = [f"{source['path']}: {note}" for source in sources for note in source["notes"]]
    n_skipped = sum(int(source["n_skipped"] or 0) for source in sources)
    yield _row(
        "reading",
        "bad" if n_skipped else "" if notes else "good",
        counted(n_skipped, "scan skipped", "scans skipped") if n_skipped else "nothing skipped",
        text="Clocks and laser settings: notes of the readers follow." if notes else "No notes on clocks or lasers.",
        more=[tag("li", note) for note in notes],
    )
    pruned = [
        tag(
            "li",
            f"{deleted['when'].replace('T', ' ').replace('Z', ' UTC')}:"
            f" {counted(deleted['n_intervals'], 'interval', 'intervals')} from before"
            f" {saved.format_moment(deleted['before_ns'])}",
        )
        for deleted in saved.manifest.pruned
    ]
    text = "Of earlier moments at most the last look at each cell is left." if pruned else "All history is there."
    yield _row("pruned", "" if pruned else "good", "some" if pruned else "nothing", text=text, more=pruned)
    yield _row(
        "repaired",
        "" if saved.repaired else "good",
        "after a crash" if saved.repaired else "nothing",
        text="" if saved.repaired else "The map was found complete.",
        more=[tag("li", note) for note in saved.repaired],
    )


def _row(name: str, kind: str, verdict: str, text: str = "", more: Sequence[Html] = ()) -> Html:
    badge = tag("span", verdict, class_=f"verdict {kind}".strip()) if verdict else Html("")
    rest = tag("ul", *more) if more else Html("")
    return tag("div", tag("dt", name), tag("dd", badge, " ", text, rest))


def sessions_table(saved: SavedMap | None, strips: Strips) -> Html:
    """Who drove when, from which files."""
    if saved is None or not saved.sessions:
        return Html("")
    rows = []
    for session in saved.sessions:
        sources = [
            tag("li", f"{source['path']} ({source['format']}, {counted(source['n_scans'], 'scan', 'scans')})")
            for source in session.sources
        ]
        cells = {
            "session": session.id,
            "robot": session.robot or "–",
            "scans": count_text(session.n_scans),
            "from": saved.format_moment(session.start_ns),
            "to": saved.format_moment(session.stop_ns),
            "files": tag("ul", *sources) if sources else "–",
            "when": strips.of_periods([(session.start_ns, session.stop_ns)], f"session {session.id}"),
        }
        rows.append(
            tag(
                "tr",
                *(
                    tag("th" if name == "session" else "td", value, data_label=name, class_=_SESSION_KINDS.get(name))
                    for name, value in cells.items()
                ),
            )
        )
    head = tag("thead", tag("tr", *(tag("th", name, scope="col") for name in cells)))
    table = tag("div", tag("table", head, tag("tbody", *rows), class_="sessions"), class_="scroll")
    return tag("section", tag("h2", "Sessions"), table)


_SESSION_KINDS = {"scans": "count", "files": "files", "when": "when"}


def settings(history: History, saved: SavedMap | None, found: FoundObjects) -> Html:
    """With which settings the map was made and objects were found, by which versions."""
    groups: dict[str, Mapping[str, Any]] = {
        **{f"map: {name}": values for name, values in history.config.to_dict().items()},
        f"objects: method {found.method}": dataclasses.asdict(found.settings),
        "versions": _versions(saved),
    }
    tables = [
        tag(
            "table",
            tag("caption", name),
            tag("tbody", *(tag("tr", tag("th", key, scope="row"), tag("td", _value(values[key]))) for key in values)),
        )
        for name, values in groups.items()
    ]
    return tag("div", *tables, class_="settings")


def _versions(saved: SavedMap | None) -> dict[str, str]:
    versions = {"tempog": __version__, "Python": platform.python_version()}
    versions |= {package: version(package) for package in LISTED_PACKAGES}
    if saved is not None:
        versions["map format"] = str(FORMAT_VERSION)
        versions["map on disk"] = bytes_text(saved.bytes_on_disk)
    return versions


def _value(value: Any) -> str:
    if value is None:
        return "none"
    return f"{value:g}" if isinstance(value, float) else str(value)


def heading(history: History, name: str, strips: Strips) -> Html:
    """What the map is called, and from when to when it goes."""
    since, until = (format_moment(stamp, strips.start_ns) for stamp in strips.period_ns)
    lasted = duration_text((strips.period_ns[1] - strips.period_ns[0]) / NS_PER_S)
    period = tag("p", f"{since} to {until}, {lasted}")
    return tag("header", tag("p", "tempog report", class_="kind"), tag("h1", name), period)
