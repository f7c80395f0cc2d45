"""``tempog demo``: a simulated corridor with a door and a person, mapped and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tempog.cli._output import (
    ForceFlag,
    QuietFlag,
    check_new_picture,
    count_text,
    duration_text,
    save_figure,
    track_scans,
    wants_progress,
)
from tempog.errors import MapError
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.analysis.find_objects import FoundObjects
    from tempog.grid.temporal_grid import TemporalGrid
    from tempog.simulation import Simulation

DOOR = "D1"
NEAR_DOOR_M = 1.5  # changes this close to the hinge are counted as the door's


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Where to put map and pictures.")
    ] = Path("demo"),
    force: ForceFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Map a simulated corridor, find its door again, and draw it. Needs no data."""
    from tempog.analysis.find_objects import find_objects
    from tempog.pipeline import build_grid
    from tempog.simulation import corridor, simulate
    from tempog.store.saved_map import check_target, save_map
    from tempog.views.figures import draw_layer
    from tempog.views.objects import draw_objects

    pictures = {
        name: output / f"{name}.png" for name in ("door-open", "door-closed", "dynamics", "static", "objects")
    }
    if output.exists() and not output.is_dir():
        raise MapError(f"{output} is a file; name a directory for the demo's map and pictures")
    output.mkdir(parents=True, exist_ok=True)
    map_path = output / "corridor.tempog"
    check_target(map_path, force)
    for picture in pictures.values():
        check_new_picture(picture, force)

    simulation = simulate(corridor(seed=0), seed=0)
    grid = build_grid(simulation.scans, track=track_scans if wants_progress(quiet) else None)
    save_map(grid, map_path, force=force)
    opened_s, closed_s = moments_of_door(simulation, grid)
    save_figure(draw_layer(grid, at=f"+{opened_s:.1f}", title="door open"), pictures["door-open"])
    save_figure(draw_layer(grid, at=f"+{closed_s:.1f}", title="door closed"), pictures["door-closed"])
    save_figure(draw_layer(grid, "dynamics"), pictures["dynamics"])
    save_figure(draw_layer(grid, "static"), pictures["static"])
    found = find_objects(grid)
    save_figure(draw_objects(found), pictures["objects"])
    describe(simulation, grid, opened_s, closed_s)
    describe_objects(found)
    typer.echo(f"Map: {map_path}")
    typer.echo(f"Pictures: {', '.join(str(picture) for picture in pictures.values())}")


def moments_of_door(simulation: Simulation, grid: TemporalGrid) -> tuple[float, float]:
    """Seconds from the start of the map at which the door has been open, and closed, for longest."""
    start_s = int(grid.stamps_ns[0]) / NS_PER_S
    states = [(t - start_s, state) for t, state in simulation.states(DOOR)]
    ends = [t for t, _ in states[1:]] + [grid.duration_s]
    longest = {}
    for wanted in ("open", "closed"):
        periods = [(end - t, end) for (t, state), end in zip(states, ends, strict=True) if state == wanted and t > 0]
        longest[wanted] = max(periods)[1] - 0.5
    return longest["open"], longest["closed"]


def describe(simulation: Simulation, grid: TemporalGrid, opened_s: float, closed_s: float) -> None:
    """Print what the map found, beside what was true."""
    from tempog.analysis.static import CellClass, static_map
    from tempog.grid.history import OCCUPIED_ABOVE

    static_cells = int(np.count_nonzero(static_map(grid) == CellClass.STATIC))
    typer.echo(
        f"{count_text(grid.n_scans)} scans, {duration_text(grid.duration_s)}: {count_text(grid.n_cells)} cells with"
        f" {count_text(grid.n_intervals)} intervals; {count_text(static_cells)} cells are static."
    )
    changes = grid.changes(f"+{opened_s:.1f}", f"+{closed_s:.1f}")
    hinge = np.array(next(iter(simulation.world.things[0].places.values()))[:2])
    near = np.hypot(*(changes.points_map - hinge).T) < NEAR_DOOR_M
    typer.echo(
        f"Between +{opened_s:.1f} s and +{closed_s:.1f} s {len(near)} cells changed,"
        f" {int(near.sum())} of them within {NEAR_DOOR_M:g} m of the door's hinge."
    )
    appeared = near & (changes.after > changes.before)
    if not appeared.any():
        return
    x, y = np.median(changes.points_map[appeared], axis=0)
    x, y = min(changes.points_map[appeared], key=lambda point: float(np.hypot(point[0] - x, point[1] - y)))
    states = [("closed" if value > OCCUPIED_ABOVE else "open", start) for start, _, value in grid.history(x, y)]
    seen = [state for k, state in enumerate(states) if k == 0 or state[0] != states[k - 1][0]]
    typer.echo(f"The cell at ({x:.2f}, {y:.2f}) m, where the leaf closes, remembers:")
    typer.echo("  seen  " + ", ".join(f"{name} +{(ns - grid.start_ns) / NS_PER_S:.0f} s" for name, ns in seen))
    true = [(name, t - grid.start_ns / NS_PER_S) for t, name in simulation.states(DOOR) if name != "moving"]
    typer.echo("  true  " + ", ".join(f"{name} +{t:.0f} s" for name, t in true))


def describe_objects(found: FoundObjects) -> None:
    """Print what was found to stand now here, now there."""
    for one in found.objects:
        centres = " and ".join(f"({x:.1f}, {y:.1f})" for x, y in (place.centre_m for place in one.configurations))
        typer.echo(
            f"Found without being told: one thing that stands at {centres} m in turn, moved {one.n_moves} times."
        )
