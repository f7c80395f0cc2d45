"""``tempog view``: a page to walk through a map's past."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import typer

from tempog.cli._maps import MapArgument, RobotOption, SessionOption, opened
from tempog.cli._output import ForceFlag, check_new_file, print_note, status, wants_progress
from tempog.errors import ConfigError
from tempog.methods import Method

if TYPE_CHECKING:
    from tempog.store.saved_map import SavedMap
    from tempog.views.web.serve import Viewer

DEFAULT_HOST, DEFAULT_PORT, DEFAULT_ZONE = "127.0.0.1", 8765, "UTC"


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
    ] = DEFAULT_HOST,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open the page in a browser.")] = False,
    method: Annotated[Method, typer.Option(help="How objects are found, as for tempog objects.")] = "evidence",
    zone: Annotated[
        str, typer.Option("--tz", metavar="ZONE", help="Time zone of hours and weekdays.")
    ] = DEFAULT_ZONE,
    rerun: Annotated[bool, typer.Option("--rerun", help="Show it in the Rerun viewer instead of a browser.")] = False,
    rrd: Annotated[
        Path | None, typer.Option("--rrd", metavar="FILE", help="Write a recording for the Rerun viewer instead.")
    ] = None,
    sessions: SessionOption = None,
    robots: RobotOption = None,
    force: ForceFlag = False,
) -> None:
    """Show a map in the browser: its whole past, to walk through.

    The page follows a map that grows. Ctrl-C ends it.
    """
    if rerun or rrd is not None:
        if rerun and rrd is not None:
            raise ConfigError("--rerun shows the map and --rrd writes a file; give one or the other")
        if (port, host, zone, no_open) != (None, DEFAULT_HOST, DEFAULT_ZONE, False):
            raise ConfigError("--port, --host, --tz and --no-open are for the page; leave them out with Rerun")
        if rrd is not None:
            check_new_file(rrd, force)
        _show_in_rerun(opened(map_path, sessions, robots), map_path.stem, rrd, method, force)
        return
    if force:
        raise ConfigError("--force is for --rrd: the page writes nothing")
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


def _show_in_rerun(saved: SavedMap, name: str, rrd: Path | None, method: Method, force: bool) -> None:
    from tempog._extras import need
    from tempog.views.rerun_log import log_to_rerun

    need("rerun", "rerun")  # before a minute goes by
    from tempog.analysis.find_objects import find_objects

    with status("finding objects", wants_progress(False)):
        found = find_objects(saved, method)
    log_to_rerun(saved, found, rrd, name=name, force=force)
    if rrd is not None:
        typer.echo(f"{rrd}: a recording of {saved.path}; open it with rerun")
