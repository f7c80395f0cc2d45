"""A site's layers as named arrays: NumPy's .npz, and xarray for netCDF."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tempog._extras import need
from tempog._files import whole_file
from tempog.export.masks import keepout_mask, speed_mask
from tempog.export.object_entries import objects_entry
from tempog.export.site_map import SiteMap
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    import xarray

NO_PLACE = 0  # ids begin with 1
MEANINGS = {
    "planning": "what never moves: 0 free, 100 occupied, -1 unknown",
    "localisation": "planning, with every known place of a thing occupied",
    "current": "planning, with what stood there at at_s",
    "keepout": "100 where a thing stands for most of the time, else -1",
    "speed": "percent of the full speed, 0 for no limit",
    "classes": "-1 unexplored, 0 free, 1 static, 2 changing, 3 uncertain (glass)",
    "share_occupied": "share of the time seen in which the cell was occupied; NaN never seen",
    "seen": "seconds in which the cell was seen; NaN never",
    "state": "id of the place that the cell is part of; 0 none",
    "object": "id of the object whose place it is; 0 none",
}


def site_arrays(site: SiteMap) -> dict[str, NDArray[Any]]:
    """The layers by name, (n_rows, n_cols) each; `MEANINGS` says what they hold."""
    state, owner = (np.full(site.extent.shape, NO_PLACE, dtype=np.int32) for _ in range(2))
    for place in site.found.unassociated:
        state[site.mask_of(place)] = place.id
    for thing in site.things:
        for place in thing.one.configurations:
            state[site.mask_of(place)] = place.id
            owner[site.mask_of(place)] = thing.one.id
    return {
        "planning": site.planning,
        "localisation": site.localisation,
        "current": site.current,
        "keepout": keepout_mask(site),
        "speed": speed_mask(site),
        "classes": site.classes,
        "share_occupied": site.share,
        "seen": site.seen_s,
        "state": state,
        "object": owner,
    }


def write_arrays(path: Path, site: SiteMap) -> None:
    """Write a .npz of the layers.

    Beside them, `x` and `y` are the centres of columns and rows, `bounds` is x_min, x_max, y_min, y_max, and
    `objects` holds what objects.yaml does, as JSON.
    """
    x, y = _axes(site)
    arrays: dict[str, Any] = {
        **site_arrays(site),
        "x": x,
        "y": y,
        "bounds": np.array(site.extent.bounds),
        "resolution": np.array(site.extent.resolution_m),
        "at_ns": np.array(site.at_ns),
        "objects": np.array(json.dumps(objects_entry(site))),
    }
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _axes(site: SiteMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x of the columns' centres and y of the rows', metres."""
    extent = site.extent
    x = (np.arange(extent.n_cols) + extent.col0 + 0.5) * extent.resolution_m
    y = (np.arange(extent.n_rows) + extent.row0 + 0.5) * extent.resolution_m
    return np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)


def to_xarray(site: SiteMap) -> xarray.Dataset:
    """The layers as an xarray.Dataset over `y` and `x` in metres; needs the extra ``xarray``.

    Raises
    ------
    ExtraError
        xarray is not installed.
    """
    library = need("xarray", extra="xarray")
    x, y = _axes(site)
    data = {name: (("y", "x"), values, {"long_name": MEANINGS[name]}) for name, values in site_arrays(site).items()}
    data["seen"][2]["units"] = "s"
    dataset: xarray.Dataset = library.Dataset(
        data,
        coords={
            "x": ("x", x, {"units": "m", "long_name": "map frame, centre of the cell"}),
            "y": ("y", y, {"units": "m", "long_name": "map frame, centre of the cell"}),
        },
        attrs={
            "frame": "map",
            "resolution_m": site.extent.resolution_m,
            "at_s": site.at_ns / NS_PER_S,
            "objects": json.dumps(objects_entry(site)),
        },
    )
    return dataset


def write_netcdf(path: Path, site: SiteMap) -> None:
    """Write `to_xarray` as netCDF 3, which SciPy does."""
    dataset = to_xarray(site)
    with whole_file(path) as unfinished:
        dataset.to_netcdf(unfinished, engine="scipy", format="NETCDF3_64BIT")
