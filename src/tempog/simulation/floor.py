"""The floor that people walk on: where there is room, where they want to go, and where they are at first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.simulation.polygons import disc_gap, outline
from tempog.simulation.walking import UNREACHED, Floor, fill_field
from tempog.simulation.world import World

CELL_M = 0.2  # of the grid that people plan their ways on; half of what a 0.9 m door leaves to their middles
N_GOALS = 60
FREE_AROUND_M = 2.0  # room around everything, where no wall ends the world
MAX_CELLS = 4_000_000  # 400 m x 400 m; each goal keeps a map of the way to it
CLEAR_OF_ROBOT_M = 0.5  # at the start


def plan_floor(world: World, walls: NDArray[np.float64], rng: np.random.Generator) -> Floor:
    """The grid that people plan on, and their goals: anywhere that can be walked to from the robot's start.

    walls (n_segments, 4) are the faces of all walls and panes.
    """
    (x0, y0), mask = _wall_mask(world, walls)
    inside = np.argwhere(_reached(mask, world.robot.waypoints[0], (x0, y0)))
    return Floor(
        goals=inside[rng.integers(0, len(inside), N_GOALS)].astype(np.int32),
        fields=np.zeros((N_GOALS, *mask.shape), dtype=np.int32),
        field_epoch=np.full(N_GOALS, -1, dtype=np.int32),
        epoch=np.array([0, -1], dtype=np.int32),
        wall_mask=mask,
        blocked=mask.copy(),
        queue=np.zeros(mask.size, dtype=np.int32),
        queued=np.zeros_like(mask),
        x0=x0,
        y0=y0,
        cell_m=CELL_M,
    )


def start_places(
    world: World, floor: Floor, corners: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Where walkers are at first, (number, 2): anywhere inside, clear of everything."""
    crowd, robot = world.people, world.robot
    people = np.empty((crowd.number, 2))
    start = np.array(robot.waypoints[0])
    cells = np.argwhere(_reached(floor.wall_mask, robot.waypoints[0], (floor.x0, floor.y0)))
    rng.shuffle(cells)
    replayed = np.array([track.positions(0.0) for track in crowd.tracks]).reshape(-1, 2)
    replayed = replayed[np.isfinite(replayed[:, 0])]
    n = 0
    for row, col in cells.tolist():
        if n == crowd.number:
            break
        x, y = floor.x0 + (col + 0.5) * CELL_M, floor.y0 + (row + 0.5) * CELL_M
        if np.hypot(*(start - (x, y))) < robot.radius_m + crowd.radius_m + CLEAR_OF_ROBOT_M:
            continue
        others = np.concatenate([people[:n], replayed])
        if len(others) and np.hypot(*(others - (x, y)).T).min() < 2 * crowd.radius_m + 0.02:
            continue
        if any(disc_gap((x, y), quad) < crowd.radius_m + 0.02 for quad in corners):
            continue
        people[n] = x, y
        n += 1
    if n < crowd.number:
        raise WorldError(f"people.number = {crowd.number}, but only {n} find room; wanted fewer, or more space")
    return people


def _wall_mask(world: World, walls: NDArray[np.float64]) -> tuple[tuple[float, float], NDArray[np.uint8]]:
    """Origin and cells of the grid that people plan on; 1 where walls leave no room for a person's middle."""
    points = np.concatenate([walls.reshape(-1, 2), np.array(world.robot.waypoints)])
    low = points.min(axis=0) - FREE_AROUND_M
    n_cols, n_rows = np.ceil((points.max(axis=0) + FREE_AROUND_M - low) / CELL_M).astype(int).tolist()
    if n_rows * n_cols > MAX_CELLS:
        raise WorldError(
            f"the world is {n_cols * CELL_M:.0f} x {n_rows * CELL_M:.0f} m; wanted at most"
            f" {MAX_CELLS * CELL_M**2:,.0f} square metres. Are its lengths metres?"
        )
    x = low[0] + (np.arange(n_cols) + 0.5)[None, :] * CELL_M
    y = low[1] + (np.arange(n_rows) + 0.5)[:, None] * CELL_M
    mask = np.zeros((n_rows, n_cols), dtype=np.uint8)
    mask[[0, -1]] = 1  # nobody leaves the world
    mask[:, [0, -1]] = 1
    for ax, ay, bx, by in walls:
        sx, sy = bx - ax, by - ay
        u = np.clip(((x - ax) * sx + (y - ay) * sy) / (sx * sx + sy * sy), 0.0, 1.0)
        mask[np.hypot(ax + u * sx - x, ay + u * sy - y) < world.people.radius_m + 0.01] = 1
    for _, corners in world.solids:
        sides = outline(corners)
        left = [(x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0 for x0, y0, x1, y1 in sides]
        mask[np.all(left, axis=0) | ~np.any(left, axis=0)] = 1
    return (float(low[0]), float(low[1])), mask


def _reached(mask: NDArray[np.uint8], start: tuple[float, float], origin: tuple[float, float]) -> NDArray[np.bool_]:
    """The cells that can be walked to from near `start`, were all doors open."""
    free = np.argwhere(mask == 0)
    if not len(free):
        raise WorldError("people: there is no room for anybody between the walls; wanted some")
    centre = np.array([(start[1] - origin[1]) / CELL_M - 0.5, (start[0] - origin[0]) / CELL_M - 0.5])
    row, col = free[np.argmin(((free - centre) ** 2).sum(axis=1))].tolist()
    field = np.empty(mask.shape, dtype=np.int32)
    fill_field(mask, row, col, field, np.zeros(mask.size, dtype=np.int32), np.zeros_like(mask))
    return np.asarray(field < UNREACHED)
