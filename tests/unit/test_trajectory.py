"""Poses from elsewhere: files, interpolation, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tempog import ConfigError, Scan, ScanError, ScanLog
from tempog.scans.trajectory import Trajectory, with_poses
from tempog.scans.trajectory_file import read_kitti, read_trajectory, read_tum

S = 1_000_000_000


def quaternion(theta: float) -> str:
    return f"0 0 {math.sin(theta / 2):.9f} {math.cos(theta / 2):.9f}"


def tum(*rows: tuple[float, float, float, float]) -> str:
    return "".join(f"{t} {x} {y} 0.3 {quaternion(theta)}\n" for t, x, y, theta in rows)


def kitti(*poses: tuple[float, float, float]) -> str:
    return "".join(
        f"{math.cos(a):.9e} {-math.sin(a):.9e} 0 {x} {math.sin(a):.9e} {math.cos(a):.9e} 0 {y} 0 0 1 0\n"
        for x, y, a in poses
    )


def written(tmp_path: Path, text: str | bytes, name: str = "run.txt") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def log_at(*stamps_s: float) -> ScanLog:
    return ScanLog([Scan(t, (9, 9, 9), [0.0], [2.0], label=f"row {t}") for t in stamps_s], source="log.npz")


ROWS = [(10.0, 0.0, 1.0, 0.0), (10.5, 1.0, 2.0, 1.0), (11.0, 2.0, 3.0, -3.0)]


@pytest.mark.parametrize("form", ["plain", "commas", "comments", "crlf", "bom"])
def test_tum_in_all_its_forms(tmp_path, form) -> None:
    text = tum(*ROWS)
    if form == "commas":
        text = text.replace(" ", ", ")
    if form == "comments":
        text = "# timestamp tx ty tz qx qy qz qw\n\n" + text.replace("\n", "  # as told\n")
    if form == "crlf":
        text = text.replace("\n", "\r\n")
    if form == "bom":
        text = "\ufeff" + text
    trajectory = read_trajectory(written(tmp_path, text))
    assert trajectory.format == "TUM trajectory, 3 poses"
    assert trajectory.notes == ()
    assert trajectory.stamps_ns.tolist() == [10 * S, 10 * S + S // 2, 11 * S]
    assert trajectory.poses == pytest.approx(np.array(ROWS)[:, 1:], abs=1e-6)
    assert np.array_equal(read_tum(tmp_path / "run.txt").poses, trajectory.poses)


def test_kitti_takes_times_from_a_file_or_from_the_scans(tmp_path) -> None:
    poses = [row[1:] for row in ROWS]
    path = written(tmp_path, kitti(*poses))
    times = written(tmp_path, "10.0\n10.5\n11.0\n", "times.txt")
    told, counted = read_trajectory(path, times=times), read_kitti(path, scan_stamps_ns=[10 * S, 11 * S, 12 * S])
    assert told.poses == pytest.approx(np.array(poses), abs=1e-6)
    assert told.stamps_ns.tolist() == [10 * S, 10 * S + S // 2, 11 * S]
    assert counted.stamps_ns.tolist() == [10 * S, 11 * S, 12 * S]
    assert "one each" in counted.notes[0]
    with pytest.raises(ScanError, match=r"3 poses, but the log has 2 scans.*\n.*--pose-times"):
        read_trajectory(path, scan_stamps_ns=[0, 1])
    with pytest.raises(ScanError, match=r"3 poses, but .*times.txt has 2 times"):
        read_trajectory(path, times=written(tmp_path, "1\n2\n", "times.txt"))
    with pytest.raises(ScanError, match="wanted the times"):
        read_trajectory(path)


def test_a_bad_kitti_row_keeps_its_stamp_from_the_next(tmp_path) -> None:
    lines = kitti((0, 0, 0), (1, 0, 0), (2, 0, 0)).splitlines()
    lines[1] = lines[1].replace("1.0", "one", 1)
    path = written(tmp_path, "\n".join(lines))
    with pytest.raises(ScanError, match=r"run.txt, line 2: 'one.*is no number"):
        read_trajectory(path, scan_stamps_ns=[S, 2 * S, 3 * S])
    trajectory = read_trajectory(path, scan_stamps_ns=[S, 2 * S, 3 * S], skip_bad=True)
    assert trajectory.stamps_ns.tolist() == [S, 3 * S]
    assert trajectory.poses[:, 0].tolist() == [0, 2]
    assert trajectory.n_skipped == 1


BAD_TUM = {
    "10.2 1 1 0 0 0 0 1 7": "has 9 fields; wanted 8",
    "10.2 1 1_0 0 0 0 0 1": "'1_0' is no number",
    "10.2 1 east 0 0 0 0 1": "'east' is no number",
    "nan 1 1 0 0 0 0 1": "the stamp nan is no usable time",
    "1700000000123456789 1 1 0 0 0 0 1": "no usable time .*not nanoseconds",
    "10.2 inf 1 0 0 0 0 1": "the position is .inf, 1, 0.; wanted metres",
    "10.2 1 1 0 0 0 0 0": "has length 0; wanted 1",
    "10.2 1 1 0 0 0 0 1.2": "has length 1.2; wanted 1",
    "10.2 1 1 0 1 0 0 0": "tilted by 180 degrees; wanted at most 3; is qw the last",
    "10.2 1 1 0 0 0.2 0 0.9797958971": "tilted by 23 degrees",
}


@pytest.mark.parametrize("row", BAD_TUM)
def test_a_bad_row_is_named_or_skipped(tmp_path, row) -> None:
    first, *rest = tum(*ROWS).splitlines()
    path = written(tmp_path, "\n".join(["# t x y z qx qy qz qw", first, row, *rest]))
    with pytest.raises(ScanError, match=rf"run.txt, line 3: .*{BAD_TUM[row]}"):
        read_trajectory(path)
    trajectory = read_trajectory(path, skip_bad=True)
    assert (len(trajectory), trajectory.n_skipped) == (3, 1)
    assert "line 3" in trajectory.notes[0]


BAD_MATRICES = {
    "1 0 0 1 0 2 0 1 0 0 1 0": "is no rotation",
    "1 0 0 1 0 -1 0 1 0 0 1 0": "mirrors",
    "1 0 0 1 0 0 -1 1 0 1 0 0": "tilted by 90 degrees.*camera",
    "1 0 0 1e99 0 1 0 1 0 0 1 0": "the position is",
    "1 0 0 nan 0 1 0 1 0 0 1 0": "holds nan",
}


@pytest.mark.parametrize("row", BAD_MATRICES)
def test_a_matrix_that_is_no_planar_pose_is_named(tmp_path, row) -> None:
    path = written(tmp_path, kitti((0, 0, 0)) + row + "\n" + kitti((1, 0, 0)))
    with pytest.raises(ScanError, match=f"line 2: .*{BAD_MATRICES[row]}"):
        read_trajectory(path, scan_stamps_ns=[0, S, 2 * S])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"# nothing\n\n", "only comments"),
        (b"1 2 3\n4 5 6\n", "rows have 3 fields"),
        (b"\x89MCAP0\r\n\xff\xfe", "is no text"),
        (b"10 0 0 0 0 0 0 2\n", "holds no usable pose"),
    ],
)
def test_what_is_no_trajectory_is_refused(tmp_path, content, said) -> None:
    with pytest.raises(ScanError, match=said):
        read_trajectory(written(tmp_path, content), skip_bad=True)
    with pytest.raises(ScanError, match="cannot read"):
        read_trajectory(tmp_path / "absent.tum")


def test_order_repeats_jumps_and_floors_are_noted(tmp_path) -> None:
    rows = [(2.0, 1, 0, 0), (1.0, 0, 0, 0), (3.0, 1, 0, 0), (3.0, 5, 0, 0), (3.1, 9, 0, 0)]
    text = tum(*rows) + "4.0 9 0 3.6 0 0 0 1\n"
    trajectory = read_trajectory(written(tmp_path, text))
    assert (trajectory.stamps_ns / S).tolist() == [1, 2, 3, 3.1, 4]
    assert trajectory.poses[:, 0].tolist() == [0, 1, 1, 9, 9]
    back, again, floors, jumps = trajectory.notes
    assert "1 of 6 poses step back in time, by up to 1 s (first: line 2)" in back
    assert "repeat a stamp (first: line 4)" in again
    assert "3.3 m" in floors
    assert "first by 8 m to line 5" in jumps


@pytest.mark.parametrize("heights", [("inf", "0"), ("nan", "nan"), ("-1e308", "1e308")])
def test_heights_of_no_use_do_not_matter(tmp_path, heights) -> None:
    rows = [f"{k} 0 0 {z} 0 0 0 1" for k, z in enumerate(heights)]
    trajectory = read_trajectory(written(tmp_path, "\n".join(rows)))
    assert trajectory.poses.tolist() == [[0, 0, 0]] * 2
    assert any("several floors" in note for note in trajectory.notes) == ("1e308" in heights)


def test_poses_turn_the_shorter_way_and_nothing_is_extrapolated() -> None:
    trajectory = Trajectory([0, S, 2 * S], [(0, 0, 3.0), (1, 2, -3.0), (1, 2, -3.0 + 4 * math.pi)])
    x, y, theta = trajectory.at([S // 4])[0]
    assert (x, y) == (0.25, 0.5)
    assert theta == pytest.approx(3.0 + (2 * math.pi - 6) / 4)
    assert np.isnan(trajectory.at([-10_000_000, 2 * S + 10_000_000])).all()
    # Stamps in files are rounded.
    assert trajectory.at([-4_000_000])[0].tolist() == [0, 0, 3.0]
    assert trajectory.at([2 * S + 4_000_000])[0, :2].tolist() == [1, 2]


def test_gaps_are_bridged_where_the_robot_stood() -> None:
    trajectory = Trajectory([0, 5 * S, 65 * S, 66 * S], [(0, 0, 0), (3, 0, 0), (3.09, 0, 0.08), (4, 0, 0)])
    known, before, after, in_gap = trajectory.coverage([0, 2 * S, 5 * S, 30 * S, 66 * S, 70 * S, -S])
    assert known.tolist() == [True, False, True, True, True, False, False]
    assert in_gap.tolist() == [False, True, False, False, False, False, False]
    assert (before.sum(), after.sum()) == (1, 1)
    assert trajectory.at([2 * S], max_gap_s=5.0)[0].tolist() == pytest.approx([1.2, 0, 0])


def test_the_whole_time_of_int64_does_not_overflow() -> None:
    far = 9_199_999_999 * S
    trajectory = Trajectory([-far, far], [(0, 0, 0), (0.02, 0, 0)])
    assert trajectory.at([0])[0].tolist() == pytest.approx([0.01, 0, 0])
    assert np.isnan(trajectory.at([2**63 - 1, -(2**63)])).all()


@pytest.mark.parametrize(
    ("stamps", "poses", "said"),
    [
        ([], np.zeros((0, 3)), "no poses"),
        ([0], [(0, 0)], "do not fit"),
        ([0, 0], np.zeros((2, 3)), "not later"),
        ([0], [(math.nan, 0, 0)], "wanted metres"),
        ([2**63 - 1], [(0, 0, 0)], "no usable times"),
    ],
)
def test_what_makes_no_trajectory(stamps, poses, said) -> None:
    with pytest.raises(ScanError, match=said):
        Trajectory(stamps, poses)


def test_a_trajectory_keeps_its_poses_to_itself() -> None:
    poses = np.zeros((2, 3))
    trajectory = Trajectory([0, S], poses)
    poses[:] = 7
    assert not trajectory.poses.any()
    with pytest.raises(ValueError, match="read-only"):
        trajectory.poses[0, 0] = 1


def test_scans_get_poses_of_a_laser_mounted_on_the_robot() -> None:
    robot = Trajectory([10 * S, 11 * S], [(0, 0, math.pi / 2), (0, 1, math.pi / 2)], source="run.tum")
    log = with_poses(log_at(10.0, 10.5), robot, laser_at=(0.2, 0.0, math.pi))
    assert [(scan.x, scan.y, scan.theta) for scan in log] == [
        pytest.approx((0, 0.2, 1.5 * math.pi)),
        pytest.approx((0, 0.7, 1.5 * math.pi)),
    ]
    assert log[1].label == "row 10.5"
    assert log.notes == ("poses from run.tum (2)",)


def test_an_offset_is_added_to_the_poses() -> None:
    late = Trajectory([110 * S, 111 * S], [(0, 0, 0), (1, 0, 0)])
    assert with_poses(log_at(10.25), late, offset_s=-100.0)[0].x == 0.25
    for offset_s in (math.nan, 1e10, 9.2e9 - 1):
        with pytest.raises(ConfigError, match="offset"):
            with_poses(log_at(10.25), late, offset_s=offset_s)
    with pytest.raises(ConfigError, match="place"):
        with_poses(log_at(10.25), late, laser_at=(math.inf, 0, 0))
    with pytest.raises(ConfigError, match="max_gap_s"):
        with_poses(log_at(10.25), late, max_gap_s=-1)


def test_scans_without_a_pose_stop_or_are_counted() -> None:
    poses = Trajectory([10 * S, 11 * S, 15 * S, 16 * S], [(k, 0, 0) for k in range(4)], source="run.tum")
    log = log_at(9.0, 10.5, 12.0, 13.0, 15.5, 20.0)
    with pytest.raises(ScanError) as refused:
        with_poses(log, poses)
    said = str(refused.value)
    for part in (
        "4 of 6 scans of log.npz have no pose in run.tum",
        "1 from 9.000 s on, before its first at 10.000 s",
        "1 up to 20.000 s, after its last at 16.000 s",
        "2 between poses more than 1 s apart (the farthest: 11.000 and 15.000 s, 4.00 s)",
        "--skip-bad",
        "--pose-gap 4",
        "--pose-offset",
    ):
        assert part in said
    kept = with_poses(log, poses, skip_bad=True)
    assert [scan.t for scan in kept] == [10.5, 15.5]
    assert kept.n_skipped == 4
    assert "left out: 4 of 6" in kept.notes[-1]
    assert [scan.t for scan in with_poses(log, poses, skip_bad=True, max_gap_s=4)] == [10.5, 12, 13, 15.5]


def test_clocks_that_share_no_time_are_told_apart_by_how_much() -> None:
    poses = Trajectory([0, S], [(0, 0, 0), (1, 0, 0)], source="run.tum")
    with pytest.raises(ScanError, match=r"share no time.*--pose-offset 1000.250000"):
        with_poses(log_at(1000.25, 1000.5), poses, skip_bad=True)
