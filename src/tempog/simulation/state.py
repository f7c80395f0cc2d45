"""Everything that changes while a world runs, as bundles of arrays for the kernels in `walking`.

Metres, radians and seconds in the map frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FAR_M = 1e6  # where a box is while it is carried, and somebody replayed while absent: nobody meets them


class Things(NamedTuple):
    """Doors' leaves and boxes.

    rectangles   (n_things, 4, 2)    in their own frames
    carried, move_s  (n_things,)     whether it is a box; time of a move
    swing_m      (n_things,)         room before it that a swinging leaf needs
    places       (n_places, 3)       poses of all things' places
    event_*      (n_events,)         moves of all things: from when, to which place; a thing's own end before
                                     event_stop; event_next is its next one                           [updated]
    travel       (n_things, 3)       place left, place headed for, place wanted                       [updated]
    fraction, held_s  (n_things,)    of the way done, 1 at rest; time it has been held up             [updated]
    corners      (n_things, 4, 2)    where it is; FAR_M away while it is carried                      [updated]
    """

    rectangles: NDArray[np.float64]
    carried: NDArray[np.uint8]
    move_s: NDArray[np.float64]
    swing_m: NDArray[np.float64]
    places: NDArray[np.float64]
    event_t: NDArray[np.float64]
    event_place: NDArray[np.int32]
    event_stop: NDArray[np.int32]
    event_next: NDArray[np.int32]
    travel: NDArray[np.int32]
    fraction: NDArray[np.float64]
    held_s: NDArray[np.float64]
    corners: NDArray[np.float64]


class Robot(NamedTuple):
    """route, drive (n, 2), (4,): waypoints; speed, turn rate, radius, stopping distance.

    target, pose  (1,), (3,)         waypoint headed for; x, y, theta                                 [updated]
    """

    route: NDArray[np.float64]
    drive: NDArray[np.float64]
    target: NDArray[np.int32]
    pose: NDArray[np.float64]


class People(NamedTuple):
    """Walkers first, then the replayed, who have no mind.

    where        (n_people, 2)       FAR_M away while absent                                          [updated]
    mind         (n_walkers, 7)      heading, pause s, aside s, aside x, aside y, sway, stuck s       [updated]
    traits       (n_walkers, 2)      speed, changes of direction per second
    goal         (n_walkers,)        which of the floor's goals                                       [updated]
    """

    where: NDArray[np.float64]
    mind: NDArray[np.float64]
    traits: NDArray[np.float64]
    goal: NDArray[np.int32]
    radius: float
    pause_mean_s: float


class Tracks(NamedTuple):
    """samples  (n_samples, 3): t, x, y of all tracks, one after the other.

    stop         (n_tracks,)         a track's own end before this row
    next         (n_tracks,)         its first row that is not past                                   [updated]
    velocity     (n_tracks, 2)                                                                        [updated]
    """

    samples: NDArray[np.float64]
    stop: NDArray[np.int32]
    next: NDArray[np.int32]
    velocity: NDArray[np.float64]


class Floor(NamedTuple):
    """The grid that people plan their ways on.

    goals        (n_goals, 2)        row, col; people mostly go to the nearest of n_compared of them
    fields       (n_goals, n_rows, n_cols)  way to each goal, valid if field_epoch equals epoch[0]    [updated]
    epoch        (2,)                raised when a leaf or box comes or goes; that of `blocked`       [updated]
    wall_mask, blocked  (n_rows, n_cols)  no room for a middle: for walls; for things at rest, too    [updated]
    """

    goals: NDArray[np.int32]
    fields: NDArray[np.int32]
    field_epoch: NDArray[np.int32]
    epoch: NDArray[np.int32]
    wall_mask: NDArray[np.uint8]
    blocked: NDArray[np.uint8]
    queue: NDArray[np.int32]
    queued: NDArray[np.uint8]
    x0: float
    y0: float
    cell_m: float
    n_compared: int
