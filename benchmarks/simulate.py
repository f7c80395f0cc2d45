"""How fast worlds are simulated: beams a second, and a quarter of an hour in the paper's hallway."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from measure import Task, interleave, median, timed
from report import Row, Section, at_least, at_most

from tempog.simulation import load_world, simulate
from tempog.simulation.raycast import cast_beams

N_SEGMENTS, N_DISCS, N_BEAMS, N_SCANS = 300, 20, 181, 300
SIDE_M, MAX_RANGE_M = 14.0, 30.0  # everything is within range, so nothing is dropped beforehand
HALLWAY_S = 900.0
PEOPLE = (0, 60)


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """The ray caster alone, then whole simulations; needs no log."""
    hallway = load_world("hallway")
    for people in (0, 1):
        simulate(hallway, 1.0, people=people)  # compiles
    tasks: dict[str, Task] = {"beams": timed(_scans())}
    for people in PEOPLE:
        tasks[str(people)] = timed(partial(simulate, hallway, HALLWAY_S, people=people))
    seconds = interleave(tasks, n_repetitions)
    section = Section(f"Simulation: {N_SEGMENTS} segments and {N_DISCS} discs; the hallway for {HALLWAY_S:g} s")
    rate = N_SCANS * N_BEAMS / median(seconds["beams"]) / 1e6
    section.rows.append(Row("beams cast, one core", f"{rate:.2f} M/s", "", rate, at_least(1.0, "M/s")))
    for people in PEOPLE:
        taken = median(seconds[str(people)])
        row = Row(f"hallway, {people} people", f"{taken:.2f} s", "", taken, at_most(4.0, "s"))
        section.rows.append(row)
    return [section]


def _scans() -> Callable[[], None]:
    """Cast `N_SCANS` scans among segments and discs that lie anywhere around the laser."""
    rng = np.random.default_rng(0)
    starts = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (N_SEGMENTS, 2))
    headings, lengths = rng.uniform(0, 2 * np.pi, N_SEGMENTS), rng.uniform(0.2, 3.0, N_SEGMENTS)
    ways = lengths[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
    segments = np.hstack([starts, starts + ways])
    discs = np.column_stack([rng.uniform(-SIDE_M / 2, SIDE_M / 2, (N_DISCS, 2)), np.full(N_DISCS, 0.25)])
    x, y, glass = np.zeros(N_BEAMS), np.zeros(N_BEAMS), np.zeros((0, N_BEAMS), dtype=np.uint8)
    angles = np.linspace(-np.pi / 2, np.pi / 2, N_BEAMS)
    distance, hit = np.empty(N_BEAMS), np.empty(N_BEAMS, dtype=np.int32)

    def cast() -> None:
        for k in range(N_SCANS):
            cast_beams(x, y, angles + 0.01 * k, segments, discs, glass, MAX_RANGE_M, distance, hit)

    return cast
