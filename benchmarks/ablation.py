"""What each ingredient of method ``evidence`` is worth: every one left out in turn, on drives it was not fitted on.

python benchmarks/ablation.py [--seeds N] [--resolution M]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
from report import describe_run

from tempog import GridConfig, MapConfig, SensingConfig, build_grid, find_objects
from tempog.analysis.evidence import places, scorecard
from tempog.evaluation.experiment import Drive, drive_through
from tempog.evaluation.judge import evaluate
from tempog.evaluation.scores import Scores
from tempog.grid.history import History
from tempog.methods import EvidenceConfig

WORLDS = (("hallway", 0), ("hallway", 40), ("office", 20), ("ring", 10), ("rooms", 8), ("random", 8))
FULL = EvidenceConfig()
LITERAL = SensingConfig(evidence="literal")
CARVING = SensingConfig(no_return="always")
OUT_OF_THE_WAY = 1e6
Patch = Callable[[], AbstractContextManager[None]]


@contextmanager
def without_trait(name: str) -> Iterator[None]:
    """The table of one trait says nothing."""
    kept = scorecard.WEIGHTS[name]
    scorecard.WEIGHTS[name] = ((0.0, 1.0), (0.0, 0.0))
    try:
        yield
    finally:
        scorecard.WEIGHTS[name] = kept


@contextmanager
def with_doubles() -> Iterator[None]:
    """Places that lie along each other are all kept."""
    kept = places.SAME_PLACE
    places.SAME_PLACE = OUT_OF_THE_WAY
    try:
        yield
    finally:
        places.SAME_PLACE = kept


# What is left out: settings, what is patched, and how the map senses.
LEFT_OUT: dict[str, tuple[EvidenceConfig, Patch, SensingConfig]] = {
    "nothing": (FULL, nullcontext, SensingConfig()),
    "protection of surfaces": (FULL, nullcontext, LITERAL),
    "doubt about beams without return": (FULL, nullcontext, CARVING),
    "smoothing of states": (replace(FULL, dwell_s=1e-3), nullcontext, SensingConfig()),
    "joining of faces": (replace(FULL, face_m=0.0), nullcontext, SensingConfig()),
    "dropping of doubles": (FULL, with_doubles, SensingConfig()),
    **{f"trait {name}": (FULL, partial(without_trait, name), SensingConfig()) for name in scorecard.Traits._fields},
    "doubt about single changes": (replace(FULL, once_doubt=0.0), nullcontext, SensingConfig()),
    "doubtful places that a link speaks for": (
        replace(FULL, doubt_above=FULL.place_above),
        nullcontext,
        SensingConfig(),
    ),
    "hinges": (replace(FULL, hinge_bonus=0.0), nullcontext, SensingConfig()),
    "distance": (replace(FULL, distance_cost=0.0), nullcontext, SensingConfig()),
    "size": (replace(FULL, size_cost=0.0), nullcontext, SensingConfig()),
    "people in doorways": (replace(FULL, conflict_share=0.0), nullcontext, SensingConfig()),
    "sets of more than two": (replace(FULL, max_states=2), nullcontext, SensingConfig()),
}


def row(name: str, scores: list[Scores]) -> str:
    """Means over drives; counts over all of them."""
    shares = [
        np.mean([value for value in values if value is not None])
        for values in (
            [one.static.f1 for one in scores],
            [one.configurations.recall_twice.value for one in scores],
            [one.configurations.precision.value for one in scores],
        )
    ]
    counts = [
        sum(one.objects.two_places.n for one in scores),
        sum(one.objects.three_places.n for one in scores),
        sum(one.links.recall.n for one in scores),
        sum(one.links.n_wrong for one in scores),
    ]
    return f"| {name} | " + " | ".join([*(f"{share:.3f}" for share in shares), *map(str, counts)]) + " |"


def main() -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2, help="from 0 on")
    parser.add_argument("--resolution", type=float, default=0.05, metavar="M")
    options = parser.parse_args()
    drives = [drive_through(world, people, seed) for world, people in WORLDS for seed in range(options.seeds)]
    print(describe_run(1))
    print(f"{len(drives)} drives, seeds 0 to {options.seeds - 1} of {WORLDS}, cells of {options.resolution} m\n")
    print("| left out | static F1 | seen twice | precision | two-state | three-state | links | wrong links |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    sensed: SensingConfig | None = None
    maps: list[tuple[Drive, History]] = []
    for name, (settings, patch, sensing) in sorted(LEFT_OUT.items(), key=lambda one: one[1][2] != SensingConfig()):
        if sensing != sensed:
            config = MapConfig(sensing=sensing, grid=GridConfig(resolution_m=options.resolution))
            maps, sensed = [(drive, build_grid(drive.simulation.scans, config)) for drive in drives], sensing
        with patch():
            scores = [evaluate(find_objects(grid, settings=settings).document(), drive.truth) for drive, grid in maps]
        print(row(name, scores), flush=True)


if __name__ == "__main__":
    main()
