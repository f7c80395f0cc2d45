"""Fits the table of `tempog.analysis.evidence.scorecard`: which traits tell places from people and displaced walls.

Drives through five kinds of world, with and without people, exact and drifting poses, fast and slow scanners, at two
resolutions. Each group of changing cells is a place if it overlaps one that was truly seen by 0.4, and none if by
less than 0.15. Logistic regression over hat functions; neighbouring weights are drawn together. Which weights serve
is judged on drives that were not fitted on, five times over. Seeds from 200 on are used up; reports have others.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog import GridConfig, MapConfig, build_grid
from tempog.analysis.evidence.blocks import BLOCK_TILES, cell_states
from tempog.analysis.evidence.find import for_looks_every, steady_look_ns
from tempog.analysis.evidence.grouping import group_cells
from tempog.analysis.evidence.places import candidates
from tempog.analysis.evidence.scorecard import Traits
from tempog.evaluation.matching import MATCH_IOU, tolerant_iou
from tempog.methods import EvidenceConfig
from tempog.simulation import PoseError, load_world, simulate
from tempog.simulation.observability import seen_places
from tempog.simulation.truth import Truth
from tempog.times import NS_PER_S


class Drive(NamedTuple):
    """Drift in metres and degrees, forgotten in so many seconds; one scan of so many is kept."""

    world: str
    people: int
    seed: int
    drift_m: float = 0.0
    drift_deg: float = 0.0
    drift_s: float = 60.0
    white_m: float = 0.0
    white_deg: float = 0.0
    one_of: int = 1


DRIVES = [
    *(Drive("hallway", people, seed) for seed, people in enumerate((0, 40, 60, 20), 200)),
    *(Drive("hallway", people, seed) for seed, people in enumerate((60, 60, 40, 20, 0, 60, 60), 220)),
    *(Drive("office", people, seed) for seed, people in enumerate((0, 20, 20, 0, 40, 0), 240)),
    *(Drive("rooms", people, seed) for seed, people in enumerate((8, 8, 0, 16), 250)),
    *(Drive("ring", people, seed) for seed, people in enumerate((0, 10, 10, 0, 20), 260)),
    *(Drive("random", people, seed) for seed, people in enumerate((0, 8, 8, 8, 8, 0, 0, 16, 16, 8), 270)),
    # Poses that are a little off, as from a good SLAM,
    Drive("hallway", 40, 300, 0.03, 0.5),
    Drive("hallway", 0, 301, 0.015, 0.25),
    Drive("hallway", 20, 302, 0.01, 0.2),
    Drive("hallway", 0, 303, 0.03, 0.5),
    Drive("office", 0, 304, 0.02, 0.3),
    Drive("office", 20, 305, 0.04, 0.6),
    Drive("office", 20, 306, white_m=0.01, white_deg=0.2),
    Drive("rooms", 8, 307, 0.03, 0.5),
    Drive("rooms", 8, 308, white_m=0.01, white_deg=0.2),
    Drive("random", 8, 309, 0.02, 0.3),
    Drive("random", 0, 310, white_m=0.01, white_deg=0.2),
    Drive("random", 0, 311, 0.03, 0.5),
    Drive("random", 8, 312, 0.03, 0.5),
    Drive("ring", 0, 313, 0.03, 0.5),
    Drive("ring", 10, 314, 0.02, 0.4),
    # poses that are off by a decimetre for minutes, as between the passes of a long drive,
    Drive("hallway", 0, 320, 0.08, 1.0, 150.0),
    Drive("hallway", 20, 321, 0.05, 1.0, 300.0),
    Drive("rooms", 0, 322, 0.06, 0.8, 150.0),
    Drive("rooms", 8, 323, 0.10, 1.0, 300.0),
    Drive("office", 0, 324, 0.06, 1.0, 200.0),
    Drive("ring", 0, 325, 0.08, 0.6, 200.0),
    Drive("random", 0, 326, 0.08, 1.0, 150.0),
    Drive("random", 8, 327, 0.05, 0.8, 100.0),
    # and logs that were thinned to a scan in seconds.
    Drive("hallway", 0, 330, 0.05, 0.8, 150.0, one_of=20),
    Drive("rooms", 0, 331, 0.05, 0.8, 150.0, one_of=30),
    Drive("rooms", 8, 332, 0.08, 0.8, 200.0, one_of=40),
    Drive("office", 0, 333, 0.03, 0.6, 200.0, one_of=20),
    Drive("random", 0, 334, 0.05, 0.8, 150.0, one_of=30),
    Drive("random", 8, 335, one_of=20),
    Drive("ring", 0, 336, 0.06, 0.8, 200.0, one_of=20),
]
RESOLUTIONS_M = (0.05, 0.1)
NO_PLACE_IOU = 0.15  # what lies between is neither
KNOTS: dict[str, tuple[float, ...]] = {
    "duty": (0.0, 0.03, 0.06, 0.1, 0.2, 0.6, 0.85, 0.95, 1.0),
    "free_worth": (0.0, 1.0, 2.5, 5.0, 10.0),
    "leak": (0.0, 0.02, 0.1, 0.35, 1.0, 2.0),
    "echo": (0.0, 0.05, 0.2, 0.5, 1.0),
    "together": (0.85, 0.97, 1.0),
    "n_occupied": (1.0, 2.0, 4.0),
    "n_long": (0.0, 1.0, 2.0),
    "depth_m": (0.0, 0.03, 0.06, 0.1, 0.2),
    "size_m": (0.3, 0.5, 0.8),
}
ALIKE = 0.5  # how strongly neighbouring weights are drawn together, per squared log odds
SMALL = 0.02  # ... and each towards 0
FOLDS = 5


class Group(NamedTuple):
    """A group of cells of one drive."""

    drive: int
    resolution_m: float
    traits: Traits
    is_place: bool


def groups_of(number: int, drive: Drive) -> Iterator[Group]:
    """All groups of one drive that are clearly a place, or clearly none."""
    error = PoseError(
        drive.white_m, math.radians(drive.white_deg), drive.drift_m, math.radians(drive.drift_deg), drive.drift_s
    )
    simulation = simulate(
        replace(load_world(drive.world, drive.seed), pose_error=error), seed=drive.seed, people=drive.people
    )
    truth = Truth.of(simulation)
    for resolution_m in RESOLUTIONS_M:
        config = MapConfig(grid=GridConfig(resolution_m=resolution_m))
        grid = build_grid(list(simulation.scans)[:: drive.one_of], config)
        look = steady_look_ns(grid)
        settings = for_looks_every(look / NS_PER_S, EvidenceConfig())
        states = cell_states(grid, settings, None, BLOCK_TILES, look)
        true_cells = [place.seen for place in seen_places(truth, resolution_m) if len(place.seen)]
        for place, traits in candidates(states, group_cells(states, settings), settings):
            cells = np.stack([states.rows[place.cells], states.cols[place.cells]], axis=-1)
            near = [
                seen
                for seen in true_cells
                if np.all(seen.max(axis=0) >= cells.min(axis=0) - 1)
                and np.all(seen.min(axis=0) <= cells.max(axis=0) + 1)
            ]
            overlap = max((tolerant_iou(cells, seen) for seen in near), default=0.0)
            if not NO_PLACE_IOU <= overlap < MATCH_IOU:
                yield Group(number, resolution_m, traits, overlap >= MATCH_IOU)


def hats(value: NDArray[np.float64], knots: tuple[float, ...]) -> NDArray[np.float64]:
    """(n, n_knots): each hat is 1 at its knot and 0 at the others."""
    return np.stack([np.interp(value, knots, hat) for hat in np.eye(len(knots))], axis=-1)


def fit(x: NDArray[np.float64], y: NDArray[np.float64], parts: list[slice]) -> NDArray[np.float64]:
    """Weights of the likeliest logistic model, neighbours drawn together."""
    from scipy.optimize import minimize

    penalty = np.zeros((x.shape[1], x.shape[1]))
    for part in parts:
        n = part.stop - part.start
        steps = np.diff(np.eye(n), axis=0)
        penalty[part, part] = ALIKE * steps.T @ steps + SMALL * np.eye(n)

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        z = x @ weights
        p = 1 / (1 + np.exp(-z))
        total = np.sum(np.logaddexp(0, z) - y * z) + weights @ penalty @ weights / 2
        return float(total), x.T @ (p - y) + penalty @ weights

    start = np.zeros(x.shape[1])
    return np.asarray(
        minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 5000, "maxfun": 20000}).x
    )


def main() -> None:
    """Simulate, fit, and print the table and how well it does on drives left out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=len(DRIVES), help="only the first so many")
    chosen = DRIVES[: parser.parse_args().drives]
    groups = []
    for number, drive in enumerate(chosen):
        groups += list(groups_of(number, drive))
        print(f"{drive.world:8} people {drive.people:2} seed {drive.seed}: {len(groups)} groups so far", flush=True)
    y = np.array([group.is_place for group in groups], dtype=np.float64)
    columns, parts = [np.ones((len(y), 1))], []
    for name, knots in KNOTS.items():
        begin = sum(column.shape[1] for column in columns)
        columns.append(hats(np.array([getattr(group.traits, name) for group in groups], dtype=np.float64), knots))
        parts.append(slice(begin, begin + len(knots)))
    x = np.hstack(columns)

    drive_of = np.array([group.drive for group in groups])
    odds = np.zeros(len(y))
    for fold in range(FOLDS):
        left_out = drive_of % FOLDS == fold
        odds[left_out] = x[left_out] @ fit(x[~left_out], y[~left_out], parts)
    print(f"{int(y.sum())} places, {int((1 - y).sum())} other groups; on drives left out, by log odds:")
    for above in (-1.0, -0.5, 0.0, 0.5, 1.0):
        kept = odds > above
        print(f"  above {above:4.1f}: {int(y[kept].sum())} places, {int((1 - y[kept]).sum())} others")

    weights = fit(x, y, parts)
    base = weights[0]
    lines = []
    for (name, knots), part in zip(KNOTS.items(), parts, strict=True):
        mean = float((x[y == 1, part] @ weights[part]).mean())
        base += mean
        table = tuple(round(float(weight - mean), 1) for weight in weights[part])
        lines.append(f'    "{name}": ({knots}, {table}),')
    print(f"\nBASE = {base:.1f}\nWEIGHTS = {{", *lines, "}", sep="\n")


if __name__ == "__main__":
    main()
