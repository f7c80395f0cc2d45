"""``tempog objects``: doors, chairs, people."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from tempog._files import whole_file
from tempog.cli._maps import MapArgument, RobotOption, SessionOption, note_pruned, opened
from tempog.cli._output import (
    ForceFlag,
    QuietFlag,
    check_new_file,
    count_text,
    counted,
    duration_text,
    print_note,
    status,
    wants_progress,
    wrapped,
)
from tempog.errors import ConfigError
from tempog.methods import METHODS, EvidenceConfig, Method, PaperConfig
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.analysis.configurations import Configuration
    from tempog.analysis.find_objects import FoundObjects
    from tempog.analysis.objects import MovingObject, ObjectPeriod
    from tempog.grid.history import History

LISTED = 20
LEAST_SHARE = 0.005  # of the time an object was seen; less rounds to 0 %
OBJECTS_HEAD = (
    f"{'object':>6} {'sure':>5} {'x':>7} {'y':>7}  {'now in':<7} {'since':>9} {'last seen':>9} {'moves':>6}"
    f" {'gaps':>5} {'seen':>12}  share of it in each place"
)
PLACES_HEAD = f"{'object':>6} {'place':>6} {'x':>8} {'y':>8} {'cells':>6} {'occupied':>14} {'seen':>14}  changes"
Settings = TypeVar("Settings", PaperConfig, EvidenceConfig, PaperConfig | EvidenceConfig)

MethodOption = Annotated[
    Method,
    typer.Option(
        help="evidence: by what speaks for each state; paper: its algorithms to the letter; paper-tuned: the same"
        " with the settings that served them best."
    ),
]


def objects(
    map_path: MapArgument,
    method: MethodOption = "evidence",
    start: Annotated[str | None, typer.Option("--from", metavar="A", help="Begin of the period.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="B", help="End of the period.")] = None,
    moving: Annotated[bool, typer.Option("--high-dynamic", help="Also what was on the move at each scan.")] = False,
    file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all of it to a file as JSON.")
    ] = None,
    chosen: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="A setting of the method, such as within_m=3; may be repeated.",
        ),
    ] = None,
    timeline: Annotated[
        list[int] | None,
        typer.Option("--timeline", metavar="OBJECT", help="Also where this object was when; may be repeated."),
    ] = None,
    sessions: SessionOption = None,
    robots: RobotOption = None,
    dask: Annotated[
        str | None,
        typer.Option(
            "--dask",
            metavar="CLUSTER",
            help="Work it out on a Dask cluster: local:N starts N processes, tcp://HOST:PORT is a running scheduler.",
        ),
    ] = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Find objects with several places, such as doors, and what is on the move.

    An object's row says how sure it is that just these places are those of one thing, which it was seen in last,
    since when, when that was seen last, and its shares of the time it was seen. Times are seconds since the log's
    start. It may have moved more often than it was seen to. A place marked hypothesis was hardly ever seen free: a
    leaf that is seen only while its door is open.

    Settings that are not set are those of the method; METHOD=evidence has those of tempog.EvidenceConfig, the
    others of tempog.PaperConfig.
    """
    settings = with_settings(METHODS[method], chosen or [])
    if dask is not None:
        check_dask(dask, method)
    if file is not None:
        check_new_file(file, force)
    from tempog.analysis.find_objects import find_objects
    from tempog.analysis.pose_consistency import pose_consistency

    saved = opened(map_path, sessions, robots)
    history: History = saved
    if start is not None or stop is not None:
        history = history.window(start, stop)
    with status("finding objects", wants_progress(quiet)) as say:

        def tell(what: str, n_done: int, n_all: int) -> None:
            say(f"finding objects: {what}, {n_done} of {n_all}")

        found = find_objects(history, method, settings, cluster=dask, progress=tell)
        say("finding objects")
        measured = found.high_dynamics() if moving else []
        poses = pose_consistency(saved)
        document = {**found.document(measured), "poses": poses.to_dict()}
    wanted = [object_of(found, number) for number in timeline or []]
    if file is not None:  # before anything is printed: whoever reads that may stop listening
        with whole_file(file) as unfinished:
            unfinished.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")

    n_uncertain = len(document["uncertain"])
    glass = f", {count_text(n_uncertain)} uncertain as glass is" if n_uncertain else ""
    n_objects, n_lone = len(found.objects), len(found.unassociated)
    typer.echo(
        f"{counted(n_objects, 'object', 'objects')}, {counted(n_lone, 'place', 'places')} in no object,"
        f" {count_text(len(document['static']))} static cells{glass}; method {method}"
    )
    start_ns = int(history.stamps_ns[0])
    if found.objects:
        typer.echo(OBJECTS_HEAD)
    for one in found.objects[:LISTED]:
        typer.echo(object_text(one, start_ns, ambiguous_with(one, found)))
    unlisted(len(found.objects), "object", "objects", file)
    if found.configurations:
        typer.echo(f"\n{PLACES_HEAD}")
    places = [(str(one.id), place) for one in found.objects for place in one.configurations]
    places += [("-", place) for place in found.unassociated]
    for name, place in places[:LISTED]:
        typer.echo(f"{name:>6} {place_text(place)}")
    unlisted(len(places), "place", "places", file)
    for one in wanted:
        typer.echo("\n" + "\n".join(timeline_lines(one, found)))
    if measured:
        mean = sum(len(one.cells) for one in measured) / len(measured)
        typer.echo(
            f"on the move: {mean:.1f} cells at a scan, in the mean; {count_text(len(measured[-1].cells))} at"
            f" {history.format_moment(measured[-1].stamp_ns)}"
        )
    if file is not None:
        typer.echo(f"Written: {file}")
    if quiet:
        return
    note_pruned(saved, *(saved.parse_moment(moment) for moment in (start, stop) if moment is not None))
    if poses.warning:
        print_note(poses.warning)


def check_dask(cluster: str, method: Method) -> None:
    """Refuse what names no cluster, and methods that cannot use one."""
    from tempog.analysis.cluster import check_cluster

    if method != "evidence":
        raise ConfigError(f"--dask works with --method evidence only, not with {method}; leave one of the two out")
    try:
        check_cluster(cluster)
    except ConfigError as error:
        raise ConfigError(f"--dask: {error}") from None


def with_settings(settings: Settings, chosen: list[str]) -> Settings:
    """Settings with some of them changed, each given as NAME=VALUE; "none" is no value at all.

    >>> from tempog.methods import METHODS, EvidenceConfig, Method, PaperConfig
    >>> with_settings(PaperConfig(), ["within_m=none", "max_states=4", "distance=jaccard"]).max_states
    4
    """
    names = {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}
    changed: dict[str, Any] = {}
    for text in chosen:
        name, equals, value = text.partition("=")
        name = name.strip().replace("-", "_")
        if not equals or name not in names:
            raise ConfigError(
                f"--set {text} names no setting of this method; wanted NAME=VALUE with one of {', '.join(names)}"
            )
        try:
            if value == "none":
                changed[name] = None
            elif isinstance(names[name], str):
                changed[name] = value
            else:
                changed[name] = int(value) if isinstance(names[name], int) else float(value)
        except ValueError:
            raise ConfigError(f"--set {text}: {value!r} is no number") from None
    return dataclasses.replace(settings, **changed)


def unlisted(count: int, one: str, many: str, file: Path | None) -> None:
    """Say how many rows of a table are left out, if any."""
    if count > LISTED:
        where = f"{file} lists them" if file is not None else "--json FILE lists them"
        typer.echo(f"... and {count_text(count - LISTED)} more {one if count - LISTED == 1 else many}; {where}")


def object_of(found: FoundObjects, number: int) -> MovingObject:
    """The object with a number; ConfigError if there is none."""
    for one in found.objects:
        if one.id == number:
            return one
    there = f"wanted one of {', '.join(str(one.id) for one in found.objects)}" if found.objects else "none was found"
    raise ConfigError(f"--timeline {number}: there is no object {number}; {there}")


def ambiguous_with(one: MovingObject, found: FoundObjects) -> list[int]:
    """The objects whose places may as well be places of this one, or the other way round."""

    def claims(rival: MovingObject, owner: MovingObject) -> bool:
        return any(place.id in rival.rivals for place in owner.configurations)

    return [other.id for other in found.objects if claims(one, other) or claims(other, one)]


def object_text(one: MovingObject, start_ns: int, ambiguous: Sequence[int]) -> str:
    """One object as a line of the table; with a second line if it is ambiguous."""
    points = [place.centre_m for place in one.configurations]
    x, y = (sum(values) / len(points) for values in zip(*points, strict=True))
    last = one.last_stay
    now = state_text(one, last.configuration) if last else "unclear"
    clear_ns = one.stays[-1].stop_ns if one.stays else None
    seen_ns = max((period.stop_ns for period in one.timeline), default=None)
    since = offset_text(last.start_ns if last else clear_ns, start_ns)
    until = offset_text(last.stop_ns if last else seen_ns, start_ns)
    shares = [
        f"{state_text(one, place)}: {share:.0%}"
        for place, share in one.shares.items()
        if place is not None or share >= LEAST_SHARE
    ]
    sure = "-" if one.confidence is None else f"{one.confidence:.2f}"
    doubt = f"\n{'':>6} ambiguous with {', '.join(map(str, ambiguous))}" if ambiguous else ""
    row = (
        f"{one.id:>6} {sure:>5} {x:>7.2f} {y:>7.2f}  {now:<7} {since:>9} {until:>9} {one.n_moves:>6}"
        f" {len(one.gaps):>5} {duration_text(one.seen_s):>12}  "
    )
    return row + wrapped(", ".join(shares), len(row)) + doubt


def state_text(one: MovingObject, place: int | None) -> str:
    """A state of an object in one word."""
    if place is None:
        return "away" if len(one.configurations) == 1 else "unclear"
    return str(place)


def offset_text(stamp_ns: int | None, start_ns: int) -> str:
    """Seconds since the start; "-" for never."""
    return "-" if stamp_ns is None else f"{(stamp_ns - start_ns) / NS_PER_S:+.1f}"


def timeline_lines(one: MovingObject, found: FoundObjects) -> list[str]:
    """Where an object was when, and when nobody looked, from the begin of the period to its end."""
    stamps, start_ns = found.history.stamps_ns, int(found.history.stamps_ns[0])
    now_ns, end_ns = int(stamps[found.history.first_scan]), int(stamps[found.history.last_scan])
    lines = [
        f"object {one.id}: {counted(one.n_moves, 'move', 'moves')}, seen for {duration_text(one.seen_s)}"
        f" of {duration_text((end_ns - now_ns) / NS_PER_S)}",
        f"{'from':>10} {'to':>10} {'for':>12}  in place",
    ]

    def add(since_ns: int, until_ns: int, what: str) -> None:
        lasted = duration_text((until_ns - since_ns) / NS_PER_S)
        lines.append(
            f"{offset_text(since_ns, start_ns):>10} {offset_text(until_ns, start_ns):>10} {lasted:>12}  {what}"
        )

    for since_ns, until_ns, place in without_short_gaps(one.timeline):
        if since_ns > now_ns:
            add(now_ns, since_ns, "not seen")
        add(since_ns, until_ns, state_text(one, place))
        now_ns = until_ns
    if end_ns > now_ns:
        add(now_ns, end_ns, "not seen")
    return lines


def without_short_gaps(timeline: Sequence[ObjectPeriod]) -> list[ObjectPeriod]:
    """A timeline in which gaps shorter than `GAP_S` within one state are filled."""
    from tempog.analysis.objects import GAP_S

    joined: list[ObjectPeriod] = []
    for period in timeline:
        last = joined[-1] if joined else None
        if (
            last is not None
            and last.configuration == period.configuration
            and period.start_ns - last.stop_ns < GAP_S * NS_PER_S
        ):
            joined[-1] = last._replace(stop_ns=period.stop_ns)
        else:
            joined.append(period)
    return joined


def place_text(place: Configuration) -> str:
    """One configuration as a line of the table."""
    x, y = place.centre_m
    seen_s = {
        name: sum(stop - start for start, stop, state in place.periods if state == name) / NS_PER_S
        for name in ("occupied", "free")
    }
    states = [state for _, _, state in place.periods]
    changes = sum(later != earlier for earlier, later in pairwise(states))
    return (
        f"{place.id:>6} {x:>8.2f} {y:>8.2f} {len(place.cells):>6} {duration_text(seen_s['occupied']):>14}"
        f" {duration_text(sum(seen_s.values())):>14}  {changes}{'  hypothesis' if place.hypothesis else ''}"
    )
