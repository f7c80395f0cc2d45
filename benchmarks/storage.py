"""Maps on disk: how fast they are written, what commits cost, how long questions take, and what all of it takes."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from report import Section
from storage_commits import commit_sections, live_section
from storage_history import history_sections
from storage_memory import memory_section
from storage_writes import size_section, write_section

FOLDER = "TEMPOG_BENCH_FOLDER"  # where large maps are kept for the next run, if the environment says so


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """All of it: on two cores a quarter of an hour, or two minutes of parts of the log."""
    return [section for part in PARTS.values() for section in part(names, n_scans, n_repetitions)]


def writes(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """What is written per second, and the bytes it takes."""
    with _folder() as folder:
        return [write_section(names[0], n_scans, n_repetitions, folder), size_section(names, n_scans, folder)]


def commits(names: list[str], n_scans: int | None, _n_repetitions: int) -> list[Section]:
    """What a commit takes, and what mapping notices of it."""
    with _folder() as folder:
        return [*commit_sections(n_scans is not None, folder), live_section(names[0], n_scans, folder)]


def memory(names: list[str], n_scans: int | None, _n_repetitions: int) -> list[Section]:
    """Whether memory stays as it is while a robot drives on."""
    with _folder() as folder:
        return [memory_section(names[0], n_scans is not None, folder)]


def history(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """Questions to large maps, and what is done to them as a whole."""
    kept = os.environ.get(FOLDER)
    with _folder() as folder:
        return history_sections(names[0], n_scans, n_repetitions, folder, Path(kept) if kept else folder)


@contextmanager
def _folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp())
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


PARTS: dict[str, Callable[[list[str], int | None, int], list[Section]]] = {
    "storage-writes": writes,
    "storage-commits": commits,
    "storage-memory": memory,
    "storage-history": history,
}
