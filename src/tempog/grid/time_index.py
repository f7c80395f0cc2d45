"""The paper's Time Index: a B+ tree of order n over the time intervals of one cell (section III.A, Fig. 1).

The grid keeps its intervals in sorted arrays, which are faster; this is the structure as published, small
enough to read, and what the arrays are tested against.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from typing import Generic, NamedTuple, TypeVar

from tempog.errors import ConfigError, TimeError

V = TypeVar("V")


class Entry(NamedTuple, Generic[V]):
    """A time interval and the value that held in it; None for a null interval."""

    start: int
    stop: int
    value: V | None


class _Leaf(Generic[V]):
    def __init__(self) -> None:
        self.entries: list[Entry[V]] = []
        self.next: _Leaf[V] | None = None

    @property
    def lowest(self) -> int:
        return self.entries[0].start


class _Inner(Generic[V]):
    def __init__(self, children: list[_Leaf[V] | _Inner[V]]) -> None:
        self.children = children
        # separators[i] is the first time below children[i + 1]
        self.separators = [child.lowest for child in children[1:]]

    @property
    def lowest(self) -> int:
        return self.children[0].lowest


class TimeIndex(Generic[V]):
    """Append-only index of values that were valid during time intervals.

    Parameters
    ----------
    order : int
        Most children of a node, and most entries of a leaf; 3 or more.

    Raises
    ------
    ConfigError
        An order below 3.

    Notes
    -----
    Time only moves forward, so entries are appended to the rightmost leaf and never deleted. A full node is
    closed and a new one opened to its right, where the next entries go: insertion is O(1) amortised, every
    closed node is full, and only the rightmost path may hold fewer than ``ceil(order / 2)`` children
    (footnote 2 and section III.A of the paper).

    Examples
    --------
    The tree of Fig. 1, of order 3, whose sixth interval is null:

    >>> index = TimeIndex(order=3)
    >>> borders = [0, 5, 10, 12, 20, 30, 35, 36, 44]
    >>> for k, (start, stop) in enumerate(zip(borders, borders[1:])):
    ...     index.append(start, stop, f"d{k + 1}" if k != 5 else None)
    >>> index.at(15), index.at(32), index.depth
    ('d4', None, 2)
    >>> [entry.value for entry in index.window(11, 21)]
    ['d3', 'd4', 'd5']
    """

    def __init__(self, order: int = 16) -> None:
        if order < 3:
            raise ConfigError(f"order = {order!r} cannot work; wanted 3 or more children per node")
        self.order = order
        self._first_leaf: _Leaf[V] = _Leaf()
        self._root: _Leaf[V] | _Inner[V] = self._first_leaf
        # The rightmost node of every level, leaf first.
        self._spine: list[_Leaf[V] | _Inner[V]] = [self._first_leaf]
        self._length = 0

    def append(self, start: int, stop: int, value: V | None) -> None:
        """Add the interval ``[start, stop]``.

        Raises
        ------
        TimeError
            It ends before it starts, or starts before the last one ends.
        """
        if stop < start:
            raise TimeError(f"interval [{start}, {stop}] ends before it starts")
        last = self.last
        if last is not None and start < last.stop:
            raise TimeError(f"interval [{start}, {stop}] starts before the last one ends, at {last.stop}")
        leaf = self._spine[0]
        assert isinstance(leaf, _Leaf)
        if len(leaf.entries) == self.order:
            full, leaf = leaf, _Leaf()
            full.next = leaf
            leaf.entries.append(Entry(start, stop, value))
            self._hang(leaf, level=0)
        else:
            leaf.entries.append(Entry(start, stop, value))
        self._length += 1

    def extend(self, stop: int) -> None:
        """Let the last interval end at `stop`; TimeError if there is none or it ends later already."""
        last = self.last
        if last is None or stop < last.stop:
            raise TimeError(f"no interval can be extended to {stop}; the last one is {last}")
        leaf = self._spine[0]
        assert isinstance(leaf, _Leaf)
        leaf.entries[-1] = Entry(last.start, stop, last.value)

    @property
    def last(self) -> Entry[V] | None:
        """The latest interval, or None."""
        leaf = self._spine[0]
        assert isinstance(leaf, _Leaf)
        return leaf.entries[-1] if leaf.entries else None

    @property
    def depth(self) -> int:
        """Levels of the tree; 1 when the root is a leaf."""
        return len(self._spine)

    def at(self, t: int) -> V | None:
        """The value at `t`; None where no interval holds it. At a shared border the later one counts."""
        leaf, k = self._find(t, bisect_right)
        return leaf.entries[k].value if k >= 0 and t <= leaf.entries[k].stop else None

    def window(self, t0: int, t1: int) -> Iterator[Entry[V]]:
        """All intervals that share a moment with ``[t0, t1]``, in order."""
        # Of the intervals that begin before t0 only the last can reach it.
        first_leaf, k = self._find(t0, bisect_left)
        leaf: _Leaf[V] | None = first_leaf
        k = max(k, 0)
        while leaf is not None:
            for entry in leaf.entries[k:]:
                if entry.start > t1:
                    return
                if entry.stop >= t0:
                    yield entry
            leaf, k = leaf.next, 0

    def __iter__(self) -> Iterator[Entry[V]]:
        """All intervals in order, along the linked leaves."""
        leaf: _Leaf[V] | None = self._first_leaf
        while leaf is not None:
            yield from leaf.entries
            leaf = leaf.next

    def __len__(self) -> int:
        return self._length

    def _find(self, t: int, bisect: Callable[[list[int], int], int]) -> tuple[_Leaf[V], int]:
        """Leaf and place of the last interval that starts before `t` (bisect_left) or by `t` (bisect_right).

        The place is -1 if there is none.
        """
        node = self._root
        while isinstance(node, _Inner):
            node = node.children[bisect(node.separators, t)]
        return node, bisect([entry.start for entry in node.entries], t) - 1

    def _hang(self, node: _Leaf[V] | _Inner[V], level: int) -> None:
        """Make `node` the rightmost of its level."""
        self._spine[level] = node
        if level + 1 == len(self._spine):
            self._root = _Inner([self._root, node])
            self._spine.append(self._root)
            return
        parent = self._spine[level + 1]
        assert isinstance(parent, _Inner)
        if len(parent.children) < self.order:
            parent.children.append(node)
            parent.separators.append(node.lowest)
        else:
            self._hang(_Inner([node]), level + 1)
