"""Interpolated poses equal a slow reading of the rule; damaged files give a trajectory or a ScanError."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strategies import damaged_bytes, damaged_lines
from tempog.errors import ScanError
from tempog.ros.transforms import SAME_HEADING_RAD, SAME_PLACE_M
from tempog.scans.relations import read_relations, relation_error
from tempog.scans.scan import Scan
from tempog.scans.trajectory import END_SLACK_S, Trajectory
from tempog.scans.trajectory_file import read_trajectory

S = 1_000_000_000
STEPS_NS = st.integers(1, 3 * S) | st.sampled_from([1, S, S + 1, 60 * S])
NO_HEALTH_CHECKS = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]


@st.composite
def trajectories(draw: st.DrawFn) -> Trajectory:
    steps = draw(st.lists(STEPS_NS, min_size=1, max_size=8))
    stamps_ns = np.cumsum([draw(st.integers(-(2**62), 2**62)), *steps[1:]])
    metres = st.floats(-5, 5) | st.sampled_from([0.0, 0.07])
    pose = st.tuples(metres, metres, st.floats(-20, 20) | st.sampled_from([0.0, 0.06, math.pi]))
    return Trajectory(stamps_ns, [draw(pose) for _ in stamps_ns])


def slow_pose(trajectory: Trajectory, stamp_ns: int, max_gap_s: float) -> tuple[float, float, float] | None:
    """The rule, read aloud."""
    stamps, poses = trajectory.stamps_ns.tolist(), trajectory.poses.tolist()
    if stamp_ns in stamps:
        return tuple(poses[stamps.index(stamp_ns)])
    for end in (0, -1):
        beyond_ns = stamps[0] - stamp_ns if end == 0 else stamp_ns - stamps[-1]
        if beyond_ns > 0:
            return tuple(poses[end]) if beyond_ns <= END_SLACK_S * S else None
    i = max(k for k in range(len(stamps)) if stamps[k] < stamp_ns)
    (x0, y0, a0), (x1, y1, a1) = poses[i : i + 2]
    turn = math.remainder(a1 - a0, 2 * math.pi)
    stood = math.hypot(x1 - x0, y1 - y0) <= SAME_PLACE_M and abs(turn) <= SAME_HEADING_RAD
    if (stamps[i + 1] - stamps[i]) / S > max_gap_s and not stood:
        return None
    f = (stamp_ns - stamps[i]) / (stamps[i + 1] - stamps[i])
    return x0 + f * (x1 - x0), y0 + f * (y1 - y0), a0 + f * turn


@given(trajectories(), st.data())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_poses_follow_the_rule(trajectory: Trajectory, data: st.DataObject) -> None:
    first, last = int(trajectory.stamps_ns[0]), int(trajectory.stamps_ns[-1])
    near = st.integers(first - 10_000_000, last + 10_000_000)
    asked = data.draw(st.lists(near | st.sampled_from(trajectory.stamps_ns.tolist()), min_size=1, max_size=20))
    max_gap_s = data.draw(st.sampled_from([0.0, 0.5, 1.0, 1e9]))
    got = trajectory.at(asked, max_gap_s)
    known = trajectory.coverage(asked, max_gap_s).known
    for k, stamp_ns in enumerate(asked):
        wanted = slow_pose(trajectory, stamp_ns, max_gap_s)
        assert known[k] == (wanted is not None)
        if wanted is None:
            assert np.isnan(got[k]).all()
            continue
        assert got[k, :2] == pytest.approx(wanted[:2], abs=1e-9)
        # At exactly half a turn either way is the shorter one; only the ends are the same then.
        turns = np.diff(trajectory.poses[:, 2])
        if not np.any(np.abs(np.abs(np.remainder(turns, 2 * math.pi) - math.pi)) < 1e-9):
            assert math.remainder(got[k, 2] - wanted[2], 2 * math.pi) == pytest.approx(0, abs=1e-9)


TUM = "\n".join(
    ["# timestamp tx ty tz qx qy qz qw", *(f"{10 + k / 5} {k / 10} 0.5 0 0 0 {0.6} {0.8}" for k in range(12)), ""]
).encode()
KITTI = "\n".join([*(f"1 0 0 {k / 10} 0 1 0 0.5 0 0 1 0" for k in range(12)), ""]).encode()


def read_or_refuse(path, content: bytes, skip_bad: bool) -> None:
    path.write_bytes(content)
    try:
        trajectory = read_trajectory(path, scan_stamps_ns=[k * S for k in range(12)], skip_bad=skip_bad)
    except ScanError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert str(path) in message
        return
    assert len(trajectory) > 0
    assert np.isfinite(trajectory.poses).all()
    assert skip_bad or trajectory.n_skipped == 0
    assert not np.isnan(trajectory.at(trajectory.stamps_ns)).any()


FILES = st.sampled_from([TUM, KITTI]).flatmap(lambda text: damaged_lines(text) | damaged_bytes(text))


@given(FILES, st.booleans())
@settings(max_examples=300, deadline=None, derandomize=True, suppress_health_check=NO_HEALTH_CHECKS)
def test_a_damaged_trajectory_is_read_or_refused(tmp_path, content: bytes, skip_bad: bool) -> None:
    read_or_refuse(tmp_path / "run.txt", content, skip_bad)


RELATIONS = "\n".join([*(f"{k} {k + 1} 0.5 0.1 0 0 0 {k / 10}" for k in range(12)), ""]).encode()


@given(damaged_lines(RELATIONS) | damaged_bytes(RELATIONS), st.booleans())
@settings(max_examples=200, deadline=None, derandomize=True, suppress_health_check=NO_HEALTH_CHECKS)
def test_damaged_relations_are_read_or_refused(tmp_path, content: bytes, skip_bad: bool) -> None:
    path = tmp_path / "run.relations"
    path.write_bytes(content)
    try:
        relations = read_relations(path, skip_bad=skip_bad)
    except ScanError as error:
        message = str(error)
    else:
        message = ""
    if message:
        assert str(path) in message
        return
    assert len(relations) > 0
    assert np.isfinite(relations.moves).all()
    scans = [Scan(float(k), (0.5 * k, 0.0, 0.0), [0.0], [2.0]) for k in range(13)]
    try:
        error = relation_error(scans, relations, within_s=0.5)
    except ScanError:
        return
    assert np.isfinite(error).all()


@pytest.mark.slow
@given(FILES, st.booleans())
@settings(max_examples=10_000, deadline=None, suppress_health_check=NO_HEALTH_CHECKS)
def test_ten_thousand_damaged_trajectories_are_read_or_refused(tmp_path, content: bytes, skip_bad: bool) -> None:
    read_or_refuse(tmp_path / "run.txt", content, skip_bad)


@pytest.mark.parametrize(("content", "kind"), [(TUM, "TUM"), (KITTI, "KITTI")])
def test_the_undamaged_trajectories_are_read(tmp_path, content: bytes, kind: str) -> None:
    (tmp_path / "run.txt").write_bytes(content)
    trajectory = read_trajectory(tmp_path / "run.txt", scan_stamps_ns=[k * S for k in range(12)])
    assert trajectory.format == f"{kind} trajectory, 12 poses"
