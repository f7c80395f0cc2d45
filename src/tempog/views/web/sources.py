"""Where the viewer's map comes from: a map on disk that may grow, one in memory, or one that is being mapped."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from tempog._version import __version__
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.tracker import ObjectTracker
from tempog.errors import MapError
from tempog.grid.history import History
from tempog.scans.scan import Scan
from tempog.store.live_map import LiveMap
from tempog.store.manifest import MANIFEST, Session
from tempog.store.saved_map import SavedMap, open_map


class Now(NamedTuple):
    """What is known of the present, without looking into the history.

    Attributes
    ----------
    stamp_ns : int
    objects : dict
        By the number of each known object, the place it is in; None if unknown.
    points_map : list of (x, y), metres
        Cells that something on the move is in.
    """

    stamp_ns: int
    objects: dict[int, int | None]
    points_map: list[tuple[float, float]]


class Choice(NamedTuple):
    """Which part of a map on disk is shown."""

    path: Path
    sessions: list[str] | None = None
    robots: list[str] | None = None

    def open(self) -> SavedMap:
        """The map as it is now."""
        return open_map(self.path, sessions=self.sessions, robots=self.robots)


class Source(Protocol):
    """A map to show, which may grow by later scans.

    Attributes
    ----------
    name : str
    live : bool
        Whether somebody is mapping it in this process.
    lock : threading.RLock
        Held while `history` is asked. Questions that take long are put to `apart`.
    choice : Choice, optional
        Where the map lies on disk, so that a process of its own can analyse it.
    """

    name: str
    live: bool
    lock: threading.RLock
    choice: Choice | None

    @property
    def version(self) -> str:
        """Another one whenever the map grew, as `look` found it."""

    def look(self) -> bool:
        """See whether the map grew; whether it did."""

    def history(self) -> History:
        """The map of this version."""

    def apart(self) -> History:
        """The same or an earlier one for questions that take long; needs no lock, and is forgotten afterwards."""

    def sessions(self) -> Sequence[Session]:
        """The runs that made the map."""

    def found(self) -> FoundObjects | None:
        """The objects, if the source knows them by itself."""

    def now(self) -> Now | None:
        """The present, if the source knows more of it than the history."""


class SavedSource:
    """A map on disk; it is opened again when it grew. See `Source`."""

    live = False

    def __init__(
        self, path: str | os.PathLike[str], sessions: list[str] | None = None, robots: list[str] | None = None
    ) -> None:
        self.choice: Choice | None = Choice(Path(path), sessions, robots)
        self._choice = Choice(Path(path), sessions, robots)
        self.name = Path(path).resolve().stem
        self.lock = threading.RLock()
        self._seen: tuple[int, int, int] | None = None
        self.trouble: MapError | None = None
        self._saved, self._version = self._opened()

    @property
    def version(self) -> str:
        """A hash of map.json and of the choice."""
        return self._version

    @property
    def saved(self) -> SavedMap:
        """The map as it was opened last."""
        return self._saved

    def look(self) -> bool:
        """Open the map again if map.json changed; a map that cannot be opened now stays as it was."""
        try:
            if self._stat() == self._seen:
                return False
            saved, version = self._opened()
        except (MapError, OSError) as error:
            self.trouble = error if isinstance(error, MapError) else MapError(f"{self._choice.path}: {error}")
            return False
        grew = version != self._version
        with self.lock:
            self._saved, self._version = saved, version
        self.trouble = None
        return grew

    def history(self) -> History:
        """The map as it was opened last."""
        return self._saved

    def apart(self) -> History:
        """Opened once more."""
        return self._choice.open()

    def sessions(self) -> Sequence[Session]:
        """Those that were asked for."""
        return self._saved.sessions

    def found(self) -> FoundObjects | None:
        """Nothing: they are yet to be found."""
        return None

    def now(self) -> Now | None:
        """Nothing beyond the history."""
        return None

    def _stat(self) -> tuple[int, int, int]:
        seen = (self._choice.path / MANIFEST).stat()
        return seen.st_mtime_ns, seen.st_size, seen.st_ino

    def _opened(self) -> tuple[SavedMap, str]:
        try:  # before it is opened: what changes meanwhile is seen by the next look
            seen, content = self._stat(), (self._choice.path / MANIFEST).read_bytes()
        except OSError:  # opening it says what is wrong
            seen, content = None, b""
        saved = self._choice.open()
        self._seen = seen
        chosen = repr((self._choice.sessions, self._choice.robots, __version__)).encode()
        return saved, hashlib.sha256(content + chosen).hexdigest()[:16]


class HistorySource:
    """A history in memory that nobody adds to. See `Source`."""

    live = False

    def __init__(self, history: History, name: str = "map", found: FoundObjects | None = None) -> None:
        self.name = name
        self.choice: Choice | None = None
        self.lock = threading.RLock()
        self._history, self._found = history, found
        self.version = os.urandom(8).hex()

    def look(self) -> bool:
        """It does not grow."""
        return False

    def history(self) -> History:
        """The history."""
        return self._history

    def apart(self) -> History:
        """The history: who asks takes turns."""
        return self._history

    def sessions(self) -> Sequence[Session]:
        """None are known."""
        return []

    def found(self) -> FoundObjects | None:
        """What was given."""
        return self._found

    def now(self) -> Now | None:
        """Nothing beyond the history."""
        return None


class LiveSource:
    """A map that is being mapped in this process, and what is followed in it. See `Source`.

    Give it each scan instead of giving it to the map and the tracker, from any thread:

    >>> import tempfile
    >>> from tempog import LiveMap
    >>> from tempog.simulation import corridor, simulate
    >>> with LiveMap(tempfile.mkdtemp() + "/site.tempog") as live:
    ...     source = LiveSource(live)
    ...     for scan in simulate(corridor(), duration_s=2.0).scans:
    ...         events = source.integrate(scan)
    ...     source.look(), source.history().n_scans
    (True, 20)

    Who maps by other means holds `lock` whenever the map or the tracker changes, and may exchange `tracker` then.

    Parameters
    ----------
    live : LiveMap
    tracker : ObjectTracker, optional
    """

    live = True

    def __init__(self, live: LiveMap, tracker: ObjectTracker | None = None) -> None:
        self.map, self.tracker = live, tracker
        self.name = live.path.resolve().stem
        self.choice: Choice | None = Choice(live.path)
        self.lock = threading.RLock()
        self._run = os.urandom(4).hex()
        self._n_scans = live.n_scans

    @property
    def version(self) -> str:
        """Of this process, the number of scans."""
        return f"{self._run}-{self._n_scans}"

    def integrate(self, scan: Scan) -> list[Any]:
        """Give a scan to the map and the tracker; returns what the tracker says (`PlaceEvent`)."""
        with self.lock:
            self.map.integrate(scan)
            return list(self.tracker.update(scan)) if self.tracker is not None else []

    def look(self) -> bool:
        """See whether there were scans."""
        with self.lock:
            n_scans = self.map.n_scans
            grew = n_scans != self._n_scans
            self._n_scans = n_scans
        return grew

    def history(self) -> History:
        """The map itself."""
        return self.map

    def apart(self) -> History:
        """What of it was committed to disk."""
        return open_map(self.map.path)

    def sessions(self) -> Sequence[Session]:
        """Those that were committed."""
        return open_map(self.map.path).sessions

    def found(self) -> FoundObjects | None:
        """What the tracker follows."""
        with self.lock:
            return self.tracker.found if self.tracker is not None else None

    def now(self) -> Now | None:
        """What the tracker says after the last scan."""
        with self.lock:
            tracker = self.tracker
            if tracker is None or not self.map.n_scans:
                return None
            objects = {one.id: tracker.where(one.id) for one in tracker.found.objects}
            points = [(x, y) for x, y in tracker.high_dynamic.points_map.tolist()]
            return Now(int(self.map.stamps_ns[self.map.last_scan]), objects, points)
