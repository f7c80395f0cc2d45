"""The costly questions, asked of the map on disk by a process of its own, so that no scan waits for an answer."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple, cast

from tempog.errors import TempogError
from tempog.sensing.grid_spec import Bounds

if TYPE_CHECKING:
    from tempog.analysis.find_objects import FoundObjects
    from tempog.analysis.learn_area import Learned, NextIds
    from tempog.grid.history import History

CHILD = "from tempog.live.analyst import main; main()"  # not -m: its classes would be those of another module
NICENESS = 10  # mapping goes first
COMMIT_WAIT_S = 90.0  # s; commits come every half minute, and may wait for a slow disk
POLL_S = 1.0  # s; between two looks at whether one came


class Question(NamedTuple):
    """What to work out once the map on disk reaches to `until_ns`.

    Attributes
    ----------
    until_ns : int
    since_ns : int or None
        Only history from there on counts.
    found, ids, area : optional
        What is known, and where to look again; none to find everything.
    """

    until_ns: int
    since_ns: int | None = None
    found: FoundObjects | None = None
    ids: NextIds | None = None
    area: Bounds | None = None


@dataclass(frozen=True)
class Answer:
    """What was found, without the history it was found in; `failure` says why there is none.

    `learned` and `ids` are of an area.
    """

    question: Question
    found: FoundObjects | None = None
    learned: Learned | None = None
    ids: NextIds | None = None
    took_s: float = 0.0
    failure: str = ""


class Analyst:
    """A child process that reads a map while it is written, and answers one question after the other.

    Parameters
    ----------
    path : path
        The map.

    Examples
    --------
    >>> analyst = Analyst("site.tempog")    # nothing is started before the first question
    >>> analyst.busy, analyst.answer()
    (False, None)
    >>> analyst.close()
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self._child: subprocess.Popen[bytes] | None = None
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        self._question: Question | None = None
        self._waiting: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """Whether a question waits for its answer."""
        return self._question is not None

    @property
    def pid(self) -> int | None:
        """Of the child process; None while there is none."""
        return None if self._child is None else self._child.pid

    def ask(self, question: Question) -> None:
        """Hand a question over; nothing may be asked while it is busy."""
        if self._child is not None and self._child.poll() is not None:
            self.close()
        self._question = question
        if self._child is None:
            try:
                self._child = subprocess.Popen(
                    [sys.executable, "-c", CHILD, str(self._path)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    start_new_session=True,  # an interrupt from the terminal is for the parent alone
                )
            except OSError as error:  # no memory, or too many processes or files: mapping goes on
                failure = f"the process that looks for objects could not be started: {error}"
                self._answers.put(Answer(question, failure=failure))
                return
        asked = (self._child, question)
        self._waiting = threading.Thread(target=self._wait, args=asked, daemon=True, name="tempog-analyst")
        self._waiting.start()

    def answer(self) -> Answer | None:
        """The answer, once it is there; each is given once."""
        try:
            answer = self._answers.get_nowait()
        except queue.Empty:
            return None
        self._question = None
        return answer

    def close(self) -> None:
        """End the child, whatever it is at; it only reads."""
        if self._child is not None:
            self._child.kill()
            if self._waiting is not None:
                self._waiting.join()
            for end in (self._child.stdin, self._child.stdout):
                with suppress(OSError):  # what was not written yet has nowhere to go
                    cast(IO[bytes], end).close()
            self._child.wait()
            self._child = None

    def _wait(self, child: subprocess.Popen[bytes], question: Question) -> None:
        try:
            pickle.dump(question, cast(IO[bytes], child.stdin))
            cast(IO[bytes], child.stdin).flush()
            answer = pickle.load(cast(IO[bytes], child.stdout))
        except Exception as error:  # it was killed, say, in the middle of its answer
            child.kill()
            child.wait()  # so that the next question finds it gone
            answer = Answer(question, failure=f"the process that looks for objects has ended: {error}")
        self._answers.put(answer)


def without_history(found: FoundObjects) -> FoundObjects:
    """What was found, light enough to be sent."""
    return replace(found, history=cast("History", None))


def answered(path: Path, question: Question) -> Answer:
    """Work a question out, here and now."""
    from tempog.analysis.find_objects import find_objects
    from tempog.analysis.learn_area import learn_area
    from tempog.store.saved_map import open_map

    try:
        give_up_s = time.monotonic() + COMMIT_WAIT_S
        while True:
            saved = open_map(path)
            if saved.n_scans and int(saved.stamps_ns[-1]) >= question.until_ns:
                break
            if time.monotonic() > give_up_s:
                return Answer(question, failure="the map on disk does not reach so far yet")
            time.sleep(POLL_S)
        started_s = time.perf_counter()
        history: History = saved
        if question.since_ns is not None and question.since_ns > int(saved.stamps_ns[0]):
            history = saved.window(question.since_ns / 1e9)
        if question.found is None or question.area is None or question.ids is None:
            found = without_history(find_objects(history))
            return Answer(question, found, took_s=time.perf_counter() - started_s)
        found, learned, ids = learn_area(question.found, history, question.area, question.ids)
        return Answer(question, without_history(found), learned, ids, time.perf_counter() - started_s)
    except (TempogError, OSError, MemoryError) as error:
        return Answer(question, failure=str(error))


def main() -> None:
    """Answer questions from standard input until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    path, inward, outward = Path(sys.argv[1]), sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr  # nothing but answers goes to the parent
    while True:
        try:
            question = pickle.load(inward)
        except EOFError:
            return
        pickle.dump(answered(path, question), outward)
        outward.flush()
