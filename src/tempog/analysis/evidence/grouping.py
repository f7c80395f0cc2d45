"""Cells that change together: a likelihood ratio for each pair nearby, then groups that agree as a whole."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.known import Known, digest, recalled
from tempog.analysis.evidence.merge_kernel import merge_groups
from tempog.analysis.evidence.states import CellStates
from tempog.analysis.evidence.threads import in_threads
from tempog.analysis.series_kernels import connect
from tempog.methods import EvidenceConfig

if TYPE_CHECKING:
    from tempog.analysis.evidence.elsewhere import Elsewhere

# Share of stretches in which two cells of one thing may differ: they are not seen by the same beam.
DISAGREEMENT = 0.1


def group_cells(
    states: CellStates, settings: EvidenceConfig, known: Known | None = None, elsewhere: Elsewhere | None = None
) -> list[NDArray[np.int64]]:
    """Groups of cells that were occupied and free together, each as sorted indices into `states`.

    Only cells take part for whose having been occupied, and free, there is some evidence. Two groups are merged if
    the pairs of neighbours across them agree in the mean, the most alike first: one similar neighbour alone does not
    chain a door to the people before it. Cells that no chain of pairs connects do not meet; so what is connected is
    merged by itself, with all else that begins in the same block.
    """
    changing = np.flatnonzero((states.evidence >= settings.least_evidence).all(axis=1))
    label = np.arange(len(states.rows))
    left, right, weight = states.alike
    part_of = np.arange(len(states.rows))
    connect(left, right, part_of)
    bundle = states.block_of[part_of[left]]
    order = np.argsort(bundle, kind="stable")
    bounds = np.flatnonzero(np.diff(bundle[order])) + 1
    bundles = [_Bundle.of(states, left[which], right[which], weight[which]) for which in np.split(order, bounds)]
    for one, merged in zip(bundles, _merge_each(bundles, settings, known, elsewhere), strict=True):
        label[one.cells] = one.cells[merged]
    label = label[changing]
    order = np.argsort(label, kind="stable")
    bounds = np.flatnonzero(np.diff(label[order])) + 1
    return [changing[group] for group in np.split(order, bounds)] if len(order) else []


class _Bundle(NamedTuple):
    """Cells, and pairs of them by their places among the cells."""

    cells: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    weight: NDArray[np.float64]
    places: tuple[NDArray[np.int64], NDArray[np.int64]]

    @classmethod
    def of(
        cls, states: CellStates, left: NDArray[np.int64], right: NDArray[np.int64], weight: NDArray[np.float64]
    ) -> _Bundle:
        cells, places = np.unique(np.concatenate([left, right]), return_inverse=True)
        left, right = np.split(places.astype(np.int64), 2)
        return cls(cells, left, right, weight, (states.rows[cells], states.cols[cells]))

    def key(self) -> bytes:
        return digest("bundle", *self.places, self.left, self.right, self.weight)


def _merge_each(
    bundles: list[_Bundle], settings: EvidenceConfig, known: Known | None, elsewhere: Elsewhere | None
) -> list[NDArray[np.int64]]:
    def work_out(one: _Bundle) -> NDArray[np.int64]:
        return merge(len(one.cells), one.left, one.right, one.weight, settings.alike_above)

    if elsewhere is not None:
        return elsewhere.merge([(len(one.cells), one.left, one.right, one.weight) for one in bundles])
    if known is None:
        return in_threads(work_out, bundles)
    return [recalled(known, one.key, partial(work_out, one)) for one in bundles]


def pairs_within(
    rows: NDArray[np.int64], cols: NDArray[np.int64], reach: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which of some distinct cells, sorted by row and col, are at most `reach` cells apart: each pair once.

    >>> [pair.tolist() for pair in pairs_within(np.array([0, 0, 0, 2]), np.array([0, 1, 3, 3]), 2)]
    [[0, 1, 2], [1, 2, 3]]
    """
    if not len(rows):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    width = int(cols.max() - cols.min()) + 2 * reach + 1  # padded: a row's end is near no other row's begin
    key = (rows - rows.min()) * width + (cols - cols.min())
    left, right = [], []
    for up in range(reach + 1):
        for across in range(-reach, reach + 1):
            if (up, across) > (0, 0) and up * up + across * across <= reach * reach:
                found = np.minimum(np.searchsorted(key, key + up * width + across), len(key) - 1)
                touches = np.flatnonzero(key[found] == key + up * width + across)
                left.append(touches)
                right.append(found[touches])
    first, second = np.concatenate(left), np.concatenate(right)
    order = np.lexsort((second, first))
    return first[order], second[order]


def likelihood_ratios(evidence: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much likelier the joint states are if both cells show one thing than if each shows its own; log.

    Of one thing: occupied with its share of the time, and both alike but for `DISAGREEMENT`. Of two: each occupied
    with its own share, independently. Two cells of floor, free together, gain next to nothing.

    Parameters
    ----------
    evidence : (n_pairs, 4)
        For both free, right only, left only, both occupied; see `joint_evidence`.
    """
    neither, right_only, left_only, both = evidence.T
    total = evidence.sum(axis=1) + 2
    left = (left_only + both + 1) / total  # a stretch of either state is taken as seen beforehand
    right = (right_only + both + 1) / total
    one = (left + right) / 2
    agree, differ = 1 - DISAGREEMENT, DISAGREEMENT / 2
    return np.asarray(
        both * np.log(one * agree / (left * right))
        + neither * np.log((1 - one) * agree / ((1 - left) * (1 - right)))
        + left_only * np.log(differ / (left * (1 - right)))
        + right_only * np.log(differ / ((1 - left) * right))
    )


def merge(
    n: int, left: NDArray[np.int64], right: NDArray[np.int64], weight: NDArray[np.float64], above: float
) -> NDArray[np.int64]:
    """Merge groups while the mean weight of the pairs across two of them exceeds `above`; returns labels (n,).

    The two with the largest mean go first. The pairs of the group that has fewer of them go over to the other, so
    that none does so more than log n_pairs times.

    >>> merge(3, np.array([0, 1]), np.array([1, 2]), np.array([2.0, -1.0]), 0.0).tolist()
    [0, 0, 2]
    """
    label = np.empty(n, dtype=np.int64)
    merge_groups(left, right, weight, above, label)
    return label
