"""What changed between two moments: what appeared, vanished or moved, and what nobody can tell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.changed_cells import changed_cells, looks_at
from tempog.analysis.diff_file import DIFF_VERSION, change_entry, patch_entry
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.moved_objects import Move, moved_objects
from tempog.analysis.patches import Patch, find_patches, stands_out
from tempog.errors import ConfigError, MomentError, TimeError
from tempog.grid.history import History
from tempog.methods import FOR_S, JOIN_M, SMALLEST_M, SURFACE_M
from tempog.sensing.grid_spec import Extent
from tempog.times import NS_PER_S, Moment


class Areas(NamedTuple):
    """How much of the map can be compared, in square metres.

    Attributes
    ----------
    compared_m2 : float
        Known at both moments, and looked at in between.
    not_seen_again_m2 : float
        Known at the first moment, and not looked at since, or longer before the second one than `hold`: whether it
        changed, nobody knows.
    first_seen_m2 : float
        Known at the second moment only: what was there before, nobody knows.
    """

    compared_m2: float
    not_seen_again_m2: float
    first_seen_m2: float


@dataclass(frozen=True, eq=False)
class MapDiff:
    """What changed between two moments.

    Attributes
    ----------
    history : History
    found : FoundObjects
    before_ns, after_ns : int
        The two moments.
    hold_s, for_s, smallest_m, join_m, surface_m : float
        The settings, see `map_diff`.
    moved : tuple of Move
        By the objects' ids.
    appeared, vanished : tuple of Patch
        What is of no known object's move, the largest first.
    brief : tuple of Patch
        What would be among them, had it been watched there for `for_s`: people, and what was only glimpsed.
    areas : Areas
    not_seen_again : (n_rows, n_cols) bool
        The cells of `Areas.not_seen_again_m2`.
    extent : Extent
        Where `not_seen_again` lies. A grid that is being mapped may reach farther by now.
    objects_not_seen_again : tuple of int
        Ids of objects that were in a clear state at the first moment and were not seen since.
    """

    history: History
    found: FoundObjects
    before_ns: int
    after_ns: int
    hold_s: float
    for_s: float
    smallest_m: float
    join_m: float
    surface_m: float
    moved: tuple[Move, ...]
    appeared: tuple[Patch, ...]
    vanished: tuple[Patch, ...]
    brief: tuple[Patch, ...]
    areas: Areas
    not_seen_again: NDArray[np.bool_]
    extent: Extent
    objects_not_seen_again: tuple[int, ...]

    @property
    def changes(self) -> tuple[Move | Patch, ...]:
        """All of them: moved, appeared, vanished. Texts and pictures number them in this order, from 1."""
        return (*self.moved, *self.appeared, *self.vanished)

    def document(self) -> dict[str, Any]:
        """All of it as the schema ``tempog/schemas/diff-1.json`` has it, ready for `json.dumps`."""
        return {
            "format": "tempog-diff",
            "version": DIFF_VERSION,
            "resolution_m": self.history.tiles.spec.resolution_m,
            "before_s": self.before_ns / NS_PER_S,
            "after_s": self.after_ns / NS_PER_S,
            "method": self.found.method,
            "settings": {
                "hold_s": None if self.hold_s == math.inf else self.hold_s,
                "for_s": self.for_s,
                "smallest_m": self.smallest_m,
                "join_m": self.join_m,
                "surface_m": self.surface_m,
            },
            "changes": [change_entry(k + 1, change) for k, change in enumerate(self.changes)],
            "brief": [patch_entry(patch) for patch in self.brief],
            "areas": self.areas._asdict(),
            "objects_not_seen_again": list(self.objects_not_seen_again),
        }


def map_diff(
    history: History,
    t1: Moment,
    t2: Moment,
    *,
    found: FoundObjects | None = None,
    hold: float = math.inf,
    for_s: float = FOR_S,
    smallest_m: float = SMALLEST_M,
    join_m: float = JOIN_M,
    surface_m: float = SURFACE_M,
) -> MapDiff:
    """What appeared, vanished or moved between two moments, and what nobody can tell.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either. All of it counts, what was seen after `t2` too: for how long a
        thing stood there, and which objects there are.
    t1, t2 : moments, see `History.at`
    found : FoundObjects, optional
        The known objects of `history`. Default: those of `find_objects`.
    hold : float, seconds
        How old the last look may be at each moment; by default the last known state counts however old.
    for_s : float, seconds
        What was watched for a shorter time while it was there, in one pass or several, is `MapDiff.brief`: somebody
        who waits is no change of the map. Where nobody walks about, 1 or 2 will do.
    smallest_m : float, metres
        Patches that reach less far, corner to corner, are dropped.
    join_m : float, metres
        Cells this close are of one patch.
    surface_m : float, metres
        What is this close to something occupied at the other moment is the same surface, seen displaced.

    Returns
    -------
    MapDiff

    Raises
    ------
    TimeError
        A moment outside the history's period, or an empty history.
    MomentError
        What is no moment, or `t2` before `t1`.
    ConfigError
        A setting that cannot work.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor()).scans)
    >>> diff = map_diff(grid, "+66", "+100")
    >>> [(move.one.id, move.before.configuration, move.after.configuration, move.n_moves) for move in diff.moved]
    [(1, 2, 1, 1)]
    >>> len(diff.appeared), len(diff.vanished)
    (0, 0)
    """
    for name, value in (("for_s", for_s), ("smallest_m", smallest_m), ("join_m", join_m), ("surface_m", surface_m)):
        if not 0 <= value < math.inf:
            raise ConfigError(f"{name} = {value!r} cannot work; wanted a number, 0 or more")
    before_ns, after_ns = two_moments(history, t1, t2)
    looks = looks_at(history, before_ns, after_ns, hold)
    known = find_objects(history) if found is None else found
    moved, unseen = moved_objects(known.objects, before_ns, after_ns, hold)
    changed = changed_cells(history, before_ns, after_ns, looks)
    changed = changed.chosen(stands_out(history, known, moved, changed, looks, surface_m))
    lasting = changed.watched_s >= for_s
    grouped = [
        [
            patch
            for kind in (changed.appeared, ~changed.appeared)
            for patch in find_patches(
                history, known, changed.chosen(which & (changed.appeared == kind)), smallest_m, join_m
            )
        ]
        for which in (lasting, ~lasting)
    ]
    cell_m2 = history.tiles.spec.resolution_m**2
    not_seen_again = looks.known_before & ~looks.compared
    return MapDiff(
        history=history,
        found=known,
        before_ns=before_ns,
        after_ns=after_ns,
        hold_s=hold,
        for_s=for_s,
        smallest_m=smallest_m,
        join_m=join_m,
        surface_m=surface_m,
        moved=tuple(moved),
        appeared=tuple(patch for patch in grouped[0] if patch.kind == "appeared"),
        vanished=tuple(patch for patch in grouped[0] if patch.kind == "vanished"),
        brief=tuple(grouped[1]),
        areas=Areas(
            int(looks.compared.sum()) * cell_m2,
            int(not_seen_again.sum()) * cell_m2,
            int((looks.known_after & ~looks.known_before).sum()) * cell_m2,
        ),
        not_seen_again=history.tiles.to_dense(not_seen_again, False),
        extent=history.extent,
        objects_not_seen_again=tuple(unseen),
    )


def two_moments(history: History, t1: Moment, t2: Moment) -> tuple[int, int]:
    """Two moments in nanoseconds, the earlier one first; errors unless both lie within the history's period."""
    history.require_scans()
    stamps = [history.parse_moment(moment) for moment in (t1, t2)]
    if stamps[0] > stamps[1]:
        first, second = (history.format_moment(stamp) for stamp in stamps)
        raise MomentError(f"the first moment, {first}, comes after the second, {second}; exchange the two")
    begin, end = (int(history.stamps_ns[scan]) for scan in (history.first_scan, history.last_scan))
    for stamp in stamps:
        if not begin <= stamp <= end:
            raise TimeError(
                f"nothing is known of {history.format_moment(stamp)}: the scans run from"
                f" {history.format_moment(begin)} to {history.format_moment(end)}; choose moments in between"
            )
    return stamps[0], stamps[1]
