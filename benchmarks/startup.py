"""How long a person waits for the first result on the command line."""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import logs
from measure import Task, interleave, median
from report import Row, Section, at_most

from tempog.scans.npz import write_npz
from tempog.simulation import corridor, simulate

SMALL_LOG = "aces"  # 440 scans of 180 beams
LONGEST_S = 300.0  # no command here takes longer


def run(_names: list[str], _n_scans: int | None, n_repetitions: int) -> list[Section]:
    """Each command in a process of its own, after one run that fills the caches."""
    section = Section("Start-up, a process each, warm caches")
    with tempfile.TemporaryDirectory() as folder:
        log = _small_log(Path(folder))
        maps = (str(Path(folder, f"map-{k}")) for k in range(n_repetitions + 1))
        python = [sys.executable, "-c"]
        commands: dict[str, Callable[[], list[str]]] = {
            "bare Python": lambda: [*python, "pass"],
            "import numba": lambda: [*python, "import numba"],
            "import TemporalGrid": lambda: [*python, "from tempog import TemporalGrid"],
            "tempog --help": lambda: [sys.executable, "-m", "tempog", "--help"],
            f"tempog map, {log.name}": lambda: [sys.executable, "-m", "tempog", "map", str(log), "-o", next(maps)],
        }
        failures: dict[str, str] = {}
        tasks: dict[str, Task] = {}
        for name, command in commands.items():
            if reason := _failure(command()):
                failures[name] = reason
            else:
                tasks[name] = partial(_wall_s, command)
        seconds = interleave(tasks, n_repetitions)
    for name in commands:
        value = median(seconds[name]) if name in seconds else math.nan
        target = at_most(2.0, "s") if name.startswith("tempog") else None
        section.rows.append(Row(name, failures.get(name, ""), "", value, target, unit="s"))
    return [section]


def _small_log(folder: Path) -> Path:
    path = logs.log_path(SMALL_LOG)
    if path.is_file():
        return path
    path = folder / "simulated-corridor.npz"
    write_npz(path, simulate(corridor(seed=0)).scans)
    return path


def _failure(command: list[str]) -> str:
    """Why the command does not work, in a few words; empty if it does."""
    answer = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    if answer.returncode == 0:
        return ""
    return f"failed: {(answer.stderr.strip().splitlines() or ['no message'])[-1].split('/')[-1][:60]}"


def _wall_s(command: Callable[[], list[str]]) -> float:
    words = command()
    start = time.perf_counter()
    subprocess.run(words, capture_output=True, timeout=LONGEST_S, check=False)
    return time.perf_counter() - start
