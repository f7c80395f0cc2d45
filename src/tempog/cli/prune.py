"""``tempog prune``: delete old history for ever."""

from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from tempog.cli._maps import MapArgument, opened
from tempog.cli._output import (
    JsonFlag,
    QuietFlag,
    bytes_text,
    count_text,
    counted,
    print_json,
    status,
    wants_progress,
)
from tempog.cli.show import MOMENT_HELP
from tempog.errors import ConfigError
from tempog.times import NS_PER_S, parse_duration

if TYPE_CHECKING:
    from tempog.store.saved_map import SavedMap
    from tempog.store.upkeep import Pruned


def prune(
    map_path: MapArgument,
    keep: Annotated[
        str | None, typer.Option(metavar="DURATION", help="How much stays, counted from the last scan: 30d, 24h.")
    ] = None,
    before: Annotated[
        str | None, typer.Option(metavar="T", help=f"What ended before this moment goes: {MOMENT_HELP}.")
    ] = None,
    forget: Annotated[
        bool, typer.Option("--forget", help="Also the last state of cells that were not seen since.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")] = False,
    quiet: QuietFlag = False,
    json: JsonFlag = False,
) -> None:
    """Delete old history of a map for ever, after saying what goes.

    The last known state of each cell stays, however old, unless --forget is given: nothing vanishes from the map
    because nobody looked.
    """
    if (keep is None) == (before is None):
        raise ConfigError("give --keep DURATION or --before T: how much stays, or what goes")
    duration_ns = kept_ns(keep) if keep is not None else 0
    if json and not (yes or dry_run):
        raise ConfigError("--json asks nobody; add --yes to delete, or --dry-run to see what would go")
    from tempog.store.upkeep import prune

    saved = opened(map_path)
    saved.require_scans()
    before_ns = saved.parse_moment(before) if before is not None else int(saved.stamps_ns[-1]) - duration_ns
    with status(f"reading {map_path}", wants_progress(quiet or json)):
        gone = prune(map_path, before_ns, forget=forget, dry_run=True)
    anything = bool(gone.n_scans or gone.n_intervals)
    if not json:
        typer.echo(
            f"{map_path}: {said(saved, gone, forget) if anything else 'nothing is that old; all of it stays.'}"
        )
    if not dry_run and anything:
        if not yes and not sys.stdin.isatty():
            raise ConfigError("nothing was deleted; add --yes to delete without being asked")
        if not yes and not typer.confirm("Delete?"):
            typer.echo("Nothing was deleted.")
            raise typer.Exit(1)
        with status(f"pruning {map_path}", wants_progress(quiet or json)):
            gone = prune(map_path, before_ns, forget=forget)
    if json:
        print_json({"map": str(map_path), "deleted": not dry_run, **dataclasses.asdict(gone)})
    elif gone.n_bytes is not None:
        typer.echo(f"Deleted; {bytes_text(gone.n_bytes)} less.")


def kept_ns(keep: str) -> int:
    """How much stays, in nanoseconds; a number without a unit is refused, since 30 is hardly meant as seconds."""
    seconds = parse_duration(keep)
    if not keep.strip()[-1].isalpha():
        raise ConfigError(f"--keep {keep} has no unit; wanted for example 30d, 24h or 90min")
    return round(seconds * NS_PER_S)


def said(saved: SavedMap, gone: Pruned, forget: bool) -> str:
    """What goes, and what becomes of cells that were not seen since."""
    text = (
        f"{count_text(gone.n_intervals)} of {count_text(saved.n_intervals)} intervals and"
        f" {count_text(gone.n_scans)} of {count_text(saved.n_scans)} scans, from before"
        f" {saved.format_moment(gone.before_ns)}, go for ever"
    )
    if not gone.n_last_seen:
        return f"{text}."
    kept = "go, too" if forget else "stay"
    return f"{text}; the last states of {counted(gone.n_last_seen, 'cell', 'cells')} that nobody saw since {kept}."
