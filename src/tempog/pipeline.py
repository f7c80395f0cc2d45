"""From scans to a map with a memory, on one screen; the command line and the demo run this."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from tempog.config import MapConfig, parse_gap
from tempog.errors import ExtentError, ScanError
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.clock import mend_clock, parse_clock
from tempog.scans.scan import Scan, ScanLog, scan_period_s


def build_grid(
    scans: Iterable[Scan] | Iterable[ScanLog],
    config: MapConfig | None = None,
    *,
    gap: str | None = None,
    skip_far: bool = False,
    track: Callable[[list[Scan]], Iterable[Scan]] | None = None,
) -> TemporalGrid:
    """A temporal grid of one log, or of several that are merged by time.

    Parameters
    ----------
    scans : iterable of Scan, or of ScanLog
        Scans that come in no log have their stamps checked as a log's: a few small steps back are sorted
        and warned of, a clock that cannot be used is refused.
    config : MapConfig, optional
    gap : str, optional
        thres_1 of Fig. 4 as ``"2s"`` or ``"10scans"``, in place of the `gap_s` of `config`. Of several
        logs, the slowest sets what a scan lasts.
    skip_far : bool
        Leave out scans that would stretch the map beyond `GridConfig.max_cells`, with a warning, instead of
        stopping at the first.
    track : callable, optional
        Wraps the list of scans on its way in; for a progress bar.

    Raises
    ------
    ScanError
        No scans.
    ClockError
        Scans in no log whose stamps make no usable time axis.
    ExtentError
        A scan that lies absurdly far off, and `skip_far` is not set; or half of them do.
    ConfigError
        A gap that does not fit the scan rate.

    Examples
    --------
    >>> from tempog import Scan, build_grid
    >>> log = [Scan(0.1 * k, (0.0, 0.0, 0.0), [0.0], [2.0]) for k in range(50)]
    >>> build_grid(log).gap_s
    1.0
    """
    logs = _as_logs(scans)
    fitting, period_s = _fitting(config, gap, logs)
    grid = TemporalGrid(fitting, scan_period_s=period_s)
    _integrate_all(grid.integrate, _ordered(logs), skip_far, track)  # Fig. 4
    return grid


def add_to_map(
    logs: Sequence[ScanLog],
    path: str | os.PathLike[str],
    config: MapConfig | None = None,
    *,
    gap: str | None = None,
    robot: str = "",
    session: str = "",
    window: str | float | None = None,
    skip_far: bool = False,
    track: Callable[[list[Scan]], Iterable[Scan]] | None = None,
) -> str:
    """Map logs as one session of a map on disk, all of it or nothing; returns the session's name.

    Parameters
    ----------
    logs, gap, skip_far, track
        See `build_grid`.
    path, config, robot, session, window
        See `LiveMap`.

    Raises
    ------
    MapError
        The map holds one of the logs already, or cannot be written; it is as it was.
    """
    from tempog.store.live_map import LiveMap
    from tempog.store.saved_map import refuse_known, source_of

    ordered = _ordered(_as_logs(logs))
    sources = [source_of(log) for log in logs]
    refuse_known(path, sources, ordered)
    if config is not None or gap is not None:
        config, period_s = _fitting(config, gap, logs)
    else:
        period_s = math.nan
    settings = {"robot": robot, "session": session, "window": window, "sources": sources, "scan_period_s": period_s}
    with LiveMap(path, config, journal=False, at_once=False, flush_s=math.inf, **settings) as live:  # type: ignore[arg-type]
        _integrate_all(live.integrate, ordered, skip_far, track)
    return live.session


def _ordered(logs: Iterable[Sequence[Scan]]) -> list[Scan]:
    return sorted(chain.from_iterable(logs), key=lambda scan: scan.stamp_ns)


def _fitting(config: MapConfig | None, gap: str | None, logs: Sequence[Sequence[Scan]]) -> tuple[MapConfig, float]:
    """Settings with the gap that was asked for, and the scan period."""
    period_s = max((log_period for log in logs if (log_period := _period_s(log)) > 0), default=math.nan)
    config = config or MapConfig()
    if gap is not None:
        config = replace(config, grid=replace(config.grid, gap_s=parse_gap(gap, period_s)))
    return config, period_s


def _integrate_all(
    integrate: Callable[[Scan], None],
    ordered: list[Scan],
    skip_far: bool,
    track: Callable[[list[Scan]], Iterable[Scan]] | None,
) -> None:
    far: list[str] = []
    for scan in ordered if track is None else track(ordered):
        try:
            integrate(scan)
        except ExtentError as error:
            far.append(str(error))
            if not skip_far or 2 * len(far) > len(ordered):
                raise
    if far:
        warnings.warn(f"{len(far)} of {len(ordered)} scans left out; the first: {far[0]}", stacklevel=3)


def _period_s(log: Sequence[Scan]) -> float:
    return scan_period_s([scan.stamp_ns for scan in log])


def _as_logs(scans: Iterable[Scan] | Iterable[ScanLog]) -> list[Sequence[Scan]]:
    if isinstance(scans, ScanLog):
        return [scans]
    if isinstance(scans, str | os.PathLike):
        raise ScanError(f"scans is the path {str(scans)!r}; wanted scans: build_grid(open_scans({str(scans)!r}))")
    logs: list[Sequence[Scan]] = []
    loose: list[Scan] = []
    for item in scans:
        if isinstance(item, Scan):
            loose.append(item)
        elif len(item):
            logs.append(item)
    if loose:
        labels = [scan.label or f"scan {k}" for k, scan in enumerate(loose)]
        stamps = [scan.stamp_ns for scan in loose]
        clock = mend_clock(np.array(stamps, dtype=np.int64), labels, parse_clock("auto"), source="scans")
        for note in clock.notes:
            warnings.warn(note, stacklevel=3)
        logs.append([loose[k] for k in clock.order])
    if not logs:
        raise ScanError("no scans were given; a map needs at least one")
    return logs
