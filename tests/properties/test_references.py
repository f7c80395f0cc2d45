"""What cells refer to is read back to the last bit."""

from __future__ import annotations

from collections import Counter

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from same_runs import assert_identical
from strategies import SOME_CELL, runs_of_cells
from tempog.grid.segments import Runs
from tempog.store.references import decode, encode


@st.composite
def runs_and_groups(draw: st.DrawFn) -> tuple[Runs, list[list[int]]]:
    """Intervals, and groups that may overlap, name a cell twice, or name cells without intervals."""
    runs = draw(runs_of_cells())
    cell = st.sampled_from(runs.cells.tolist()) | SOME_CELL if len(runs.cells) else SOME_CELL
    return runs, draw(st.lists(st.lists(cell, max_size=30), max_size=4))


def as_arrays(groups: list[list[int]]) -> list[NDArray[np.int32]]:
    return [np.array(group, np.int32) for group in groups]


@settings(deadline=None)
@given(runs_and_groups(), st.integers(1, 4))
def test_references_are_read_back_to_the_last_bit(
    given_runs: tuple[Runs, list[list[int]]], least_shared: int
) -> None:
    runs, groups = given_runs
    assert_identical(decode(encode(runs, as_arrays(groups), least_shared)), runs)


@settings(deadline=None)
@given(runs_and_groups(), st.integers(1, 4))
def test_a_timeline_holds_just_what_enough_cells_of_its_group_share(
    given_runs: tuple[Runs, list[list[int]]], least_shared: int
) -> None:
    runs, groups = given_runs
    encoded = encode(runs, as_arrays(groups), least_shared)

    group_of = {cell: number for number, group in reversed(list(enumerate(groups))) for cell in group}
    sharing = Counter(
        (group_of[cell], first, last, bits) for cell, first, last, bits in rows_of(runs) if cell in group_of
    )
    wanted = sorted(key for key, n_cells in sharing.items() if n_cells >= least_shared)
    bits = encoded.entry_value.view(np.int32).tolist()
    entries = zip(
        encoded.entry_group.tolist(), encoded.entry_first.tolist(), encoded.entry_last.tolist(), bits, strict=True
    )
    assert sorted(entries) == wanted
    assert len(encoded.cell) == runs.n_intervals - sum(sharing[key] for key in wanted)


def rows_of(runs: Runs) -> list[tuple[int, int, int, int]]:
    cell = np.repeat(runs.cells, np.diff(runs.offsets))
    columns = (cell, runs.first, runs.last, runs.value.view(np.int32))
    return list(zip(*(column.tolist() for column in columns), strict=True))


def test_equal_values_of_other_bits_are_not_shared_and_nan_is() -> None:
    for values, n_entries in (([0.0, -0.0], 0), ([float("nan")] * 2, 1)):
        runs = Runs(
            np.array([3, 5], np.int32),
            np.array([0, 1, 2], np.int64),
            np.array([2, 2], np.int32),
            np.array([6, 6], np.int32),
            np.array(values, np.float32),
        )
        encoded = encode(runs, [runs.cells], least_shared=2)
        assert len(encoded.entry_first) == n_entries
        assert_identical(decode(encoded), runs)
