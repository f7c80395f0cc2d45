"""A history as labelled arrays, for xarray."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tempog._extras import need
from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.static import CellClass, static_map
from tempog.errors import ConfigError
from tempog.times import NS_PER_S, Moment, is_unix_time

if TYPE_CHECKING:
    import xarray

    from tempog.grid.history import History

OVER_TIME, OVER_CELLS = ("time", "y", "x"), ("y", "x")


def history_arrays(history: History, times: Sequence[Moment] | None, hold: float) -> xarray.Dataset:
    """What `History.to_xarray` gives."""
    library = need("xarray", "xarray")
    history.require_scans()
    last = np.datetime64(int(history.stamps_ns[history.last_scan]), "ns")
    moments = [last] if times is None else list(times)
    if not moments:
        raise ConfigError("times = [] names no moment; leave it out for the last one")
    extent = history.extent
    snapshots = [history.at(moment, hold) for moment in moments]
    stamps = np.array([snapshot.stamp_ns for snapshot in snapshots], dtype=np.int64)
    x, y = (
        (np.arange(n) + first + 0.5) * extent.resolution_m
        for n, first in ((extent.n_cols, extent.col0), (extent.n_rows, extent.row0))
    )
    time: tuple[Any, ...] = ("time", stamps.astype("datetime64[ns]"))
    if not is_unix_time(history.start_ns):
        time = ("time", (stamps - history.start_ns) / NS_PER_S, {"units": "s", "long_name": "since the first scan"})
    classes = {
        "long_name": "what never moves and what does",
        "flag_values": [int(one) for one in CellClass],
        "flag_meanings": " ".join(one.name.lower() for one in CellClass),
    }
    dataset: xarray.Dataset = library.Dataset(
        {
            "occupied": (
                OVER_TIME,
                np.stack([snapshot.value for snapshot in snapshots]),
                {"long_name": "P(occupied), NaN unknown"},
            ),
            "age": (
                OVER_TIME,
                np.stack([snapshot.age_s for snapshot in snapshots]),
                {"long_name": "since last seen, NaN unknown", "units": "s"},
            ),
            "static": (OVER_CELLS, static_map(history), classes),
            "dynamics": (
                OVER_CELLS,
                map_dynamics(history),
                {"long_name": "mean absolute deviation of P(occupied), NaN never seen"},
            ),
        },
        coords={
            "time": time,
            "y": ("y", y, {"units": "m", "long_name": "map frame, centre of the cell"}),
            "x": ("x", x, {"units": "m", "long_name": "map frame, centre of the cell"}),
        },
        attrs={
            "frame": "map",
            "resolution_m": extent.resolution_m,
            "hold_s": hold if math.isfinite(hold) else "for ever",
            "period_s": [int(history.stamps_ns[k]) / NS_PER_S for k in (history.first_scan, history.last_scan)],
        },
    )
    return dataset
