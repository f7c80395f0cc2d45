"""Rows with targets, and how they are printed. A lost row is printed like any other."""

from __future__ import annotations

import importlib.metadata
import math
import os
import platform
import sqlite3
import sys
from dataclasses import dataclass, field
from pathlib import Path

HEADER = ("what", "tempog", "peer", "ratio or value", "target", "")
PACKAGES = ("numpy", "numba", "pyoctomap", "duckdb", "pyarrow", "deltalake", "mcap", "polars")


@dataclass(frozen=True)
class Target:
    """A limit on a row's value."""

    limit: float
    at_most: bool
    unit: str = "x"

    def __str__(self) -> str:
        return f"{'at most' if self.at_most else 'at least'} {self.limit:g} {self.unit}"

    def is_met(self, value: float) -> bool:
        """Whether `value` is on the right side of the limit, or on it."""
        return value <= self.limit if self.at_most else value >= self.limit


def at_most(limit: float, unit: str = "x") -> Target:
    """Smaller is better."""
    return Target(limit, at_most=True, unit=unit)


def at_least(limit: float, unit: str = "x") -> Target:
    """Larger is better."""
    return Target(limit, at_most=False, unit=unit)


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    what, ours, peer : str
    value : float
        The ratio or number that is judged; NaN if it could not be measured.
    target : Target, optional
        None: for information.
    unit : str
        Of `value`, where there is no target that says so.
    """

    what: str
    ours: str
    peer: str = ""
    value: float = math.nan
    target: Target | None = None
    unit: str = "x"

    @property
    def verdict(self) -> str:
        """ "met", "LOST", "not measured", or nothing for a row without a target."""
        if self.target is None:
            return ""
        if math.isnan(self.value):
            return "not measured"
        return "met" if self.target.is_met(self.value) else "LOST"

    @property
    def cells(self) -> tuple[str, ...]:
        """As text, one entry per column of HEADER."""
        unit = self.target.unit if self.target else self.unit
        value = "" if math.isnan(self.value) else f"{self.value:.3g} {unit}"
        return self.what, self.ours, self.peer, value, str(self.target or ""), self.verdict


@dataclass
class Section:
    """Rows that belong together, and what a reader must know about them."""

    title: str
    rows: list[Row] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def to_markdown(self) -> str:
        """A heading, a padded table, and the notes."""
        lines = [HEADER, *(row.cells for row in self.rows)]
        widths = [max(len(line[k]) for line in lines) for k in range(len(HEADER))]
        padded = [" | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines]
        rule = " | ".join("-" * max(width, 3) for width in widths)
        table = [f"| {text} |" for text in (padded[0], rule, *padded[1:])]
        return "\n".join([f"### {self.title}", "", *table, "", *(f"- {note}" for note in self.notes)]).rstrip()


def describe_run(n_repetitions: int) -> str:
    """The command line, the machine and the versions; no date and no path."""
    arguments = " ".join(Path(argument).name for argument in sys.argv[1:])
    versions = [f"{name} {_version(name)}" for name in PACKAGES]
    versions += [f"sqlite {sqlite3.sqlite_version}", f"tempog {_tempog_version()}"]
    return "\n".join(
        [
            f"- command: python benchmarks/run.py {arguments}".rstrip(),
            f"- machine: {_cpu_model()}, {os.cpu_count()} cores, {platform.system()}",
            f"- Python {platform.python_version()}, {', '.join(versions)}",
            f"- {n_repetitions} repetitions; tasks take turns, ratios are medians over the rounds",
        ]
    )


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def _tempog_version() -> str:
    from tempog import __version__

    return __version__


def _cpu_model() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
