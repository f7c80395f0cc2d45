"""Worlds as TOML files: what they may say, what they may not, and when things in them move."""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from clearance import assert_nobody_overlaps
from tempog.errors import TempogError, WorldError
from tempog.simulation import Hit, Route, Thing, Wall, World, load_world, simulate
from tempog.simulation.overlaps import overlap
from tempog.simulation.polygons import disc_gap, leg_gap
from tempog.simulation.schedules import Dwell, Listed, Recorded, Weekly
from tempog.simulation.tracks import read_tracks

ROOM = """
duration_s = 20.0
[robot]
waypoints = [[1.0, 1.0], [4.0, 1.0]]
[[wall]]
line = [[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [0.0, 3.0]]
thickness_m = 0.2
closed = true
"""
DOOR = "\n[door.D1]\nhinge = [2.0, 3.1]\nplaces = { closed = 0, open = 90, half = 45 }\n"
SLIDING = "\n[door.S]\nclosed = [4.0, 3.0]\nopen = [5.0, 3.0]\ndirection_deg = 0\n"
BOX = "\n[box.B]\nsize_m = [0.4, 0.3]\nplaces = { here = [1.0, 2.3, 0], there = [4.0, 2.3, 30] }\n"


@pytest.fixture
def load(tmp_path):
    def load(text):
        path = tmp_path / "some.toml"
        path.write_text(text, encoding="utf-8")
        return load_world(path)

    return load


def area(wall):
    x, y = np.array(wall.corners).T
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def covered(world, point):
    return any(disc_gap(point, np.array(wall.corners)) == 0 for wall in world.walls)


def test_a_closed_line_becomes_walls_that_fill_their_corners(load):
    world = load(ROOM)
    assert [area(wall) for wall in world.walls] == pytest.approx([6.2 * 0.2, 3.2 * 0.2] * 2)
    assert covered(world, (-0.09, -0.09))
    assert covered(world, (6.09, 3.09))
    assert not covered(world, (0.11, 0.11))


def test_a_door_cuts_the_wall_it_closes(load):
    world = load(ROOM + DOOR)
    assert covered(world, (1.95, 3.0))
    assert not covered(world, (2.05, 3.0))
    assert not covered(world, (2.85, 3.0))
    assert covered(world, (2.95, 3.0))


def test_the_thickness_of_a_leaf_lies_behind_the_face_that_leads(load):
    (door,) = load(ROOM + DOOR).things
    np.testing.assert_allclose(door.corners("closed"), [(2, 3.1), (2.9, 3.1), (2.9, 3.05), (2, 3.05)], atol=1e-9)
    np.testing.assert_allclose(door.corners("open"), [(2, 3.1), (2, 4.0), (2.05, 4.0), (2.05, 3.1)], atol=1e-9)


def test_an_open_sliding_leaf_is_hidden_in_the_wall(load):
    world = load(ROOM + SLIDING)
    (leaf,) = world.things
    assert not covered(world, (4.45, 3.0))
    assert all(covered(world, tuple(corner)) for corner in leaf.corners("open"))


def test_an_opening_is_cut_and_a_block_is_a_wall(load):
    world = load(ROOM + "[[opening]]\nfrom = [2, 0]\nto = [3, 0]\n[[wall]]\ncorners = [[2, 2], [2.3, 2], [2, 2.3]]\n")
    assert not covered(world, (2.5, 0.0))
    assert covered(world, (3.05, 0.0))
    assert covered(world, (2.1, 2.1))


def test_glass_cuts_the_wall_it_stands_in(load):
    world = load(
        ROOM
        + "[[glass]]\nline = [[2, 3], [3, 3], [3, 2]]\npass_share = 0.5\nthickness_m = 0.03\nseen_within_deg = 25\n"
    )
    assert [(pane.start, pane.end) for pane in world.glass] == [((2, 3), (3, 3)), ((3, 3), (3, 2))]
    pane = world.glass[0]
    assert (pane.pass_share, pane.thickness_m, pane.seen_within_deg) == (0.5, 0.03, 25)
    assert not covered(world, (2.5, 3.0))
    assert covered(world, (1.95, 3.0))


def test_the_hallway_is_the_papers():
    world = load_world("hallway")
    assert [thing.name for thing in world.things] == [f"D{k}" for k in range(1, 9)]
    assert [len(thing.places) for thing in world.things] == [3] + [2] * 7
    xs = [x for wall in world.walls for x, _ in wall.corners]
    assert 36 < max(xs) - min(xs) < 40


def test_a_box_has_its_places_at_its_middle(load):
    (box,) = load(ROOM + BOX).things
    assert box.corners("there").mean(axis=0) == pytest.approx((4.0, 2.3))
    assert box.initial == "here"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROOM + "[windows]\n", ["windows", "no known key", "opening"]),
        (ROOM.replace("closed =", "shut ="), ["wall[0].shut", "no known key"]),
        (ROOM + "[laser]\nbeams = 3\n", ["laser.beams", "n_beams"]),
        (ROOM + "[laser]\nn_beams = 3.5\n", ["laser.n_beams", "3.5", "whole"]),
        (ROOM + "[laser]\ndropout = 2.0\n", ["dropout = 2.0"]),
        (ROOM + "[pose_error]\nwhite_m = -1.0\n", ["pose_error.white_m", "-1.0"]),
        (ROOM + "[people]\nnumber = -3\n", ["people.number", "-3"]),
        (ROOM + "[people]\nspeed_m_s = [2.0, 1.0]\n", ["people.speed_m_s", "[2.0, 1.0]"]),
        (ROOM.replace("4.0, 1.0]]", "6.0, 1.0]]"), ["robot.waypoints", "number 1", "(6.0, 1.0)", "(6.00, 1.50) m"]),
        (ROOM.replace("4.0, 1.0]]", "4.0, 9.0]]"), ["robot.waypoints", "the way from", "(3.00, 3.00) m"]),
        (ROOM.replace("4.0, 1.0]]", "1.0, 1.0]]"), ["robot.waypoints", "numbers 0 and 1"]),
        (ROOM.replace("waypoints", "ways"), ["robot.waypoints is missing"]),
        (ROOM.replace("0.2", "0.0"), ["wall[0].thickness_m", "0.0"]),
        (ROOM.replace("[6.0, 0.0]", "[0.0, 0.0]"), ["wall[0].line", "(0.0, 0.0)", "no area"]),
        (ROOM + "[[wall]]\ncorners = [[2, 2], [3, 2], [4, 2]]\n", ["wall[1]", "(3.00, 2.00) m", "no area"]),
        (ROOM + "[[wall]]\ncorners = [[2, 2], [4, 2], [2.5, 2.2], [2, 3]]\n", ["wall[1]", "not convex"]),
        (ROOM + "[[opening]]\nfrom = [2, 1]\nto = [3, 1]\n", ["opening[0]", "(2.0, 1.0)", "no wall"]),
        (ROOM + DOOR + 'initial = "ajar"\n', ["door.D1.initial", "'ajar'", "closed, open, half"]),
        (ROOM + DOOR + 'schedule.moves = [[3, "ajar"]]\n', ["door.D1.schedule", "'ajar'", "closed, open, half"]),
        (ROOM + DOOR + "schedule.dwell_s = { ajar = 5 }\n", ["door.D1.schedule", "'ajar'"]),
        (ROOM + DOOR + "schedule.dwell_s = { open = 0 }\n", ["door.D1.schedule.dwell_s.open", "0.0"]),
        (ROOM + DOOR + 'schedule.moves = [[5, "open"], [3, "closed"]]\n', ["door.D1.schedule.moves", "order"]),
        (ROOM + DOOR + 'schedule.moves = ["open"]\n', ["door.D1.schedule.moves[0]", "'open'"]),
        (ROOM + DOOR + 'schedule.daily = [["25:00", "open"]]\n', ["door.D1.schedule.daily", "'25:00'"]),
        (ROOM + DOOR + "schedule = { moves = [], dwell_s = {} }\n", ["door.D1.schedule", "moves and dwell_s"]),
        (ROOM + DOOR + "schedule.weekly.sun2 = []\n", ["door.D1.schedule.weekly.sun2", "no known key"]),
        (ROOM + DOOR + 'schedule.series = "none.txt"\n', ["door.D1.schedule.series", "none.txt", "No such file"]),
        (ROOM + DOOR.replace("hinge", "pin"), ["door.D1", "hinge", "direction_deg"]),
        (ROOM + DOOR.replace("open =", "moving ="), ["door.D1.places", '"moving"']),
        (ROOM + DOOR + "length_m = 0\n", ["door.D1", "length_m = 0.0"]),
        (
            ROOM + BOX.replace("4.0, 2.3", "4.0, 1.2") + 'schedule.moves = [[5, "there"]]\n',
            ["box.B.schedule", "'there'", "(4.00, 1.20) m", "onto the robot at waypoint 1"],
        ),
        (
            ROOM
            + '[door.X]\nhinge = [1.0, 1.5]\nplaces = { open = 90, closed = 270 }\nschedule.moves = [[9, "closed"]]',
            ["door.X.schedule", "'closed'", "onto the robot at waypoint 0"],
        ),
        (ROOM + '[[people.track]]\nfile = "none.txt"\n', ["people.track[0].file", "none.txt", "No such file"]),
        (ROOM + "[[people.track]]\nrate_hz = 16\n", ["people.track[0].file is missing"]),
        (ROOM + "[[people.track]]\nfile = 'some.toml'\nrate = 16\n", ["people.track[0].rate", "no known key"]),
        (ROOM + "[[people.track]]\nfile = 'some.toml'\nrate_hz = 0\n", ["people.track[0]", "rate_hz = 0.0"]),
        (
            ROOM + "[[people.track]]\nfile = 'some.toml'\n",
            ["people.track[0]", "line 2 is 'duration_s", "t x y"],
        ),
        (
            ROOM + "[[people.track]]\nfile = 'some.toml'\ncolumns = ['t', 'x']\n",
            ["people.track[0]", "columns = ['t', 'x']", "once each"],
        ),
        (ROOM + "[[glass]]\nline = [[2, 2], [3, 2]]\npass = 1\n", ["glass[0].pass", "no known key", "pass_share"]),
        (ROOM + "[[glass]]\nline = [[2, 2], [3, 2]]\npass_share = 2\n", ["glass[0]", "pass_share = 2.0"]),
        (ROOM + "[laser]\nsweep_s = 0.2\n", ["sweep_s = 0.2", "10 scans a second", "0.1 s"]),
        (ROOM + "[people]\nlegs = 1\n", ["people.legs", "true or false"]),
        (
            ROOM + "[people]\ngoals = [[1, 2], [5.96, 2]]\n",
            ["people.goals", "number 1", "(5.96, 2.0)", "lies in a wall", "the nearest place"],
        ),
        (
            ROOM + "[people]\ngoals = [[5, 2]]\n[[wall]]\nline = [[4.6, 0], [4.6, 3]]\n",
            ["people.goals", "number 0", "(5.0, 2.0)", "cannot be walked to", "(1.0, 1.0)"],
        ),
        (
            ROOM + BOX.replace("4.0, 2.3", "2.5, 1.2") + 'schedule.moves = [[5, "there"]]\n',
            ["box.B.schedule", "leaves it at 'there'", "(2.50, 1.20) m", "never pass", "(1.0, 1.0) to (4.0, 1.0)"],
        ),
        (
            ROOM + BOX.replace("1.0, 2.3", "2.5, 1.2"),
            ["box.B.schedule", "leaves it at 'here'", "never pass"],
        ),
        (
            ROOM + BOX.replace("4.0, 2.3", "2.5, 1.2") + "schedule.dwell_s = { there = 5 }\n",
            ["box.B.schedule", "leaves it at 'there'"],
        ),
        (
            ROOM + BOX.replace("1.0, 2.3", "1.2, 1.2"),
            ["box.B.schedule", "'here'", "onto the robot at waypoint 0"],
        ),
        (
            ROOM + "[[wall]]\nline = [[2, 3], [4, 3]]\n",
            ["wall[1] lies along wall[0] for 2.00 m", "(3.00, 3.00) m", "meet"],
        ),
        (
            ROOM + "[[wall]]\nline = [[2, 2.1], [4, 2.3]]\n[[wall]]\nline = [[3, 2.2], [5, 2.4]]\n",
            ["wall[2] lies along wall[1] for 1.0"],
        ),
        (
            ROOM + "[[wall]]\ncorners = [[2, 2], [3, 2], [3, 2.8], [2, 2.8]]\n"
            "[[wall]]\ncorners = [[2.5, 1.8], [3.5, 1.8], [3.5, 2.6], [2.5, 2.6]]\n",
            ["wall[2] overlaps wall[1] by 0.50 m", "(2.75, 2.30) m", "0.15 m"],
        ),
        (
            ROOM + "[[wall]]\ncorners = [[2, 2.5], [3, 2.5], [3, 3.5], [2, 3.5]]\n"
            "[[wall]]\nline = [[2, 2.7], [3.5, 2.7]]\nthickness_m = 0.15\n"
            "[[wall]]\ncorners = [[2.5, 2.6], [3.2, 2.6], [3.2, 2.65], [2.5, 2.65]]\n",
            ["wall[3] lies along wall[2] for 0.70 m"],
        ),
        ("x = [", ["cannot read", "some.toml"]),
    ],
)
def test_what_a_file_cannot_say_is_refused_with_file_key_and_place(load, text, words):
    with pytest.raises(WorldError) as caught:
        load(text)
    assert isinstance(caught.value, TempogError)
    for word in ["some.toml", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "walls",
    [
        "[[wall]]\nline = [[3, 2], [3, 3]]\n",  # T
        "[[wall]]\nline = [[2, 2], [3, 2], [3, 2.8]]\n[[wall]]\nline = [[2.5, 1.7], [2.5, 2.5]]\n",  # L and a cross
        "[[wall]]\nline = [[2, 2], [2.5, 2], [3, 2], [3.5, 2.05], [4, 2.2]]\n",  # a bend
        "[[wall]]\nline = [[2, 2], [3, 2]]\n[[wall]]\nline = [[3, 2], [4, 2]]\n",  # end to end
        "[[wall]]\nline = [[2, 2], [4, 2]]\n[[wall]]\nline = [[2, 2.3], [4, 1.7]]\n",  # at 17 degrees
        # a column in a wall
        "[[wall]]\nline = [[2, 2], [4, 2]]\n[[wall]]\ncorners = [[3, 1.8], [3.4, 1.8], [3.4, 2.2], [3, 2.2]]\n",
    ],
)
def test_walls_may_meet_and_cross(load, walls):
    assert len(load(ROOM + walls).walls) > 4


def test_what_two_polygons_have_in_common_is_what_it_should_be():
    box = np.array(Wall.box(0.0, 0.0, 2.0, 1.0).corners)
    beside, over = Wall.box(3.0, 0.0, 5.0, 1.0), Wall.box(1.5, 0.25, 3.5, 1.25)
    assert len(overlap(box, np.array(beside.corners))) < 3
    for other in (np.array(over.corners), np.array(over.corners)[::-1]):
        common = overlap(box, other)
        assert common.min(axis=0).tolist() == [1.5, 0.25]
        assert common.max(axis=0).tolist() == [2.0, 1.0]
    diamond = ((1.0, -0.7), (2.2, 0.5), (1.0, 1.7), (-0.2, 0.5))  # cuts a triangle off each corner of the box
    assert area(Wall(tuple(overlap(box, np.array(diamond)).tolist()))) == pytest.approx(2.0 - 4 * 0.3**2 / 2)


def test_a_door_may_close_across_the_way_for_a_while(load):
    across = "[door.X]\nhinge = [2.5, 1.5]\nplaces = { open = 90, closed = 270 }\n"
    world = load(ROOM + across + 'schedule.moves = [[4, "closed"], [9, "open"]]\n')
    x = simulate(world, 25.0).poses[:, 0]
    assert x.max() > 3.9
    load(ROOM + across + "schedule.dwell_s = { open = 5, closed = 5 }\n")
    load(ROOM + across + 'schedule.daily = [["08:00", "closed"], ["09:00", "open"]]\n')
    with pytest.raises(WorldError, match=r"door\.X\.schedule leaves it at 'closed'.*for good"):
        load(ROOM + across + 'schedule.daily = [["08:00", "closed"]]\n')


def test_a_file_that_is_not_there_is_refused_with_the_worlds_that_are(tmp_path):
    with pytest.raises(WorldError, match=r"(?s)nowhere\.toml: No such file.*Packaged worlds: hallway"):
        load_world(tmp_path / "nowhere.toml")


def test_a_directory_called_like_a_packaged_world_is_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("hallway", "random"):
        (tmp_path / name).mkdir()
    assert load_world("hallway").name == "hallway"
    assert load_world("random", 3).name == "random 3"


def test_a_world_is_called_like_its_file_unless_it_says_otherwise(tmp_path):
    (tmp_path / "flat.toml").write_text(ROOM)
    assert load_world(tmp_path / "flat.toml").name == "flat"
    (tmp_path / "flat.toml").write_text('name = "my flat"\n' + ROOM)
    assert load_world(tmp_path / "flat.toml").name == "my flat"


def test_worlds_made_in_python_are_checked_too():
    with pytest.raises(WorldError, match="no area"):
        World(Route(((0.0, 0.0),)), (Wall(((1.0, 1.0), (2.0, 2.0), (3.0, 3.0))),))
    box = Thing("B", "box", 0.4, 0.4, {"here": (3.0, 0.0, 0.0)})
    with pytest.raises(WorldError, match=r"box\.B is there twice"):
        World(Route(((0.0, 0.0),)), things=(box, box))
    with pytest.raises(WorldError, match=r"box\.B has no place 'there'"):
        box.corners("there")


def test_the_gap_between_a_way_and_a_polygon_is_what_it_should_be():
    box = np.array(Wall.box(0.0, 0.0, 2.0, 1.0).corners)
    assert leg_gap((-1.0, 0.5), (3.0, 0.5), box) == 0  # right through
    assert leg_gap((0.5, 0.5), (0.6, 0.5), box) == 0  # inside
    assert leg_gap((-5.0, 3.0), (9.0, 3.0), box) == pytest.approx(2.0)
    assert leg_gap((3.0, -4.0), (3.0, 9.0), box[::-1]) == pytest.approx(1.0)
    assert disc_gap((5.0, 5.0), box) == pytest.approx(5.0)


def test_the_world_in_the_readme_runs(load):
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    world = load(readme.split("```toml\n")[1].split("```")[0])
    simulation = simulate(world, 60.0)
    assert {Hit.GLASS, Hit.PERSON, Hit.DOOR} <= set(simulation.hits.ravel().tolist())
    assert_nobody_overlaps(simulation)
    assert simulation.poses[:, 0].max() > 6.9


# --- recorded people ---

ROWS = """# frame person x z y
10 1 0.0 9 0.0
10 2 5.0 9 1.0 extra

20, 1, 1.0, 9, 0.0  # commas, too
30 2 5.0 9 3.0
"""


def test_recorded_people_are_replayed_where_and_when_the_options_say(load, tmp_path):
    (tmp_path / "rows.txt").write_text(ROWS)
    options = """
[[people.track]]
file = "rows.txt"
columns = ["t", "person", "x", "-", "y"]
"""
    first, second = load(ROOM + options).people.tracks
    np.testing.assert_array_equal(first.samples, [(10, 0, 0), (20, 1, 0)])
    np.testing.assert_array_equal(second.samples, [(10, 5, 1), (30, 5, 3)])
    options += "rate_hz = 20\nscale = 0.1\nrotation_deg = 90\noffset = [2, 1]\nstart_s = 3\n"
    world = load(ROOM + options)
    np.testing.assert_allclose(world.people.tracks[0].samples, [(3.0, 2.0, 1.0), (3.5, 2.0, 1.1)])
    np.testing.assert_allclose(world.people.tracks[1].samples, [(3.0, 1.9, 1.5), (4.0, 1.7, 1.5)])
    simulation = simulate(world, 5.0)
    assert np.isfinite(simulation.people[:, 1, 0]).sum() == 11


def test_rows_of_three_are_one_person_and_may_be_packed(tmp_path):
    path = tmp_path / "walk.txt.gz"
    path.write_bytes(gzip.compress(b"0 1 2\n4 3 2\n"))
    (track,) = read_tracks(path)
    assert track.positions([1.0, 5.0]).tolist()[0] == [1.5, 2.0]


def test_a_person_whose_times_do_not_rise_is_refused_with_the_line(tmp_path):
    path = tmp_path / "walk.txt"
    path.write_text("0 1 2\n4 3 2\n4 3 3\n")
    with pytest.raises(WorldError, match=r"walk.txt, line 3 is at t = 4, after .* t = 4; wanted rising"):
        read_tracks(path)
    path.write_text("# nothing\n")
    with pytest.raises(WorldError, match="no rows"):
        read_tracks(path)


# --- schedules ---


def moves(schedule, duration_s=1000.0, seed=0, places=("closed", "open", "wide")):
    return schedule.moves(places, "closed", duration_s, np.random.default_rng(seed))


def test_listed_moves_are_made_until_the_end():
    assert moves(Listed(((1.0, "open"), (4.0, "closed"), (7.0, "open"))), 7.0) == [(1.0, "open"), (4.0, "closed")]


def test_dwell_times_have_their_means_and_follow_the_seed():
    dwell = Dwell({"closed": 30.0, "open": 10.0})
    made = moves(dwell, 200_000.0)
    t, places = np.array([t for t, _ in made]), [place for _, place in made]
    assert set(places[::2]) == {"open"}
    stays = np.diff(t)
    assert stays[::2].mean() == pytest.approx(10.0, rel=0.1)
    assert stays[1::2].mean() == pytest.approx(30.0, rel=0.1)
    assert made == moves(dwell, 200_000.0)
    assert made != moves(dwell, 200_000.0, seed=1)


def test_with_three_places_every_one_is_gone_to():
    assert {place for _, place in moves(Dwell(dict.fromkeys(("closed", "open", "wide"), 5.0)))} == {
        "closed",
        "open",
        "wide",
    }


def test_a_daily_pattern_repeats_and_a_day_of_the_week_may_differ(load):
    text = 'schedule = { daily = [["08:00", "open"], ["18:00", "closed"]], weekly.tue = [], start = "mon 07:00" }\n'
    (door,) = load(ROOM + DOOR + text).things
    made = door.schedule.moves(list(door.places), "closed", 3 * 86400.0, np.random.default_rng(0))
    assert [(t / 3600, place) for t, place in made] == [(1, "open"), (11, "closed"), (49, "open"), (59, "closed")]


def test_a_week_begins_again():
    weekly = Weekly(((0.0, "open"), (60.0, "closed")), start_s=7 * 86400.0 - 30.0)
    assert moves(weekly, 200.0) == [(30.0, "open"), (90.0, "closed")]


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("lines", ["0\n0\n1\n1\n0\n", "100 0\n160 0\n220 1\n280 1\n340 0\n"])
def test_a_recorded_door_moves_as_it_did(load, tmp_path, lines, packed):
    data = lines.encode()
    (tmp_path / "door.txt").write_bytes(gzip.compress(data) if packed else data)
    (door,) = load(ROOM + DOOR + 'schedule = { series = "door.txt", speed = 10 }\n').things
    assert isinstance(door.schedule, Recorded)
    assert moves(door.schedule) == [(12.0, "open"), (24.0, "closed")]


@pytest.mark.parametrize("lines", ["0\n2\n", "5 1\n4 0\n", "one\n", "1 2 3\n", ""])
def test_a_damaged_recording_is_refused_with_its_place(load, tmp_path, lines):
    (tmp_path / "door.txt").write_text(lines)
    with pytest.raises(WorldError, match=r"door\.D1\.schedule\.series: .*door\.txt"):
        load(ROOM + DOOR + 'schedule.series = "door.txt"\n')


def test_angles_in_files_are_degrees(load):
    world = load(ROOM + "[pose_error]\nwhite_deg = 0.5\n[laser]\nfov_deg = 270\n")
    assert world.laser.fov_rad == pytest.approx(1.5 * math.pi)
    assert world.pose_error.white_rad == pytest.approx(math.radians(0.5))
