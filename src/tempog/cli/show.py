"""``tempog show``: a map as a picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tempog.cli._maps import MapArgument, RobotOption, SessionOption, note_pruned, opened
from tempog.cli._output import ForceFlag, check_new_picture, save_figure
from tempog.errors import ConfigError, TimeError
from tempog.methods import Method
from tempog.times import NS_PER_S
from tempog.views.layers import FOUND_LAYERS, MOMENT_LAYERS, Layer

if TYPE_CHECKING:
    from tempog.grid.history import History

MOMENT_HELP = "seconds as in the log, +120 or +36h from the start, or a date like 2003-12-10T17:51:58Z"


def show(
    map_path: MapArgument,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="PICTURE", help="The file to write, e.g. out.png.")
    ],
    layer: Annotated[Layer, typer.Option(help="What to draw.")] = "occupancy",
    at: Annotated[str | None, typer.Option(metavar="T", help=f"The moment to draw: {MOMENT_HELP}.")] = None,
    start: Annotated[str | None, typer.Option("--from", metavar="A", help="Begin of the period to draw.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="B", help="End of the period to draw.")] = None,
    hold: Annotated[
        float | None,
        typer.Option(help="Seconds that a cell keeps its last known state (occupancy, age). Default: for ever."),
    ] = None,
    method: Annotated[
        Method | None, typer.Option(help="How objects are found, as for tempog objects (objects). Default: evidence.")
    ] = None,
    sessions: SessionOption = None,
    robots: RobotOption = None,
    force: ForceFlag = False,
) -> None:
    """Draw one layer of a map."""
    if at is not None and (start is not None or stop is not None):
        raise ConfigError("--at names a moment, --from and --to a period; give one or the other")
    check_new_picture(output, force)
    from tempog.views.figures import draw_layer

    if at is not None and layer not in MOMENT_LAYERS:
        raise ConfigError(f"--at names a moment, but the {layer} layer shows a period; use --from and --to")
    if hold is not None and layer not in MOMENT_LAYERS:
        raise ConfigError(f"--hold does not go with the {layer} layer; it is for {' and '.join(MOMENT_LAYERS)}")
    if method is not None and layer not in FOUND_LAYERS:
        raise ConfigError(f"--method does not go with the {layer} layer; it is for objects")
    saved = opened(map_path, sessions, robots)
    history: History = saved
    if at is not None:
        _require_covered(history, at)
    if start is not None or stop is not None:
        history = history.window(start, stop)
    note_pruned(saved, *(saved.parse_moment(moment) for moment in (at, start, stop) if moment is not None))
    figure = draw_layer(
        history,
        layer,
        at=at,
        hold=math.inf if hold is None else hold,
        method=method or "evidence",
        title=map_path.stem,
    )
    save_figure(figure, output)
    typer.echo(f"{output}: {layer} of {map_path}")


def _require_covered(history: History, moment: str) -> None:
    stamp_ns = history.parse_moment(moment)
    first, last = int(history.stamps_ns[0]), int(history.stamps_ns[-1])
    if not first <= stamp_ns <= last:
        raise TimeError(
            f"the map knows nothing of {stamp_ns / NS_PER_S:.3f} s: its scans run from {first / NS_PER_S:.3f} s to"
            f" {last / NS_PER_S:.3f} s, +0 to +{(last - first) / NS_PER_S:.1f}"
        )
