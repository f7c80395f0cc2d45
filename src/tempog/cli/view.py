"""``tempog view``: a page to walk through a map's past."""

from __future__ import annotations

import webbrowser
from typing import TYPE_CHECKING, Annotated
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import typer

from tempog.cli._maps import MapArgument, RobotOption, SessionOption, opened
from tempog.cli._output import print_note
from tempog.errors import ConfigError
from tempog.methods import Method

if TYPE_CHECKING:
    from tempog.views.web.serve import Viewer

DEFAULT_PORT = 8765


def view(
    map_path: MapArgument,
    port: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, help=f"Port; 0 for any that is free. Default: {DEFAULT_PORT}, or the next free."
        ),
    ] = None,
    host: Annotated[
        str,
        typer.Option(help="Address to serve on. Others than this machine's own ask for a token, which is printed."),
    ] = "127.0.0.1",
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open the page in a browser.")] = False,
    method: Annotated[Method, typer.Option(help="How objects are found, as for tempog objects.")] = "evidence",
    zone: Annotated[str, typer.Option("--tz", metavar="ZONE", help="Time zone of hours and weekdays.")] = "UTC",
    sessions: SessionOption = None,
    robots: RobotOption = None,
) -> None:
    """Show a map in the browser: its whole past, to walk through.

    The page follows a map that grows. Ctrl-C ends it.
    """
    try:
        told_in = ZoneInfo(zone)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ConfigError(f"--tz {zone} is no time zone; wanted a name such as Europe/Athens") from None
    from tempog.views.web.serve import Viewer
    from tempog.views.web.sources import SavedSource

    opened(map_path, sessions, robots)
    source = SavedSource(map_path, sessions or None, robots or None)
    wanted = DEFAULT_PORT if port is None else port
    viewer = Viewer(source, host, wanted, search=port is None, method=method, zone=told_in)
    if wanted not in (0, viewer.port):
        print_note(f"port {wanted} is in use, so this is on {viewer.port}")
    viewer.run(lambda: _tell(viewer, no_open))


def _tell(viewer: Viewer, no_open: bool) -> None:
    typer.echo(f"{viewer.url}  (Ctrl-C ends it)")
    if not no_open:
        webbrowser.open(viewer.url)
