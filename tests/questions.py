"""Any questions, asked of two histories that must give the same answers."""

from __future__ import annotations

import contextlib
import math

from hypothesis import strategies as st

from fed_grid import moment
from same_answers import (
    HOLDS,
    assert_same_analyses,
    assert_same_cells,
    assert_same_changes,
    assert_same_intervals,
    assert_same_series,
    assert_same_states,
    moments_of_interest,
)
from strategies import STREAM_CELLS
from tempog.errors import EmptyWindowError
from tempog.grid.history import History

UNSEEN = (5, 5)  # a cell no stream speaks about


def ask(data: st.DataObject, got: History, wanted: History, stamps: list[int]) -> None:
    """One question of any kind, at any time."""
    moments = st.sampled_from(moments_of_interest(stamps))
    hold = st.sampled_from(HOLDS)
    question = data.draw(st.sampled_from(["at", "at", "window", "area", "cells", "changes", "whole", "intervals"]))
    if question == "at":
        assert_same_states(got, wanted, data.draw(moments), data.draw(hold))
    elif question == "cells":
        assert_same_cells(got, wanted, [*STREAM_CELLS, UNSEEN])
    elif question == "changes":
        some_hold = data.draw(st.sampled_from([0.0, 0.1505, math.inf]))
        assert_same_changes(got, wanted, data.draw(moments), data.draw(moments), some_hold)
    elif question == "whole":
        assert_same_analyses(got, wanted)
        assert_same_series(got, wanted)
    elif question == "intervals":
        assert_same_intervals(got, wanted)
    else:
        parts = [got, wanted]
        for kind in data.draw(
            st.sampled_from([["window"], ["area"], ["window", "area"], ["area", "window"], ["area", "area"]])
        ):
            if kind == "area":
                bounds = data.draw(st.sampled_from([(0.0, 0.3, 0.0, 0.3), (-0.4, 0.1, -20.0, 0.2)]))
                how = {"x_min": bounds[0], "x_max": bounds[1], "y_min": bounds[2], "y_max": bounds[3]}
                parts = same_parts(parts, "area", **how)
            else:
                t0, t1 = sorted((data.draw(moments), data.draw(moments)))
                parts = same_parts(parts, "window", t0=moment(t0), t1=moment(t1))
            if not parts:
                return
        assert_same_analyses(*parts)
        assert_same_series(*parts)
        assert_same_cells(*parts, [*STREAM_CELLS, UNSEEN])
        assert_same_states(*parts, data.draw(moments), data.draw(hold))


def same_parts(histories: list[History], kind: str, **how) -> list[History]:
    """A part of each of two histories; none if neither has it."""
    parts = []
    for history in histories:
        with contextlib.suppress(EmptyWindowError):
            parts.append(getattr(history, kind)(**how))
    assert len(parts) in (0, len(histories))
    return parts


def ask_all(data: st.DataObject, got: History, wanted: History, stamps: list[int]) -> None:
    """The questions that tell most, then any."""
    for t_ns in moments_of_interest(stamps)[::3]:
        assert_same_states(got, wanted, t_ns, math.inf)
    assert_same_intervals(got, wanted)
    for _ in range(4):
        ask(data, got, wanted, stamps)
