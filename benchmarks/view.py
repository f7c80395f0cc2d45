"""How fast the viewer's server answers: what a page asks for when its slider moves.

A page of 1920 x 1080 pixels shows two layers, occupancy and age. While the slider moves, it asks for each as one
picture of all tiles; when it rests, for tile by tile over six connections, as browsers do. What counts is the time
until the last is there. The moments jump about the whole history, so that nothing is asked for twice.
"""

from __future__ import annotations

import http.client
import json
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import logs
from ingest import integrate
from measure import median
from report import Row, Section, at_most
from towns import CELLS, INTERVALS, save_town

from tempog import save_map

SCREEN = (1920, 1080)
CONNECTIONS = 6
N_MOMENTS = 15  # per repetition
LAYERS = ("occupancy", "age")
TARGET_MS = 100.0
SMALL = (400_000, 4_000_000)  # cells and intervals of a quick run


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """The first log, and a town of 4 million cells."""
    log = logs.load(names[0], n_scans)
    with tempfile.TemporaryDirectory() as folder:
        mapped, town = Path(folder, "log.tempog"), Path(folder, "town.tempog")
        save_map(integrate(log, "surface"), mapped)
        save_town(town, *((CELLS, INTERVALS) if n_scans is None else SMALL))
        section = Section("Viewer: from slider to tiles, one screen of 1920 x 1080, two layers, over HTTP")
        for name, path in ((log.name, mapped), ("town", town)):
            section.rows += _rows(name, path, n_repetitions)
    section.notes.append(
        f"{len(LAYERS)} layers, {CONNECTIONS} connections, {N_MOMENTS * n_repetitions} moments; the client runs on"
        " the same cores. The target is for slider to picture: what the browser adds is measured in the browser."
    )
    return [section]


def _rows(name: str, path: Path, n_repetitions: int) -> list[Row]:
    begin_s = time.perf_counter()
    with _server(path) as address:
        entry = _ask(address, "/api/map")
        _screen(address, entry, entry["zooms"][-1], 0.0)
        ready_s = time.perf_counter() - begin_s
        while _ask(address, "/api/objects").get("state") == "working" and time.perf_counter() - begin_s < 600:
            time.sleep(1.0)
        _kept.pop(address)  # the server lets go of connections that are idle for so long
        size = f"{entry['n_cells'] / 1e6:.2f} M cells, {entry['n_intervals'] / 1e6:.1f} M intervals"
        rows = [Row(f"{name}, {size}: first picture after the start", f"{ready_s:.1f} s")]
        chosen = random.Random(0)
        for z in reversed(entry["zooms"]):
            for at_once in (True, False):
                taken_ms = []
                for k in range(N_MOMENTS * n_repetitions + 1):
                    begin_s = time.perf_counter()
                    n, n_bytes = _screen(address, entry, z, chosen.uniform(0, entry["duration_s"]), at_once)
                    if k:  # the first one reads what the zoom needs
                        taken_ms.append(1e3 * (time.perf_counter() - begin_s))
                worst = sorted(taken_ms)[int(0.95 * len(taken_ms))]
                row = Row(
                    f"{name}, zoom {z}: {n} {'pictures' if at_once else 'tiles'}, {n_bytes / 1e3:.0f} kB",
                    f"{median(taken_ms):.0f} ms, 95 % within {worst:.0f} ms",
                    "",
                    median(taken_ms),
                    at_most(TARGET_MS, "ms") if at_once else None,
                    "ms",
                )
                rows.append(row)
        rows.append(Row(f"{name}: memory of the server", f"{_memory_bytes(address) / 2**20:.0f} MB"))
    return rows


_processes: dict[tuple[str, int], int] = {}


@contextmanager
def _server(path: Path) -> Iterator[tuple[str, int]]:
    """Where a viewer of a map listens, in a process of its own."""
    command = [sys.executable, "-m", "tempog", "view", str(path), "--no-open", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            url = urllib.parse.urlsplit(process.stdout.readline().split()[0])
            address = str(url.hostname), int(url.port or 0)
            _processes[address] = process.pid
            yield address
        finally:
            process.terminate()


def _memory_bytes(address: tuple[str, int]) -> int:
    """Resident memory of the server, where the system tells; else 0."""
    statm = Path(f"/proc/{_processes[address]}/statm")
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if statm.is_file() else 0


def _ask(address: tuple[str, int], path: str) -> Any:
    connection = http.client.HTTPConnection(*address, timeout=120)
    connection.request("GET", path)
    answer = json.loads(connection.getresponse().read())
    connection.close()
    return answer


def _tiles(entry: dict[str, Any], z: int) -> list[tuple[int, int]]:
    """Columns and rows of the tiles that a screen in the middle of the map shows, those without cells left out."""
    found = []
    for first, n, pixels in (
        (entry["col0"], entry["n_cols"], SCREEN[0]),
        (entry["row0"], entry["n_rows"], SCREEN[1]),
    ):
        middle = (first + n // 2) >> z
        begin, end = max(middle - pixels // 2, first >> z), min(middle + pixels // 2, (first + n - 1) >> z)
        found.append(range(begin >> 8, (end >> 8) + 1))
    return [(col, row) for col in found[0] for row in found[1]]


def _screen(
    address: tuple[str, int], entry: dict[str, Any], z: int, t: float, at_once: bool = False
) -> tuple[int, int]:
    """Ask for all tiles of a screen, each by itself or at once; how many answers there were, and how many bytes."""
    waiting: SimpleQueue[str] = SimpleQueue()
    tiles, span = _tiles(entry, z), ""
    if at_once:
        (west, south), (east, north) = tiles[0], tiles[-1]
        tiles, span = tiles[:1], f"&cols={east - west + 1}&rows={north - south + 1}"
    paths = [
        f"/api/tiles/{layer}/{z}/{col}/{row}.png?t={t:.3f}&v={entry['version']}{span}"
        for layer in LAYERS
        for col, row in tiles
    ]
    for path in paths:
        waiting.put(path)
    sizes: list[int] = []
    connections = _kept.setdefault(address, [http.client.HTTPConnection(*address) for _ in range(CONNECTIONS)])
    threads = [threading.Thread(target=_fetch, args=[connection, waiting, sizes]) for connection in connections]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(sizes) == len(paths)
    return len(paths), sum(sizes)


_kept: dict[tuple[str, int], Sequence[http.client.HTTPConnection]] = {}


def _fetch(connection: http.client.HTTPConnection, waiting: SimpleQueue[str], sizes: list[int]) -> None:
    while not waiting.empty():
        connection.request("GET", waiting.get())
        answer = connection.getresponse()
        content = answer.read()
        assert answer.status == 200, content
        sizes.append(len(content))
