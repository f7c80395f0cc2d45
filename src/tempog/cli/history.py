"""``tempog history``: every state of one spot."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tempog.cli._maps import MapArgument, RobotOption, SessionOption, note_pruned, opened
from tempog.cli._output import JsonFlag, count_text, counted, duration_text, print_json
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.grid.history import CellHistory, History

STRIP_WIDTH = 72
LISTED = 20
OCCUPIED, FREE, BOTH, UNSEEN = "█", "░", "▒", " "


def history(
    map_path: MapArgument,
    x: Annotated[float, typer.Argument(metavar="X", help="Metres, map frame.")],
    y: Annotated[float, typer.Argument(metavar="Y", help="Metres, map frame.")],
    every: Annotated[bool, typer.Option("--all", help="List every interval.")] = False,
    sessions: SessionOption = None,
    robots: RobotOption = None,
    json: JsonFlag = False,
) -> None:
    """List the states that the cell at X Y has had."""
    saved = opened(map_path, sessions, robots)
    states = saved.history(x, y)
    if json:
        intervals = [
            {"start_s": start / NS_PER_S, "stop_s": stop / NS_PER_S, "prob": round(value, 6)}
            for start, stop, value in states
        ]
        gaps = [{"start_s": start / NS_PER_S, "stop_s": stop / NS_PER_S} for start, stop in states.gaps.tolist()]
        print_json({"map": str(map_path), "x": x, "y": y, "intervals": intervals, "gaps": gaps})
        return
    if not len(states):
        typer.echo(f"({x:g}, {y:g}) m: never observed")
        return
    row, col = saved.tiles.spec.cell_of(x, y)
    occupied = states.value > 0.5
    typer.echo(
        f"({x:g}, {y:g}) m, cell [{row}, {col}]: {counted(len(states), 'interval', 'intervals')},"
        f" {int(occupied.sum())} occupied, {int((~occupied).sum())} free, {counted(len(states.gaps), 'gap', 'gaps')}"
    )
    note_pruned(saved, int(states.start_ns[0]))
    typer.echo(f"|{strip(saved, states)}|")
    label = f"+{saved.duration_s:.0f} s"
    typer.echo(f"+0{label:>{STRIP_WIDTH}}")
    typer.echo(f"{OCCUPIED} occupied  {FREE} free  {BOTH} both  blank: not observed")
    listed = states[:] if every else states[:LISTED]
    since = [saved.format_moment(state.start_ns) for state in listed]
    width = max(map(len, since))
    for when, (start, stop, value) in zip(since, listed, strict=True):
        name = "occupied" if value > 0.5 else "free"
        length = duration_text((stop - start) / NS_PER_S)
        # Dates stand below each other, and so do plain seconds.
        aligned = when.ljust(width) if "UTC" in when else when.rjust(width)
        typer.echo(f"{aligned}  {name:8} {value:.2f}  for {length}")
    if len(listed) < len(states):
        typer.echo(f"... and {count_text(len(states) - len(listed))} more; --all lists them")


def strip(saved: History, states: CellHistory) -> str:
    """One character per equal part of the map's time."""
    first, last = int(saved.stamps_ns[0]), int(saved.stamps_ns[-1])
    borders = np.linspace(first, last, STRIP_WIDTH + 1)
    marks = []
    for left, right in pairwise(borders):
        inside = (states.start_ns <= right) & (states.stop_ns >= left)
        kinds = set((states.value[inside] > 0.5).tolist())
        marks.append({(): UNSEEN, (True,): OCCUPIED, (False,): FREE}.get(tuple(kinds), BOTH))
    return "".join(marks)
