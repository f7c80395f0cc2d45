"""`tempog simulate` as a user calls it: logs that read back, the truth beside them, and what is refused."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest

from tempog.errors import ScanError
from tempog.scans.carmen_writer import write_carmen
from tempog.scans.open import open_scans
from tempog.scans.scan import Scan
from tempog.simulation import Hit, load_world, simulate
from tempog.simulation.truth import truth_paths


@pytest.fixture
def tempog(tempog):
    """``tempog simulate WORDS...``"""
    return partial(tempog, "simulate")


@pytest.mark.parametrize("suffix", [".npz", ".log"])
def test_a_written_log_reads_back_with_the_truth_beside_it(tempog, tmp_path, suffix):
    log = tmp_path / f"drive{suffix}"
    code, out, err = tempog("hallway", "-o", log, "--people", 5, "--seed", 3, "--duration", 90)
    assert (code, err) == (0, "")
    assert "900 scans in 1 min 30 s, 5 people, 8 doors" in out
    simulation = simulate(load_world("hallway"), 90.0, seed=3, people=5)
    read = open_scans(log)
    assert len(read) == 900
    for scan, made in zip(read, simulation.scans, strict=True):
        np.testing.assert_allclose(scan.angles, made.angles, atol=1e-9)
        np.testing.assert_allclose((scan.x, scan.y, scan.theta), (made.x, made.y, made.theta), atol=1e-6)
        returns = np.isfinite(made.ranges)
        np.testing.assert_allclose(scan.ranges[returns], made.ranges[returns], atol=1e-6)
        assert (scan.ranges[~returns] >= scan.max_range).all()
        assert abs(scan.stamp_ns - made.stamp_ns) <= 1000
    as_json, as_npz = truth_paths(log)
    truth = json.loads(as_json.read_text())
    assert [thing["name"] for thing in truth["things"]] == [f"D{k}" for k in range(1, 9)]
    states = [(state["from_s"], state["state"]) for state in truth["things"][0]["states"]]
    assert states == simulation.states("D1")
    with np.load(as_npz) as arrays:
        for name in ("t", "poses", "hits", "hit_things", "places", "corners", "people"):
            np.testing.assert_array_equal(arrays[name], getattr(simulation, name))


def test_the_answer_as_json_is_one_object(tempog, tmp_path):
    code, out, _ = tempog("hallway", "-o", tmp_path / "a.npz", "--duration", 1, "--json")
    assert code == 0
    assert json.loads(out)["n_scans"] == 10


def test_people_who_are_replayed_are_counted(tempog, tmp_path):
    (tmp_path / "walk.txt").write_text("0 1 2.0 2.0\n1 1 3.0 2.0\n0 2 5.0 2.0\n")
    world = tmp_path / "some.toml"
    world.write_text('[robot]\nwaypoints = [[0, 0]]\n[people]\nnumber = 3\n[[people.track]]\nfile = "walk.txt"\n')
    code, out, err = tempog(world, "-o", tmp_path / "a.npz", "--duration", 2)
    assert (code, err) == (0, "")
    assert "5 people (2 of them replayed), 0 doors" in out
    with np.load(truth_paths(tmp_path / "a.npz")[1]) as arrays:
        assert np.isfinite(arrays["people"][:, :, 0]).sum(axis=0).tolist() == [20, 20, 20, 11, 1]


def test_the_truth_in_files_says_where_beams_start_and_end(tempog, tmp_path):
    world = tmp_path / "some.toml"
    world.write_text(
        "[robot]\nwaypoints = [[0, 0], [2, 0]]\n[laser]\nsweep_s = 0.1\nn_beams = 9\n"
        "[people]\nnumber = 2\nlegs = true\n"
        "[[wall]]\nline = [[-2, -2], [4, -2], [4, 3], [-2, 3]]\nclosed = true\n"
        "[[glass]]\nline = [[2, 2], [3, 2]]\n"
    )
    log = tmp_path / "a.npz"
    assert tempog(world, "-o", log, "--duration", 20)[0] == 0
    as_json, as_npz = truth_paths(log)
    truth = json.loads(as_json.read_text())
    assert [wall["corners"] for wall in truth["walls"] if wall["glass"]] == [
        [[2, 1.99], [3, 1.99], [3, 2.01], [2, 2.01]]
    ]
    with np.load(as_npz) as arrays:
        moved = arrays["sweep_ends"] - arrays["poses"]
        moved[:, 2] = (moved[:, 2] + np.pi) % (2 * np.pi) - np.pi
        at = arrays["poses"][:, None] + np.linspace(0, 1, 9)[:, None] * moved[:, None]
        angles = at[..., 2] + truth["laser"]["angles_rad"]
        x = at[..., 0] + arrays["distances"] * np.cos(angles)
        y = at[..., 1] + arrays["distances"] * np.sin(angles)
        wall = arrays["hits"] == Hit.WALL
        to_wall = np.minimum(abs(x - 1) - (3 - 0.075), abs(y - 0.5) - (2.5 - 0.075))
        off = np.minimum(abs(abs(x - 1) - 2.925), abs(abs(y - 0.5) - 2.425))
        assert wall.sum() > 1000
        assert off[wall].max() < 1e-9
        assert to_wall[wall].max() < 1e-9
        person = np.argwhere(arrays["hits"] == Hit.PERSON)
        for scan, beam in person:  # legs swing a stride ahead of and behind the middle
            middles = arrays["people"][scan]
            assert np.hypot(middles[:, 0] - x[scan, beam], middles[:, 1] - y[scan, beam]).min() < 0.5
        assert len(person) > 10


def test_what_is_there_is_replaced_only_by_force(tempog, tmp_path):
    log = tmp_path / "a.npz"
    truth_paths(log)[0].write_text("mine")
    code, _, err = tempog("hallway", "-o", log, "--duration", 1)
    assert code == 1
    assert "a.npz.truth.json exists already; use --force" in err
    assert not log.exists()
    assert tempog("hallway", "-o", log, "--duration", 1, "--force")[0] == 0


def test_a_log_never_stands_beside_the_truth_about_another(tempog, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    log = tmp_path / "a.npz"
    assert tempog("hallway", "-o", log, "--duration", 1)[0] == 0
    monkeypatch.setattr("tempog.simulation.truth.write_truth", full)
    code, _, err = tempog("hallway", "-o", log, "--duration", 2, "--force")
    assert (code, "No space left" in err) == (1, True)
    assert len(open_scans(log)) == 20
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["hallway", "-o", "{tmp}/a.txt"], 2, "names no kind of log"),
        (["hallway", "-o", "{tmp}/none/a.npz"], 1, "is not a directory"),
        (["hallway", "-o", "{tmp}/dir.npz"], 1, "is a directory"),
        (["nowhere", "-o", "{tmp}/a.npz"], 1, "cannot read nowhere: No such file"),
        (["hallway", "-o", "{tmp}/a.npz", "--people", "-1"], 2, "--people"),
        (["hallway", "-o", "{tmp}/a.npz", "--duration", "0"], 2, "--duration 0"),
        (["hallway", "-o", "{tmp}/a.npz", "--duration", "inf"], 2, "--duration inf"),
        (["hallway", "-o", "{tmp}/a.npz", "--duration", "1e14"], 1, "not enough memory"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_message(tempog, tmp_path, words, code, message):
    (tmp_path / "dir.npz").mkdir()
    seen, out, err = tempog(*(word.format(tmp=tmp_path) for word in words))
    assert (seen, out) == (code, "")
    assert message in err
    assert "Traceback" not in err


def test_beams_that_a_carmen_log_cannot_hold_are_refused(tmp_path):
    uneven = Scan(1.0, (0, 0, 0), [0.0, 0.1, 0.3], [1.0, 1.0, 1.0], max_range=8.0)
    for scans in ([], [uneven]):
        with pytest.raises(ScanError, match=r"wanted at least one|evenly spaced"):
            write_carmen(tmp_path / "a.log", scans)
    with pytest.raises(ScanError, match="cannot write"):
        write_carmen(tmp_path / "none" / "a.log", [Scan(1.0, (0, 0, 0), [0.0], [1.0], max_range=8.0)])
