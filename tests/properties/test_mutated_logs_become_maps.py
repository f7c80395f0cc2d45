"""Whatever happened to a log, mapping it gives a whole map or a TempogError, in bounded time and memory."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strategies import mutated_log_bytes
from tempog import GridConfig, MapConfig, SensingConfig, build_grid, open_map, open_scans, save_map
from tempog.errors import TempogError

NO_HEALTH_CHECKS = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]
MOST_BYTES = 64_000_000  # twelve scans of five beams; a corrupt pose must not make more of them
CONFIGS = st.builds(
    lambda evidence, no_return, resolution_m: MapConfig(
        SensingConfig(evidence=evidence, no_return=no_return),
        GridConfig(resolution_m=resolution_m, max_cells=2**22),
    ),
    st.sampled_from(["surface", "literal"]),
    st.sampled_from(["neighbours", "never", "always"]),
    st.sampled_from([0.05, 0.1, 0.5]),
)


def map_or_refuse(folder: Path, content: bytes, clock: str, skip_bad: bool, config: MapConfig) -> None:
    log, path = folder / "log", folder / "m.tempog"
    log.write_bytes(content)
    try:
        scans = open_scans(log, clock=clock, skip_bad=skip_bad)
        grid = build_grid(scans, config)
        save_map(grid, path, sources=[scans], force=True)
    except TempogError:
        pass
    else:
        assert grid.memory_bytes < MOST_BYTES
        assert open_map(path).n_intervals == grid.n_intervals
    assert {file.name for file in folder.iterdir()} <= {"log", "m.tempog"}


ARGUMENTS = (mutated_log_bytes(), st.sampled_from(["auto", "auto", "sort", "rate=5"]), st.booleans(), CONFIGS)


@given(*ARGUMENTS)
@settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=NO_HEALTH_CHECKS)
def test_a_damaged_log_is_mapped_or_refused(tmp_path, content, clock, skip_bad, config):
    map_or_refuse(tmp_path, content, clock, skip_bad, config)


@pytest.mark.slow
@given(*ARGUMENTS)
@settings(max_examples=20_000, deadline=None, suppress_health_check=NO_HEALTH_CHECKS)
def test_twenty_thousand_damaged_logs_are_mapped_or_refused(tmp_path, content, clock, skip_bad, config):
    map_or_refuse(tmp_path, content, clock, skip_bad, config)
