"""Logs in JSON."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tempog import ScanError, open_scans

GOOD = {"range": [1.0, 2.0, 81.83], "theta": 0.5, "x": 1.0, "y": -2.0}


def written(tmp_path: Path, document: object) -> Path:
    path = tmp_path / "intel_gfs"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def test_a_log_is_recognised_and_read_in_order_of_time(tmp_path) -> None:
    document = {"map": {"1000.5": GOOD, "999.5": {**GOOD, "x": 7}}}
    log = open_scans(written(tmp_path, json.dumps(document, indent=4, sort_keys=True)), laser="rear")
    assert [scan.t for scan in log] == [999.5, 1000.5]
    assert (log[0].x, log[0].y, log[0].theta) == (7.0, -2.0, 0.5)
    assert np.degrees(log[0].angles) == pytest.approx([-90, 0, 90])
    assert log[0].max_range == 80
    assert log.format == "JSON log: 3 beams, sensor maximum 80 m"
    assert "sensor maximum taken as 80 m" in log.notes[0]
    assert "holds one laser" in log.notes[-1]
    assert open_scans(tmp_path / "intel_gfs", sensor_max_range=30)[0].max_range == 30


BAD_SCANS = {
    "no number": ({"range": [1, "two"]}, "a reading is 'two'"),
    "true": ({"range": [1, True]}, "a reading is 'True'"),
    "no list": ({"range": 3}, "range is '3'"),
    "empty": ({"range": []}, "range is"),
    "far": ({"x": float("inf")}, "the pose is inf"),
    "text": ({"theta": "north"}, "the pose is .*'north'"),
}


@pytest.mark.parametrize("kind", BAD_SCANS)
def test_a_bad_scan_is_named_or_skipped(tmp_path, kind) -> None:
    change, said = BAD_SCANS[kind]
    path = written(tmp_path, {"map": {"1.0": GOOD, "2.0": {**GOOD, **change}, "3.0": GOOD}})
    with pytest.raises(ScanError, match=rf"scan '2.0': {said}"):
        open_scans(path)
    log = open_scans(path, skip_bad=True)
    assert ([scan.t for scan in log], log.n_skipped) == ([1, 3], 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"map": {"1.0": {"range"', "is no JSON"),
        ('{"map": [1, 2]}', 'without an object "map"'),
        ('{"scans": {}}', "it holds 'scans'"),
        ('{"map": {}}', "its map is empty"),
        ('{"map": {"1.0": 7}}', "has no x, y, theta, range"),
        ('{"map": {"1.0": {}, "1.0": {}}}', "'1.0' twice"),
        ('{"map": {"monday": ' + json.dumps(GOOD) + "}}", "no usable time"),
        ('{"map": ' + "[" * 100_000, "nested|no JSON"),
        ('{"map": ' + "9" * 5000 + "}", "is no JSON"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path, text, said) -> None:
    with pytest.raises(ScanError, match=said):
        open_scans(written(tmp_path, text))


def test_stamps_that_cannot_be_used_may_be_replaced(tmp_path) -> None:
    path = written(tmp_path, {"map": {"monday": GOOD, "tuesday": GOOD}})
    log = open_scans(path, clock="rate=2")
    assert [scan.t for scan in log] == [0, 0.5]
