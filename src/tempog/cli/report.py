"""``tempog report``: a page about a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tempog._files import whole_file
from tempog.cli._maps import MapArgument, RobotOption, SessionOption, note_pruned, opened
from tempog.cli._output import (
    ForceFlag,
    QuietFlag,
    bytes_text,
    check_new_file,
    status,
    wants_progress,
)
from tempog.cli.objects import MethodOption
from tempog.errors import ConfigError

SUFFIXES = (".html", ".htm")


def report(
    map_path: MapArgument,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="PAGE", help="The file to write, e.g. report.html.")
    ],
    start: Annotated[str | None, typer.Option("--from", metavar="A", help="Begin of the period.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="B", help="End of the period.")] = None,
    method: MethodOption = "evidence",
    name: Annotated[str | None, typer.Option(help="Title of the page. Default: the map's file name.")] = None,
    sessions: SessionOption = None,
    robots: RobotOption = None,
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Write a page about a map: pictures, objects, quality of the data, settings.

    The page is one file that loads nothing from anywhere: send it, print it, keep it.
    """
    if output.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"{output} names no page; wanted a name that ends in {' or '.join(SUFFIXES)}")
    check_new_file(output, force)
    from tempog.views.report import report_page

    saved = opened(map_path, sessions, robots)
    with status("finding objects and drawing", wants_progress(quiet)):
        page = report_page(saved, start, stop, method=method, name=name or map_path.stem)
    with whole_file(output) as unfinished:
        unfinished.write_text(page, encoding="utf-8")
    typer.echo(f"{output}: report on {map_path}, {bytes_text(output.stat().st_size)}")
    if not quiet:
        note_pruned(saved, *(saved.parse_moment(moment) for moment in (start, stop) if moment is not None))
