"""``tempog compact``: a map in few files."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import typer

from tempog.cli._maps import MapArgument
from tempog.cli._output import JsonFlag, QuietFlag, bytes_text, counted, print_json, status, wants_progress


def compact(
    map_path: MapArgument,
    by_reference: Annotated[
        bool, typer.Option("--by-reference", help="Keep what cells of an object share once; hardly ever smaller.")
    ] = False,
    quiet: QuietFlag = False,
    json: JsonFlag = False,
) -> None:
    """Write a map anew in few files; it answers as before."""
    from tempog.store.upkeep import compact

    with status(f"compacting {map_path}", wants_progress(quiet or json)):
        done = compact(map_path, by_reference=by_reference)
    if json:
        print_json({"map": str(map_path), **dataclasses.asdict(done)})
        return
    typer.echo(
        f"{map_path}: {counted(done.n_segments_before, 'segment', 'segments')}, {bytes_text(done.n_bytes_before)}"
        f" -> {counted(done.n_segments, 'segment', 'segments')}, {bytes_text(done.n_bytes)}"
    )
