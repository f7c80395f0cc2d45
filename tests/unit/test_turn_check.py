"""Whether scans turn as their poses say, in drives whose poses are wrong in known ways."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tempog import Scan, ScanLog, open_scans
from tempog.analysis.turn_check import turn_check
from tempog.scans.trajectory import Trajectory, with_poses
from tempog.simulation import load_world, random_building, simulate

DATA = Path(__file__).parents[3] / "shared/data/laser_logs"


def poses_of(scans) -> Trajectory:
    stamps_ns, rows = np.unique([scan.stamp_ns for scan in scans], return_index=True)
    return Trajectory(stamps_ns, np.array([(scan.x, scan.y, scan.theta) for scan in scans])[rows])


@pytest.fixture(scope="module", params=["rooms", "crowd", "random"])
def drive(request) -> ScanLog:
    world = random_building(3) if request.param == "random" else load_world("rooms")
    people = 20 if request.param == "crowd" else 0
    return ScanLog(simulate(world, duration_s=120.0, seed=21, people=people).scans)


def test_true_poses_turn_as_the_scans_do(drive) -> None:
    answer = turn_check(drive)
    assert answer.n_pairs >= 20
    assert answer.error_deg < 1
    assert answer.consistent
    assert answer.warning is None


@pytest.mark.parametrize("offset_s", [0.1, 0.2, -0.2, 0.5])
def test_a_clock_that_differs_is_found_and_by_how_much(drive, offset_s: float) -> None:
    answer = turn_check(with_poses(drive, poses_of(drive), offset_s=offset_s, skip_bad=True))
    assert answer.consistent is False
    assert answer.error_deg > 2.5
    assert answer.offset_s == pytest.approx(-offset_s, abs=0.03)
    assert ("behind" if offset_s < 0 else "ahead") in answer.warning
    assert f"{answer.offset_s:+.2f} s" in answer.warning


def test_mirrored_poses_are_told_as_such(drive) -> None:
    poses = poses_of(drive)
    answer = turn_check(with_poses(drive, Trajectory(poses.stamps_ns, poses.poses * [1, -1, -1])))
    assert answer.mirrored
    assert "mirrored" in answer.warning
    assert answer.to_dict()["consistent"] is False


def test_poses_of_another_drive_fit_in_no_way(drive) -> None:
    poses = poses_of(drive)
    other = Trajectory(poses.stamps_ns, np.column_stack([poses.poses[:, :2], 3 * np.sin(np.arange(len(poses)) / 7)]))
    answer = turn_check(with_poses(drive, other))
    assert answer.consistent is False
    assert answer.offset_s is None
    assert "of this log" in answer.warning


def test_poses_that_stand_still_while_the_scans_turn_are_told(drive) -> None:
    poses = poses_of(drive)
    answer = turn_check(
        with_poses(drive, Trajectory(poses.stamps_ns, np.repeat(poses.poses[:1], len(poses), axis=0)))
    )
    assert answer.n_pairs == 0
    assert answer.consistent is False
    assert "of this log" in answer.warning


def test_who_never_turns_and_who_sees_nothing_gets_no_verdict() -> None:
    angles = np.radians(np.arange(-90, 90))
    wall = 2 / np.maximum(np.abs(np.sin(angles)), 0.01)
    straight = [Scan(k / 10, (k / 20, 0, 0), angles, wall, 30.0) for k in range(100)]
    turning = [Scan(k / 10, (0, 0, k / 20), angles, np.full(180, math.inf), 30.0) for k in range(100)]
    round_room = [Scan(k / 10, (0, 0, k / 20), angles, np.full(180, 3.0), 30.0) for k in range(100)]
    for scans in ([], straight[:1], straight, turning, round_room):
        answer = turn_check(scans)
        assert (answer.error_deg, answer.consistent, answer.warning) == (None, None, None)


@pytest.mark.skipif(not DATA.is_dir(), reason="no copies of the real logs here")
def test_a_public_log_agrees_and_its_lag_is_found() -> None:
    log = open_scans(DATA / "freiburg-079-corrected.log.gz")
    assert turn_check(log).consistent
    late = turn_check(with_poses(log, poses_of(log), offset_s=0.2, skip_bad=True))
    assert late.offset_s == pytest.approx(-0.2, abs=0.03)
