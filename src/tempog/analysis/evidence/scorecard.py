"""How likely a group of cells is a place that things come to stand in: log odds, a sum over what is known of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Traits(NamedTuple):
    """What tells a place from people, and from walls that one pass of the robot saw displaced.

    Attributes
    ----------
    duty : float, 0..1
        Share of the time seen in which it was occupied: people pass, what is always there is a wall.
    free_worth : float
        How long it was seen free, in `worth_s`.
    leak : float
        Hits in the ring around it while it was occupied, per hit in it: people fill theirs.
    echo : float, 0..1
        Share of its cells that have something standing right beside them while it is free: a wall still does.
    together : float, 0..1
        Share of its cells seen that are occupied while it is.
    n_occupied : int
        How often it was found occupied.
    n_long : int
        How often it was found occupied again after a long time.
    depth_m : float, metres
        Of its cells across their line; people are rounder than leaves.
    size_m : float, metres
        Corner to corner: the more changes at once, the less by chance.
    """

    duty: float
    free_worth: float
    leak: float
    echo: float
    together: float
    n_occupied: int
    n_long: int
    depth_m: float
    size_m: float


BASE = 3.4  # of a place whose traits are those of the places it was fitted on, in the mean
# Log odds at some values of each trait, straight lines between them. Fitted by benchmarks/fit_places.py.
WEIGHTS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "duty": ((0.0, 0.03, 0.06, 0.1, 0.2, 0.6, 0.85, 0.95, 1.0), (-3.4, -2.7, -1.9, -1.3, 0.0, 0.7, -0.7, -1.8, -6.4)),
    "free_worth": ((0.0, 1.0, 2.5, 5.0, 10.0), (-2.2, -2.3, -0.4, -0.1, 0.1)),
    "leak": ((0.0, 0.02, 0.1, 0.35, 1.0, 2.0), (0.6, -0.2, -0.9, -1.7, -2.2, -4.0)),
    "echo": ((0.0, 0.05, 0.2, 0.5, 1.0), (-0.1, 0.4, 0.6, -0.4, -6.9)),
    "together": ((0.85, 0.97, 1.0), (-1.8, -0.9, 0.3)),
    "n_occupied": ((1.0, 2.0, 4.0), (-1.4, -0.1, 0.3)),
    "n_long": ((0.0, 1.0, 2.0), (-1.7, 0.1, 0.5)),
    "depth_m": ((0.0, 0.03, 0.06, 0.1, 0.2), (0.8, 0.7, -1.9, -1.0, 0.2)),
    "size_m": ((0.3, 0.5, 0.8), (-3.1, -1.8, 0.4)),
}


def place_odds(traits: Traits) -> float:
    """Log odds that what has these traits is a place."""
    return BASE + sum(float(np.interp(getattr(traits, name), *table)) for name, table in WEIGHTS.items())
