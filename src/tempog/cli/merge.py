"""``tempog merge``: several maps as one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tempog.cli._maps import opened
from tempog.cli._output import ForceFlag, JsonFlag, QuietFlag, count_text, counted, print_json, status, wants_progress


def merge(
    maps: Annotated[list[Path], typer.Argument(metavar="MAP...", help="Two or more maps of one site.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="MAP", help="The map to write.")],
    force: ForceFlag = False,
    quiet: QuietFlag = False,
    json: JsonFlag = False,
) -> None:
    """Put maps of one site, in one map frame, into one; all their sessions can be chosen."""
    from tempog.store.upkeep import merge

    with status(f"merging into {output}", wants_progress(quiet or json)):
        merge(maps, output, force=force)
    saved = opened(output)
    answer = {
        "map": str(output),
        "n_scans": saved.n_scans,
        "n_intervals": saved.n_intervals,
        "sessions": [session.id for session in saved.sessions],
    }
    if json:
        print_json(answer)
        return
    typer.echo(
        f"{output}: {counted(len(saved.sessions), 'session', 'sessions')}, {count_text(saved.n_scans)} scans,"
        f" {count_text(saved.n_intervals)} intervals"
    )
