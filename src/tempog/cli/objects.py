"""``tempog objects``: doors, chairs, people."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tempog._files import whole_file
from tempog.cli._output import ForceFlag, QuietFlag, check_new_file, count_text, duration_text, status, wants_progress
from tempog.cli.info import MapArgument
from tempog.config import METHODS, Candidates, Measure, Method, SeriesDistance, Weight
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.analysis.configurations import Configuration
    from tempog.grid.history import History

LISTED = 20

MethodOption = Annotated[
    Method, typer.Option(help="paper: to the letter; paper-tuned: the same with the settings that served it best.")
]


def objects(
    map_path: MapArgument,
    method: MethodOption = "paper",
    start: Annotated[str | None, typer.Option("--from", metavar="A", help="Begin of the period.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="B", help="End of the period.")] = None,
    moving: Annotated[bool, typer.Option("--high-dynamic", help="Also what was on the move at each scan.")] = False,
    file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all of it to a file as JSON.")
    ] = None,
    static_measure: Annotated[
        Measure | None, typer.Option(help="Spread of a cell for the static map: mean absolute or standard deviation.")
    ] = None,
    static_weight: Annotated[
        Weight | None, typer.Option(help="Whether intervals count by their time there, or once each.")
    ] = None,
    candidates: Annotated[
        Candidates | None, typer.Option(help="Cells that can be part of a place: once occupied, or all.")
    ] = None,
    least_occupied: Annotated[
        float | None, typer.Option(help="Cells that were occupied for a smaller share of the time are left out.")
    ] = None,
    neighbourhood: Annotated[int | None, typer.Option(help="4 or 8 neighbours of a cell.")] = None,
    distance: Annotated[SeriesDistance | None, typer.Option(help="How time series of cells are compared.")] = None,
    distance_p: Annotated[float | None, typer.Option(help="p of the Minkowski distance.")] = None,
    distance_below: Annotated[
        float | None, typer.Option(help="Neighbouring cells whose series are closer belong together.")
    ] = None,
    min_common: Annotated[
        float | None, typer.Option(help="What was seen together for a shorter time is not compared. Seconds.")
    ] = None,
    seen_share: Annotated[
        float | None, typer.Option(help="Share of a place that must be seen for its state to count.")
    ] = None,
    smallest: Annotated[float | None, typer.Option(help="Smaller places are dropped. Metres.")] = None,
    max_states: Annotated[int | None, typer.Option(help="Most places of one object.")] = None,
    within: Annotated[
        float | None, typer.Option(help="Places further apart are not one object; inf: any. Metres.")
    ] = None,
    none_share: Annotated[
        float | None, typer.Option(help="Share of time in which an object may be in none of its places.")
    ] = None,
    both_share: Annotated[
        float | None, typer.Option(help="Share of time in which several of its places may be occupied.")
    ] = None,
    near: Annotated[
        float | None, typer.Option(help="What is so close to walls and places is not on the move. Metres.")
    ] = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Find objects with several places, such as doors, and what is on the move.

    Settings that are not given are those of the method.
    """
    given: dict[str, Any] = {
        "static_measure": static_measure,
        "static_weight": static_weight,
        "candidates": candidates,
        "least_occupied": least_occupied,
        "neighbourhood": neighbourhood,
        "distance": distance,
        "distance_p": distance_p,
        "distance_below": distance_below,
        "min_common_s": min_common,
        "seen_share": seen_share,
        "smallest_m": smallest,
        "max_states": max_states,
        "within_m": within,
        "none_share": none_share,
        "both_share": both_share,
        "near_m": near,
    }
    chosen = {name: value for name, value in given.items() if value is not None}
    if within == float("inf"):
        chosen["within_m"] = None
    settings = replace(METHODS[method], **chosen)
    if file is not None:
        check_new_file(file, force)
    from tempog.analysis.find_objects import find_objects
    from tempog.store.map_directory import open_map

    history: History = open_map(map_path)
    if start is not None or stop is not None:
        history = history.window(start, stop)
    with status("finding objects", wants_progress(quiet)):
        found = find_objects(history, method, settings)
        measured = found.high_dynamics() if moving else []
        document = found.document(measured)

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
        typer.echo(f"... and {len(places) - LISTED} more; --json FILE lists them")
    if measured:
        mean = sum(len(one.cells) for one in measured) / len(measured)
        typer.echo(
            f"on the move: {mean:.1f} cells at a scan, in the mean; {count_text(len(measured[-1].cells))} at"
            f" {history.format_moment(measured[-1].stamp_ns)}"
        )
    if file is not None:
        with whole_file(file) as unfinished:
            unfinished.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")
        typer.echo(f"Written: {file}")


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
        f" {duration_text(sum(seen_s.values())):>14}  {changes}"
    )
