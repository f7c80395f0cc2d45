"""How a history shows itself, and what it gives to others who show it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

from tempog.texts import counted
from tempog.times import Moment

if TYPE_CHECKING:
    import xarray

    from tempog.grid.history import History


class Presented:
    """What every history has for people and their notebooks; made by the modules of views when it is asked for."""

    def __repr__(self) -> str:
        try:
            return f"<{type(self).__name__}: {self._summary()}>"
        except Exception:  # to be shown must never be what fails
            return object.__repr__(self)

    def _repr_html_(self) -> str:
        """What a notebook shows: the map as last known, and what is known of it."""
        from tempog.views.notebook import history_html, shown

        return shown(cast("History", self), history_html)

    def _summary(self) -> str:
        history = cast("History", self)
        if history.n_scans == 0:
            return "no scans yet"
        since, until = (
            history.format_moment(int(history.stamps_ns[k])) for k in (history.first_scan, history.last_scan)
        )
        x_min, x_max, y_min, y_max = history.extent.bounds
        area = f"x {x_min:.1f} to {x_max:.1f} m, y {y_min:.1f} to {y_max:.1f} m"
        return f"{counted(history.n_scans, 'scan', 'scans')}, {since} to {until}, {area}"

    def to_xarray(self, times: Sequence[Moment] | None = None, hold: float = math.inf) -> xarray.Dataset:
        """The map as an `xarray.Dataset` over ``time``, ``y`` and ``x``; needs ``pip install 'tempog[xarray]'``.

        Parameters
        ----------
        times : sequence of moments, optional
            When to ask for ``occupied`` and ``age``, see `at`. Default: the last scan.
        hold : float, seconds
            How long a cell keeps its last known state; by default for ever.

        Returns
        -------
        xarray.Dataset
            ``occupied`` (P(occupied), NaN unknown) and ``age`` (seconds, NaN unknown) over time, y and x; ``static``
            (values of `CellClass`) and ``dynamics`` (see `map_dynamics`), of the whole period, over y and x. ``x``
            and ``y`` are the cells' centres in metres, map frame; ``time`` is dates, or seconds from the first scan
            for a clock that has none.

        Raises
        ------
        ExtraError
            xarray is not installed.
        TimeError
            There are no scans.
        ConfigError
            No times, or a `hold` that is negative.

        Examples
        --------
        >>> from tempog import build_grid
        >>> from tempog.simulation import corridor, simulate
        >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
        >>> cube = grid.to_xarray(times=["+5", "+10", "+15"])
        >>> dict(cube.sizes)
        {'time': 3, 'y': 168, 'x': 264}
        >>> [round(float(p), 1) for p in cube.occupied.sel(x=6.98, y=2.53, method="nearest")]
        [0.9, 0.9, 0.9]
        """
        from tempog.views.arrays import history_arrays

        return history_arrays(cast("History", self), times, hold)
