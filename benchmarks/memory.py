"""Peak memory, and compile time: what only a process of its own can tell."""

from __future__ import annotations

import contextlib
import gc
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import logs
import numpy as np
from logs import MAX_RANGE_M, RESOLUTION_M, BenchLog
from numpy.typing import NDArray
from peers import LogOddsGrid, OctoMap

from tempog import Scan, TemporalGrid

MAXRSS_UNIT = 1 if sys.platform == "darwin" else 1024  # getrusage speaks kilobytes elsewhere


def peak_memory(method: str, log: BenchLog) -> float:
    """Bytes by which a process that maps `log` by `method` outgrows itself before; NaN if it failed.

    With glibc, large blocks are set to go back to the system once freed, so that nothing is mapped into
    what loading left behind.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "scans.npz")
        _save(log, path)
        answer = _ask(["peak", method, str(path)], MALLOC_MMAP_THRESHOLD_="131072")
    return float(answer[0]) if answer else math.nan


def compile_seconds() -> tuple[float, float]:
    """Seconds of the first scan with an empty cache of kernels, and with a full one."""
    with tempfile.TemporaryDirectory() as folder:
        times = [_ask(["first-scan"], NUMBA_CACHE_DIR=folder) for _ in range(2)]
    cold, warm = (float(answer[0]) if answer else math.nan for answer in times)
    return cold, warm


def _ask(arguments: list[str], **environment: str) -> list[str]:
    """Words this file prints when run with `arguments`."""
    command = [sys.executable, str(Path(__file__)), *arguments]
    answer = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=False)
    return answer.stdout.split() if answer.returncode == 0 else []


def _save(log: BenchLog, path: Path) -> None:
    np.savez(
        path,
        stamps_ns=np.array([scan.stamp_ns for scan in log.scans]),
        poses=np.array([(scan.x, scan.y, scan.theta) for scan in log.scans]),
        angles=log.scans[0].angles,
        ranges=np.array([scan.ranges for scan in log.scans]),
        bounds=np.array(log.bounds),  # working them out would leave freed memory behind
    )


def _scans(saved: Mapping[str, NDArray[Any]]) -> Iterator[Scan]:
    angles = saved["angles"]
    rows = zip(saved["stamps_ns"], saved["poses"], saved["ranges"], strict=True)
    for stamp_ns, (x, y, theta), ranges in rows:
        yield Scan(0.0, (x, y, theta), angles, ranges, stamp_ns=int(stamp_ns))


def peak_bytes() -> int:
    """Most bytes this process ever held, or has held since `_forget_peak` where that works."""
    status = Path("/proc/self/status")
    if status.is_file():  # getrusage would count what the parent held when it started this process
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * MAXRSS_UNIT


def _forget_peak() -> None:
    """Let the peak be what is held now: importing and loading took more for a moment."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _map(method: str, log: BenchLog, bounds: tuple[float, float, float, float]) -> None:
    """Map all scans by `method`."""
    if method == "octomap":
        octree = OctoMap(RESOLUTION_M, MAX_RANGE_M)
        for scan in log.scans:
            octree.integrate(logs.end_points(scan), np.array([scan.x, scan.y, 0.0]))
        octree.finish()
        return
    if method == "plain":
        grid: LogOddsGrid | TemporalGrid = LogOddsGrid(bounds, RESOLUTION_M)
    else:
        grid = TemporalGrid(log.config("surface" if method == "surface" else "literal"))
    for scan in log.scans:
        grid.integrate(scan)


def _print_peak(method: str, path: str) -> None:
    with np.load(path) as saved:
        log = BenchLog("", list(_scans(saved)))
        x_min, x_max, y_min, y_max = (float(bound) for bound in saved["bounds"])
    bounds = (x_min, x_max, y_min, y_max)
    _map(method, BenchLog("warm-up", log.scans[:2]), bounds)
    gc.collect()
    _forget_peak()
    before = peak_bytes()
    _map(method, log, bounds)
    print(peak_bytes() - before)


def _print_first_scan() -> None:
    """Seconds of the first scan of a corridor, by either evidence, with everything imported."""
    angles = np.linspace(-1.5, 1.5, 180)
    scan = Scan(0.0, (0.0, 0.0, 0.0), angles, np.full(180, 2.0))
    start = time.perf_counter()
    TemporalGrid().integrate(scan)
    print(time.perf_counter() - start)


if __name__ == "__main__":
    if sys.argv[1] == "peak":
        _print_peak(*sys.argv[2:4])
    else:
        _print_first_scan()
