"""The method ``evidence`` on histories made by hand: doors, boxes, people, walls."""

from __future__ import annotations

import dataclasses
import math

import pytest

from tempog.errors import ConfigError
from tempog.methods import EvidenceConfig

MAY_BE_NEGATIVE = ("alike_above", "grow_above")
SETTINGS = [field.name for field in dataclasses.fields(EvidenceConfig)]


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("value", [math.nan, math.inf, "much", -1])
def test_settings_out_of_range_are_refused_by_their_name(name, value) -> None:
    if value == -1 and name in MAY_BE_NEGATIVE:
        assert getattr(EvidenceConfig(**{name: value}), name) == -1
        return
    with pytest.raises(ConfigError, match=rf"^{name} = "):
        EvidenceConfig(**{name: value})


@pytest.mark.parametrize(
    "name",
    [*(n for n in SETTINGS if n.endswith(("_share", "_duty"))), "together", "short_together", "echo", "max_states"],
)
def test_shares_above_1_and_too_many_states_are_refused_by_their_name(name) -> None:
    with pytest.raises(ConfigError, match=rf"^{name} = "):
        EvidenceConfig(**{name: 1.01 if name != "max_states" else 9})
