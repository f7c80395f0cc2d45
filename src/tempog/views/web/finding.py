"""Finding the objects of a map in a process of its own, at low priority, so that pictures are not kept waiting."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import threading
import time
from dataclasses import replace
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.pose_consistency import MapWithHits, pose_consistency
from tempog.errors import TempogError
from tempog.grid.history import History
from tempog.grid.segments import Runs
from tempog.methods import Method
from tempog.views.web.sources import Choice, Source

NICENESS = 10


class Findings(NamedTuple):
    """What is known once the objects are found.

    Attributes
    ----------
    found : FoundObjects
    moving : Runs
        When each cell was occupied by something on the move.
    n_visits : (n_rows, n_cols) int32
        How often something on the move came to each cell; over the extent of `found`.
    poses : str
        What the consistency of poses is; empty if unknown.
    version : str
        Of the map it was found in.
    """

    found: FoundObjects
    moving: Runs
    n_visits: NDArray[np.int32]
    poses: str
    version: str


def findings_of(history: History, found: FoundObjects, version: str) -> Findings:
    """What follows from the objects that were found in a history."""
    found = replace(found, history=history)
    moving = found.moving_intervals()
    n_visits = np.zeros(history.tiles.n_cells, dtype=np.int32)
    n_visits[moving.cells] = np.diff(moving.offsets)
    return Findings(found, moving, history.tiles.to_dense(n_visits, 0), _poses_text(history), version)


def _poses_text(history: History) -> str:
    if not hasattr(history, "surfaces"):
        return ""
    poses = pose_consistency(cast(MapWithHits, history))
    return poses.warning or str(poses)


class Finder:
    """Finds the objects of a source, once for each time it is told to.

    Attributes
    ----------
    state : "idle", "working", "ready" or "failed"
    findings : Findings, optional
        The latest; they stay while it works on newer ones.
    error : str
        What went wrong, if something did.
    tried : str
        The version of the map that it worked on last, or works on.
    took_s : float, seconds
        How long the latest took.
    """

    def __init__(self, source: Source, method: Method = "evidence") -> None:
        self.source, self.method = source, method
        self.state: Literal["idle", "working", "ready", "failed"] = "idle"
        self.findings: Findings | None = None
        self.error = self.tried = ""
        self.took_s = 0.0
        self.began_s = self.ended_s = time.monotonic()
        self._changing = threading.Lock()
        self._child: subprocess.Popen[bytes] | None = None
        self._closed = False

    def start(self) -> None:
        """Begin, unless it is at work."""
        with self._changing:
            if self.state == "working" or self._closed:
                return
            self.state, self.began_s, self.tried = "working", time.monotonic(), self.source.version
        threading.Thread(target=self._work, name="tempog finds objects", daemon=True).start()

    def close(self) -> None:
        """Stop working."""
        with self._changing:
            self._closed = True
            if self._child is not None:
                self._child.kill()

    def _work(self) -> None:
        try:
            findings = self._found()
        except Exception as error:  # whatever it is, who waits is told, and the next version is tried
            self.error = str(error) or type(error).__name__
            state: Literal["ready", "failed"] = "failed"
        else:
            self.findings, self.error = findings, ""
            state = "ready"
        self.ended_s = time.monotonic()
        self.took_s = self.ended_s - self.began_s
        self.state = state

    def _found(self) -> Findings:
        source, version = self.source, self.tried
        known = source.found()
        if known is not None:
            history = source.apart()
            return findings_of(history, laid_over(known, history), version)
        if source.choice is None:
            history = source.apart()
            return findings_of(history, find_objects(history, self.method), version)
        return self._found_by_child(source.choice, version)

    def _found_by_child(self, choice: Choice, version: str) -> Findings:
        asked = {
            "path": str(choice.path),
            "sessions": choice.sessions,
            "robots": choice.robots,
            "method": self.method,
        }
        command = [sys.executable, "-m", "tempog.views.web.finding"]
        with self._changing:
            if self._closed:
                raise OSError("the viewer was closed")
            self._child = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
        answer, _ = self._child.communicate(json.dumps(asked).encode())
        if self._child.returncode != 0:
            raise OSError(f"the process that finds objects ended with code {self._child.returncode}")
        kind, content = pickle.loads(answer)
        if kind == "error":
            raise TempogError(content)
        findings: Findings = content
        found = replace(findings.found, history=self.source.apart())
        return findings._replace(found=found, version=version)


def laid_over(found: FoundObjects, history: History) -> FoundObjects:
    """What was found, laid over the extent of a history that grew since."""
    return replace(found, history=history, walls=found.walls_over(history.extent), extent=history.extent)


def answer(asked: dict[str, Any]) -> tuple[str, Any]:
    """What the process of its own answers: ("found", Findings), without the map; or ("error", its message)."""
    try:
        choice = Choice(asked["path"], asked["sessions"], asked["robots"])
        history = choice.open()
        findings = findings_of(history, find_objects(history, asked["method"]), "")
    except (TempogError, OSError, MemoryError) as error:
        return "error", str(error) or type(error).__name__
    return "found", findings._replace(found=replace(findings.found, history=cast(History, None)))


if __name__ == "__main__":
    from tempog.views.web import finding  # under its own name, as whoever reads the answer knows it

    os.nice(NICENESS)
    sys.stdout.buffer.write(pickle.dumps(finding.answer(json.load(sys.stdin))))
