"""From scans to a map with a memory, on one screen; the command line and the demo run this."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain

from tempog.config import DEFAULT_GAP, MapConfig, parse_gap
from tempog.errors import ScanError
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.scan import Scan, scan_period_s


def build_grid(
    scans: Sequence[Scan] | Sequence[Sequence[Scan]],
    config: MapConfig | None = None,
    *,
    gap: str = DEFAULT_GAP,
    track: Callable[[list[Scan]], Iterable[Scan]] | None = None,
) -> TemporalGrid:
    """A temporal grid of one log, or of several that are merged by time.

    Parameters
    ----------
    scans : sequence of Scan, or a sequence of such
    config : MapConfig, optional
        Its `gap_s` is replaced by `gap`.
    gap : str
        thres_1 of Fig. 4 as ``"2s"`` or ``"10scans"``. Of several logs, the slowest sets what a scan lasts.
    track : callable, optional
        Wraps the list of scans on its way in; for a progress bar.

    Raises
    ------
    ScanError
        No scans.
    ConfigError
        A gap that does not fit the scan rate.

    Examples
    --------
    >>> from tempog import Scan, build_grid
    >>> log = [Scan(0.1 * k, (0.0, 0.0, 0.0), [0.0], [2.0]) for k in range(50)]
    >>> build_grid(log).config.grid.gap_s
    1.0
    """
    logs = _as_logs(scans)
    period_s = max((log_period for log in logs if (log_period := _period_s(log)) > 0), default=math.nan)
    config = config or MapConfig()
    config = replace(config, grid=replace(config.grid, gap_s=parse_gap(gap, period_s)))
    grid = TemporalGrid(config)
    ordered = sorted(chain.from_iterable(logs), key=lambda scan: scan.stamp_ns)
    grid.integrate_many(ordered if track is None else track(ordered))  # Fig. 4
    return grid


def _period_s(log: Sequence[Scan]) -> float:
    return scan_period_s([scan.stamp_ns for scan in log])


def _as_logs(scans: Sequence[Scan] | Sequence[Sequence[Scan]]) -> list[Sequence[Scan]]:
    if len(scans) == 0:
        raise ScanError("no scans were given; a map needs at least one")
    logs: list[Sequence[Scan]] = []
    loose: list[Scan] = []
    for item in scans:
        if isinstance(item, Scan):
            loose.append(item)
        elif len(item):
            logs.append(item)
    if loose:
        logs.append(loose)
    if not logs:
        raise ScanError("no scans were given; a map needs at least one")
    return logs
