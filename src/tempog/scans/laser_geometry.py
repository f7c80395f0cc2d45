"""What an old log does not say about its laser: where its beams point, and how far it can measure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError

SICK_MAX_RANGE_M = 80.0  # what these logs' lasers can measure; 81.83..81.91 m are their error codes
MIN_INFERRED_RANGE_M = 20.0  # below, a pile-up can as well be the walls of the room
MIN_PILE_UP_SHARE = 0.001  # of all readings; aces has 0.8 %
MIN_PILE_UP_READINGS = 20
MIN_PILE_UP_RATIO = 10.0  # of readings a metre, against those just below it; aces has 20, acapulco 245
MIN_PILE_UP_TRAVEL_M = 5.0  # a wall's distance changes on such a way, the sensor's maximum does not
PILE_UP_WIDTH_M = 1.5  # acapulco's no-returns lie at 50.0 and at 51.1..51.25
BELOW_WIDTH_M = 5.0
BIN_WIDTH_M = 0.1


def beam_angles(n_beams: int, field_of_view_deg: float = 180.0) -> NDArray[np.float64]:
    """Beam angles that CARMEN assumes where a log gives only their number.

    Parameters
    ----------
    n_beams : int
    field_of_view_deg : float, degrees

    Returns
    -------
    (n_beams,) float64, radians
        An even number of beams stops one step short of the far edge: 180 beams at -90..+89 degrees, 360 at
        -90..+89.5. An odd number reaches it: 181 and 361 at -90..+90. A single beam looks ahead.

    Examples
    --------
    >>> np.degrees(beam_angles(4))
    array([-90., -45.,   0.,  45.])
    >>> np.degrees(beam_angles(5))
    array([-90., -45.,   0.,  45.,  90.])
    """
    if n_beams == 1:
        return np.zeros(1)
    n_steps = n_beams if n_beams % 2 == 0 else n_beams - 1
    angles_deg = -field_of_view_deg / 2 + np.arange(n_beams) * (field_of_view_deg / n_steps)
    angles: NDArray[np.float64] = np.radians(angles_deg)
    return angles


def infer_sensor_max(ranges: Sequence[NDArray[np.float32]], xy: Sequence[tuple[float, float]]) -> tuple[float, str]:
    """Sensor maximum of a SICK-style log that does not name it: where readings pile up, or 80 m.

    Parameters
    ----------
    ranges : n_scans of (n_beams,) float32, metres
    xy : n_scans of (x, y), metres
        Where the laser was. A pile-up that is seen only from one place is taken for a wall.

    Returns
    -------
    max_range : float, metres, at most 80
        A hundredth or less below the lowest reading of the pile-up.
    why : str
    """
    n_readings = sum(len(r) for r in ranges)
    far = [r[(r >= MIN_INFERRED_RANGE_M) & (r < math.inf)] for r in ranges]
    values = np.concatenate(far).astype(np.float64)
    n_top = max(MIN_PILE_UP_READINGS, math.ceil(MIN_PILE_UP_SHARE * n_readings))
    assumed = SICK_MAX_RANGE_M, "as for a SICK laser: readings do not pile up below that"
    if len(values) < n_top:
        return assumed
    top = float(np.partition(values, -n_top)[-n_top])  # a few stray readings above it do no harm
    if top >= SICK_MAX_RANGE_M:
        return (
            SICK_MAX_RANGE_M,
            f"the reach of a SICK laser: its readings without return pile up at {top:.2f} m",
        )

    low = top - PILE_UP_WIDTH_M
    n_below = np.count_nonzero((values >= low - BELOW_WIDTH_M) & (values < low))
    n_pile = np.count_nonzero(values >= low)
    if n_pile / PILE_UP_WIDTH_M < MIN_PILE_UP_RATIO * n_below / BELOW_WIDTH_M:
        return assumed
    pile = values[(values >= low) & (values <= top)]
    bin_of_reading = ((pile - low) / BIN_WIDTH_M).astype(np.intp)
    n_in_bin = np.bincount(bin_of_reading)
    n_enough = max(MIN_PILE_UP_READINGS, MIN_PILE_UP_RATIO * n_below * BIN_WIDTH_M / BELOW_WIDTH_M)
    piled = np.flatnonzero(n_in_bin >= n_enough)
    if not piled.size:
        return assumed
    start = float(pile[bin_of_reading == piled[0]].min())
    places = np.array([xy[i] for i, r in enumerate(far) if (r >= start).any()], dtype=np.float64)
    with np.errstate(over="ignore"):  # a corrupt pose may be any number
        travel = float(np.hypot(*np.ptp(places, axis=0)))
    if travel < MIN_PILE_UP_TRAVEL_M:
        return assumed
    share = np.count_nonzero(values >= start) / n_readings
    # rounded down to a centimetre, so that float32 readings of the pile-up are not below it
    return math.floor(start * 100) / 100, f"where {share:.1%} of the readings pile up"


def check_sensor_max_range(sensor_max_range: float | None) -> None:
    """Raise ConfigError unless it is None or metres above 0."""
    if sensor_max_range is not None and not sensor_max_range > 0:
        raise ConfigError(f"sensor_max_range = {sensor_max_range!r}; wanted metres above 0")
