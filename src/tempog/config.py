"""Every setting, once: the same names in Python, in saved maps and (with dashes) on the command line.

Lengths are metres and durations seconds, never cells or scans, so that a setting means the same at every
resolution and scan rate.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any, Literal, Self, get_args, get_type_hints

from tempog.errors import ConfigError

Evidence = Literal["surface", "literal"]
NoReturn = Literal["neighbours", "never", "always"]
Measure = Literal["mad", "std"]
Weight = Literal["duration", "interval"]

MAX_SCAN_CELLS_ACROSS = 8_000  # cells; 200 m of range at 0.05 m: working on one scan then takes 0.6 GB


def require(ok: bool, name: str, seen: object, wanted: str) -> None:
    if not ok:
        raise ConfigError(f"{name} = {seen!r} cannot work; wanted {wanted}")


def require_choice(name: str, seen: object, choices: Any) -> None:
    require(seen in get_args(choices), name, seen, "one of " + ", ".join(get_args(choices)))


def make_plain(config: Any) -> None:
    """Numbers of any kind, NumPy's too, to Python's own, so that they can be saved."""
    for name, kind in get_type_hints(type(config)).items():
        value = getattr(config, name)
        if kind in (float, int) or (kind == float | None and value is not None):
            plain = int if kind is int else float
            try:
                if isinstance(value, str):  # float() would take it
                    raise TypeError
                object.__setattr__(config, name, plain(value))
            except (TypeError, ValueError, OverflowError):
                raise ConfigError(f"{name} = {value!r} cannot work; wanted a number") from None


@dataclass(frozen=True)
class SensingConfig:
    """How one scan becomes evidence: hit, free, or nothing, per cell.

    Parameters
    ----------
    evidence : "surface" or "literal"
        ``literal``: the inverse sensor model of this scan alone, as in the paper: the cell a beam ends in
        is a hit, every cell before it is free. ``surface``: the same, but nothing near a surface is called
        free because a beam grazed past it.
    max_range_m : float, metres
        Readings beyond are no hits; such a beam frees cells up to here.
    no_return : "neighbours", "never" or "always"
        Whether a beam without return frees the cells up to `max_range_m`. Half a percent of drop-outs is
        enough to carve every wall away, so by default both neighbouring beams must be without return too.
        ``surface`` also ends such a beam at the nearer of the two returns beside its run: indoors a run of
        beams without return is dark or shiny material more often than open space.
    prob_hit, prob_free : float, 0..1
        P(occupied) that a hit and a free statement stand for.
    free_margin_m : float, metres
        ``surface``: a beam frees a cell only if it leaves the cell this far before its own end.
        Covers range noise of common scanners (1-3 cm) three times over.
    protect_m : float, metres
        ``surface``: no cell within this distance of a surface seen in the same scan is called free.
    bridge_m : float, metres
        ``surface``: neighbouring hits up to this far apart, and in line with a third, are one surface.
        Beams half a degree apart that graze a wall at 5 degrees from 10 m away end 1 m apart.
    collinear_m : float, metres
        ``surface``: how far from the line the third hit may lie.
    surface_min_hits : int
        ``surface``: hits from which on a cell's hit points are taken as its surface's shape.
    clear_behind_m : float, metres
        ``surface``: a beam finds a known surface gone only if it ends this far behind it, measured square to
        the surface. Poses of different passes disagree by a decimetre or more in most logs.
    snap_m : float, metres
        ``surface``: a hit this close to a cell with many more hits than its own counts for that cell. Three
        standard deviations of a common scanner's range noise; without it, walls grow rims that flicker.
    """

    evidence: Evidence = "surface"
    max_range_m: float = 30.0
    no_return: NoReturn = "neighbours"
    prob_hit: float = 0.9
    prob_free: float = 0.1
    free_margin_m: float = 0.1
    protect_m: float = 0.1
    bridge_m: float = 1.0
    collinear_m: float = 0.05
    surface_min_hits: int = 4
    clear_behind_m: float = 0.2
    snap_m: float = 0.03

    def __post_init__(self) -> None:
        make_plain(self)
        require_choice("evidence", self.evidence, Evidence)
        require_choice("no_return", self.no_return, NoReturn)
        require(0 < self.max_range_m < math.inf, "max_range_m", self.max_range_m, "metres above 0")
        require(0.5 < self.prob_hit < 1, "prob_hit", self.prob_hit, "a probability between 0.5 and 1")
        require(0 < self.prob_free < 0.5, "prob_free", self.prob_free, "a probability between 0 and 0.5")
        for name in ("free_margin_m", "protect_m", "bridge_m", "collinear_m", "clear_behind_m", "snap_m"):
            value = getattr(self, name)
            require(0 <= value <= 10, name, value, "metres from 0 to 10")
        require(self.surface_min_hits >= 2, "surface_min_hits", self.surface_min_hits, "2 or more")


@dataclass(frozen=True)
class GridConfig:
    """How evidence becomes history (paper, Fig. 4).

    Parameters
    ----------
    resolution_m : float, metres
        Side of a cell.
    gap_s : float, seconds, optional
        thres_1 of Fig. 4: a cell not seen for longer starts a new interval. Must exceed the scan period.
        Default: ten scan periods where the period is known, which keeps far cells, that few beams reach,
        in one piece; else 2 s.
    tolerance : float, 0..1
        thres_2 of Fig. 4: a statement that differs by more from the interval's value starts a new one.
    max_cells : int
        Bound on the cells of the map's bounding rectangle, against corrupt poses. The default is 400 m x
        400 m at 0.05 m, and 270 MB for an array of the whole map.
    """

    resolution_m: float = 0.05
    gap_s: float | None = None
    tolerance: float = 0.2
    max_cells: int = 2**26

    def __post_init__(self) -> None:
        make_plain(self)
        require(1e-3 <= self.resolution_m <= 100, "resolution_m", self.resolution_m, "metres from 0.001 to 100")
        require(self.gap_s is None or 0 < self.gap_s < math.inf, "gap_s", self.gap_s, "seconds above 0")
        require(0 <= self.tolerance <= 1, "tolerance", self.tolerance, "a probability difference from 0 to 1")
        require(64 <= self.max_cells <= 2**31 - 1, "max_cells", self.max_cells, "from 64 to 2**31 - 1")


@dataclass(frozen=True)
class MapConfig:
    """All settings of a map; saved with it.

    Examples
    --------
    >>> MapConfig(grid=GridConfig(resolution_m=0.1)).grid.resolution_m
    0.1
    >>> MapConfig.from_dict(MapConfig().to_dict()) == MapConfig()
    True
    """

    sensing: SensingConfig = field(default_factory=SensingConfig)
    grid: GridConfig = field(default_factory=GridConfig)

    def __post_init__(self) -> None:
        across = 2 * self.sensing.max_range_m / self.grid.resolution_m
        if across > MAX_SCAN_CELLS_ACROSS:
            raise ConfigError(
                f"max_range_m = {self.sensing.max_range_m:g} at resolution_m = {self.grid.resolution_m:g} is"
                f" {across:.0f} cells across for one scan (wanted: at most {MAX_SCAN_CELLS_ACROSS});"
                " use a coarser resolution or a shorter range"
            )

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Plain dictionaries, ready for JSON."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, settings: dict[str, dict[str, Any]]) -> Self:
        """The reverse of `to_dict`; ConfigError for an unknown or unusable setting."""
        hints = get_type_hints(cls)
        parts: dict[str, Any] = {}
        for name, values in settings.items():
            if name not in hints:
                raise ConfigError(f"unknown settings group {name!r}; known: {', '.join(hints)}")
            try:
                parts[name] = hints[name](**values)
            except TypeError as error:
                raise ConfigError(f"settings group {name!r}: {error}") from None
        return cls(**parts)


DEFAULT_GAP = "10scans"
DEFAULT_GAP_S = 2.0  # s; where nothing tells how often scans come: ten of a slow 5 Hz scanner


def parse_gap(text: str, scan_period_s: float) -> float:
    """The gap threshold in seconds, from ``"2s"``, ``"2"`` or ``"10scans"``.

    Parameters
    ----------
    text : str
    scan_period_s : float, seconds
        Typical time between two scans; NaN where unknown (a single scan), then a second per scan.

    Raises
    ------
    ConfigError
        Text of another form, or a gap shorter than the scan period.

    Examples
    --------
    >>> parse_gap("10scans", scan_period_s=0.1)
    1.0
    >>> parse_gap("0.05s", scan_period_s=0.1)
    Traceback (most recent call last):
        ...
    tempog.errors.ConfigError: gap of 0.05 s is shorter than the scan period, 0.1 s, so every scan would open a new \
interval in every cell. Try 10scans (1 s here), or 0.2s at the least.
    """
    unit_s = 1.0
    number = text.strip().lower()
    for suffix in ("scans", "scan", "s"):
        if number.endswith(suffix):
            number = number.removesuffix(suffix).strip()
            if suffix != "s":
                unit_s = scan_period_s if math.isfinite(scan_period_s) else 1.0
            break
    try:
        gap_s = float(number) * unit_s
    except ValueError:
        gap_s = math.nan
    if not 0 < gap_s < math.inf:
        raise ConfigError(f"gap {text!r} is not a duration; wanted for example 2s or 10scans")
    check_gap(gap_s, scan_period_s)
    return gap_s


def check_gap(gap_s: float, scan_period_s: float) -> None:
    """Refuse a gap threshold that every pause between two scans exceeds."""
    if gap_s < scan_period_s:
        raise ConfigError(
            f"gap of {gap_s:g} s is shorter than the scan period, {scan_period_s:.3g} s, so every scan would open"
            f" a new interval in every cell. Try 10scans ({10 * scan_period_s:.3g} s here),"
            f" or {2 * scan_period_s:.3g}s at the least."
        )
