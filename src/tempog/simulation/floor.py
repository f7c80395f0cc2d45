"""The floor that people walk on: where they want to go, and where they are at first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.simulation.polygons import disc_gap
from tempog.simulation.room import CELL_M, Room
from tempog.simulation.state import Floor
from tempog.simulation.world import World

N_GOALS = 60
N_COMPARED = 12  # of these; goals that the world gives are all alike likely
CLEAR_OF_ROBOT_M = 0.5  # at the start


def plan_floor(world: World, room: Room, rng: np.random.Generator) -> Floor:
    """The grid that people plan on, and their goals: the world's, or anywhere that can be walked to."""
    inside = np.argwhere(room.inside)
    goals = room.goal_cells(world.people.goals)
    if not len(goals):
        goals = inside[rng.integers(0, len(inside), N_GOALS)].astype(np.int32)
    return Floor(
        goals=goals,
        fields=np.zeros((len(goals), *room.mask.shape), dtype=np.int32),
        field_epoch=np.full(len(goals), -1, dtype=np.int32),
        epoch=np.array([0, -1], dtype=np.int32),
        wall_mask=room.mask,
        blocked=room.mask.copy(),
        queue=np.zeros(room.mask.size, dtype=np.int32),
        queued=np.zeros_like(room.mask),
        x0=room.x0,
        y0=room.y0,
        cell_m=CELL_M,
        n_compared=1 if world.people.goals else N_COMPARED,
    )


def start_places(
    world: World, room: Room, corners: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Where walkers are at first, (number, 2): anywhere inside, clear of everything."""
    crowd, robot = world.people, world.robot
    people = np.empty((crowd.number, 2))
    start = np.array(robot.waypoints[0])
    cells = np.argwhere(room.inside)
    rng.shuffle(cells)
    replayed = np.array([track.positions(0.0) for track in crowd.tracks]).reshape(-1, 2)
    replayed = replayed[np.isfinite(replayed[:, 0])]
    n = 0
    for row, col in cells.tolist():
        if n == crowd.number:
            break
        x, y = room.x0 + (col + 0.5) * CELL_M, room.y0 + (row + 0.5) * CELL_M
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
