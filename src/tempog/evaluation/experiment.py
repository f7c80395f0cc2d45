"""The paper's experiments, from the world to the scores (sections V.B and V.C, Fig. 12-14, Table I)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.evaluation.judge import evaluate
from tempog.evaluation.scores import Scores
from tempog.methods import SENSING, Method
from tempog.pipeline import build_grid
from tempog.scans.scan import Scan
from tempog.simulation import Simulation, World, load_world, simulate
from tempog.simulation.truth import Truth

EXPERIMENTS = {"1": 0, "2a": 20, "2b": 40, "2c": 60}  # people in the hallway
HIGH_DYNAMIC_EVERY_S = 1.0  # people walk at most 1.5 m/s: scans closer in time judge the same people twice


@dataclass(frozen=True, eq=False)
class Drive:
    """One simulated drive, and how long simulating took.

    `name` is what the world was asked for by, without folder and suffix: all buildings by chance are "random".
    """

    name: str
    world: World
    seed: int
    people: int
    simulation: Simulation
    truth: Truth
    simulate_s: float


@dataclass(frozen=True, eq=False)
class Outcome:
    """One drive, mapped and analysed by one method at one resolution.

    Attributes
    ----------
    drive : Drive
    method : str
    resolution_m : float, metres
    found : FoundObjects
        Its `history` is the map.
    scores : Scores
    step_s : dict of step -> seconds
        Wall time of "simulate", "map", "analyse" and "judge".
    """

    drive: Drive
    method: Method
    resolution_m: float
    found: FoundObjects
    scores: Scores
    step_s: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Scores and how they came about, ready for JSON."""
        return {
            "world": self.drive.world.name,
            "people": self.drive.people,
            "seed": self.drive.seed,
            "duration_s": self.drive.simulation.duration_s,
            "n_scans": len(self.drive.simulation.scans),
            "method": self.method,
            "evidence": SENSING[self.method],
            "resolution_m": self.resolution_m,
            "scores": self.scores.to_dict(),
            "seconds": {step: round(seconds, 3) for step, seconds in self.step_s.items()},
        }


def drive_through(
    world: str = "hallway",
    people: int | None = None,
    seed: int = 0,
    duration_s: float | None = None,
    track: Callable[[Sequence[int]], Iterable[int]] | None = None,
) -> Drive:
    """Simulate one drive; see `load_world` and `simulate` for the parameters."""
    started = time.perf_counter()
    described = load_world(world, seed)
    simulation = simulate(described, duration_s, seed=seed, people=people, track=track)
    seconds = time.perf_counter() - started
    n_people = simulation.people.shape[1]
    return Drive(Path(world).stem, described, seed, n_people, simulation, Truth.of(simulation), seconds)


def examine(
    drive: Drive,
    method: Method = "evidence",
    resolution_m: float = GridConfig.resolution_m,
    track: Callable[[list[Scan]], Iterable[Scan]] | None = None,
) -> Outcome:
    """Map a drive, find objects in it, and judge them.

    The map's sensing goes with the method, see `tempog.methods.SENSING`. What is on the move is judged once a second.
    """
    sensing = SensingConfig(evidence=SENSING[method])
    config = MapConfig(sensing=sensing, grid=GridConfig(resolution_m=resolution_m))
    moments = [time.perf_counter()]
    grid = build_grid(drive.simulation.scans, config, track=track)
    moments.append(time.perf_counter())
    found = find_objects(grid, method)
    moving = found.high_dynamics(HIGH_DYNAMIC_EVERY_S)
    moments.append(time.perf_counter())
    scores = evaluate(found.document(moving), drive.truth)
    moments.append(time.perf_counter())
    steps = dict(zip(("map", "analyse", "judge"), np.diff(moments).tolist(), strict=True))
    return Outcome(drive, method, resolution_m, found, scores, {"simulate": drive.simulate_s, **steps})
