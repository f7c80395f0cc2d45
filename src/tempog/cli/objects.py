"""``tempog objects``: doors, chairs, people."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from tempog._files import whole_file
from tempog.cli._output import ForceFlag, check_new_file, count_text, duration_text
from tempog.cli.info import MapArgument
from tempog.config import ObjectsConfig
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.analysis.configurations import Configuration
    from tempog.grid.history import History

LISTED = 20


def objects(
    map_path: MapArgument,
    method: Annotated[Literal["paper"], typer.Option(help="paper: its algorithms to the letter.")] = "paper",
    start: Annotated[str | None, typer.Option("--from", metavar="A", help="Begin of the period.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="B", help="End of the period.")] = None,
    moving: Annotated[
        bool, typer.Option("--high-dynamic", help="Also what was on the move at the period's last scan.")
    ] = False,
    file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all of it to a file as JSON.")
    ] = None,
    distance_p: Annotated[
        float, typer.Option(help="p of the Minkowski distance of time series.")
    ] = ObjectsConfig.distance_p,
    distance_below: Annotated[
        float, typer.Option(help="Neighbouring cells whose series are closer belong together.")
    ] = ObjectsConfig.distance_below,
    min_common: Annotated[
        float, typer.Option(help="What was seen together for a shorter time is not compared. Seconds.")
    ] = ObjectsConfig.min_common_s,
    max_states: Annotated[int, typer.Option(help="Most places of one object.")] = ObjectsConfig.max_states,
    within: Annotated[
        float, typer.Option(help="Places further apart are not one object; inf: any. Metres.")
    ] = ObjectsConfig.within_m or float("inf"),
    none_share: Annotated[
        float, typer.Option(help="Share of time in which an object may be in none of its places.")
    ] = ObjectsConfig.none_share,
    both_share: Annotated[
        float, typer.Option(help="Share of time in which several of its places may be occupied.")
    ] = ObjectsConfig.both_share,
    force: ForceFlag = False,
) -> None:
    """Find objects with several places, such as doors, and what is on the move."""
    settings = ObjectsConfig(
        distance_p,
        distance_below,
        min_common,
        max_states,
        None if within == float("inf") else within,
        none_share,
        both_share,
    )
    if file is not None:
        check_new_file(file, force)
    from tempog.analysis.configurations import find_configurations
    from tempog.analysis.high_dynamic import high_dynamic
    from tempog.analysis.objects import associate
    from tempog.analysis.objects_file import objects_document
    from tempog.analysis.static import static_map
    from tempog.store.map_directory import open_map

    history: History = open_map(map_path)
    history.require_scans()
    if start is not None or stop is not None:
        history = history.window(start, stop)
    walls = static_map(history, weight="interval")  # Fig. 6
    configurations = find_configurations(  # Fig. 7
        history,
        walls,
        distance=settings.distance_p,
        threshold=settings.distance_below,
        min_common_s=settings.min_common_s,
    )
    found = associate(  # Fig. 10
        configurations,
        max_states=settings.max_states,
        within_m=settings.within_m,
        none_share=settings.none_share,
        both_share=settings.both_share,
        min_common_s=settings.min_common_s,
    )
    measured = [high_dynamic(history, walls=walls, configurations=configurations)] if moving else []  # Fig. 11
    document = objects_document(history, walls, configurations, found, measured, settings)

    typer.echo(
        f"{len(found)} objects, {len(document['unassociated'])} configurations in none,"
        f" {count_text(len(document['static']))} static cells; method {method}"
    )
    if configurations:
        typer.echo(
            f"{'object':>6} {'place':>6} {'x':>8} {'y':>8} {'cells':>6} {'occupied':>14} {'seen':>14}  changes"
        )
    places = [(str(one.id), place) for one in found for place in one.configurations]
    associated = {place.id for _, place in places}
    places += [("-", place) for place in configurations if place.id not in associated]
    for name, place in places[:LISTED]:
        typer.echo(f"{name:>6} {place_text(place)}")
    if len(places) > LISTED:
        typer.echo(f"... and {len(places) - LISTED} more; --json FILE lists them")
    for one in measured:
        typer.echo(f"on the move at {history.format_moment(one.stamp_ns)}: {count_text(len(one.cells))} cells")
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
