"""What was true during a simulation, as files beside its log.

``LOG.truth.json`` holds, for each door and box, its places and its states over time. ``LOG.truth.npz`` holds,
for each scan, the arrays of `Simulation`: t, poses, distances, hits, hit_things, places, corners, people.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tempog._files import whole_file
from tempog.simulation.simulation import START_S, Simulation

ARRAYS = ("t", "poses", "distances", "hits", "hit_things", "places", "corners", "people")


def truth_paths(log: Path) -> tuple[Path, Path]:
    """Where the truth about a log is kept: the .json and the .npz.

    >>> [path.name for path in truth_paths(Path("drive.npz"))]
    ['drive.npz.truth.json', 'drive.npz.truth.npz']
    """
    return log.with_name(f"{log.name}.truth.json"), log.with_name(f"{log.name}.truth.npz")


def truth(simulation: Simulation) -> dict[str, Any]:
    """Places and states of all doors and boxes, ready for JSON; stamps in seconds of the scans' clock."""
    world = simulation.world
    return {
        "world": world.name,
        "start_s": START_S,
        "duration_s": simulation.duration_s,
        "n_scans": len(simulation.scans),
        "n_people": simulation.people.shape[1],
        "things": [
            {
                "name": thing.name,
                "kind": thing.kind,
                "places": {place: np.round(thing.corners(place), 6).tolist() for place in thing.places},
                "states": [{"from_s": t, "state": state} for t, state in simulation.states(thing.label)],
            }
            for thing in world.things
        ],
    }


def write_truth(log: Path, simulation: Simulation) -> tuple[Path, Path]:
    """Write the truth beside a log, each file whole or not at all; return where."""
    as_json, as_npz = truth_paths(log)
    with whole_file(as_json) as unfinished:
        unfinished.write_text(json.dumps(truth(simulation), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with whole_file(as_npz) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **{name: getattr(simulation, name) for name in ARRAYS})
    return as_json, as_npz
