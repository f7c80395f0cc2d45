"""How fast bags become maps on one core, against the same scans as .npz."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from measure import Task, interleave, median, ratio
from report import Row, Section, at_least, at_most

from tempog import Scan, TemporalGrid, build_grid, open_scans, write_npz
from tempog.ros.bag_writers import Compression
from tempog.scans.bag_writer import Mount, write_bag
from tempog.simulation import corridor, simulate

N_BEAMS, RATE_HZ = 720, 10.0
DURATION_S = 180.0
SWEEP_S = 0.05
KINDS: dict[str, tuple[str, Compression]] = {
    "MCAP": ("run.mcap", "none"),
    "MCAP, Zstandard": ("zstd.mcap", "zstd"),
    "ROS 1 bag": ("run.bag", "none"),
    "ROS 1 bag, LZ4": ("lz4.bag", "lz4"),
    "ROS 2 bag, SQLite": ("run.db3", "none"),
}
MOVING = "MCAP, moving sweeps"


def run(_names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """One section: reading alone, and reading and mapping."""
    scans = _scans(0.0)[:n_scans]
    duration_s = (scans[-1].stamp_ns - scans[0].stamp_ns) / 1e9
    with tempfile.TemporaryDirectory() as folder, one_core():
        paths = {kind: Path(folder, name) for kind, (name, _) in KINDS.items()} | {"npz": Path(folder, "run.npz")}
        write_npz(paths["npz"], scans)
        for kind, (_, compression) in KINDS.items():
            write_bag(paths[kind], scans, compression=compression)
        paths[MOVING] = Path(folder, "moving.mcap")
        write_bag(paths[MOVING], {Mount(sweep_s=SWEEP_S): _scans(SWEEP_S)[:n_scans]})
        reading = {kind: cpu_timed(partial(open_scans, path)) for kind, path in paths.items()}
        mapping = {f"{kind} and map": cpu_timed(partial(_map, path)) for kind, path in paths.items()}
        interleave(mapping, 1)  # warm-up
        seconds = interleave(reading | mapping, n_repetitions)
    section = Section(
        f"Bags: simulated corridor, {len(scans)} scans of {N_BEAMS} beams at {RATE_HZ:g} Hz, transforms at 50 Hz"
    )
    for kind in (*KINDS, MOVING):
        whole, npz = seconds[f"{kind} and map"], seconds["npz and map"]
        rate, npz_rate, read_rate, npz_read_rate = (
            f"{len(scans) / median(one):.0f} scans/s" for one in (whole, npz, seconds[kind], seconds["npz"])
        )
        real = duration_s / median(whole)
        alone = ratio(seconds[kind], seconds["npz"])
        section.rows += [
            Row(f"{kind}: read and map, time over .npz's", rate, npz_rate, ratio(whole, npz), at_most(2)),
            Row(f"{kind}: read and map, faster than real time", rate, "", real, at_least(50)),
            Row(f"{kind}: read alone, time over .npz's", read_rate, npz_read_rate, alone),
        ]
    section.notes.append(
        "Seconds of one core (CPU time). A bag holds a transform every 20 ms and a scan every 100 ms, an .npz poses."
    )
    section.notes.append(
        f"Moving sweeps: rays are taken over {SWEEP_S:g} s, and the motion in that time is taken out."
    )
    return [section]


def _map(path: Path) -> TemporalGrid:
    return build_grid(open_scans(path))


def cpu_timed(work: Callable[[], object]) -> Task:
    """What `work` takes of this process's core, whoever else uses it."""

    def task() -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    return task


def _scans(sweep_s: float) -> list[Scan]:
    world = corridor(seed=0)
    laser = replace(world.laser, n_beams=N_BEAMS, fov_rad=np.radians(270.0), rate_hz=RATE_HZ, sweep_s=sweep_s)
    return simulate(replace(world, laser=laser), duration_s=DURATION_S, seed=0).scans


@contextmanager
def one_core() -> Iterator[None]:
    """This process on one core while it lasts, where the system can do that."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
