"""Worlds with doors and people: scans plus the truth about them (paper, section V).

A `World` is built in Python, or read from a TOML file by `load_world`. In it doors, boxes, people and the
robot wait for each other; only people who are replayed from a `Track` wait for nobody.

Importing this compiles nothing: Numba is loaded by the first call of `simulate`.
"""

from tempog.simulation.buildings import random_building, turned
from tempog.simulation.corridor import corridor
from tempog.simulation.simulate import simulate
from tempog.simulation.simulation import Hit, Simulation
from tempog.simulation.tracks import Track
from tempog.simulation.world import Crowd, Glass, Laser, PoseError, Route, Thing, Wall, World
from tempog.simulation.world_file import load_world

__all__ = [
    "Crowd",
    "Glass",
    "Hit",
    "Laser",
    "PoseError",
    "Route",
    "Simulation",
    "Thing",
    "Track",
    "Wall",
    "World",
    "corridor",
    "load_world",
    "random_building",
    "simulate",
    "turned",
]
