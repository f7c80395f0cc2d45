"""What a commit asks of the disk, and what a process killed while it writes leaves behind."""

from __future__ import annotations

import math
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from report import Row, Section, at_least, at_most
from table_child import ROWS_PER_COMMIT, STORES
from table_stores import MANIFEST, open_segments

N_KILLS = 30
N_KILLS_QUICK = 5
LONGEST_LIFE_S = 1.5  # after the first commit
N_TRACED = 40
CALLS = ("fsync", "fdatasync", "sync_file_range", "rename", "renameat", "renameat2", "link", "linkat")
SYNCS = ("fsync", "fdatasync", "sync_file_range")


@dataclass
class Aftermath:
    """What was found after the kills.

    Attributes
    ----------
    n_promised : int
        Commits that had been acknowledged.
    n_unreadable : int
        Stores that did not open.
    n_lost, n_beyond : int
        Acknowledged commits that are not there; commits that are, though the kill came before the word.
    n_parts : int
        Stores that show some rows of a commit and not others.
    n_with_debris, n_debris : int
        Stores with files that they do not name, and how many files.
    n_stuck : int
        Stores that could not be written on.
    """

    n_promised: int = 0
    n_unreadable: int = 0
    n_lost: int = 0
    n_beyond: int = 0
    n_parts: int = 0
    n_with_debris: int = 0
    n_debris: int = 0
    n_stuck: int = 0


def section(child: Path, quick: bool) -> Section:
    """System calls of a commit, then the kills."""
    n_kills = N_KILLS_QUICK if quick else N_KILLS
    table = Section(f"Storage: waiting for the disk, and {n_kills} kills of each writer at random moments")
    for store in STORES:
        table.rows.append(_traced_row(child, store))
    for store in STORES:
        found = _kill_all(child, store, n_kills)
        target = at_most(0, "stores") if store == "segments" else None
        shown = f"{found.n_promised} promised, {found.n_lost} lost, {found.n_beyond} more there"
        debris = f"{found.n_debris} files"
        n_wrong = found.n_unreadable + found.n_parts + found.n_stuck + min(found.n_lost, n_kills)
        table.rows += [
            Row(f"{store}: not whole after a kill", *_sides(store, shown), n_wrong, target, "stores"),
            Row(f"{store}: with debris", *_sides(store, debris), found.n_with_debris, None, "stores"),
        ]
    table.notes += [
        "A kill loses nothing that the operating system was handed; only a power cut does, and that is what the calls"
        " to fsync are for. Power cuts were not tried.",
        "Not whole: does not open, misses a commit that was acknowledged, shows part of one, or is stuck.",
        "Debris: files that the newest version does not name. Segments remove them when next opened to write;"
        " Delta Lake at the next full vacuum.",
    ]
    return table


def _sides(store: str, text: str) -> tuple[str, str]:
    return (text, "") if store == "segments" else ("", text)


def _traced_row(child: Path, store: str) -> Row:
    """Calls of N_TRACED commits, merging included, for each commit."""
    what = f"{store}: syncs for each commit, merging included"
    target = at_least(1, "syncs") if store == "segments" else None
    if shutil.which("strace") is None:
        return Row(what, *_sides(store, "strace absent"), math.nan, target)
    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder, "trace")
        tracing = ["strace", "-f", "-o", str(trace), "-e", f"trace={','.join(CALLS)}"]
        command = [sys.executable, str(child), "write", store, f"{folder}/store", str(N_TRACED)]
        subprocess.run([*tracing, *command], capture_output=True, check=True)
        calls = Counter(re.findall(r"^\d+ +(\w+)\(", trace.read_text(encoding="utf-8"), re.MULTILINE))
    shown = ", ".join(f"{count} {name}" for name, count in sorted(calls.items()))
    n_syncs = sum(calls[name] for name in SYNCS)
    return Row(what, *_sides(store, f"{N_TRACED} commits: {shown}"), n_syncs / N_TRACED, target, "syncs")


def _kill_all(child: Path, store: str, n_kills: int) -> Aftermath:
    found = Aftermath()
    lives = random.Random(0)
    for _ in range(n_kills):
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder, "store")
            _kill_once(child, store, root, lives.uniform(0, LONGEST_LIFE_S), found)
    return found


def _kill_once(child: Path, store: str, root: Path, life_s: float, found: Aftermath) -> None:
    command = [sys.executable, str(child), "write", store, str(root)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        time.sleep(life_s)
        writer.kill()
        said = [line for line in writer.stdout.read().split("\n")[:-1] if line]  # a line cut short was not said
    n_promised = int(said[-1]) if said else 1
    found.n_promised += n_promised
    try:
        files = _files(store, root)
        n_there, n_rest = divmod(_n_rows(files), ROWS_PER_COMMIT)
    except Exception as error:  # whatever a library raises on a store that does not open
        print(f"{store} does not open: {error}", file=sys.stderr)
        found.n_unreadable += 1
        return
    found.n_parts += n_rest > 0
    found.n_lost += max(0, n_promised - n_there)
    found.n_beyond += max(0, n_there - n_promised)
    unnamed = _unnamed(root, files)
    found.n_debris += len(unnamed)
    found.n_with_debris += bool(unnamed)
    more = subprocess.run([*command, "2"], capture_output=True, check=False)
    found.n_stuck += more.returncode != 0 or _n_rows(_files(store, root)) != (n_there + 2) * ROWS_PER_COMMIT


def _files(store: str, root: Path) -> list[Path]:
    if store == "segments":
        return [root / "segments" / segment.file for segment in open_segments(root)[0]]
    from deltalake import DeltaTable

    return [root / Path(uri).name for uri in DeltaTable(root).file_uris()]


def _n_rows(files: list[Path]) -> int:
    """As read, not as the footers say."""
    import pyarrow.parquet as pq

    return sum(pq.read_table(file).num_rows for file in files)


def _unnamed(root: Path, files: list[Path]) -> list[Path]:
    named = {*files, root / MANIFEST}
    log = re.compile(r"\d+\.json|\d+\.checkpoint\.parquet|\d+\.crc|_last_checkpoint")
    there = [path for path in root.rglob("*") if path.is_file() and path not in named]
    return [path for path in there if not (path.parent.name == "_delta_log" and log.fullmatch(path.name))]
