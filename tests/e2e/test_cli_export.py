"""``tempog export`` as a user calls it, on a simulated drive whose truth is known."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import textwrap
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree

from tempog import build_grid, find_objects, open_map, save_map
from tempog.export.map_server import read_nav2_map
from tempog.export.site_map import SiteMap, site_map
from tempog.simulation import PoseError, Simulation, corridor, load_world, simulate
from tempog.simulation.cell_sets import near
from tempog.simulation.truth import Truth

FILES = {
    f"{name}.{end}" for name in ("map", "localisation", "current", "keepout", "speed") for end in ("pgm", "yaml")
}
FILES |= {"objects.yaml", "filters.yaml"}


@pytest.fixture(scope="module")
def drive() -> Simulation:
    return simulate(load_world("rooms"), duration_s=400.0, seed=1, people=3)


@pytest.fixture(scope="module")
def rooms(drive: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "rooms.tempog"
    save_map(build_grid(drive.scans), path)
    return path


@pytest.fixture(scope="module")
def site(rooms: Path) -> SiteMap:
    return site_map(find_objects(open_map(rooms)))


@pytest.fixture
def tempog(tempog):
    """``tempog export WORDS...``"""
    return partial(tempog, "export")


def occupied(folder: Path, name: str) -> np.ndarray:
    """Lattice row and col of the occupied cells of a map."""
    read = read_nav2_map(folder / f"{name}.yaml")
    rows, cols = np.nonzero(read.cells == 100)
    return np.stack([rows + read.extent.row0, cols + read.extent.col0], axis=-1)


def test_maps_for_nav2_are_right(tempog, rooms: Path, drive: Simulation, tmp_path: Path) -> None:
    code, out, err = tempog(rooms, "--nav2", tmp_path / "site")
    assert (code, err) == (0, "")
    assert "5 doors" in out
    assert {path.name for path in (tmp_path / "site").iterdir()} == FILES
    assert [path.name for path in tmp_path.iterdir()] == ["site"]  # nothing unfinished
    truth, moving = Truth.of(drive), []
    walls = truth.static_cells(0.05)
    planning, localisation, current = (
        occupied(tmp_path / "site", name) for name in ("map", "localisation", "current")
    )
    assert near(truth.static_seen(0.05), planning).mean() > 0.99
    assert near(planning, walls).mean() > 0.97
    document = yaml.safe_load((tmp_path / "site/objects.yaml").read_text())
    doors = [one for one in document["objects"] if one["kind"] == "door"]
    for one in doors:
        for state in one["states"]:
            (hinge_x, hinge_y), (tip_x, tip_y) = state["leaf"]
            leaf = np.array(
                [[hinge_x + s * (tip_x - hinge_x), hinge_y + s * (tip_y - hinge_y)] for s in (0.3, 0.5, 0.7)]
            )
            cells = np.floor(leaf[:, ::-1] / 0.05).astype(np.int64)
            moving.append(cells)
            assert not near(cells, planning).any(), state  # the leaf is gone
            assert near(cells, localisation).all(), state
            assert near(cells, current).all() == (one["last"]["state"] == state["state"]), (one["last"], state)
    assert len(moving) >= 10


def test_doors_are_described_as_they_are(tempog, rooms: Path, drive: Simulation, tmp_path: Path) -> None:
    tempog(rooms, "--nav2", tmp_path / "site")
    document = yaml.safe_load((tmp_path / "site/objects.yaml").read_text())
    leaves = {
        (x, y): leaf for leaf in drive.world.things if leaf.kind == "hinged" for x, y, _ in leaf.places.values()
    }
    doors = [one for one in document["objects"] if one["kind"] == "door"]
    assert len(doors) == 5
    for one in doors:
        x, y = one["hinge"]
        (off_m, hinge) = min((np.hypot(x - a, y - b), (a, b)) for a, b in leaves)
        leaf = leaves[hinge]
        assert off_m < 0.1
        assert one["leaf_length"] == pytest.approx(leaf.length_m, abs=0.15)
        shut, *_ = leaf.places
        for state in one["states"]:
            at = np.array(state["centre"])
            name = min(leaf.places, key=lambda place: np.linalg.norm(leaf.corners(place).mean(axis=0) - at))
            assert state["blocks_way"] == (name == shut)
            assert len(state["outline"]) >= 4
        blocking = sum(state["share"] for state in one["states"] if state["blocks_way"])
        assert one["share_open"] == pytest.approx(1 - blocking / (1 - one["share_unclear"]), abs=1e-3)
        assert one["last"]["open"] in (True, False)
        truth = Truth.of(drive)
        k = [thing.name for thing in truth.things].index(leaf.name)
        seen_at = int(np.searchsorted(truth.stamps_s, one["last"]["last_seen_s"] - 0.25))
        assert one["last"]["open"] == (truth.places[seen_at, k] != 0)


def test_every_file_of_nav2_is_yaml_that_names_files_that_are_there(tempog, rooms: Path, tmp_path: Path) -> None:
    tempog(rooms, "--nav2", tmp_path / "site")
    parameters = yaml.safe_load((tmp_path / "site/filters.yaml").read_text())
    servers = [own["ros__parameters"] for own in parameters.values() if "ros__parameters" in own]
    files = [Path(own["yaml_filename"]) for own in servers if "yaml_filename" in own]
    assert sorted(path.name for path in files) == ["keepout.yaml", "localisation.yaml", "map.yaml", "speed.yaml"]
    assert all(path.parent == tmp_path / "site" and path.exists() for path in files)
    masks = {own["mask_topic"]: own for own in servers if "mask_topic" in own}
    assert {own["filter_info_topic"] for own in masks.values()} == {"/keepout_filter_info", "/speed_filter_info"}
    published = {"/" + own["topic_name"] for own in servers if "topic_name" in own}
    assert set(masks) <= published
    costmap = parameters["global_costmap"]["global_costmap"]["ros__parameters"]
    assert all(
        costmap[name]["filter_info_topic"] in {m["filter_info_topic"] for m in masks.values()}
        for name in costmap["filters"]
    )
    managed = parameters["lifecycle_manager_site"]["ros__parameters"]["node_names"]
    assert set(managed) <= set(parameters)
    tempog(rooms, "--nav2", tmp_path / "b", "--on-robot", "/opt/maps/b")
    assert 'yaml_filename: "/opt/maps/b/map.yaml"' in (tmp_path / "b/filters.yaml").read_text()


def test_masks_say_what_nav2s_filters_want(tempog, rooms: Path, drive: Simulation, tmp_path: Path) -> None:
    tempog(rooms, "--nav2", tmp_path / "site", "--swing-percent", 40, "--people-percent", 60)
    speed = read_nav2_map(tmp_path / "site/speed.yaml").cells
    assert set(np.unique(speed)) == {0, 40, 60}  # unknown would be an error to the filter
    keepout = read_nav2_map(tmp_path / "site/keepout.yaml").cells
    assert set(np.unique(keepout)) == {-1, 100}  # 0 would make unknown cells of the costmap free
    extent = read_nav2_map(tmp_path / "site/keepout.yaml").extent
    document = yaml.safe_load((tmp_path / "site/objects.yaml").read_text())
    for one in document["objects"]:
        for state in one["states"]:
            row, col = extent.index_of(*state["centre"])
            if state["blocks_way"] and state["share"] < 0.9:
                assert keepout[row, col] == -1  # a door that opens now and then stays passable
            if one["kind"] == "door" and state["blocks_way"]:
                assert speed[row, col] == 40


def test_nobody_walks_where_there_are_no_people(tmp_path: Path) -> None:
    alone = simulate(load_world("rooms"), duration_s=150.0, seed=1, people=0)
    from tempog.export.masks import busy_floor

    assert not busy_floor(site_map(find_objects(build_grid(alone.scans)))).any()


def test_people_slow_the_robot_down_where_they_walk(drive: Simulation, site: SiteMap) -> None:
    from tempog.export.masks import busy_floor

    busy = busy_floor(site)
    rows, cols = np.nonzero(busy)
    points = site.history.tiles.spec.centres(rows + site.extent.row0, cols + site.extent.col0)
    off_m, _ = cKDTree(drive.people.reshape(-1, 2)).query(points)
    assert busy.any()
    assert np.quantile(off_m, 0.99) < 1.1  # PEOPLE_MARGIN_M, a block's diagonal, and a person's radius


def test_a_moment_gives_the_state_of_then(tempog, rooms: Path, drive: Simulation, tmp_path: Path) -> None:
    assert tempog(rooms, "--nav2", tmp_path / "a", "--at", "+200").code == 0
    assert tempog(rooms, "--nav2", tmp_path / "b").code == 0
    then, now = (yaml.safe_load((tmp_path / name / "objects.yaml").read_text()) for name in "ab")
    assert then["at_s"] == now["from_s"] + 200
    assert [one["states"] for one in then["objects"]] == [one["states"] for one in now["objects"]]
    assert all(one["last"] is None or one["last"]["last_seen_s"] <= then["at_s"] for one in then["objects"])
    assert (tmp_path / "a/map.pgm").read_bytes() == (tmp_path / "b/map.pgm").read_bytes()
    assert (tmp_path / "a/current.pgm").read_bytes() != (tmp_path / "b/current.pgm").read_bytes()


def test_a_period_counts_alone(tempog, rooms: Path, tmp_path: Path) -> None:
    assert tempog(rooms, "--nav2", tmp_path / "a", "--from", "+100", "--to", "+250").code == 0
    document = yaml.safe_load((tmp_path / "a/objects.yaml").read_text())
    assert document["to_s"] - document["from_s"] == pytest.approx(150)
    assert document["at_s"] == document["to_s"]


def test_shares_in_scale_mode(tempog, rooms: Path, site: SiteMap, tmp_path: Path) -> None:
    assert tempog(rooms, "--nav2", tmp_path / "a", "--mode", "scale").code == 0
    read = read_nav2_map(tmp_path / "a/map.yaml").cells
    assert np.array_equal(read, site.with_shares(site.planning))
    assert len(np.unique(read)) > 20


def test_the_same_map_gives_the_same_bytes(tempog, rooms: Path, tmp_path: Path) -> None:
    digests = []
    for name in "ab":
        folder = tmp_path / name
        folder.mkdir()
        words = [("--npz", "l.npz"), ("--geojson", "o.json"), ("--mcap", "m.mcap")]
        paths = [word for flag, file in words for word in (flag, folder / file)]
        result = tempog(rooms, "--nav2", folder / "site", "--on-robot", "/maps", "--every", "50s", *paths)
        assert result.code == 0, result.err
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        digests.append({path.relative_to(folder): hashlib.sha256(path.read_bytes()).hexdigest() for path in files})
    assert digests[0] == digests[1]
    assert len(digests[0]) == len(FILES) + 3


def test_features_lie_where_objects_are(tempog, rooms: Path, site: SiteMap, tmp_path: Path) -> None:
    tempog(rooms, "--geojson", tmp_path / "o.geojson")
    document = json.loads((tmp_path / "o.geojson").read_text())
    assert (document["type"], document["units"]) == ("FeatureCollection", "metres")
    kinds = [feature["properties"]["what"] for feature in document["features"]]
    assert kinds.count("hinge") == 5
    n_states = sum(len(thing.one.configurations) for thing in site.things)
    assert kinds.count("state") == n_states
    for feature in document["features"]:
        coordinates = feature["geometry"]["coordinates"]
        if feature["properties"]["what"] == "state":
            ring = np.array(coordinates[0])
            assert ring[0].tolist() == ring[-1].tolist()
            x, y = ring[:-1].T
            area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
            assert area > 0  # anticlockwise, as RFC 7946 wants it
            assert np.hypot(*(ring.mean(axis=0) - feature["properties"]["centre"])) < 0.5
    assert sum(feature["properties"].get("now", False) for feature in document["features"]) > 0


def test_arrays_lie_over_their_axes(tempog, rooms: Path, site: SiteMap, tmp_path: Path) -> None:
    tempog(rooms, "--npz", tmp_path / "l.npz", "--xarray", tmp_path / "l.nc")
    with np.load(tmp_path / "l.npz") as arrays:
        assert arrays["planning"].shape == (len(arrays["y"]), len(arrays["x"]))
        assert np.array_equal(arrays["localisation"], site.localisation)
        objects = json.loads(str(arrays["objects"]))["objects"]
        row, col = np.argwhere(arrays["object"] == objects[0]["id"]).mean(axis=0)
        centre = np.mean([state["centre"] for state in objects[0]["states"]], axis=0)
        assert np.hypot(arrays["x"][round(col)] - centre[0], arrays["y"][round(row)] - centre[1]) < 1.0
        names = set(arrays.files)
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(tmp_path / "l.nc", engine="scipy") as dataset:
        assert names - set(dataset.variables) == {"bounds", "resolution", "at_ns"} | {"objects"}
        assert np.array_equal(dataset["planning"].values, site.planning)
        nearest = dataset["planning"].sel(x=1.0, y=1.0, method="nearest")
        assert int(nearest) == site.planning[site.extent.index_of(1.0, 1.0)]


def test_messages_come_back(tempog, rooms: Path, site: SiteMap, tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    make_reader = pytest.importorskip("mcap.reader").make_reader
    result = tempog(rooms, "--mcap", tmp_path / "m.mcap", "--every", "20")
    assert "21 snapshots, one every 20 s" in result.out
    messages: dict[str, list] = {}
    with highlevel.AnyReader([tmp_path / "m.mcap"]) as reader:
        stamps = []
        for connection, stamp_ns, raw in reader.messages():
            stamps.append(stamp_ns)
            messages.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
        qos = {connection.ext.offered_qos_profiles[0].durability.name for connection in reader.connections}
    assert stamps == sorted(stamps)
    assert qos == {"TRANSIENT_LOCAL"}
    with (tmp_path / "m.mcap").open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    # rosbag2 since Jazzy takes words where a file names no version; a number it takes for an unknown policy.
    assert all("durability: transient_local" in channel.metadata["offered_qos_profiles"] for channel in channels)
    for topic, cells in [
        ("/map", site.planning),
        ("/localisation_map", site.localisation),
        ("/current_map", site.current),
    ]:
        (grid,) = messages[topic]
        assert np.array_equal(grid.data.reshape(grid.info.height, grid.info.width), cells)
        assert (grid.info.origin.position.x, grid.info.origin.position.y) == (
            site.extent.bounds[0],
            site.extent.bounds[2],
        )
        assert grid.header.frame_id == "map"
    assert len(messages["/map_history"]) == 21
    first, last = messages["/map_history"][0], messages["/map_history"][-1]
    assert (first.data >= 0).sum() < (last.data >= 0).sum()  # what is known grows
    assert len(messages["/objects"]) == len(messages["/object_markers"])
    states = [json.loads(message.data) for message in messages["/objects"]]
    for thing in site.things:
        said = [one["state"] for state in states for one in state["objects"] if one["id"] == thing.one.id]
        seen = [state for k, state in enumerate(said) if k == 0 or state != said[k - 1]]
        stays = [stay.configuration for stay in thing.one.stays]
        assert [one for one in seen if one is not None or None in stays][-len(stays) :] == stays
    markers = messages["/object_markers"][-1].markers
    assert {marker.ns for marker in markers} == {"outline", "text"}
    assert len(markers) == 2 * len(site.things)


def test_ros_1_takes_the_same_grid(site: SiteMap) -> None:
    """Debian's own definitions of ROS Noetic read what our codec for ROS 1 writes."""
    pytest.importorskip("rosbags")
    script = textwrap.dedent(
        """
        import sys
        from nav_msgs.msg import OccupancyGrid
        grid = OccupancyGrid()
        grid.deserialize(sys.stdin.buffer.read())
        print(grid.info.width, grid.info.height, grid.info.origin.position.x, sum(grid.data), grid.header.stamp.secs)
        """
    )
    python = "/usr/bin/python3"
    probe = [python, "-c", "import nav_msgs.msg"]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    if not Path(python).exists() or subprocess.run(probe, capture_output=True, env=environment).returncode:
        pytest.skip("no ROS 1 messages for the system's Python")
    from tempog.ros.messages import Codec, occupancy_grid

    codec = Codec("ros1")
    x, _, y, _ = site.extent.bounds
    raw = codec.encode(occupancy_grid(codec, 1_750_000_000 * 10**9, "map", 0.05, (x, y), site.planning))
    done = subprocess.run([python, "-c", script], input=raw, capture_output=True, check=True, env=environment)
    n_rows, n_cols = site.extent.shape
    width, height, origin_x, total, sec = done.stdout.split()
    assert (int(width), int(height), int(total)) == (n_cols, n_rows, int(site.planning.astype(int).sum()))
    assert float(origin_x) == pytest.approx(x)
    assert int(sec) == 1_750_000_000


def test_nothing_is_overwritten_unless_told_to(tempog, rooms: Path, tmp_path: Path) -> None:
    (tmp_path / "site").mkdir()
    (tmp_path / "site/map.yaml").write_text("mine")
    (tmp_path / "site/robot.urdf").write_text("mine, too")
    result = tempog(rooms, "--nav2", tmp_path / "site")
    assert result.code == 1
    assert "map.yaml already; use --force" in result.err
    assert (tmp_path / "site/map.yaml").read_text() == "mine"
    assert tempog(rooms, "--nav2", tmp_path / "site", "--mode", "scale", "--force").code == 0
    assert tempog(rooms, "--nav2", tmp_path / "site", "--force").code == 0  # leaves no picture of the mode before
    assert {path.name for path in (tmp_path / "site").iterdir()} == FILES | {"robot.urdf"}
    assert (tmp_path / "site/robot.urdf").read_text() == "mine, too"
    assert [path.name for path in tmp_path.iterdir()] == ["site"]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ([], 2, "nothing to write; give one or more of --nav2 DIR"),
        (["--nav2", "{}/a", "--at", "+1", "--to", "+2"], 2, "give one or the other"),
        (["--npz", "{}/a.npz", "--mode", "scale"], 2, "--mode is for --nav2"),
        (["--npz", "{}/a.npz", "--every", "3"], 2, "--every is for --mcap"),
        (["--mcap", "{}/a.mcap", "--every", "no"], 2, "wanted seconds above 0"),
        (["--mcap", "{}/a.mcap", "--every", "-3s"], 2, "wanted seconds above 0"),
        (["--mcap", "{}/a.mcap", "--every", "1e-6"], 2, "makes more snapshots than there are scans"),
        (["--nav2", "{}/none/a"], 1, "is not a directory"),
        (["--nav2", "{}/a", "--at", "+1e6"], 1, "nothing is known of"),
        (["--nav2", "{}/a", "--at", "soon"], 2, "soon"),
        (["--nav2", "{}/a", "--from", "+1e6"], 1, "no scan between"),
        (["--nav2", "{}/a", "--session", "nobody"], 1, "nobody"),
    ],
)
def test_wrong_words(tempog, rooms: Path, tmp_path: Path, words: list[str], code: int, message: str) -> None:
    result = tempog(rooms, *(word.format(tmp_path) for word in words))
    assert result.code == code, result
    assert message in result.err
    assert not list(tmp_path.iterdir())


def test_a_folder_is_not_begun_if_it_cannot_be_finished(tempog, rooms, tmp_path: Path, monkeypatch) -> None:
    import tempog.export.nav2 as nav2

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(nav2, "objects_entry", full)
    result = tempog(rooms, "--nav2", tmp_path / "site")
    assert result.code == 1
    assert "No space left" in result.err
    assert not list(tmp_path.iterdir())


def test_a_missing_extra_is_said_before_the_work(tempog, rooms: Path, tmp_path: Path, monkeypatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "xarray", None)
    result = tempog(rooms, "--xarray", tmp_path / "a.nc")
    assert result.code == 1
    assert "pip install 'tempog[xarray]'" in result.err


def test_bad_poses_are_said(tempog, tmp_path: Path) -> None:
    world = replace(load_world("rooms"), pose_error=PoseError(drift_m=0.05, drift_rad=0.015))
    save_map(build_grid(simulate(world, duration_s=150.0, seed=2, people=0).scans), tmp_path / "bad.tempog")
    result = tempog(tmp_path / "bad.tempog", "--nav2", tmp_path / "site")
    assert result.code == 0
    assert "poses look inconsistent" in result.err
    assert "count as walls" in result.err
    assert tempog(tmp_path / "bad.tempog", "--nav2", tmp_path / "quiet", "-q").err == ""


def test_a_map_without_objects_is_exported_with_a_note(tempog, tmp_path: Path) -> None:
    path = tmp_path / "short.tempog"
    save_map(build_grid(simulate(corridor(seed=0), duration_s=10, seed=0).scans), path)
    result = tempog(
        path, "--nav2", tmp_path / "site", "--geojson", tmp_path / "o.json", "--mcap", tmp_path / "m.mcap"
    )
    assert result.code == 0, result.err
    assert "no object was found" in result.err
    planning, localisation = (read_nav2_map(tmp_path / f"site/{name}.yaml").cells for name in ("map", "localisation"))
    assert np.array_equal(planning, localisation)
    assert json.loads((tmp_path / "o.json").read_text())["features"] == []
    assert yaml.safe_load((tmp_path / "site/objects.yaml").read_text())["objects"] == []
