"""Masks for Nav2's costmap filters: where not to drive, and where to drive slowly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.static import CellClass
from tempog.errors import ConfigError
from tempog.export.doors import swept_cells
from tempog.export.layers import Cells, Mask
from tempog.export.map_server import OCCUPIED, UNKNOWN
from tempog.export.site_map import SiteMap, indices
from tempog.times import NS_PER_S

NO_LIMIT = 0  # of a speed mask; Nav2 takes unknown cells there for an error
KEEPOUT_SHARE = 0.5  # of the time in which a place was seen; emptier ones cost the planner less if they are crossed
SHUT_SHARE = 0.95  # the same where a way is blocked: a mask must not lock a door that opens twice a day
SWING_MARGIN_M = 0.5  # Nav2 looks at the robot's middle; half of it, and the way it takes to slow down
SWING_PERCENT, PEOPLE_PERCENT = 50, 70

MAX_SAMPLES = 3600  # of a history: where people walk is known from fewer than a day's scans
SAMPLE_S = 1.0  # a second's walk is about as long as a block, and as what is grown around it
BLOCK_M = 0.25
PASSING_S = 5.0  # who is seen in the same block again within this time has not left
LEAST_PASSAGES = 3
PASSAGES_PER_HOUR = 12.0  # of looking there
PEOPLE_MARGIN_M = 0.5


def keepout_mask(site: SiteMap) -> Cells:
    """100 where a thing stands for most of the time, else -1: Nav2's filter leaves unknown cells as they are.

    A place counts if it was occupied for `KEEPOUT_SHARE` of the time in which it was seen; one that blocks a way, as
    a closed door does, only from `SHUT_SHARE` on. Walls are in the map already, and people are no places.
    """
    mask = np.full(site.extent.shape, UNKNOWN, dtype=np.int8)
    for thing in site.things:
        for place, blocks in zip(thing.one.configurations, thing.blocks, strict=True):
            lasted_ns = {"occupied": 0, "free": 0}
            for start, stop, state in place.periods:
                lasted_ns[state] += stop - start
            share = lasted_ns["occupied"] / max(1, sum(lasted_ns.values()))
            if share >= (SHUT_SHARE if blocks else KEEPOUT_SHARE) and not place.hypothesis:
                mask[site.mask_of(place)] = OCCUPIED
    return mask


def speed_mask(site: SiteMap, *, swing_percent: int = SWING_PERCENT, people_percent: int = PEOPLE_PERCENT) -> Cells:
    """Percent of the full speed that is allowed, 0 for no limit, as Nav2's SpeedFilter with base 0 and multiplier 1.

    Parameters
    ----------
    site : SiteMap
    swing_percent : int, 1..100
        Where a door's leaf swings, and in front of what else comes to block a way, such as a sliding door.
    people_percent : int, 1..100
        Where people walk, see `busy_floor`.

    Raises
    ------
    ConfigError
        A percent that is none.
    """
    for name, percent in (("swing_percent", swing_percent), ("people_percent", people_percent)):
        if not 1 <= percent <= 100:
            raise ConfigError(f"{name} = {percent!r} cannot work; wanted a percent of the full speed, 1 to 100")
    mask = np.full(site.extent.shape, NO_LIMIT, dtype=np.int8)
    floor = (site.planning != OCCUPIED) & (site.classes != CellClass.UNEXPLORED)
    mask[floor & busy_floor(site)] = people_percent
    swings = floor & swing_floor(site)
    mask[swings] = np.where(mask[swings] == NO_LIMIT, swing_percent, np.minimum(mask[swings], swing_percent))
    return mask


def swing_floor(site: SiteMap) -> Mask:
    """Where doors swing, and what lies within `SWING_MARGIN_M` of that."""
    swings = np.zeros(site.extent.shape, dtype=np.bool_)
    for thing in site.things:
        if thing.hinge is not None:
            swings[indices(swept_cells(thing.hinge, site.extent), site.extent)] = True
        elif thing.blocks == (True,):
            swings[site.mask_of(thing.one.configurations[0])] = True
    return grown(swings, SWING_MARGIN_M, site.extent.resolution_m)


def busy_floor(site: SiteMap) -> Mask:
    """Where people walk: at least `LEAST_PASSAGES` were seen there, and `PASSAGES_PER_HOUR` of looking.

    What is on the move is asked of the history once a second (less often for more than an hour of scans), by blocks
    of `BLOCK_M`. Found blocks are grown by `PEOPLE_MARGIN_M`.
    """
    history, extent = site.history, site.extent
    every_s = max(SAMPLE_S, history.n_scans * (history.scan_period_s or SAMPLE_S) / MAX_SAMPLES)
    if not math.isfinite(every_s):  # a single scan
        return np.zeros(extent.shape, dtype=np.bool_)
    n = max(1, round(BLOCK_M / extent.resolution_m))
    shape = -(-extent.n_rows // n), -(-extent.n_cols // n)
    passages = np.zeros(shape, dtype=np.int64)
    last_ns = np.full(shape, -(2**62), dtype=np.int64)
    for moving in site.found.high_dynamics(every_s):
        cells = (moving.cells.astype(np.int64) - (extent.row0, extent.col0)) // n
        inside = ((cells >= 0) & (cells < shape)).all(axis=1)
        blocks = np.unique(cells[inside], axis=0)
        at = blocks[:, 0], blocks[:, 1]
        passages[at] += moving.stamp_ns - last_ns[at] > max(PASSING_S, every_s) * NS_PER_S
        last_ns[at] = moving.stamp_ns
    seen_s = np.zeros((shape[0] * n, shape[1] * n))
    seen_s[: extent.n_rows, : extent.n_cols] = np.nan_to_num(site.seen_s)
    looked_s = seen_s.reshape(shape[0], n, shape[1], n).max(axis=(1, 3))
    busy = (passages >= LEAST_PASSAGES) & (passages * 3600 >= PASSAGES_PER_HOUR * looked_s)
    return grown(_as_cells(busy, n, extent.shape), PEOPLE_MARGIN_M, extent.resolution_m)


def _as_cells(blocks: Mask, n: int, shape: tuple[int, int]) -> Mask:
    return np.repeat(np.repeat(blocks, n, axis=0), n, axis=1)[: shape[0], : shape[1]]


def grown(mask: Mask, by_m: float, resolution_m: float) -> Mask:
    """A mask with all cells whose centres are this close to its cells'."""
    from scipy.ndimage import distance_transform_edt

    if not mask.any():
        return mask
    away: NDArray[np.float64] = distance_transform_edt(~mask)
    return np.asarray(away <= by_m / resolution_m + 1e-9)
