"""Does a live map's memory stay as it is? The same log with later stamps, in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import logs
from report import Row, Section, at_most
from storage_commits import lapped

from tempog import LiveMap

WINDOW_S = 1200.0
N_SCANS = 1200  # of the log, per round
N_ROUNDS, N_ROUNDS_QUICK = 200, 20
N_ROUNDS_ENDLESS = 40  # without a window


def memory_section(name: str, quick: bool, folder: Path) -> Section:
    """With a window, and without one for fewer rounds."""
    n_rounds = N_ROUNDS_QUICK if quick else N_ROUNDS
    shown = [k for k in (5, 10, 20, 50, 100, 200) if k <= n_rounds]
    with_window = _megabytes(name, n_rounds, WINDOW_S, folder / "window")
    without = _megabytes(name, min(n_rounds, N_ROUNDS_ENDLESS), None, folder / "endless")
    n = N_SCANS
    section = Section(f"Storage: memory of a live map, {name}, literal, {n} scans {n_rounds} times")
    for k in shown[1:]:
        peer = f"{without[k - 1]:.0f} MB without a window" if k <= len(without) else ""
        row = Row(
            f"round {k} over round {shown[0]}, window {WINDOW_S / 60:g} min",
            f"{with_window[k - 1]:.0f} MB",
            peer,
            with_window[k - 1] / with_window[shown[0] - 1],
            at_most(1.1) if k == n_rounds else None,
        )
        section.rows.append(row)
    last = len(without)
    section.rows.append(
        Row(
            f"round {last} over round {shown[0]}, no window",
            f"{without[-1]:.0f} MB",
            "",
            without[-1] / without[shown[0] - 1],
        )
    )
    section.notes.append("Resident memory of the process after the round, the log itself and all libraries included.")
    return section


def _megabytes(name: str, n_rounds: int, window_s: float | None, path: Path) -> list[float]:
    """Resident memory after each round."""
    command = [sys.executable, __file__, name, str(n_rounds), str(window_s or ""), str(path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    output = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    sizes: list[float] = json.loads(output)
    return sizes


def _drive(name: str, n_rounds: int, window_s: float | None, path: Path) -> None:
    log = logs.load(name, N_SCANS)
    sizes = []
    with LiveMap(path, log.config("literal"), window=window_s) as live:
        for k in range(n_rounds):
            for number in range(k * len(log.scans), (k + 1) * len(log.scans)):
                live.integrate(lapped(log.scans, number))
            sizes.append(_resident_bytes() / 1e6)
    print(json.dumps(sizes))


def _resident_bytes() -> int:
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    _drive(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]) if sys.argv[3] else None, Path(sys.argv[4]))
