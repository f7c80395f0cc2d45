"""What is worked out once for a map, and not for each picture: layers of the whole period, and when much changed."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.static import CellClass, static_map
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.times import NS_PER_S
from tempog.views.pauses import pauses_s
from tempog.views.web.kernels import count_changes
from tempog.views.web.layers import N_SHADES
from tempog.views.web.tiles import Codes, Pyramid

# As pictures of the command line have it: fainter dynamics are not drawn, from the second on in full colour.
FAINT_DYNAMICS, FULL_DYNAMICS = 0.1, 0.3
STATIC_CODES = {CellClass.FREE: 1, CellClass.CHANGING: 2, CellClass.STATIC: 3}


class Prepared(NamedTuple):
    """What does not depend on a moment.

    Attributes
    ----------
    layers : dict of Pyramid
        By the layers' names: static and dynamics.
    changes : (n_scans,) int64
        How many cells each scan found in another state than before.
    version : str
        Of the map it was worked out for.
    """

    layers: dict[str, Pyramid]
    changes: NDArray[np.int64]
    version: str


def prepare(history: History, n_zooms: int, version: str) -> Prepared:
    """Work all of it out for a history."""
    extent = history.extent
    layers = {
        "static": Pyramid.of(static_codes(static_map(history)), extent, n_zooms),
        "dynamics": Pyramid.of(dynamics_codes(map_dynamics(history)), extent, n_zooms),
    }
    return Prepared(layers, changes_per_scan(history), version)


def static_codes(classes: NDArray[np.int8]) -> Codes:
    """Classes of cells by the codes of their layer, in which the larger one hides the smaller."""
    codes = np.zeros(classes.shape, dtype=np.uint8)
    for cell_class, code in STATIC_CODES.items():
        codes[classes == cell_class] = code
    return codes


def dynamics_codes(dynamics: NDArray[np.float32]) -> Codes:
    """Shades of dynamics; 0 for what is not drawn."""
    return shades((np.nan_to_num(dynamics) - FAINT_DYNAMICS) / (FULL_DYNAMICS - FAINT_DYNAMICS))


def visits_codes(n_visits: NDArray[np.int32], most: int) -> Codes:
    """Shades of how often somebody came, by its logarithm: once is the faintest."""
    return shades(np.log2(np.maximum(n_visits, 0) + 1.0) / math.log2(most + 1.0))


def shades(amount: NDArray[Any]) -> Codes:
    """Codes 1 to N_SHADES of amounts above 0 and up to 1, or more; else 0."""
    return np.asarray(np.ceil(np.clip(amount, 0, 1) * N_SHADES).astype(np.uint8))


def changes_per_scan(history: History) -> NDArray[np.int64]:
    """How many cells each scan found occupied that were free before, or the other way round."""
    counts = np.zeros(len(history.stamps_ns), dtype=np.int64)
    state = np.zeros(history.tiles.n_cells, dtype=np.uint8)
    for runs in history.runs():
        count_changes(runs.cells, runs.offsets, runs.first, runs.value, OCCUPIED_ABOVE, state, counts)
    return counts


def activity(stamps_ns: NDArray[np.int64], changes: NDArray[np.int64], n_bins: int) -> dict[str, list[Any]]:
    """How many cells changed from when to when: bins of one length, but for long pauses, which are one bin each.

    Parameters
    ----------
    stamps_ns : (n_scans,) int64
    changes : (n,) int64
        Of each scan; of the first ones, if there were more since.
    n_bins : int
        About how many.

    Examples
    --------
    >>> stamps = np.array([0, 10, 20, 3600, 3610], dtype=np.int64) * 10**9
    >>> found = activity(stamps, np.array([0, 5, 0, 7, 0]), 3)
    >>> found["edges_t"], found["changes"], found["observed"]
    ([0.0, 10.0, 20.0, 3600.0, 3610.0], [0, 5, 0, 7], [True, True, False, True])
    """
    stamps_s = (stamps_ns - stamps_ns[0]) / NS_PER_S
    pauses = pauses_s(stamps_s)
    knots = [0.0, *pauses.ravel().tolist(), float(stamps_s[-1])]
    driven_s = sum(stop - start for start, stop in zip(knots[::2], knots[1::2], strict=True))
    edges = [knots[0]]
    for k, (start, stop) in enumerate(pairwise(knots)):
        n = 1
        if k % 2 == 0 and driven_s > 0:
            n = max(1, round(n_bins * (stop - start) / driven_s))
        edges += np.linspace(start, stop, n + 1)[1:].tolist()
    if len(edges) == 2 and edges[1] <= edges[0]:
        edges[1] = edges[0] + 1e-3  # a single moment
    bins = np.clip(np.searchsorted(edges, stamps_s, side="right") - 1, 0, len(edges) - 2)
    bins -= np.isin(stamps_s, pauses[:, 0])  # the scan at a pause's begin belongs to what was before
    known = len(changes)
    counts = np.bincount(bins[:known], weights=changes[: len(bins)], minlength=len(edges) - 1)
    observed = np.bincount(bins, minlength=len(edges) - 1) > 0
    return {"edges_t": edges, "changes": counts.astype(int).tolist(), "observed": observed.tolist()}
