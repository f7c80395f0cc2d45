"""The truth about a log: kept whole, read back the same, refused where it is not one, and cut to a period."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tempog.errors import EmptyWindowError, TruthError
from tempog.simulation import Crowd, Glass, Hit, Laser, Route, Wall, World, load_world, simulate
from tempog.simulation.truth import ARRAYS, ThingTruth, Truth, WallTruth, read_truth, truth_paths, write_truth


@pytest.fixture(scope="module")
def simulation():
    return simulate(load_world("hallway"), 30.0, people=5)


@pytest.fixture
def log(simulation, tmp_path):
    write_truth(tmp_path / "drive.npz", simulation)
    return tmp_path / "drive.npz"


def facing_a_wall(distance=2.0, **changes):
    """Three beams, 0.1 rad apart, at a wall whose face is x = 2 m; one scan a second, nothing else."""
    angles = np.array([-0.1, 0.0, 0.1])
    distances = np.tile(distance / np.cos(angles), (4, 1))
    fields = {
        "world": "wall",
        "start_s": 100.0,
        "walls": (WallTruth(np.array([(2.0, -1.0), (2.2, -1.0), (2.2, 1.0), (2.0, 1.0)])),),
        "things": (),
        "angles": angles,
        "max_range_m": 8.0,
        "person_radius_m": 0.25,
        "t": np.arange(4.0),
        "poses": np.zeros((4, 3)),
        "sweep_ends": np.zeros((4, 3)),
        "distances": distances,
        "hits": np.full((4, 3), Hit.WALL, dtype=np.uint8),
        "hit_things": np.full((4, 3), -1, dtype=np.int16),
        "places": np.empty((4, 0), dtype=np.int16),
        "corners": np.empty((4, 0, 4, 2)),
        "people": np.empty((4, 0, 2)),
    }
    return Truth(**(fields | changes))


@pytest.mark.parametrize("suffix", ["", ".truth.json", ".truth.npz"])
def test_the_truth_reads_back_as_it_was(simulation, log, suffix):
    truth, read = Truth.of(simulation), read_truth(f"{log}{suffix}")
    for name in (*ARRAYS, "angles"):
        np.testing.assert_array_equal(getattr(read, name), getattr(truth, name))
        assert getattr(read, name).dtype == getattr(truth, name).dtype
    for name in ("world", "start_s", "max_range_m", "person_radius_m"):
        assert getattr(read, name) == getattr(truth, name)
    assert [(t.name, t.kind, list(t.places)) for t in read.things] == [
        (t.name, t.kind, list(t.places)) for t in truth.things
    ]
    for one, two in zip(read.things, truth.things, strict=True):
        np.testing.assert_array_equal(list(one.places.values()), list(two.places.values()))
    for one, two in zip(read.walls, truth.walls, strict=True):
        np.testing.assert_array_equal(one.corners, two.corners)
    assert [read.states(k) for k in range(8)] == [simulation.states(f"D{k}") for k in range(1, 9)]
    np.testing.assert_array_equal(read.static_cells(0.1), simulation.static_cells(0.1))


def test_people_who_are_not_there_are_kept(simulation, tmp_path):
    people = simulation.people.copy()
    people[:100, 0] = np.nan
    write_truth(tmp_path / "a.log", replace(simulation, people=people))
    np.testing.assert_array_equal(read_truth(tmp_path / "a.log").people, people)


def change(key, value):
    def damage(as_json, as_npz):
        document = json.loads(as_json.read_text())
        if value is None:
            del document[key]
        else:
            document[key] = value
        as_json.write_text(json.dumps(document))

    return damage


def drop_array(as_json, as_npz):
    with np.load(as_npz) as arrays:
        kept = {name: arrays[name] for name in arrays if name != "hits"}
    np.savez(as_npz, **kept)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda j, n: j.unlink(), r"cannot read .*drive.npz.truth.json: No such file.*tempog simulate writes"),
        (lambda j, n: n.unlink(), r"cannot read .*drive.npz.truth.npz: No such file"),
        (lambda j, n: j.write_text("{"), "is no JSON"),
        (lambda j, n: j.write_bytes(b"\xff\xfe\x00"), "is no JSON"),
        (lambda j, n: j.write_text("[]"), "is no truth about a log"),
        (change("format", None), 'wanted "format": "tempog-truth"'),
        (change("version", 2), "has version 2, this tempog reads 1"),
        (change("walls", None), "lacks 'walls'"),
        (change("walls", [{"corners": [[1, 2]]}]), r"corners \[\[1, 2\]\] are no polygon"),
        (change("things", [7]), "is damaged"),
        (change("things", []), r"array places has shape \(300, 8\).*speaks of \(300, 0\)"),
        (lambda j, n: n.write_bytes(b"PK no archive"), "is no archive of arrays"),
        (lambda j, n: n.write_bytes(n.read_bytes()[:3000]), "is no archive of arrays"),
        (drop_array, "hits"),
    ],
)
def test_what_is_no_truth_is_refused(log, damage, words):
    damage(*truth_paths(log))
    with pytest.raises(TruthError, match=words):
        read_truth(log)


def test_a_window_holds_the_scans_from_start_to_stop(simulation):
    truth = Truth.of(simulation)
    window = truth.window(truth.start_s + 2.0, truth.start_s + 3.0)
    np.testing.assert_allclose(window.t, np.arange(20, 31) / 10)
    for name in ARRAYS:
        assert len(getattr(window, name)) == 11
    with pytest.raises(
        EmptyWindowError, match=r"no scan from 5\.000 s to 6\.000 s; the truth covers 1750000000\.000"
    ):
        truth.window(5.0, 6.0)


def test_what_was_seen_of_a_wall_is_where_beams_ended_on_it():
    truth = facing_a_wall()
    # The beams end at y = -0.2007, 0 and 0.2007 on the face x = 2.0 m, the border of two cells: inside it.
    assert truth.static_seen(0.1).tolist() == [[-3, 20], [0, 20], [2, 20]]
    assert len(truth.static_cells(0.1)) == 2 * 20
    nothing = facing_a_wall(hits=np.zeros((4, 3), dtype=np.uint8))
    assert nothing.static_seen(0.1).shape == (0, 2)


def test_glass_is_no_wall_to_be_found():
    wall, pane = ([(x, -1.0), (x + 0.2, -1.0), (x + 0.2, 1.0), (x, 1.0)] for x in (2.0, 2.15))
    truth = facing_a_wall(walls=(WallTruth(np.array(wall)), WallTruth(np.array(pane), glass=True)))
    assert set(truth.static_cells(0.1)[:, 1].tolist()) == {20, 21}
    assert set(truth.static_cells(0.1, glass=True)[:, 1].tolist()) == {22, 23}
    assert len(replace(truth, walls=truth.walls[1:]).static_seen(0.1)) == 0


def test_beams_of_a_sweep_start_one_after_the_other():
    # The laser turns from 3 to -3 rad, the shorter way, by 2 pi - 6, and moves 0.2 m.
    poses, ends = np.tile([0.0, 0.0, 3.0], (4, 1)), np.tile([0.2, 0.0, -3.0], (4, 1))
    x, y, angle = facing_a_wall(poses=poses, sweep_ends=ends).beams()
    np.testing.assert_allclose(x, np.tile([0.0, 0.1, 0.2], (4, 1)))
    np.testing.assert_allclose(y, 0.0)
    np.testing.assert_allclose(angle, np.tile([2.9, math.pi, 2 * math.pi - 2.9], (4, 1)))


def test_the_truth_about_a_swept_drive_among_glass_reads_back_and_beams_end_where_the_simulation_says(tmp_path):
    walls = tuple(
        Wall.box(*box) for box in [(-2, -2, 4, -1.8), (-2, 2, 4, 2.2), (-2, -1.8, -1.8, 2), (3.8, -1.8, 4, 2)]
    )
    world = World(
        Route(((0.0, 0.0), (2.0, 0.0))),
        walls,
        people=Crowd(2, legs=True),
        laser=Laser(n_beams=31, sweep_s=0.1),
        glass=(Glass((2.0, 1.0), (3.0, 1.0)),),
    )
    simulation = simulate(world, 20.0)
    write_truth(tmp_path / "a.npz", simulation)
    truth = read_truth(tmp_path / "a.npz")
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(truth, name), getattr(simulation, name))
    assert [wall.glass for wall in truth.walls] == [False] * 4 + [True]
    np.testing.assert_array_equal(truth.walls[4].corners, world.glass[0].corners)
    assert (truth.sweep_ends != truth.poses).any()
    hit = np.nonzero(np.isfinite(truth.distances))
    np.testing.assert_allclose(truth.ends(*hit), simulation.end_points[hit], atol=2e-6)
    assert (truth.hits == Hit.GLASS).any()


def test_states_name_places_and_moves():
    places = np.array([[0], [-1], [1], [1]], dtype=np.int16)
    door = ThingTruth("D", "hinged", {"closed": np.eye(4, 2), "open": np.eye(4, 2)})
    truth = facing_a_wall(things=(door,), places=places)
    assert truth.states(0) == [(100.0, "closed"), (101.0, "moving"), (102.0, "open")]
    assert math.isclose(truth.stamps_s[-1], 103.0)
