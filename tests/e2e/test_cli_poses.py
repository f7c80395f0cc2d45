"""``tempog map LOG --poses FILE`` as a user calls it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tempog import Scan, open_map, open_scans
from tempog.scans.npz import write_npz
from tempog.simulation import corridor, load_world, simulate


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A minute of the corridor without poses, and beside it those of the robot, whose laser looks back."""
    folder = tmp_path_factory.mktemp("drive")
    scans = simulate(corridor(seed=0), duration_s=60, seed=0).scans
    write_npz(folder / "true.npz", scans)
    blind = [Scan(0.0, (0, 0, 0), one.angles, one.ranges, one.max_range, stamp_ns=one.stamp_ns) for one in scans]
    write_npz(folder / "blind.npz", blind)
    tum, kitti = [], []
    for one in scans:
        a = one.theta - math.pi
        x, y = one.x - 0.2 * math.cos(a), one.y - 0.2 * math.sin(a)
        tum.append(f"{one.t + 7:.9f} {x!r} {y!r} 0 0 0 {math.sin(a / 2)!r} {math.cos(a / 2)!r}")
        kitti.append(f"{math.cos(a)} {-math.sin(a)} 0 {x} {math.sin(a)} {math.cos(a)} 0 {y} 0 0 1 0")
    (folder / "late.tum").write_text("\n".join(tum))
    (folder / "kitti.txt").write_text("\n".join(kitti))
    (folder / "times.txt").write_text("\n".join(row.split()[0] for row in tum))
    return folder


@pytest.mark.parametrize(
    "options",
    [
        ["late.tum", "--pose-offset", "-7"],
        ["kitti.txt"],
        ["kitti.txt", "--pose-times", "times.txt", "--pose-offset", "-7"],
    ],
)
def test_poses_from_a_file_make_the_same_map(tempog, drive: Path, tmp_path: Path, options, monkeypatch) -> None:
    monkeypatch.chdir(drive)
    wanted = json.loads(tempog("map", "true.npz", "-o", tmp_path / "a.tempog", "--json").out)
    result = tempog(
        "map", "blind.npz", "-o", tmp_path / "b.tempog", "--json", "--poses", *options, "--laser-at", "0.2,0,180"
    )
    assert result.code == 0, result.err
    got = json.loads(result.out)
    assert f"poses from {options[0]} (600)" in got["sources"][0]["notes"]
    # Sines and cosines in text move hits across the borders of a few cells.
    assert got["n_cells"] == pytest.approx(wanted["n_cells"], rel=0.002)
    assert got["n_intervals"] == pytest.approx(wanted["n_intervals"], rel=0.01)
    one, other = (open_map(tmp_path / name) for name in ("a.tempog", "b.tempog"))
    assert np.allclose(one.poses[:, :2], other.poses[:, :2], atol=1e-6)


def test_bags_take_them_for_their_base_frame(tempog, drive: Path, tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip("rosbags", reason="rosbags, of the extra bags, is not installed")
    from tempog.scans.bag_writer import write_bag

    monkeypatch.chdir(drive)
    wanted = json.loads(tempog("map", "true.npz", "-o", tmp_path / "a.tempog", "--json").out)
    write_bag(tmp_path / "run.mcap", open_scans("true.npz").scans)
    command = [
        "map",
        tmp_path / "run.mcap",
        "-o",
        tmp_path / "b.tempog",
        "--poses",
        "late.tum",
        "--pose-offset",
        "-7",
    ]
    result = tempog(*command, "--laser-at", "0.2,0,180", "--json")
    assert result.code == 0, result.err
    got = json.loads(result.out)
    assert any("poses from late.tum (600)" in note for note in got["sources"][0]["notes"])
    assert got["n_cells"] == pytest.approx(wanted["n_cells"], rel=0.002)
    assert got["n_intervals"] == pytest.approx(wanted["n_intervals"], rel=0.01)
    for options, said in (
        (["--pose-gap", "3"], "not for bags"),
        (["--laser-at", "0.2,0,180", "--base-frame", "base_link"], "give one of them"),
        (["--fixed-frame", "odom"], "take the place"),
    ):
        result = tempog(*command, "--force", *options)
        assert result.code == 2
        assert said in result.err


def test_scans_without_poses_stop_the_command_or_are_counted(tempog, drive: Path, tmp_path: Path) -> None:
    command = ["map", drive / "blind.npz", "-o", tmp_path / "m.tempog", "--poses", drive / "late.tum"]
    result = tempog(*command)
    assert result.code == 1
    assert "70 of 600 scans" in result.err
    assert "--skip-bad" in result.err
    assert not (tmp_path / "m.tempog").exists()
    result = tempog(*command, "--skip-bad")
    assert result.code == 0
    assert "530 scans" in result.out
    assert "left out: 70 of 600 scans" in result.err


def test_poses_that_do_not_fit_the_scans_are_told_with_a_number(tempog, tmp_path: Path) -> None:
    scans = simulate(load_world("rooms"), duration_s=100, seed=2, people=0).scans
    write_npz(tmp_path / "log.npz", scans)
    rows = [f"{one.t!r} {one.x} {one.y} 0 0 0 {math.sin(one.theta / 2)} {math.cos(one.theta / 2)}" for one in scans]
    (tmp_path / "true.tum").write_text("\n".join(rows))
    command = ["map", tmp_path / "log.npz", "-o", tmp_path / "m.tempog", "--poses", tmp_path / "true.tum", "--force"]
    assert "inconsistent" not in tempog(*command).err
    result = tempog(*command, "--pose-offset", "0.2", "--skip-bad")
    assert result.code == 0
    assert "clock were 0.20 s ahead: where they come from a file, add -0.20 s to --pose-offset" in result.err
    answer = json.loads(tempog(*command, "--pose-offset", "0.2", "--skip-bad", "--json").out)
    assert answer["sources"][0]["turns"]["offset_s"] == pytest.approx(-0.2, abs=0.03)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--pose-offset", "3"], "go with --poses"),
        (["--poses", "late.tum", "--laser-at", "behind"], "X,Y,DEG"),
        (["--poses", "late.tum", "--laser-at", "nan,0,0"], "place"),
        (["--poses", "late.tum", "--pose-gap", "-1"], "max_gap_s"),
        (["--poses", "late.tum", "--pose-offset", "nan"], "offset"),
    ],
)
def test_wrong_usage_is_said(tempog, drive: Path, tmp_path: Path, monkeypatch, options, said: str) -> None:
    monkeypatch.chdir(drive)
    result = tempog("map", "blind.npz", "-o", tmp_path / "m.tempog", *options)
    assert result.code == 2
    assert said in result.err
