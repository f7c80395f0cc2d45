"""Where there is room for people, on a grid of cells: between walls, and connected with where the robot starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.simulation.polygons import Point, outline

if TYPE_CHECKING:
    from tempog.simulation.world import World

CELL_M = 0.2  # of the grid that people plan their ways on; half of what a 0.9 m door leaves to their middles
FREE_AROUND_M = 2.0  # room around everything, where no wall ends the world
MAX_CELLS = 4_000_000  # 400 m x 400 m; each goal keeps a map of the way to it
AT_GOAL_M = 0.3  # a goal this close to where somebody can be is as good as there
STEPS = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]


class Room:
    """The cells where a person's middle can be.

    Attributes
    ----------
    x0, y0 : float, metres
        Outer corner of cell [0, 0].
    mask : (n_rows, n_cols) uint8
        1 where walls or glass leave no room.
    inside : (n_rows, n_cols) bool
        What can be walked to from the robot's start, were all doors open.
    """

    def __init__(self, world: World) -> None:
        (self.x0, self.y0), self.mask = _wall_mask(world)
        self.start = world.robot.waypoints[0]
        self.inside = self._reached()

    def nearest(self, point: Point, cells: NDArray[np.bool_]) -> tuple[tuple[int, int], float]:
        """The cell among `cells` whose middle is nearest to a point: (row, col), and how far it is, metres."""
        found = np.argwhere(cells)
        if not len(found):
            raise WorldError("people: there is no room for anybody between the walls; wanted some")
        y, x = (found.T + 0.5) * CELL_M
        gaps = np.hypot(x + self.x0 - point[0], y + self.y0 - point[1])
        k = int(gaps.argmin())
        return (int(found[k, 0]), int(found[k, 1])), float(gaps[k])

    def goal_cells(self, goals: tuple[Point, ...]) -> NDArray[np.int32]:
        """The cells (row, col) of goals; WorldError for one that cannot be walked to."""
        cells = []
        for k, goal in enumerate(goals):
            cell, gap = self.nearest(goal, self.inside)
            if gap > AT_GOAL_M:
                in_wall = self.nearest(goal, self.mask == 0)[1] > AT_GOAL_M
                why = "lies in a wall or outside" if in_wall else "cannot be walked to"
                raise WorldError(
                    f"people.goals: number {k}, {goal}, {why}, seen from the robot's start at {self.start} with all"
                    f" doors open; the nearest place that can is {gap:.2f} m away. Wanted one within {AT_GOAL_M:g} m"
                )
            cells.append(cell)
        return np.array(cells, dtype=np.int32).reshape(-1, 2)

    def _reached(self) -> NDArray[np.bool_]:
        free = self.mask == 0
        (row, col), _ = self.nearest(self.start, free)
        reached: NDArray[np.bool_] = np.zeros(free.shape, dtype=np.bool_)
        reached[row, col] = True
        rows, cols = np.array([row]), np.array([col])
        while len(rows):  # the outermost cells are not free, so steps stay on the grid
            found = []
            for dr, dc in STEPS:
                r, c = rows + dr, cols + dc
                ok = free[r, c] & free[r, cols] & free[rows, c] & ~reached[r, c]
                found.append(np.column_stack([r[ok], c[ok]]))
            cells = np.unique(np.concatenate(found), axis=0)
            rows, cols = cells.T
            reached[rows, cols] = True
        return reached


def _wall_mask(world: World) -> tuple[tuple[float, float], NDArray[np.uint8]]:
    """Origin and cells of the grid that people plan on; 1 where walls leave no room for a person's middle."""
    walls = np.concatenate([np.empty((0, 4)), *(outline(corners) for _, corners in world.solids)])
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
