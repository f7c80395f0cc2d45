"""Objects worked out by a Dask cluster on this machine: against one process, and what a block of a map costs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import logs
from measure import interleave, median, timed
from objects import SPAN_S, WORLDS, Town, _drive
from report import Row, Section, at_least

from tempog import History, build_grid, find_objects, save_map
from tempog.analysis.cluster import dask_workers, packed, unpacked
from tempog.analysis.evidence.find import find_by_evidence
from tempog.grid.temporal_grid import TemporalGrid
from tempog.methods import EvidenceConfig
from tempog.simulation import corridor, simulate

N_WORKERS = 2
N_CELLS = 500_000
LONG_S = 9000.0
MAPS = {  # as _measure takes them, and for people
    "small": "four worlds side by side, {:.0f} M intervals",
    "crowded": "the same, {:.0f} M intervals, somebody stood in every cell",
    "large": "the same, {:.0f} M intervals",
    "long": f"the hallway for {LONG_S:g} s with 20 people, {{:.0f}} M intervals",
}
N_INTERVALS = {"small": 10_000_000, "large": 60_000_000, "crowded": 5_000_000}
MOST_REPETITIONS = 3
MEGABYTE = 1e6

T = TypeVar("T")
U = TypeVar("U")


class Counting:
    """Workers that are this process: what is sent is packed and unpacked; everything is timed, in CPU seconds."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.n_tasks: dict[str, int] = defaultdict(int)
        self.n_bytes: dict[str, int] = defaultdict(int)

    def each(self, what: str, work: Callable[[T], U], items: Iterable[T], n_items: int) -> list[U]:
        """Work out one item after the other."""
        answers: list[U] = []
        left = iter(items)
        while True:
            start = time.process_time()
            try:
                sent = packed((work, next(left)))
            except StopIteration:
                break
            made = time.process_time()
            there, item = unpacked(sent)
            answer = packed(there(item))
            done = time.process_time()
            answers.append(unpacked(answer))
            self.seconds["sending"] += made - start + time.process_time() - done
            self.seconds[what] += done - made
            self.n_tasks[what] += 1
            self.n_bytes[what] += len(sent) + len(answer)
        return answers


def run(names: list[str], n_scans: int | None, n_repetitions: int) -> list[Section]:
    """The logs are asked only what their maps hold."""
    n_repetitions = min(n_repetitions, MOST_REPETITIONS)
    measured = {name: _in_its_own_process(name, n_repetitions) for name in (["small"] if n_scans else MAPS)}
    return [_together(measured), _shares(measured), _blocks(measured), _contents(names, n_scans)]


def _together(measured: dict[str, dict[str, Any]]) -> Section:
    section = Section(f"Objects on a cluster: {N_WORKERS} processes here against one process")
    for name, answer in measured.items():
        what = _text(name, answer)
        one, both, cluster = (median(answer[key]) for key in ("one core", "two cores", "cluster"))
        section.rows += [
            Row(f"{what}, against one core", f"{cluster:.2f} s", f"{one:.2f} s", one / cluster, at_least(1.0)),
            Row(f"{what}, against threads", f"{cluster:.2f} s", f"{both:.2f} s", both / cluster, at_least(1.0)),
            Row(
                f"{what}, CPU of all processes",
                f"{answer['client_cpu_s']:.2f} + {answer['workers_cpu_s']:.2f} s",
                f"{median(answer['one core, CPU']):.2f} s",
                median(answer["one core, CPU"]) / (answer["client_cpu_s"] + answer["workers_cpu_s"]),
            ),
        ]
    start = median([answer["start_s"] for answer in measured.values()])
    section.rows.append(Row(f"starting local:{N_WORKERS}, and what workers import", "", "", start, None, "s"))
    section.notes += [
        f"The client, the scheduler and {N_WORKERS} workers share {len(os.sched_getaffinity(0))} cores; ratios above"
        " 1 are for the cluster. CPU is that of the client with the scheduler, and of the workers.",
        f"Answers are compared; they are equal. At most {MOST_REPETITIONS} repetitions.",
    ]
    return section


def _shares(measured: dict[str, dict[str, Any]]) -> Section:
    section = Section("Objects on a cluster: where the time goes, one process that sends to itself")
    for name, answer in measured.items():
        seconds, whole = answer["seconds"].copy(), answer["whole_s"]
        sending = seconds.pop("sending")
        away = sum(seconds.values())
        what = _text(name, answer)
        section.rows += [
            Row(f"{what}, worked out elsewhere", f"{away:.2f} s", f"{whole:.2f} s", 100 * away / whole, None, "%"),
            Row(f"{what}, cut out and sent", f"{sending:.2f} s", f"{whole:.2f} s", 100 * sending / whole, None, "%"),
        ]
        parts = ", ".join(f"{what} {100 * taken / whole:.0f} %" for what, taken in seconds.items())
        section.notes.append(f"{name}: {parts}; {sum(answer['n_bytes'].values()) / MEGABYTE:.0f} MB to and fro.")
    return section


def _blocks(measured: dict[str, dict[str, Any]]) -> Section:
    section = Section("Objects on a cluster: a block of 6.4 m x 6.4 m, one core")
    section.notes.append("CPU seconds: other work on the machine does not count.")
    for name, answer in measured.items():
        n_blocks, what = answer["n_tasks"]["blocks"], _text(name, answer)
        away = sum(taken for step, taken in answer["seconds"].items() if step != "sending")
        n_bytes = sum(answer["n_bytes"].values()) / n_blocks / MEGABYTE
        one = median(answer["one core, CPU"])
        per_interval = 1e9 * one / answer["n_intervals"]
        section.rows += [
            Row(f"{what}, {n_blocks} blocks, work for each", "", "", 1e3 * away / n_blocks, None, "ms"),
            Row(f"{what}, sent for each, and back", "", "", n_bytes, None, "MB"),
            Row(f"{what}, one core, per interval", f"{one:.2f} s", "", per_interval, None, "ns"),
        ]
    section.notes.append("Work for each block: all that is worked out elsewhere; for its cells, groups, and places.")
    return section


def _contents(names: list[str], n_scans: int | None) -> Section:
    """What there is to analyse after an hour, from logs and simulated drives."""
    section = Section("What maps hold, by the default evidence")
    grids: dict[str, TemporalGrid] = {}
    for name in names:
        log = logs.load(name, n_scans)
        grids[log.name] = TemporalGrid(log.config("surface"))
        grids[log.name].integrate_many(log.scans)
    for world, people in WORLDS:
        grids[f"{world}, {people} people"] = _drive(world, people, 60.0 if n_scans else SPAN_S)
    for name, grid in grids.items():
        hours, seen_m2 = grid.duration_s / 3600, grid.n_cells * grid.tiles.spec.resolution_m**2
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "one.tempog")
            save_map(grid, path)
            n_bytes = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        scans = f"{len(grid.stamps_ns) / grid.duration_s:.1f} scans/s, {seen_m2:.0f} m2"
        section.rows += [
            Row(f"{name}, intervals per hour of driving", scans, "", grid.n_intervals / hours / 1e6, None, "M"),
            Row(f"{name}, per m2 seen and hour", scans, "", grid.n_intervals / hours / seen_m2, None, ""),
            Row(f"{name}, map directory per interval", "", "", n_bytes / grid.n_intervals, None, "bytes"),
        ]
    return section


def _text(name: str, answer: dict[str, Any]) -> str:
    return MAPS[name].format(answer["n_intervals"] / 1e6)


def _in_its_own_process(name: str, n_repetitions: int) -> dict[str, Any]:
    command = [sys.executable, str(Path(__file__)), name, str(n_repetitions)]
    answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(answer.stdout)
    return found


def _measure(name: str, n_repetitions: int) -> dict[str, Any]:
    cores = os.sched_getaffinity(0)

    cpu_s: list[float] = []

    def on_one_core(work: Callable[[], object]) -> Callable[[], float]:
        def task() -> float:
            os.sched_setaffinity(0, {min(cores)})
            start = time.process_time()
            seconds = timed(work)()
            cpu_s.append(time.process_time() - start)
            os.sched_setaffinity(0, cores)
            return seconds

        return task

    first = _drive(WORLDS[0][0], WORLDS[0][1], SPAN_S)
    history: History
    if name == "long":
        history = _drive("hallway", 20, LONG_S)
    else:
        drives = [first, *(_drive(world, people, SPAN_S) for world, people in WORLDS[1:])]
        history = Town(drives, N_CELLS, N_INTERVALS[name], crowded=name == "crowded")
    find_objects(first)  # compiles
    with _local() as (client, start_s):
        find_objects(first, cluster=client)
        alone = json.dumps(find_objects(history).document())
        before = time.process_time(), sum(client.run(time.process_time).values())
        together = find_objects(history, cluster=client)
        client_cpu_s = time.process_time() - before[0]
        workers_cpu_s = sum(client.run(time.process_time).values()) - before[1]
        assert json.dumps(together.document()) == alone
        tasks = {
            "one core": on_one_core(lambda: find_objects(history)),
            "two cores": timed(lambda: find_objects(history)),
            "cluster": timed(lambda: find_objects(history, cluster=client)),
        }
        answer: dict[str, Any] = dict(interleave(tasks, n_repetitions))
    answer["one core, CPU"] = list(cpu_s)
    counting = Counting()
    on_one_core(lambda: find_by_evidence(history, EvidenceConfig(), workers=counting))()
    return answer | {
        "start_s": start_s,
        "client_cpu_s": client_cpu_s,
        "workers_cpu_s": workers_cpu_s,
        "n_intervals": sum(runs.n_intervals for runs in history.runs()),
        "whole_s": cpu_s[-1],
        "seconds": counting.seconds,
        "n_tasks": counting.n_tasks,
        "n_bytes": counting.n_bytes,
    }


@contextmanager
def _local() -> Iterator[tuple[Any, float]]:
    """A client of a cluster as ``--dask local:2`` starts it, and how long that took with a first small task."""
    start = time.perf_counter()
    with dask_workers(f"local:{N_WORKERS}") as workers:
        find_by_evidence(build_grid(simulate(corridor(seed=0)).scans), EvidenceConfig(), workers=workers)
        yield workers.client, time.perf_counter() - start


if __name__ == "__main__":
    print(json.dumps(_measure(sys.argv[1], int(sys.argv[2]))))
