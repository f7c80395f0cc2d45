"""Scans from and to .npz, and what is said about archives that hold something else."""

import zipfile

import numpy as np
import pytest

from tempog.errors import ClockError, ConfigError, ScanError
from tempog.scans.npz import read_npz, write_npz
from tempog.scans.open import open_scans
from tempog.scans.scan import Scan

N_SCANS, N_BEAMS = 4, 3


@pytest.fixture
def arrays():
    return {
        "t": 100 + 0.1 * np.arange(N_SCANS),
        "x": np.arange(N_SCANS) * 0.5,
        "y": np.zeros(N_SCANS),
        "theta": np.full(N_SCANS, 0.25),
        "angles": np.array([-0.5, 0.0, 0.5]),
        "ranges": np.arange(1.0, 1 + N_SCANS * N_BEAMS).reshape(N_SCANS, N_BEAMS),
        "max_range": 30.0,
    }


@pytest.fixture
def save(tmp_path):
    def save(arrays):
        path = tmp_path / "scans.npz"
        np.savez(path, **arrays)
        return path

    return save


def test_every_array_reaches_the_scans(save, arrays):
    log = read_npz(save(arrays))
    assert len(log) == N_SCANS
    scan = log[2]
    assert (scan.stamp_ns, scan.x, scan.y, scan.theta) == (100_200_000_000, 1.0, 0.0, 0.25)
    assert (scan.max_range, scan.label) == (30.0, "row 2")
    np.testing.assert_array_equal(scan.angles, [-0.5, 0.0, 0.5])
    np.testing.assert_array_equal(scan.ranges, [7, 8, 9])
    assert log.notes == ()


def test_open_scans_recognises_an_archive_whatever_its_name(save, arrays, tmp_path):
    path = save(arrays).rename(tmp_path / "scans.log")
    assert open_scans(path).format == "npz arrays: 3 beams, sensor maximum 30 m"


def test_the_rear_laser_of_an_archive_is_noted_to_be_no_choice(save, arrays):
    assert "one laser" in open_scans(save(arrays), laser="rear").notes[0]


@pytest.mark.parametrize("name", ["t", "x", "y", "theta", "angles", "ranges", "max_range"])
def test_a_missing_array_is_named(save, arrays, name):
    del arrays[name]
    with pytest.raises(ScanError, match=f"no array {name}.*holds"):
        read_npz(save(arrays))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("t", 5.0, r"array t has shape \(\); wanted: t"),
        ("t", np.zeros(0), r"array t has shape \(0,\)"),
        ("x", np.zeros(3), r"array x has shape \(3,\); wanted \(4,\)"),
        ("angles", np.zeros((3, 1)), r"array angles has shape \(3, 1\)"),
        ("ranges", np.zeros((3, 4)), r"array ranges has shape \(3, 4\); wanted \(4, 3\)"),
        ("max_range", np.zeros(4), r"array max_range has shape \(4,\)"),
    ],
)
def test_a_wrong_shape_is_shown_beside_the_wanted_one(save, arrays, name, value, message):
    with pytest.raises(ScanError, match=message):
        read_npz(save(arrays | {name: value}))


@pytest.mark.parametrize("value", [np.array(["a"] * 4), np.zeros(4, dtype=complex), np.array([None] * 4)])
def test_text_complex_numbers_and_objects_are_no_stamps(save, arrays, value):
    with pytest.raises(ScanError, match=r"array t holds .*; wanted real numbers"):
        read_npz(save(arrays | {"t": value}))


def test_a_sensor_maximum_of_zero_is_refused(save, arrays):
    with pytest.raises(ScanError, match=r"max_range is 0\.0"):
        read_npz(save(arrays | {"max_range": 0.0}))


def test_a_given_sensor_maximum_replaces_a_missing_one(save, arrays):
    del arrays["max_range"]
    assert read_npz(save(arrays), sensor_max_range=12)[0].max_range == 12.0


def test_a_given_sensor_maximum_must_be_positive(save, arrays):
    with pytest.raises(ConfigError, match="sensor_max_range"):
        read_npz(save(arrays), sensor_max_range=-1)


def test_an_angle_that_is_no_number_is_refused(save, arrays):
    arrays["angles"][1] = np.nan
    with pytest.raises(ScanError, match="nan at beam 1"):
        read_npz(save(arrays))


def test_ranges_may_be_nan_infinite_or_beyond_float32(save, arrays):
    arrays["ranges"][0] = [np.nan, np.inf, 1e300]
    np.testing.assert_array_equal(read_npz(save(arrays))[0].ranges, [np.nan, np.inf, np.inf])


def test_a_bad_pose_stops_at_its_row(save, arrays):
    arrays["theta"][2] = np.inf
    with pytest.raises(ScanError, match=r"row 2: the pose is \(1\.0, 0\.0, inf\).*\n.*--skip-bad"):
        read_npz(save(arrays))


def test_skip_bad_leaves_bad_poses_and_stamps_out(save, arrays):
    arrays["theta"][2] = np.inf
    arrays["t"][0] = np.nan
    log = read_npz(save(arrays), skip_bad=True)
    assert [scan.label for scan in log] == ["row 1", "row 3"]
    assert log.n_skipped == 2
    assert "row 2, row 0" in log.notes[0]


def test_a_bad_stamp_is_a_clock_error(save, arrays):
    arrays["t"][1] = np.nan
    with pytest.raises(ClockError, match="row 1"):
        read_npz(save(arrays))


def test_a_rate_makes_up_for_bad_stamps(save, arrays):
    arrays["t"][:] = np.nan
    assert read_npz(save(arrays), clock="rate=5").scan_period_s == 0.2


def test_rows_come_in_time_order(save, arrays):
    arrays["t"] = arrays["t"][::-1]
    assert [scan.label for scan in read_npz(save(arrays), clock="sort")] == [
        "row 3",
        "row 2",
        "row 1",
        "row 0",
    ]


def test_a_cut_archive_is_refused(save, arrays):
    path = save(arrays)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(ScanError, match="damaged or cut short"):
        read_npz(path)


def test_a_header_that_claims_more_than_the_file_holds_is_refused_before_memory_is_taken(save, arrays):
    path = save(arrays)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    honest, huge = b"'shape': (4,), }" + b" " * 8, b"'shape': (400000000,), }"
    members["x.npy"] = members["x.npy"].replace(honest, huge)
    assert huge in members["x.npy"]
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(ScanError, match=r"array x claims shape \(400000000,\)"):
        read_npz(path)


def test_written_scans_read_back_the_same(tmp_path):
    angles = np.linspace(-1, 1, 5)
    scans = [Scan(1e9 + i, (0.1 * i, -1.0, 3.0), angles, [1.0, np.nan, np.inf, 0.0, 2.5 + i], 20.0) for i in range(6)]
    path = tmp_path / "out.npz"
    write_npz(path, scans)
    for before, after in zip(scans, read_npz(path), strict=True):
        assert (before.stamp_ns, before.x, before.theta) == (after.stamp_ns, after.x, after.theta)
        np.testing.assert_array_equal(before.ranges, after.ranges)
        np.testing.assert_array_equal(before.angles, after.angles)


def test_nothing_but_the_archive_is_left_behind(tmp_path):
    write_npz(tmp_path / "out.npz", [Scan(1.0, (0, 0, 0), [0.0], [1.0], 9.0)])
    assert [path.name for path in tmp_path.iterdir()] == ["out.npz"]


def test_scans_of_two_sensors_are_not_written_together(tmp_path):
    scans = [Scan(float(n), (0, 0, 0), np.zeros(n), np.ones(n), 9.0) for n in (2, 3)]
    with pytest.raises(ScanError, match=r"scan 1 .* 3 beams"):
        write_npz(tmp_path / "out.npz", scans)
    assert not list(tmp_path.iterdir())


def test_no_scans_are_not_written(tmp_path):
    with pytest.raises(ScanError, match="no scans"):
        write_npz(tmp_path / "out.npz", [])


def test_a_place_that_cannot_be_written_is_a_scan_error(tmp_path):
    with pytest.raises(ScanError, match="cannot write"):
        write_npz(tmp_path / "absent" / "out.npz", [Scan(1.0, (0, 0, 0), [0.0], [1.0], 9.0)])
