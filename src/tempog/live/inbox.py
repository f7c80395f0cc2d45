"""What waits between the threads that receive and the one that maps: bounded, and honest about what it drops."""

from __future__ import annotations

import threading
from collections import deque
from typing import NamedTuple

MOST_TRANSFORMS = 20_000  # messages; some minutes of them, so that only a stopped machine loses any


class Letter(NamedTuple):
    """A message as it came.

    Attributes
    ----------
    kind : str
        The topic it came by.
    raw : bytes
    """

    kind: str
    raw: bytes


class Inbox:
    """Messages in the order they came, transforms before scans: a scan cannot be placed without.

    Where scans come faster than they are mapped, the oldest that wait are dropped as a whole: the map then lags by
    no more than `most_scans`, and what it says of doors is about now.

    Parameters
    ----------
    most_scans : int
        That wait at a time.

    Attributes
    ----------
    n_dropped : int
        Scans that were.
    n_transforms_dropped : int
        Messages of transforms that were.

    Examples
    --------
    >>> inbox = Inbox(most_scans=2)
    >>> for k in range(3):
    ...     inbox.put_scan("scan", bytes([k]))
    >>> inbox.put_transforms("/tf", b"tf")
    >>> [letter.raw for letter in iter(lambda: inbox.get(0), None)], inbox.n_dropped
    ([b'tf', b'\\x01', b'\\x02'], 1)
    """

    def __init__(self, most_scans: int) -> None:
        self._scans: deque[Letter] = deque()
        self._transforms: deque[Letter] = deque()
        self._most_scans = most_scans
        self._ready = threading.Condition()
        self.n_dropped = self.n_transforms_dropped = 0

    def put_scan(self, topic: str, raw: bytes) -> None:
        """Add a scan."""
        with self._ready:
            self._scans.append(Letter(topic, raw))
            if len(self._scans) > self._most_scans:
                self._scans.popleft()
                self.n_dropped += 1
            self._ready.notify()

    def put_transforms(self, topic: str, raw: bytes) -> None:
        """Add a message of transforms."""
        with self._ready:
            self._transforms.append(Letter(topic, raw))
            if len(self._transforms) > MOST_TRANSFORMS:
                self._transforms.popleft()
                self.n_transforms_dropped += 1
            self._ready.notify()

    def get(self, wait_s: float) -> Letter | None:
        """The next message; None if there is none for so long."""
        with self._ready:
            if not (self._scans or self._transforms):
                self._ready.wait(wait_s)
            if self._transforms:
                return self._transforms.popleft()
            return self._scans.popleft() if self._scans else None

    def __len__(self) -> int:
        return len(self._scans)
