"""The commands together, and what happens to errors."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from tempog._version import __version__
from tempog.cli import (
    compact,
    datasets,
    demo,
    diff,
    evaluate,
    experiment,
    export,
    history,
    info,
    live,
    map_logs,
    merge,
    objects,
    prune,
    replay,
    report,
    show,
    simulate,
    view,
)
from tempog.errors import ConfigError, TempogError

BAD_DATA, WRONG_USAGE = 1, 2

app = typer.Typer(
    name="tempog",
    help="A map with a memory: every state each spot of an occupancy grid has had.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("map")(map_logs.map_logs)
app.command("info")(info.info)
app.command("show")(show.show)
# A coordinate such as -3.2 is not an option.
app.command("history", context_settings={"ignore_unknown_options": True})(history.history)
app.command("view")(view.view)
app.command("objects")(objects.objects)
app.command("merge")(merge.merge)
app.command("compact")(compact.compact)
app.command("prune")(prune.prune)
app.command("diff")(diff.diff)
app.command("export")(export.export)
app.command("report")(report.report)
app.command("live")(live.live)
app.command("replay")(replay.replay)
app.command("simulate")(simulate.simulate)
app.command("evaluate")(evaluate.evaluate)
app.command("experiment")(experiment.experiment)
app.command("demo")(demo.demo)
app.add_typer(datasets.app)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tempog {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def run() -> None:
    """Run the command line; errors of tempog's own become one message and an exit code."""
    try:
        app()
    except TempogError as error:
        typer.echo(f"tempog: {error}", err=True)
        sys.exit(WRONG_USAGE if isinstance(error, ConfigError) else BAD_DATA)
    except MemoryError as error:
        what = f": {error}" if str(error) else ""
        typer.echo(
            f"tempog: not enough memory{what}; try a shorter time, larger cells, or a larger machine", err=True
        )
        sys.exit(BAD_DATA)
    except OSError as error:  # the disk's or the file system's own words: full, read-only, name too long
        typer.echo(f"tempog: {error}", err=True)
        sys.exit(BAD_DATA)
