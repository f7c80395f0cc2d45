"""Worlds with doors and people: scans plus the truth about them (paper, section V).

A `World` is scripted: everything keeps to its path, whatever stands in the way. In a `Site`, which
`load_world` reads from a TOML file, doors, people and the robot wait for each other.

Importing this compiles nothing: Numba is loaded by the first call of `simulate` or `simulate_site`.
"""

from tempog.simulation.corridor import corridor
from tempog.simulation.simulate import Hit, Simulation, simulate
from tempog.simulation.simulate_site import SiteSimulation, simulate_site
from tempog.simulation.site import Crowd, PoseError, Route, Site, Thing
from tempog.simulation.world import Door, Laser, Person, Robot, Wall, World
from tempog.simulation.world_file import load_world

__all__ = [
    "Crowd",
    "Door",
    "Hit",
    "Laser",
    "Person",
    "PoseError",
    "Robot",
    "Route",
    "Simulation",
    "Site",
    "SiteSimulation",
    "Thing",
    "Wall",
    "World",
    "corridor",
    "load_world",
    "simulate",
    "simulate_site",
]
