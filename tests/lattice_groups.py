"""Groups of cells on a lattice, what was seen of them, and the same as the method ``evidence`` takes it.

Groups lie anywhere on the lattice for the fast code, and about its origin for the oracle: where that is says nothing.
"""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st

from oracle import evidence as oracle_evidence
from tempog.analysis.evidence import places
from tempog.analysis.evidence.courses import Courses, HeldCourses
from tempog.analysis.evidence.states import Alike, CellStates

LOOK_NS = 100_000_000
RESOLUTIONS = st.sampled_from([0.05, 0.1])
SHIFTS = st.tuples(st.integers(-300, 300), st.integers(-300, 300))


@st.composite
def bars(draw: st.DrawFn) -> list[tuple[int, int]]:
    """Cells along a line, some of them missing: a face, a leaf, the side of a box."""
    row, col = draw(st.integers(-4, 4)), draw(st.integers(-4, 4))
    turn = math.radians(draw(st.sampled_from([0, 0, 0, 20, 45, 70, 90, 90, 90, 115, 135, 160])))
    length, thick = draw(st.integers(2, 14)), draw(st.sampled_from([1, 1, 1, 2]))
    gaps = draw(st.sets(st.integers(0, length - 1), max_size=3))
    cells = set()
    for r in range(length):
        for off in range(thick):
            y, x = r * math.sin(turn) + off * math.cos(turn), r * math.cos(turn) - off * math.sin(turn)
            if r not in gaps or r in (0, length - 1):
                cells.add((row + round(y), col + round(x)))
    return sorted(cells)


@st.composite
def series(draw: st.DrawFn) -> list[tuple[int, int, bool]]:
    """What was seen of a cell: periods in time order, some with gaps between."""
    t, found = 0, []
    steps = st.tuples(st.sampled_from([0, 0, 0, 30]), st.sampled_from([1, 5, 13, 40, 250]), st.booleans())
    for gap, length, state in draw(st.lists(steps, min_size=1, max_size=7)):
        found.append(((t + gap) * LOOK_NS, (t + gap + length) * LOOK_NS, state))
        t += gap + length
    return found


def shifted(cells, shift):
    return [(row + shift[0], col + shift[1]) for row, col in cells]


def points_of(cells, resolution_m, shift=(0, 0)):
    """Centres, as `CellStates.points_map` has them."""
    rows, cols = np.array(shifted(cells, shift), dtype=np.int64).T
    return np.stack([cols + 0.5, rows + 0.5], axis=-1) * resolution_m


def cell_states_of(smoothed, measured, resolution_m, worth_s, shift) -> CellStates:
    """States of cells, each with a course as smoothed and one as measured, of the same periods."""
    cells = sorted(smoothed)
    flat = [period for cell in cells for period in smoothed[cell]]
    offsets = np.cumsum([0, *(len(smoothed[cell]) for cell in cells)]).astype(np.int64)
    start, stop = (np.array([period[k] for period in flat], dtype=np.int64) for k in (0, 1))
    state = np.array([period[2] for period in flat], dtype=np.uint8)
    hit = np.array([period[2] for cell in cells for period in measured[cell]], dtype=np.uint8)
    rows, cols = (np.array([cell[k] for cell in shifted(cells, shift)], dtype=np.int64) for k in (0, 1))
    n = len(cells)
    evidence, seconds = (
        np.array([oracle_evidence.state_evidence(smoothed[cell], worth_s)[k] for cell in cells], dtype=np.float64)
        for k in (0, 1)
    )
    alike = Alike(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    courses = HeldCourses(Courses(offsets, start, stop, hit, state))
    numbers, blocks = np.arange(n, dtype=np.int32), np.zeros(n, dtype=np.int64)
    content, by_view = np.zeros(n, np.uint64), np.zeros(n, np.bool_)
    return CellStates(rows, cols, resolution_m, numbers, evidence, seconds, blocks, alike, courses, content, by_view)


def indices(cells, smoothed):
    """Which of the cells, in `CellStates`."""
    number = {cell: k for k, cell in enumerate(sorted(smoothed))}
    return np.array(sorted(number[cell] for cell in cells), dtype=np.int64)


def place_of(cells, resolution_m, shift=(0, 0), log_odds=0.0, first=0) -> places.Place:
    points = points_of(cells, resolution_m, shift)
    return places.Place(np.arange(first, first + len(cells)), points, (), (), resolution_m, log_odds)
