"""``tempog objects``: doors, chairs, people."""

from __future__ import annotations

import dataclasses
import json
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from tempog._files import whole_file
from tempog.cli._output import (
    ForceFlag,
    QuietFlag,
    check_new_file,
    count_text,
    duration_text,
    print_note,
    status,
    wants_progress,
)
from tempog.cli.info import MapArgument
from tempog.errors import ConfigError
from tempog.methods import METHODS, EvidenceConfig, Method, PaperConfig
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.analysis.configurations import Configuration
    from tempog.grid.history import History

LISTED = 20
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
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Find objects with several places, such as doors, and what is on the move.

    Settings that are not set are those of the method; METHOD=evidence has those of tempog.EvidenceConfig, the
    others of tempog.PaperConfig.
    """
    settings = with_settings(METHODS[method], chosen or [])
    if file is not None:
        check_new_file(file, force)
    from tempog.analysis.find_objects import find_objects
    from tempog.analysis.pose_consistency import pose_consistency
    from tempog.store.map_directory import open_map

    saved = open_map(map_path)
    history: History = saved
    if start is not None or stop is not None:
        history = history.window(start, stop)
    with status("finding objects", wants_progress(quiet)):
        found = find_objects(history, method, settings)
        measured = found.high_dynamics() if moving else []
        poses = pose_consistency(saved)
        document = {**found.document(measured), "poses": poses.to_dict()}
    if file is not None:  # before anything is printed: whoever reads that may stop listening
        with whole_file(file) as unfinished:
            unfinished.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")

    typer.echo(
        f"{len(found.objects)} objects, {len(found.unassociated)} configurations in none,"
        f" {count_text(len(document['static']))} static cells; method {method}"
    )
    if found.configurations:
        typer.echo(
            f"{'object':>6} {'place':>6} {'x':>8} {'y':>8} {'cells':>6} {'occupied':>14} {'seen':>14}  changes"
        )
    places = [(str(one.id), place) for one in found.objects for place in one.configurations]
    places += [("-", place) for place in found.unassociated]
    for name, place in places[:LISTED]:
        typer.echo(f"{name:>6} {place_text(place)}")
    if len(places) > LISTED:
        where = f"{file} lists them" if file is not None else "--json FILE lists them"
        typer.echo(f"... and {len(places) - LISTED} more; {where}")
    if measured:
        mean = sum(len(one.cells) for one in measured) / len(measured)
        typer.echo(
            f"on the move: {mean:.1f} cells at a scan, in the mean; {count_text(len(measured[-1].cells))} at"
            f" {history.format_moment(measured[-1].stamp_ns)}"
        )
    if file is not None:
        typer.echo(f"Written: {file}")
    if poses.warning and not quiet:
        print_note(poses.warning)


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
