"""Processes that write maps and are killed meanwhile.

Run as a program, this loads everything once and then makes a child for each line of standard input, so that children
begin to write at once.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

STEPS = ("fsync", "replace", "rename", "unlink", "rmdir", "mkdir", "write")  # of os, after which a map differs


class Victims:
    """Starts children and kills them."""

    def __init__(self) -> None:
        self.parent = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd="/"
        )
        assert self._answer() == "ready"

    def start(self, job: str, **settings: Any) -> int:
        """Start a child; its process id."""
        self.parent.stdin.write(json.dumps({"job": job, **settings}) + "\n")
        self.parent.stdin.flush()
        return int(self._answer())

    def end(self) -> int:
        """Wait for the child; its exit code, negative if it was killed."""
        return int(self._answer())

    def run(self, job: str, **settings: Any) -> int:
        """Start a child and wait for it."""
        self.start(job, **settings)
        return self.end()

    def kill(self, pid: int) -> int:
        """Kill the child with a signal that it cannot catch."""
        os.kill(pid, signal.SIGKILL)
        return self.end()

    def close(self) -> None:
        self.parent.stdin.close()
        self.parent.wait(timeout=60)
        self.parent.stdout.close()

    def _answer(self) -> str:
        return self.parent.stdout.readline().strip()


def acknowledged(path: Path) -> int:
    """How many scans a child has said to be kept."""
    return path.stat().st_size if path.exists() else 0


def wait_for(path: Path, count: int) -> None:
    """Wait until a child has said so of some scans."""
    until = time.monotonic() + 60
    while acknowledged(path) < count:
        assert time.monotonic() < until, f"{acknowledged(path)} of {count} scans after 60 s"
        time.sleep(0.0005)


# What children do.


def live(path: str, acks: str, n_scans: int, start_s: float = 100.0, flush_s: float = 0.25, grace_s: float = 0.0):
    """Map scans into a live map; one byte in `acks` for each that was taken in."""
    from same_history import CONFIG, room_scans
    from tempog import LiveMap
    from tempog.store import committer

    committer.FANOUT, committer.GRACE_S = 3, grace_s
    file = os.open(acks, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    acknowledge = os.pwrite  # not counted as a step of writing the map
    with LiveMap(path, CONFIG, flush_s=flush_s) as writer:
        for k, scan in enumerate(room_scans(n_scans, start_s)):
            writer.integrate(scan)
            acknowledge(file, b".", k)


def append(log: str, path: str) -> None:
    """Add a log to a map as a user does."""
    from tempog.cli.app import run

    sys.argv = ["tempog", "map", log, "--append", "-o", path, "--quiet"]
    run()


def reopen(path: str) -> None:
    """Open a map, which repairs it."""
    from tempog import open_map

    open_map(path)


def fill(path: str, acks: str, n_scans: int, most_bytes: int) -> None:
    """As `live`, with files of so many bytes at most; each scan is tried again with more room."""
    import resource

    from same_history import CONFIG, room_scans
    from tempog import LiveMap
    from tempog.errors import MapError

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    file = os.open(acks, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    n_refused = 0
    with LiveMap(path, CONFIG, flush_s=60) as writer:
        for scan in room_scans(n_scans):
            while True:
                resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, hard))
                try:
                    writer.integrate(scan)
                    break
                except MapError:
                    n_refused += 1
                    most_bytes += 1000
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    os.write(file, b"." * n_refused)


def die_at(step: int) -> None:
    """End without a word at some step of what changes files: before it, or half of it done where it can be."""
    from tempog.store import tables

    n = 0

    def watched(original):
        def counted(*args, **kwargs):
            nonlocal n
            n += 1
            if n == step:
                if original is write:
                    write(args[0], args[1][: len(args[1]) // 2])
                os._exit(9)
            return original(*args, **kwargs)

        return counted

    write = os.write
    for name in STEPS:
        setattr(os, name, watched(getattr(os, name)))
    tables.pq.write_table = watched(tables.pq.write_table)


def main() -> None:
    sys.path.insert(0, str(Path(__file__).parent))
    from same_history import grid_of, room_scans
    from tempog.cli import map_logs  # noqa: F401
    from tempog.sensing.surfaces import SurfaceMemory
    from tempog.store import live_map, saved_map  # noqa: F401

    grid = grid_of(room_scans(30))  # no thread is started here: children have but the one that forks
    grid.at(grid.stamps_ns[-1] / 1e9)
    used = slice(0, grid.surfaces.n_slots)
    known = grid.surfaces.cell_of_slot[used], grid.surfaces.hit_count[used], grid.surfaces.moments[used]
    SurfaceMemory.of(grid.tiles.n_cells, *known)
    print("ready", flush=True)
    for line in sys.stdin:
        settings = json.loads(line)
        job, step = settings.pop("job"), settings.pop("die_at", None)
        child = os.fork()
        if child == 0:
            code = 1
            os.dup2(2, 1)  # the pipe is for the process that forks
            try:
                if step is not None:
                    die_at(step)
                {"live": live, "append": append, "reopen": reopen, "fill": fill}[job](**settings)
                code = 0
            except SystemExit as stop:
                code = int(stop.code or 0)
            except BaseException:
                import traceback

                traceback.print_exc()
            finally:
                os._exit(code)
        print(child, flush=True)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    main()
