"""What is worked out for each block of a map by itself, and joined at the blocks' borders.

A block is a square of tiles. What it says comes from its own cells and those within `reach_m` of its border, so that
blocks can be worked out in any order and anywhere: `look_at_block` takes arrays and gives arrays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.courses import BlockCourses, Courses, smoothed_courses
from tempog.analysis.evidence.grouping import likelihood_ratios, pairs_within
from tempog.analysis.evidence.kernels import add_content, joint_evidence, state_evidence
from tempog.analysis.evidence.known import Known, digest
from tempog.analysis.evidence.states import Alike, CellStates, within
from tempog.analysis.evidence.threads import in_threads
from tempog.analysis.series import Intervals, ever_occupied
from tempog.grid.history import History
from tempog.methods import EvidenceConfig
from tempog.sensing.tiles import TILE

BLOCK_TILES = 16  # along a side: 6.4 m of 0.05 m cells; larger ones gain little, as their border is short already


class BlockEvidence(NamedTuple):
    """What the cells of one block say.

    Attributes
    ----------
    n_periods : (n,) int64
        Of each cell.
    evidence, seconds : (n, 2) float64
        As in `CellStates`.
    left, right : (n_pairs, 2) int64
        Row and col of pairs of cells whose left one is in the block, while the right one may be beyond its border.
    weight : (n_pairs,) float64
        As in `Alike`.
    """

    n_periods: NDArray[np.int64]
    evidence: NDArray[np.float64]
    seconds: NDArray[np.float64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    weight: NDArray[np.float64]


def look_at_block(
    courses: Courses,
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    own: NDArray[np.bool_],
    resolution_m: float,
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
    return BlockEvidence(
        np.diff(courses.offsets)[own],
        evidence[own],
        seconds[own],
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
) -> CellStates:
    """States of every cell that was ever hit, block by block; those blocks anew that differ from what is known."""
    intervals = Intervals.of(history, look_ns)
    numbers = np.flatnonzero(ever_occupied(history)).astype(np.int32)
    rows, cols = (places.astype(np.int64) for places in history.tiles.rows_cols(numbers))
    order = np.lexsort((cols, rows))
    numbers, rows, cols = numbers[order], rows[order], cols[order]
    content = np.zeros(len(numbers), dtype=np.uint64)
    if known is not None:
        content = cell_content(history)[numbers]
    block_of, members = _blocks(rows, cols, block_tiles * TILE)
    resolution_m = history.tiles.spec.resolution_m
    reach = reach_in_cells(resolution_m, settings)

    def area(block: int) -> NDArray[np.int64]:
        """The block's cells and those its cells are paired with."""
        side = block_tiles * TILE
        row, col = (int(of[members[block][0]]) // side * side for of in (rows, cols))
        return within(rows, cols, row, row + side - 1 + reach, col - reach, col + side - 1 + reach)

    def look(block: int) -> BlockEvidence:
        cells = area(block)
        courses = smoothed_courses(intervals, numbers[cells], settings)
        return look_at_block(courses, rows[cells], cols[cells], block_of[cells] == block, resolution_m, settings)

    found: dict[int, BlockEvidence] = {}
    keys: dict[int, bytes] = {}
    if known is not None:
        for block in range(len(members)):
            cells = area(block)
            keys[block] = digest("block", block_of[cells] == block, rows[cells], cols[cells], content[cells])
            is_known, answer = known.recall(keys[block])
            if is_known:
                found[block] = answer
    anew = [block for block in range(len(members)) if block not in found]
    for block, answer in zip(anew, in_threads(look, anew), strict=True):
        found[block] = answer
        if known is not None:
            known.keep(keys[block], answer)

    def load(block: int) -> Courses:
        return smoothed_courses(intervals, numbers[members[block]], settings)

    n_periods = np.zeros(len(rows), dtype=np.int64)
    evidence, seconds = np.zeros((2, len(rows), 2))
    place_of = np.zeros(len(rows), dtype=np.int64)
    for block, mine in enumerate(members):
        n_periods[mine], evidence[mine], seconds[mine] = found[block][:3]
        place_of[mine] = np.arange(len(mine))
    alike = _alike([found[block] for block in range(len(members))], rows, cols)
    courses = BlockCourses(block_of, place_of, n_periods, load)
    return CellStates(rows, cols, resolution_m, numbers, evidence, seconds, block_of, alike, courses, content)


def cell_content(history: History) -> NDArray[np.uint64]:
    """Per cell number, 64 bits that differ if anything else was measured in the cell within the period."""
    content = np.zeros(history.tiles.n_cells, dtype=np.uint64)
    for runs in history.runs():
        bits = np.ascontiguousarray(runs.value).view(np.uint32)
        period = (history.first_scan, history.last_scan, history.stamps_ns)
        add_content(runs.cells, runs.offsets, runs.first, runs.last, bits, *period, content)
    return content


def _blocks(
    rows: NDArray[np.int64], cols: NDArray[np.int64], side: int
) -> tuple[NDArray[np.int64], list[NDArray[np.int64]]]:
    """Which block each cell is in, blocks numbered by row and column; and the cells of each."""
    across = cols // side - (cols.min(initial=0) // side)
    key = rows // side * (across.max(initial=0) + 1) + across
    _, block_of = np.unique(key, return_inverse=True)
    order = np.argsort(block_of, kind="stable")
    bounds = np.flatnonzero(np.diff(block_of[order])) + 1
    return block_of.astype(np.int64), list(np.split(order, bounds)) if len(order) else []


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
