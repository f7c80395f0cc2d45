"""How fast scans become history, against maps without history and against a history in plain Python."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable

import logs
import numpy as np
from logs import MAX_RANGE_M, RESOLUTION_M, BenchLog
from measure import Task, interleave, median, ratio, timed
from memory import compile_seconds, peak_memory
from numpy.typing import NDArray
from peers import DictionaryGrid, LogOddsGrid, OctoMap
from report import Row, Section, at_least, at_most

from tempog import TemporalGrid
from tempog.config import DEFAULT_GAP_S, Evidence
from tempog.sensing.evidence import Statements

HAS_OCTOMAP = importlib.util.find_spec("pyoctomap") is not None
N_ORACLE_SCANS = 100  # plain Python takes a minute for a whole log


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """One section per log."""
    return [_section(logs.load(name, n_scans), n_repetitions) for name in names]


def integrate(log: BenchLog, evidence: Evidence) -> TemporalGrid:
    """A grid of the whole log, scan by scan."""
    grid = TemporalGrid(log.config(evidence))
    for scan in log.scans:
        grid.integrate(scan)
    return grid


def integrate_plain(log: BenchLog, bounds: tuple[float, float, float, float]) -> LogOddsGrid:
    """The occupancy grid without history of the whole log."""
    grid = LogOddsGrid(bounds, RESOLUTION_M)
    for scan in log.scans:
        grid.integrate(scan)
    return grid


def integrate_dictionary(log: BenchLog) -> DictionaryGrid:
    """The history in plain Python of the whole log."""
    config = log.config("literal")
    grid = DictionaryGrid(
        RESOLUTION_M,
        round((config.grid.gap_s or DEFAULT_GAP_S) * 1e9),
        config.grid.tolerance,
        config.sensing.prob_hit,
        config.sensing.prob_free,
    )
    for scan in log.scans:
        grid.integrate(scan)
    return grid


def integrate_octomap(points: list[NDArray[np.float64]], origins: list[NDArray[np.float64]]) -> OctoMap:
    """OctoMap of a whole log, given as end points."""
    octree = OctoMap(RESOLUTION_M, MAX_RANGE_M)
    for points_map, origin in zip(points, origins, strict=True):
        octree.integrate(points_map, origin)
    octree.finish()
    return octree


def count_statements(log: BenchLog, evidence: Evidence) -> int:
    """Cell statements (hit or free, once per cell and scan) in the whole log."""
    grid = TemporalGrid(log.config(evidence))
    total = 0
    sense: Callable[..., Statements] = grid._mapper.sensor.sense

    def counting(*arguments: object) -> Statements:
        nonlocal total
        statements = sense(*arguments)
        total += len(statements.cells)
        return statements

    grid._mapper.sensor.sense = counting  # type: ignore[method-assign, assignment]
    grid.integrate_many(log.scans)
    return total


def _section(log: BenchLog, n_repetitions: int) -> Section:
    bounds = log.bounds
    middle = max(0, len(log.scans) // 2 - N_ORACLE_SCANS // 2)
    part = BenchLog(log.name, log.scans[middle : middle + N_ORACLE_SCANS])
    tasks: dict[str, Task] = {
        "literal": timed(lambda: integrate(log, "literal")),
        "surface": timed(lambda: integrate(log, "surface")),
        "plain": timed(lambda: integrate_plain(log, bounds)),
        "part": timed(lambda: integrate(part, "literal")),
        "dictionary": timed(lambda: integrate_dictionary(part)),
    }
    if HAS_OCTOMAP:
        points, origins = _octomap_input(log)
        tasks["octomap"] = timed(lambda: integrate_octomap(points, origins))
    interleave({name: tasks[name] for name in ("part", "surface", "plain")}, 1)  # warm-up
    seconds = interleave(tasks, n_repetitions)
    section = Section(f"Ingest: {log.name}, {len(log.scans)} scans, {log.n_rays} rays")
    _add_ratios(section, log, seconds)
    _add_rates(section, log, seconds)
    _add_memory(section, log)
    section.notes += [_same_cells(log, bounds), _same_intervals(part), *_compile_notes()]
    return section


def _octomap_input(log: BenchLog) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """End points and origin of each scan, made beforehand."""
    origins = [np.array([scan.x, scan.y, 0.0]) for scan in log.scans]
    return [logs.end_points(scan) for scan in log.scans], origins


def _add_ratios(section: Section, log: BenchLog, seconds: dict[str, list[float]]) -> None:
    def rate(name: str, n: int = len(log.scans)) -> str:
        return f"{n / median(seconds[name]):.0f} scans/s"

    slower = ratio(seconds["literal"], seconds["plain"])
    section.rows.append(
        Row("literal, time over plain log-odds grid's", rate("literal"), rate("plain"), slower, at_most(2.5))
    )
    what = "literal, faster than OctoMap"
    if "octomap" in seconds:
        faster = ratio(seconds["octomap"], seconds["literal"])
        section.rows.append(Row(what, rate("literal"), rate("octomap"), faster, at_least(20)))
    else:
        section.rows.append(Row(what, rate("literal"), "pyoctomap is absent", math.nan, at_least(20)))
    n = min(N_ORACLE_SCANS, len(log.scans))
    faster = ratio(seconds["dictionary"], seconds["part"])
    section.rows.append(
        Row(
            f"literal, faster than Python dictionary ({n} scans)",
            rate("part", n),
            rate("dictionary", n),
            faster,
            at_least(200),
        )
    )
    slower = ratio(seconds["surface"], seconds["literal"])
    section.rows.append(Row("surface, time over literal's", rate("surface"), rate("literal"), slower, at_most(2.5)))


def _add_rates(section: Section, log: BenchLog, seconds: dict[str, list[float]]) -> None:
    evidences: tuple[Evidence, ...] = ("literal", "surface")
    for evidence in evidences:
        duration_s, n = median(seconds[evidence]), count_statements(log, evidence)
        ours = f"{log.n_rays / duration_s / 1e6:.2f} M rays/s, {n / duration_s / 1e6:.1f} M statements/s"
        section.rows.append(Row(f"{evidence}, per cell statement", ours, value=1e9 * duration_s / n, unit="ns"))
    plain = f"{log.n_rays / median(seconds['plain']) / 1e6:.2f} M rays/s"
    section.rows.append(Row("plain log-odds grid", "", plain))


def _add_memory(section: Section, log: BenchLog) -> None:
    peaks = {name: peak_memory(name, log) for name in ("literal", "surface", "plain", "octomap")}
    for name in ("literal", "surface"):
        for peer in ("plain", "octomap"):
            section.rows.append(
                Row(
                    f"{name}, peak memory over {'log-odds grid' if peer == 'plain' else 'OctoMap'}'s",
                    f"{peaks[name] / 1e6:.1f} MB",
                    f"{peaks[peer] / 1e6:.1f} MB",
                    peaks[name] / peaks[peer] if peaks[peer] > 0 else math.nan,
                )
            )
    section.notes.append("Peak memory: a process each, above what it holds with everything imported and warm.")


def _same_cells(log: BenchLog, bounds: tuple[float, float, float, float]) -> str:
    ours = integrate(log, "literal").n_cells
    plain = int(np.count_nonzero(integrate_plain(log, bounds).logodds))
    return f"Cells seen: {ours} by tempog, {plain} by the plain log-odds grid."


def _same_intervals(part: BenchLog) -> str:
    ours, dictionary = integrate(part, "literal"), integrate_dictionary(part)
    note = (
        f"{len(part.scans)} scans in the dictionary: {dictionary.n_intervals} intervals of"
        f" {len(dictionary.history)} cells; tempog: {ours.n_intervals} of {ours.n_cells}"
    )
    if HAS_OCTOMAP:
        note += f"; OctoMap: {integrate_octomap(*_octomap_input(part)).tree.getNumLeafNodes()} leaves"
    return f"{note}."


def _compile_notes() -> list[str]:
    cold_s, warm_s = compile_seconds()
    return [
        f"Not counted above: the first scan takes {cold_s:.1f} s after installation, when the kernels are"
        f" compiled, and {warm_s:.2f} s in later processes, which load them."
    ]
