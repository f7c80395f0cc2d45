"""Questions to maps of ten and a hundred million intervals, in processes of their own, against databases."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import logs
from measure import median
from report import Row, Section, Target, at_least, at_most
from storage_commits import lapped

from tempog import LiveMap, MapConfig, Scan, open_map, open_scans, save_map
from tempog.config import DEFAULT_GAP, GridConfig, SensingConfig, parse_gap
from tempog.scans.scan import scan_period_s
from tempog.simulation import corridor, simulate
from tempog.store.upkeep import compact, prune

N_ROUNDS = (1, 10)  # of the log: ten million intervals each
N_SCANS_QUICK = 600
HOLDS = {"hold=inf": "inf", "hold=None": "none"}
MOMENT = 0.73  # of the way from the first scan to the last
DROP_CACHES = Path("/proc/sys/vm/drop_caches")
WINDOW_S = 1200.0
SMALLER_FOR_SQLITE = 2e7  # intervals; of more, filling it and its index takes longer than all else

Answer = dict[str, Any]


def history_sections(name: str, n_scans: int | None, n_repetitions: int, folder: Path, kept: Path) -> list[Section]:
    """For each size: questions, peers, pruning and compacting."""
    kept.mkdir(parents=True, exist_ok=True)
    sections = []
    tiny = save_map(_tiny(), folder / "tiny")
    for n_rounds in N_ROUNDS if n_scans is None else (1,):
        path = kept / f"{name}-{n_scans or 'all'}-{n_rounds}.tempog"
        if not path.exists():
            _make(name, n_scans, n_rounds, path)
        sections += [
            _questions_section(path, tiny, n_repetitions, folder),
            _upkeep_section(path, folder),
        ]
    return sections


def _tiny() -> Any:
    from tempog import build_grid

    return build_grid(simulate(corridor(), duration_s=20.0).scans)


def _make(name: str, n_scans: int | None, n_rounds: int, path: Path) -> None:
    """The log with all it says, up to its maximum range, again and again."""
    log = logs.log_path(name)
    scans: list[Scan] = (open_scans(log).scans if log.is_file() else simulate(corridor()).scans)[:n_scans]
    gap_s = parse_gap(DEFAULT_GAP, scan_period_s([scan.stamp_ns for scan in scans]))
    config = MapConfig(SensingConfig(evidence="literal"), GridConfig(gap_s=gap_s))
    unfinished = path.with_name(f"{path.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    with LiveMap(unfinished, config, window=WINDOW_S) as live:
        for number in range(n_rounds * len(scans)):
            live.integrate(lapped(scans, number))
    unfinished.rename(path)


def _questions_section(path: Path, tiny: Path, n_repetitions: int, folder: Path) -> Section:
    saved = open_map(path)
    n, large = saved.n_intervals, saved.n_intervals > 5e7
    section = Section(
        f"Storage: questions to {n / 1e6:.1f} M intervals of {saved.n_cells / 1e6:.2f} M cells,"
        f" {len(saved.segments)} segments of {saved.bytes_on_disk / n:.2f} bytes an interval"
    )
    common = {"map": str(path), "tiny": str(tiny), "moment": MOMENT}
    opened = [_ask(**common, who="tempog", question="open") for _ in range(n_repetitions)]
    section.rows.append(_seconds_row("open, cold", opened, "cold_s", at_most(0.5, "s") if large else None))
    peers = _peers(path, folder, n)
    for word, question in HOLDS.items():
        what = f"snapshot, {word}"
        ours = [_ask(**common, who="tempog", question=question) for _ in range(n_repetitions)]
        in_memory = _ask(**common, who="grid", question=question)
        section.rows += [
            _seconds_row(f"{what}, cold", ours, "cold_s", at_most(1, "s") if large else None),
            _seconds_row(f"{what}, cold, processor time", ours, "cold_cpu_s", None),
            _seconds_row(f"{what}, in a segment not read before, files cached", ours, "other_s", None),
            Row(
                f"{what}, warm over TemporalGrid's",
                f"{1e3 * median([one['warm_s'] for one in ours]):.3g} ms",
                f"{1e3 * in_memory['warm_s']:.3g} ms",
                median([one["warm_s"] for one in ours]) / in_memory["warm_s"],
                at_most(2),
            ),
        ]
        _compare(section, what, ours, in_memory, "TemporalGrid in memory", timed=())
        for peer, arguments in peers.items():
            _compare(section, what, ours, _fastest(common | arguments, question), peer)
    ours = [_ask(**common, who="tempog", question="tile") for _ in range(n_repetitions)]
    section.rows.append(_seconds_row("history of a tile's cells, cold", ours, "cold_s", None))
    for peer, arguments in peers.items():
        if "two files" not in peer:
            answer = _fastest(common | arguments, "tile")
            _compare(section, "history of a tile's cells", ours, answer, peer)
    dropped = "dropped" if os.access(DROP_CACHES, os.W_OK) else "NOT dropped, which needs root"
    section.notes += [
        f"A process per number; cold: the system's cache of files was {dropped}. Imports and a first question to a"
        " tiny map, which loads the kernels, come before. Warm: the same question again, median of five.",
        "Databases get scan numbers, and are asked for cell and value only; of several ways to put a question the"
        " fastest counts. SQLite gets no more than 10 million intervals, whose filling takes a minute.",
    ]
    return section


def _peers(path: Path, folder: Path, n_intervals: int) -> dict[str, Answer]:
    """Who else is asked, and with which arguments; databases on disk are filled."""
    peers: dict[str, Answer] = {}
    if importlib.util.find_spec("duckdb"):
        peers["DuckDB, all Parquet files"] = {"who": "parquet"}
        peers["DuckDB, told which two files"] = {"who": "two-files"}
        peers["DuckDB, its own file"] = {"who": "duckdb"}
    if n_intervals < SMALLER_FOR_SQLITE:
        peers["SQLite, indexed"] = {"who": "sqlite"}
    for arguments in peers.values():
        if arguments["who"] in ("duckdb", "sqlite"):
            arguments["database"] = str(folder / f"history.{arguments['who']}")
            Path(arguments["database"]).unlink(missing_ok=True)
            _ask(map=str(path), **arguments, question="fill")
    return peers


def _fastest(arguments: Answer, question: str) -> Answer:
    """What the fastest way to put a question takes."""
    answers = [_ask(**arguments, question=question, way=0)]
    answers += [_ask(**arguments, question=question, way=way) for way in range(1, answers[0]["n_ways"])]
    return min(answers, key=lambda answer: float(answer["warm_s"]))


def _seconds_row(what: str, answers: list[Answer], key: str, target: Target | None) -> Row:
    seconds = [answer[key] for answer in answers]
    peak = f"{max(answer['peak_bytes'] for answer in answers) / 1e6:.0f} MB"
    return Row(what, peak, "", median(seconds), target, unit="s")


def _compare(
    section: Section,
    what: str,
    ours: list[Answer],
    peer: Answer,
    name: str,
    timed: tuple[str, ...] = ("cold", "warm"),
) -> None:
    """How much faster we are, and whether both say the same."""
    for word in timed:
        mine = median([answer[f"{word}_s"] for answer in ours])
        theirs = f"{peer[f'{word}_s']:.3g} s, {peer['peak_bytes'] / 1e6:.0f} MB"
        ratio = peer[f"{word}_s"] / mine
        section.rows.append(Row(f"{what}, {word}, faster than {name}", f"{mine:.3g} s", theirs, ratio, at_least(1)))
    same = peer["n"] == ours[0]["n"] and abs(peer["total"] - ours[0]["total"]) <= 1e-4 * abs(ours[0]["total"])
    if not same:
        section.notes.append(
            f"DISAGREE, {what}: tempog {ours[0]['n']} values, sum {ours[0]['total']:.6g};"
            f" {name} {peer['n']}, {peer['total']:.6g}."
        )


def _upkeep_section(path: Path, folder: Path) -> Section:
    n = open_map(path).n_intervals
    section = Section(f"Storage: upkeep of {n / 1e6:.1f} M intervals")
    copy = folder / "copy"
    stamps_ns = open_map(path).stamps_ns
    for what, share in (("the older half", 0.5), ("all but the last tenth", 0.9)):
        shutil.copytree(path, copy)
        before_ns = int(stamps_ns[0] + share * (stamps_ns[-1] - stamps_ns[0]))
        start = time.perf_counter()
        pruned = prune(copy, before_ns)
        seconds = time.perf_counter() - start
        section.rows.append(Row(f"prune {what}", f"{pruned.n_intervals / 1e6:.1f} M go", "", seconds, unit="s"))
        shutil.rmtree(copy)
    shutil.copytree(path, copy)
    start = time.perf_counter()
    done = compact(copy)
    seconds = time.perf_counter() - start
    ours = f"{done.n_segments_before} to {done.n_segments} segments, {done.n_bytes / n:.2f} bytes an interval"
    section.rows.append(Row("compact", ours, f"{done.n_bytes_before / n:.2f} bytes before", seconds, unit="s"))
    shutil.rmtree(copy)
    return section


def _ask(**arguments: Any) -> Answer:
    """One question to one of them, in a process of its own that begins with an empty cache of files."""
    if os.access(DROP_CACHES, os.W_OK):
        os.sync()
        DROP_CACHES.write_text("3")
    child = Path(__file__).with_name("storage_child.py")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(child), json.dumps(arguments)]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if result.returncode:
        raise RuntimeError(f"{arguments} failed: {result.stderr}")
    answer: Answer = json.loads(result.stdout)
    return answer
