"""What is worked out for each block of a map by itself, and joined at the blocks' borders.

A block is a square of tiles. What it says comes from its own cells and those within `reach_m` of its border, so that
blocks can be worked out in any order and anywhere: `look_at_block` takes arrays and gives arrays.
"""

from __future__ import annotations

from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.courses import HELD_PERIODS, BlockCourses, Courses, HeldCourses, smoothed_courses
from tempog.analysis.evidence.grouping import likelihood_ratios, pairs_within
from tempog.analysis.evidence.kernels import add_content, joint_evidence, state_evidence
from tempog.analysis.evidence.known import Known, digest
from tempog.analysis.evidence.states import Alike, CellStates, within
from tempog.analysis.evidence.threads import in_threads
from tempog.analysis.evidence.views import Scans, explained_by_view
from tempog.analysis.series import Intervals, ever_occupied
from tempog.grid.history import History
from tempog.methods import EvidenceConfig
from tempog.sensing.grid_spec import GridSpec
from tempog.sensing.tiles import TILE

if TYPE_CHECKING:
    from tempog.analysis.evidence.elsewhere import Elsewhere

BLOCK_TILES = 16  # along a side: 6.4 m of 0.05 m cells; larger ones gain little, as their border is short already


class BlockEvidence(NamedTuple):
    """What the cells of one block say.

    Attributes
    ----------
    n_periods : (n,) int64
        Of each cell.
    evidence, seconds : (n, 2) float64
    by_view : (n,) bool
        As in `CellStates`.
    left, right : (n_pairs, 2) int64
        Row and col of pairs of cells whose left one is in the block, while the right one may be beyond its border.
    weight : (n_pairs,) float64
        As in `Alike`.
    """

    n_periods: NDArray[np.int64]
    evidence: NDArray[np.float64]
    seconds: NDArray[np.float64]
    by_view: NDArray[np.bool_]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    weight: NDArray[np.float64]


def look_at_block(
    courses: Courses,
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    own: NDArray[np.bool_],
    resolution_m: float,
    scans: Scans,
    settings: EvidenceConfig,
) -> BlockEvidence:
    """Work out what a block says.

    Parameters
    ----------
    courses : Courses
        Of the block's cells, and of those up to `reach_m` beside and above it.
    rows, cols : (n,) int64
        Of these cells, sorted by row, then column.
    own : (n,) bool
        Which of them are the block's.
    scans : Scans
        All of the history.
    """
    evidence, seconds = np.zeros((2, len(rows), 2))
    state_evidence(*courses.smoothed, settings.worth_s, evidence, seconds)
    changing = np.flatnonzero((evidence >= settings.least_evidence).all(axis=1))
    left, right = pairs_within(rows[changing], cols[changing], reach_in_cells(resolution_m, settings))
    left, right = changing[left], changing[right]
    left, right = left[own[left]], right[own[left]]
    joint = np.zeros((len(left), 4))
    joint_evidence(*courses.smoothed, left, right, settings.worth_s, joint)
    places = np.stack([rows, cols], axis=-1)
    points_map = GridSpec(resolution_m).centres(rows[own], cols[own])
    return BlockEvidence(
        np.diff(courses.offsets)[own],
        evidence[own],
        seconds[own],
        explained_by_view(courses, np.flatnonzero(own), points_map, scans, settings),
        places[left],
        places[right],
        likelihood_ratios(joint),
    )


def reach_in_cells(resolution_m: float, settings: EvidenceConfig) -> int:
    """How many cells apart cells are compared."""
    return max(1, round(settings.reach_m / resolution_m))


def cell_states(
    history: History,
    settings: EvidenceConfig,
    known: Known | None = None,
    block_tiles: int = BLOCK_TILES,
    look_ns: int | None = None,
    elsewhere: Elsewhere | None = None,
) -> CellStates:
    """States of every cell that was ever hit, block by block; those blocks anew that differ from what is known."""
    intervals = elsewhere.intervals if elsewhere else Intervals.of(history, look_ns)
    content = cell_content(history) if known is not None else np.zeros(history.tiles.n_cells, dtype=np.uint64)
    layout = _lay_out(history, content, block_tiles * TILE, settings)
    held: dict[int, Courses] = {}
    if elsewhere is not None:
        found = elsewhere.look_at_blocks([partial(layout.sent, block) for block in range(len(layout.members))])
    else:
        scans = Scans(intervals.stamps_ns, history.poses, intervals.look_ns)
        found = _look_at_blocks(layout, intervals, scans, settings, known, held)

    def load(block: int) -> Courses:
        return smoothed_courses(intervals, layout.numbers[layout.members[block]], settings)

    n = len(layout.rows)
    n_periods, place_of = np.zeros((2, n), dtype=np.int64)
    evidence, seconds = np.zeros((2, n, 2))
    by_view = np.zeros(n, dtype=np.bool_)
    for one, mine in zip(found, layout.members, strict=True):
        n_periods[mine], evidence[mine], seconds[mine], by_view[mine] = one[:4]
        place_of[mine] = np.arange(len(mine))
    return CellStates(
        layout.rows,
        layout.cols,
        layout.resolution_m,
        layout.numbers,
        evidence,
        seconds,
        layout.block_of,
        _alike(found, layout.rows, layout.cols),
        BlockCourses(layout.block_of, place_of, n_periods, load, held),
        layout.content,
        by_view,
    )


class _Layout(NamedTuple):
    """Cells sorted by row and col, as in `CellStates`, and the blocks they are in.

    Blocks are numbered by row and column; `members` holds the cells of each, `side` is theirs in cells, `reach` how
    far beyond its border a block looks.
    """

    numbers: NDArray[np.int32]
    rows: NDArray[np.int64]
    cols: NDArray[np.int64]
    content: NDArray[np.uint64]
    resolution_m: float
    block_of: NDArray[np.int64]
    members: list[NDArray[np.int64]]
    side: int
    reach: int

    def area(self, block: int) -> NDArray[np.int64]:
        """The block's cells and those they are paired with, beside and above."""
        row, col = (int(of[self.members[block][0]]) // self.side * self.side for of in (self.rows, self.cols))
        last_row, last_col = row + self.side - 1 + self.reach, col + self.side - 1 + self.reach
        return within(self.rows, self.cols, row, last_row, col - self.reach, last_col)

    def sent(self, block: int) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """The cells of the block's area: their numbers, rows and columns, and which are the block's own."""
        cells = self.area(block)
        return self.numbers[cells], self.rows[cells], self.cols[cells], self.block_of[cells] == block

    def key(self, block: int) -> bytes:
        """A name for what was measured in the block's area."""
        cells = self.area(block)
        return digest("block", self.block_of[cells] == block, self.rows[cells], self.cols[cells], self.content[cells])


def _lay_out(history: History, content: NDArray[np.uint64], side: int, settings: EvidenceConfig) -> _Layout:
    numbers = np.flatnonzero(ever_occupied(history)).astype(np.int32)
    rows, cols = (places.astype(np.int64) for places in history.tiles.rows_cols(numbers))
    order = np.lexsort((cols, rows))
    numbers, rows, cols = numbers[order], rows[order], cols[order]
    across = cols // side - cols.min(initial=0) // side
    _, block_of = np.unique(rows // side * (across.max(initial=0) + 1) + across, return_inverse=True)
    order = np.argsort(block_of, kind="stable")
    bounds = np.flatnonzero(np.diff(block_of[order])) + 1
    members = np.split(order, bounds) if len(order) else []
    resolution_m = history.tiles.spec.resolution_m
    reach = reach_in_cells(resolution_m, settings)
    places = (numbers, rows, cols, content[numbers], resolution_m)
    return _Layout(*places, block_of.astype(np.int64), members, side, reach)


def _look_at_blocks(
    layout: _Layout,
    intervals: Intervals,
    scans: Scans,
    settings: EvidenceConfig,
    known: Known | None,
    held: dict[int, Courses],
) -> list[BlockEvidence]:
    """What each block says, as it is known or worked out now; courses that were are put into `held`, if they fit."""
    lock, n_held = Lock(), 0

    def look(block: int) -> BlockEvidence:
        nonlocal n_held
        cells = layout.area(block)
        courses = smoothed_courses(intervals, layout.numbers[cells], settings)
        own = layout.block_of[cells] == block
        n_periods = int(np.diff(courses.offsets)[own].sum())
        with lock:
            fits = n_held + n_periods <= HELD_PERIODS
            n_held += n_periods * fits
        if fits:
            held[block] = HeldCourses(courses).of(np.flatnonzero(own))
        places = (layout.rows[cells], layout.cols[cells], own)
        return look_at_block(courses, *places, layout.resolution_m, scans, settings)

    blocks = range(len(layout.members))
    if known is None:
        return in_threads(look, blocks)
    found = {}
    keys = [layout.key(block) for block in blocks]
    for block in blocks:
        is_known, answer = known.recall(keys[block])
        if is_known:
            found[block] = answer
    anew = [block for block in blocks if block not in found]
    for block, answer in zip(anew, in_threads(look, anew), strict=True):
        found[block] = answer
        known.keep(keys[block], answer)
    return [found[block] for block in blocks]


def cell_content(history: History) -> NDArray[np.uint64]:
    """Per cell number, 64 bits that differ if anything else was measured in the cell within the period.

    Or if it was measured from elsewhere: by scans at other moments or places between a first and a last look.
    """
    content = np.zeros(history.tiles.n_cells, dtype=np.uint64)
    sums = _scan_sums(history.stamps_ns, history.poses)
    for runs in history.runs():
        bits = np.ascontiguousarray(runs.value).view(np.uint32)
        period = (history.first_scan, history.last_scan, history.stamps_ns)
        add_content(runs.cells, runs.offsets, runs.first, runs.last, bits, *period, *sums, content)
    return content


def _scan_sums(
    stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]
) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """For each scan, 64 bits of all scans before its stamp, and of all up to it: when, and where the laser was."""
    mixed = stamps_ns.astype(np.uint64)
    for coordinate in poses[:, :2].T:
        mixed = (mixed ^ np.ascontiguousarray(coordinate).view(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
        mixed ^= mixed >> np.uint64(31)
        mixed *= np.uint64(0x94D049BB133111EB)
        mixed ^= mixed >> np.uint64(29)
    sums = np.append(np.zeros(1, np.uint64), np.cumsum(mixed, dtype=np.uint64))
    return sums[np.searchsorted(stamps_ns, stamps_ns)], sums[np.searchsorted(stamps_ns, stamps_ns, side="right")]


def _alike(blocks: list[BlockEvidence], rows: NDArray[np.int64], cols: NDArray[np.int64]) -> Alike:
    """The pairs of all blocks, with cells by their indices."""
    if not blocks:
        return Alike(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    width = int(cols.max() - cols.min()) + 1
    key = (rows - rows[0]) * width + (cols - cols.min())
    left, right = (
        np.searchsorted(key, (places[:, 0] - rows[0]) * width + (places[:, 1] - cols.min()))
        for places in (np.concatenate([block.left for block in blocks]), np.concatenate([b.right for b in blocks]))
    )
    return Alike(left, right, np.concatenate([block.weight for block in blocks]))
