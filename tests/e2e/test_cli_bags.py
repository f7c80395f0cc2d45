"""``tempog map`` on bags."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import amcl_pose, odometry, room_scans, sweep_messages, tf, transform, write_messages
from tempog import open_map
from tempog.ros.messages import Codec
from tempog.scans.bag_writer import Mount, write_bag
from tempog.scans.npz import write_npz
from tempog.simulation import corridor, simulate

Tempog = Callable[..., Any]
KINDS = ["run.mcap", "run.bag", "run.db3", "run"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute of the corridor, as .npz and as every kind of bag."""
    folder = tmp_path_factory.mktemp("runs")
    scans = simulate(corridor(seed=0), duration_s=30, seed=0).scans
    write_npz(folder / "run.npz", scans)
    for name in KINDS:
        write_bag(folder / name, scans)
    return folder


@pytest.mark.parametrize("name", KINDS)
def test_the_map_is_that_of_the_npz(tempog: Tempog, runs: Path, tmp_path: Path, name: str) -> None:
    for source in ("run.npz", name):
        result = tempog("map", runs / source, "-o", tmp_path / f"{source}.tempog", "--json")
        assert result.code == 0, result.err
    ours, npz = open_map(tmp_path / f"{name}.tempog"), open_map(tmp_path / "run.npz.tempog")
    assert ours.n_scans == npz.n_scans == 300
    then, wanted = ours.at("+29"), npz.at("+29")
    assert then.value.shape == wanted.value.shape
    differ = ~((then.value == wanted.value) | (np.isnan(then.value) & np.isnan(wanted.value)))
    # Angles are float32 in a LaserScan: a beam or two passes a corner of a cell on the other side.
    assert differ.mean() < 1e-4
    assert abs(ours.n_intervals - npz.n_intervals) <= 1e-3 * npz.n_intervals


def test_the_default_name_of_the_map_is_the_bags(
    tempog: Tempog, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert tempog("map", runs / "run.db3", "-q").code == 0
    assert (tmp_path / "run.tempog" / "map.json").is_file()
    assert tempog("map", f"{runs / 'run'}/", "-q", "--force").code == 0


def test_map_says_what_it_chose_and_what_else_there_is(tempog: Tempog, runs: Path, tmp_path: Path) -> None:
    result = tempog("map", runs / "run.mcap", "-o", tmp_path / "m.tempog")
    assert "MCAP: /scan in laser, 181 beams, sensor maximum 8 m; placed in map by transforms, 300 scans" in result.out
    assert "note: poses are in map; others: --fixed-frame odom" in result.err


def test_several_bags_are_one_recording(tempog: Tempog, tmp_path: Path) -> None:
    codec = Codec("ros2")
    scans = room_scans(40)
    placed = [tf(codec, transform(t / 10, "map", "laser", 1 + t / 10, 3)) for t in range(42)]
    write_messages(tmp_path / "scans.mcap", sweep_messages(codec, scans))
    write_messages(tmp_path / "transforms.mcap", placed)
    result = tempog(
        "map", tmp_path / "transforms.mcap", tmp_path / "scans.mcap", "-o", tmp_path / "m.tempog", "--json"
    )
    assert result.code == 0, result.err
    answer = json.loads(result.out)
    assert answer["n_scans"] == 40
    assert len(answer["sources"]) == 1
    assert "MCAP, 2 files" in answer["sources"][0]["format"]
    again = tempog(
        "map", tmp_path / "transforms.mcap", tmp_path / "scans.mcap", "-o", tmp_path / "m.tempog", "--append"
    )
    assert (again.code, "already" in again.err) == (1, True)


def test_two_lasers_make_one_map_without_notes_of_an_overlap(tempog: Tempog, tmp_path: Path) -> None:
    lasers = {Mount("/front", "front", 0.2): room_scans(20), Mount("/rear", "rear", -0.2): room_scans(20)}
    write_bag(tmp_path / "run.bag", lasers)
    result = tempog("map", tmp_path / "run.bag", "-o", tmp_path / "m.tempog")
    assert result.code == 0, result.err
    assert "/front in front" in result.out
    assert "/rear in rear" in result.out
    assert "overlap" not in result.err
    assert open_map(tmp_path / "m.tempog").n_scans == 40
    one = tempog("map", tmp_path / "run.bag", "--scan-topic", "/rear", "-o", tmp_path / "one.tempog")
    assert one.code == 0
    assert open_map(tmp_path / "one.tempog").n_scans == 20


def test_flags_that_a_bag_cannot_meet_are_wrong_usage(tempog: Tempog, runs: Path, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "m.tempog")
    for words, text in [
        (("--scan-topic", "/tf"), "topic /tf holds tf2_msgs/msg/TFMessage"),
        (("--fixed-frame", "earth"), "there is no frame 'earth'; there are base_link, laser, map, odom"),
        (("--base-frame", "bse"), "there is no frame 'bse'"),
        (("--pose-topic", "/odom"), "topic /odom is not there"),
        (("--from-cloud", "low:high"), "--from-cloud low:high is no band of heights"),
        (("--from-cloud", "3:2"), "is no band"),
    ]:
        result = tempog("map", runs / "run.mcap", *words, *out)
        assert (result.code, text in result.err) == (2, True), result.err
    result = tempog("map", runs / "run.npz", "--fixed-frame", "odom", *out)
    assert (result.code, "are for bags" in result.err) == (2, True)
    assert not (tmp_path / "m.tempog").exists()


def test_a_cut_bag_is_refused_or_salvaged_and_counted(tempog: Tempog, runs: Path, tmp_path: Path) -> None:
    content = (runs / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    result = tempog("map", tmp_path / "cut.mcap", "-o", tmp_path / "m.tempog")
    assert result.code == 1
    assert "Use --skip-bad to map what is intact" in result.err
    result = tempog("map", tmp_path / "cut.mcap", "-o", tmp_path / "m.tempog", "--skip-bad", "--json")
    (source,) = json.loads(result.out)["sources"]
    assert result.code == 0
    assert 100 < source["n_scans"] < 200
    assert source["n_skipped"] >= 1
    assert any("damaged: it ends in the middle" in note for note in source["notes"])


def test_a_pose_topic_in_place_of_transforms(tempog: Tempog, tmp_path: Path) -> None:
    codec = Codec("ros1")
    times = [k / 10 for k in range(-1, 25)]
    poses = [odometry(codec, t, child="laser") for t in times] + [amcl_pose(codec, t) for t in times]
    write_messages(tmp_path / "run.bag", [*poses, *sweep_messages(codec, room_scans(20))])
    result = tempog("map", tmp_path / "run.bag", "--pose-topic", "/odom", "-o", tmp_path / "m.tempog")
    assert result.code == 0, result.err
    assert "placed in odom by /odom" in result.out
    assert "others" not in result.err
