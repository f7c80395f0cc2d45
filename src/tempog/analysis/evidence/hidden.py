"""Open leaves that are seen only while their door is open, and so look like walls: the paper's door D8."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.places import Place, measure
from tempog.analysis.evidence.states import CellStates
from tempog.methods import EvidenceConfig

LEAF_M = (0.6, 1.5)  # lengths of leaves
STRAIGHT_M = 0.04  # depth of a leaf's cells, as a standard deviation
BESIDE_M = 0.08  # cells this far from a line are on it: half a leaf's thickness and a cell
BEYOND_M = 0.2  # ... and behind its end, so that no slanted line cuts a wall short
SWINGS_RAD = (math.radians(30), math.radians(150))  # between a leaf's closed and its open place
STEP_RAD = math.radians(3)
LEAST_COVERED = 0.6  # of a leaf's length; a jamb hides the part at the hinge
MOST_BEYOND = 0.2  # of half a leaf's length behind its end: a wall would go on
SEEN_WHILE_CLOSED = 0.05  # share of its time; closed leaves move while they are looked at


class Hidden(NamedTuple):
    """A hypothesis: which place it belongs to, and the place where the leaf may stand when that is free."""

    of: int
    place: Place


def hidden_places(
    states: CellStates, places: Sequence[Place], alone: Sequence[int], settings: EvidenceConfig
) -> list[Hidden]:
    """For doors found in one place only: a leaf's length of wall that begins at an end of it and is seen only then.

    Nothing ever saw such a place free, so each is a hypothesis, to be marked so.
    """
    found = []
    for k in alone:
        if LEAF_M[0] <= places[k].size_m <= LEAF_M[1] and places[k].line.depth_m <= STRAIGHT_M:
            cells = _behind(states, places[k], settings)
            lines = sorted(_lines(states, cells, places[k]), key=lambda line: -line[0])
            if lines:
                found.append(Hidden(k, measure(states, np.sort(lines[0][1]), settings)))
    return found


def _behind(states: CellStates, place: Place, settings: EvidenceConfig) -> NDArray[np.int64]:
    """Cells around a place that were never seen free, and seen only while the place was."""
    reach = math.ceil(1.6 * place.size_m / states.resolution_m)
    around = states.around(place.cells, reach)
    evidence = states.evidence[around]
    around = around[(evidence[:, 0] < settings.least_evidence) & (evidence[:, 1] >= settings.least_evidence)]
    while_free, while_taken = (
        states.seconds_during(around, [period[:2] for period in place.periods if period.state == state])
        for state in ("free", "occupied")
    )
    kept = (while_free[:, 1] >= settings.least_stay_s) & (
        while_taken.sum(axis=1) <= SEEN_WHILE_CLOSED * while_free[:, 1]
    )
    return np.asarray(around[kept])


def _lines(states: CellStates, cells: NDArray[np.int64], place: Place) -> Iterator[tuple[float, NDArray[np.int64]]]:
    """Straight lines of a leaf's length from either end of a place: how much of it is covered, and by which cells."""
    if not len(cells):
        return
    points = states.points_map(cells)
    centred = place.points_map - place.points_map.mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, 1]
    along = centred @ axis
    length_m, step_m = place.size_m, states.resolution_m
    for hinge, tip in ((along.min(), along.max()), (along.max(), along.min())):
        start = place.points_map.mean(axis=0) + hinge * axis
        closed = math.atan2(*((tip - hinge) * axis)[::-1])
        for turn in np.arange(SWINGS_RAD[0], SWINGS_RAD[1] + 1e-9, STEP_RAD):
            for angle in (closed + turn, closed - turn):
                ahead = np.array([math.cos(angle), math.sin(angle)])
                r, off = (points - start) @ ahead, (points - start) @ np.array([-ahead[1], ahead[0]])
                beside = abs(off) <= BESIDE_M
                on_leaf = beside & (r > 0) & (r <= 1.1 * length_m)
                covered = len(np.unique((r[on_leaf] / step_m).astype(int))) * step_m / length_m
                beyond = (abs(off) <= BEYOND_M) & (r > 1.15 * length_m) & (r <= 1.65 * length_m)
                goes_on = len(np.unique((r[beyond] / step_m).astype(int))) * step_m / (0.5 * length_m)
                if covered >= LEAST_COVERED and goes_on <= MOST_BEYOND:
                    yield covered - float(abs(off[on_leaf]).mean()), cells[on_leaf]
