"""Whatever happened to a log, reading it gives scans or a TempogError, never another exception."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strategies import CARMEN, CARMEN_WITHOUT_ROBOTLASER, JSON, NPZ, NPZ_COMPRESSED, mutated_log_bytes
from tempog.errors import TempogError
from tempog.scans.open import open_scans
from tempog.scans.scan import ScanLog

CLOCKS = st.sampled_from(["auto", "auto", "sort", "rate=5"])
NO_HEALTH_CHECKS = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]


def read_or_refuse(path: Path, content: bytes, clock: str, skip_bad: bool, laser: str) -> None:
    path.write_bytes(content)
    try:
        log = open_scans(path, clock=clock, skip_bad=skip_bad, laser=laser)
    except TempogError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert str(path) in message
        return
    assert isinstance(log, ScanLog)
    assert len(log) > 0
    assert (np.diff([scan.stamp_ns for scan in log]) >= 0).all()
    assert all(np.isfinite([scan.x, scan.y, scan.theta]).all() for scan in log)
    assert skip_bad or log.n_skipped == 0


@given(mutated_log_bytes(), CLOCKS, st.booleans(), st.sampled_from(["front", "front", "rear"]))
@settings(max_examples=300, deadline=None, derandomize=True, suppress_health_check=NO_HEALTH_CHECKS)
def test_a_damaged_log_is_read_or_refused(tmp_path, content, clock, skip_bad, laser):
    read_or_refuse(tmp_path / "log", content, clock, skip_bad, laser)


@pytest.mark.slow
@given(mutated_log_bytes(), CLOCKS, st.booleans(), st.sampled_from(["front", "front", "rear"]))
@settings(max_examples=20_000, deadline=None, suppress_health_check=NO_HEALTH_CHECKS)
def test_twenty_thousand_damaged_logs_are_read_or_refused(tmp_path, content, clock, skip_bad, laser):
    read_or_refuse(tmp_path / "log", content, clock, skip_bad, laser)


@pytest.mark.parametrize("content", [CARMEN, CARMEN_WITHOUT_ROBOTLASER, NPZ, NPZ_COMPRESSED, JSON])
def test_the_undamaged_logs_are_read(tmp_path, content):
    path = tmp_path / "log"
    path.write_bytes(content)
    assert len(open_scans(path)) in (1, 12)
