"""Worlds with doors and people: scans plus the truth about them (paper, section V).

Importing this compiles nothing: Numba is loaded by the first call of `simulate`.
"""

from tempog.simulation.corridor import corridor
from tempog.simulation.simulate import Hit, Simulation, simulate
from tempog.simulation.world import Door, Laser, Person, Robot, Wall, World

__all__ = ["Door", "Hit", "Laser", "Person", "Robot", "Simulation", "Wall", "World", "corridor", "simulate"]
