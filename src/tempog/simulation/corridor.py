"""The smallest world worth mapping: a corridor, one door, one person."""

from __future__ import annotations

import math

import numpy as np

from tempog.simulation.schedules import Listed
from tempog.simulation.tracks import Track
from tempog.simulation.world import Crowd, Route, Thing, Wall, World

DURATION_S = 192.0
DOOR_SCHEDULE = Listed(
    (
        (14.0, "open"),  # behind the robot's back, on its first way back it finds the door open
        (66.0, "closed"),  # also behind its back
        (101.0, "open"),  # in sight, 3 m ahead
        (126.0, "closed"),  # in sight, seen through the doorway
        (150.0, "open"),  # in sight
        (175.0, "closed"),  # in sight
    )
)


def corridor(seed: int = 0) -> World:
    """A corridor with one door that opens three times, one person, and a robot that drives up and down.

    A room in the north has the door and, 0.6 m further east, a doorway without one. Through that, the
    robot on its way west sees where the open leaf stands also while the door is closed. The door opens
    into the room; the robot keeps to the south of the corridor and the person to the north, so nobody
    ever meets. The robot takes 22 s for each way and 2 s to turn, and passes the door eight times.

    Parameters
    ----------
    seed : int
        Varies how fast the person walks and where along the way the person starts, nothing else.

    Returns
    -------
    World
        192 s long. Faces of walls and of the resting door lie in the middle of 5 cm cells, so that noise
        does not decide which cell a reading falls into.

    Examples
    --------
    >>> len(corridor().walls), [thing.label for thing in corridor().things], len(corridor().people.tracks)
    (13, ['door.D1'], 1)
    """
    walls = (
        # corridor: 14.0 m x 2.4 m inside
        Wall.box(-0.125, 0.025, 0.025, 2.425),  # west end
        Wall.box(14.025, 0.025, 14.175, 2.425),  # east end
        Wall.box(-0.125, 2.425, 6.525, 2.575),  # north, as far as the door
        Wall.box(7.425, 2.425, 8.025, 2.575),  # between door and doorway
        Wall.box(9.225, 2.425, 14.175, 2.575),  # north, beyond the doorway
        Wall.box(-0.125, -0.125, 2.525, 0.025),  # south, as far as the southern doorway
        Wall.box(3.525, -0.125, 14.175, 0.025),  # south, beyond it
        # northern room: 5.0 m x 3.0 m
        Wall.box(4.875, 2.575, 5.025, 5.725),
        Wall.box(10.025, 2.575, 10.175, 5.725),
        Wall.box(5.025, 5.575, 10.025, 5.725),
        # southern room: 3.0 m x 2.5 m
        Wall.box(1.875, -2.775, 2.025, -0.125),
        Wall.box(5.025, -2.775, 5.175, -0.125),
        Wall.box(2.025, -2.775, 5.025, -2.625),
    )
    hinge = (7.425, 2.575)
    door = Thing(
        name="D1",
        kind="hinged",
        length_m=0.9,
        thickness_m=0.05,
        places={"closed": (*hinge, math.pi), "open": (*hinge, math.pi / 2)},
        schedule=DOOR_SCHEDULE,
    )
    return World(
        robot=Route(((1.525, 0.725), (12.525, 0.725))),
        walls=walls,
        things=(door,),
        people=Crowd(tracks=(_there_and_back(np.random.default_rng(seed)),)),
        duration_s=DURATION_S,
        name="corridor",
    )


def _there_and_back(rng: np.random.Generator) -> Track:
    """A person who walks the length of the corridor all the time, on the way already at the start."""
    west, east = (1.025, 1.775), (13.025, 1.775)
    way_s = (east[0] - west[0]) / rng.uniform(0.9, 1.3)
    first_s = -rng.uniform(0.0, 18.0)
    n_ways = math.ceil((DURATION_S - first_s) / way_s)
    return Track([(first_s + k * way_s, *(east if k % 2 else west)) for k in range(n_ways + 1)])
