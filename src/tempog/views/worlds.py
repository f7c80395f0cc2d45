"""Simulated worlds: walls, doors and boxes in all their places, the robot's way, people (paper, Fig. 12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from tempog.simulation import Simulation, World
from tempog.views.canvas import BLACK, Colour, sheet_for

RED: Colour = (0.80, 0.10, 0.12)
PALE_RED: Colour = (0.98, 0.58, 0.67)
BLUE: Colour = (0.0, 0.45, 0.70)
PALE_BLUE: Colour = (0.57, 0.57, 1.0)
CYAN: Colour = (0.0, 0.8, 1.0)
YELLOW: Colour = (0.93, 0.75, 0.0)
GREEN: Colour = (0.0, 0.62, 0.45)
DRAWN_AT_M = 0.05  # the canvas is as large as for a map of this resolution
MARGIN_M = 0.5


def draw_world(simulation: Simulation, *, title: str = "", axes: Axes | None = None) -> Figure:
    """The simulated environment from above (Fig. 12).

    Parameters
    ----------
    simulation : Simulation
    title : str
        Put before the world's name.
    axes : matplotlib.axes.Axes, optional
        Where to draw, with the legend below. Default: axes that fit, in a figure of their own.

    Returns
    -------
    matplotlib.figure.Figure
        Axes in metres, map frame, y up. Doors are red, boxes blue, in their first place in full colour and in
        the others pale; glass is cyan; the robot's way is yellow; people are where they were at the start.

    Examples
    --------
    >>> from tempog.simulation import corridor, simulate
    >>> draw_world(simulate(corridor(), duration_s=1.0)).axes[0].get_title(loc="left")
    'world corridor'
    """
    low, high = bounds(simulation.world)
    n_cols, n_rows = np.ceil((high - low) / DRAWN_AT_M).astype(int).tolist()
    sheet = sheet_for((n_rows, n_cols), axes)
    paint_world(sheet.axes, simulation)
    shown = f"world {simulation.world.name or 'without a name'}"
    return sheet.label([title, shown], [(BLACK, "wall"), *world_legend([simulation])])


def world_legend(simulations: Sequence[Simulation]) -> list[tuple[Colour, str]]:
    """Colours of what `paint_world` draws besides walls in these worlds, and what they mean."""
    kinds = {thing.kind for simulation in simulations for thing in simulation.world.things}
    legend = [(CYAN, "glass")] if any(simulation.world.glass for simulation in simulations) else []
    legend += [(RED, "door"), (PALE_RED, "its other places")] if kinds - {"box"} else []
    legend += [(BLUE, "box"), (PALE_BLUE, "its other places")] if "box" in kinds else []
    legend += [(GREEN, "person")] if any(simulation.people.shape[1] for simulation in simulations) else []
    return [*legend, (YELLOW, "robot's way")]


def paint_world(axes: Axes, simulation: Simulation) -> None:
    """`draw_world` on given axes, without title and legend."""
    world = simulation.world
    low, high = bounds(world)
    for what, corners in world.solids:
        axes.add_patch(Polygon(corners, closed=True, facecolor=BLACK if what == "wall" else CYAN, linewidth=0))
    for thing in world.things:
        full, pale = (BLUE, PALE_BLUE) if thing.kind == "box" else (RED, PALE_RED)
        for k, place in reversed(list(enumerate(thing.places))):
            axes.add_patch(Polygon(thing.corners(place), closed=True, facecolor=pale if k else full, linewidth=0))
        corners = thing.corners(next(iter(thing.places)))
        axes.annotate(
            thing.name,
            (corners[:, 0].mean(), corners[:, 1].max()),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=7,
            color=full,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
        )
    way = np.array([*world.robot.round_trip, world.robot.round_trip[0]])
    axes.plot(*way.T, color=YELLOW, linewidth=1.5, marker="o", markersize=3, zorder=1)
    for x, y in simulation.people[0] if len(simulation.people) else ():
        if np.isfinite(x):
            axes.add_patch(Circle((x, y), world.people.radius_m, facecolor=GREEN, linewidth=0))
    axes.set(xlabel="x (m)", ylabel="y (m)", xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.tick_params(labelsize=8)


def bounds(world: World) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of a rectangle around all that is in a world, with a margin; x and y, metres."""
    corners = [np.array(world.robot.waypoints), *(corners for _, corners in world.solids)]
    corners += [thing.corners(place) for thing in world.things for place in thing.places]
    points = np.concatenate(corners)
    return points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
