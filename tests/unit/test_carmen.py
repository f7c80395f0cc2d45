"""CARMEN logs: geometry, sensor maximum, bad lines, and the public logs."""

import gzip
import time
from pathlib import Path

import numpy as np
import pytest

from tempog.errors import ClockError, ConfigError, ScanError
from tempog.scans.carmen import read_carmen
from tempog.scans.laser_geometry import beam_angles, infer_sensor_max
from tempog.scans.open import open_scans

LASER_LOGS = Path(__file__).parents[2].parent / "shared" / "data" / "laser_logs"


def flaser(i, ranges=(1.0, 2.0, 3.0, 4.0, 5.0), name="FLASER", pose=None, stamp=None):
    x, y, theta = pose or (0.1 * i, 0.5, 0.25)
    numbers = " ".join(str(r) for r in ranges)
    stamp = 10 + 0.2 * i if stamp is None else stamp
    return f"{name} {len(ranges)} {numbers} {x} {y} {theta} 7 8 9 {stamp} host 99"


def robotlaser(i, ranges=(1.0, 2.0, 3.0), remissions=(), start=-0.5, resolution=0.5, maximum=30.0):
    r, e = " ".join(map(str, ranges)), "".join(f" {value}" for value in remissions)
    return (
        f"ROBOTLASER1 0 {start} 1.0 {resolution} {maximum} 0.01 0 {len(ranges)} {r} {len(remissions)}{e}"
        f" {0.1 * i} 0.5 0.25 7 8 9 0.1 0.2 0.3 0.4 0.5 {10 + 0.2 * i} host 99"
    )


@pytest.fixture
def write(tmp_path):
    def write(*lines, name="some.log"):
        path = tmp_path / name
        path.write_bytes(b"\n".join(line if isinstance(line, bytes) else line.encode() for line in lines) + b"\n")
        return path

    return write


def good(n_scans=10):
    return [flaser(i) for i in range(n_scans)]


# ---- reading -------------------------------------------------------------------------------------


def test_a_line_becomes_a_scan(write):
    scan = read_carmen(write("# a comment", "", flaser(3), "ODOM 0 0 0 0 0 0 1 host 1"))[0]
    assert scan.stamp_ns == 10_600_000_000
    assert (scan.x, scan.y, scan.theta) == (pytest.approx(0.3), 0.5, 0.25)
    np.testing.assert_array_equal(scan.ranges, [1, 2, 3, 4, 5])
    assert scan.label == "line 3"


def test_gzip_is_told_by_content(tmp_path):
    path = tmp_path / "plain-looking.log"
    path.write_bytes(gzip.compress("\n".join(good()).encode()))
    log = open_scans(path)
    assert len(log) == 10
    assert log.format == "CARMEN log, gzip: FLASER, 5 beams, sensor maximum 80 m"


def test_a_plain_file_named_gz_is_read(write):
    assert len(open_scans(write(*good(), name="odd.log.gz"))) == 10


def test_windows_line_ends_and_a_byte_order_mark_are_read(tmp_path):
    path = tmp_path / "windows.log"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(good()).encode())
    assert len(open_scans(path)) == 10


def test_the_rear_laser_is_read_on_request(write):
    path = write(*good(), flaser(0, [9.0, 9.0], name="RLASER"))
    assert read_carmen(path, laser="rear")[0].ranges.tolist() == [9.0, 9.0]
    assert len(read_carmen(path)) == 10


def test_an_unknown_laser_is_a_config_error(write):
    with pytest.raises(ConfigError, match="front or rear"):
        open_scans(write(*good()), laser="left")


def test_robotlaser_lines_carry_their_own_geometry(write):
    scan = read_carmen(write(robotlaser(2, remissions=(5, 6, 7))))[0]
    np.testing.assert_allclose(scan.angles, [-0.5, 0.0, 0.5])
    assert (scan.max_range, scan.stamp_ns, scan.y) == (30.0, 10_400_000_000, 0.5)
    assert scan.ranges.tolist() == [1.0, 2.0, 3.0]


def test_robotlaser_lines_win_over_the_same_sweeps_as_flaser(write):
    lines = [line for i in range(5) for line in (flaser(i), robotlaser(i))]
    log = read_carmen(write(*lines))
    assert [scan.max_range for scan in log] == [30.0] * 5
    assert log.notes[0].startswith("5 FLASER lines are left out in favour of ROBOTLASER1")


def test_a_stray_robotlaser_line_does_not_hide_the_flaser_lines(write):
    log = read_carmen(write(*[flaser(i) for i in range(9)], robotlaser(9)))
    assert len(log) == 9
    assert log.notes[0].startswith("1 ROBOTLASER1 lines are left out in favour of FLASER")


def test_message_types_unknown_to_carmen_are_noted(write):
    assert "WOBBLE" in read_carmen(write(*good(), "WOBBLE 1 2"), sensor_max_range=80).notes[0]


def test_ranges_may_be_nan_infinite_or_beyond_float32(write):
    scan = read_carmen(write(flaser(0, ["nan", "inf", "1e300", "-1"])))[0]
    np.testing.assert_array_equal(scan.ranges, [np.nan, np.inf, np.inf, -1])


# ---- geometry ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n_beams", "last_deg"), [(180, 89), (181, 90), (360, 89.5), (361, 90), (541, 90), (2, 0), (3, 90)]
)
def test_the_number_of_beams_decides_where_they_end(n_beams, last_deg):
    angles_deg = np.degrees(beam_angles(n_beams))
    assert angles_deg[[0, -1]] == pytest.approx([-90, last_deg])
    np.testing.assert_allclose(np.diff(angles_deg), 180 / (n_beams - n_beams % 2))


def test_a_single_beam_looks_ahead():
    assert beam_angles(1).tolist() == [0.0]


@pytest.mark.parametrize(("n_beams", "first_deg", "last_deg"), [(541, -135, 135), (540, -135, 134.5)])
def test_a_resolution_parameter_widens_the_view_and_is_noted(write, n_beams, first_deg, last_deg):
    path = write("PARAM laser_front_laser_resolution 0.5 1 host 1", flaser(0, [1.0] * n_beams))
    log = read_carmen(path, sensor_max_range=80)
    assert np.degrees(log[0].angles[[0, -1]]) == pytest.approx([first_deg, last_deg])
    assert "270 degrees: used" in log.notes[0]


def test_a_resolution_parameter_that_means_180_degrees_is_not_worth_a_note(write):
    path = write("PARAM laser_front_laser_resolution 0.5 1 host 1", flaser(0, [1.0] * 361))
    assert read_carmen(path, sensor_max_range=80).notes == ()


def test_a_resolution_beyond_a_full_turn_is_ignored_and_noted(write):
    path = write("PARAM laser_front_laser_resolution 2 1 host 1", flaser(0, [1.0] * 361))
    log = read_carmen(path, sensor_max_range=80)
    assert np.degrees(log[0].angles[0]) == pytest.approx(-90)
    assert "ignored" in log.notes[0]


def test_a_parameter_that_is_no_number_is_ignored_and_noted(write):
    log = read_carmen(write("PARAM robot_front_laser_max much 1 host 1", *good()))
    assert "'much'" in log.notes[0]
    assert log[0].max_range == 80.0


def test_the_rear_laser_has_its_own_parameters(write):
    lines = ["PARAM robot_front_laser_max 50 1 host 1", "PARAM robot_rear_laser_max 8 1 host 1"]
    log = read_carmen(write(*lines, flaser(0, name="RLASER")), laser="rear")
    assert log[0].max_range == 8.0


# ---- sensor maximum ------------------------------------------------------------------------------


def scans_with_no_return_at(value, n_scans=40, step_m=0.5):
    ranges = np.linspace(1, 30, 200, dtype=np.float32)
    ranges = np.tile(ranges, (n_scans, 1))
    ranges[:, :10] = value
    return list(ranges), [(step_m * i, 0.0) for i in range(n_scans)]


@pytest.mark.parametrize(("value", "expected"), [(50.0, 50.0), (51.14, 51.13), (79.99, 79.98), (81.83, 80.0)])
def test_the_sensor_maximum_is_where_readings_pile_up_but_80_m_at_most(value, expected):
    max_range, _ = infer_sensor_max(*scans_with_no_return_at(value))
    assert max_range == pytest.approx(expected)
    assert np.float32(value) >= max_range


def test_a_few_stray_readings_above_the_pile_up_do_no_harm():
    ranges, xy = scans_with_no_return_at(50.0)
    ranges[3][0] = 79.0
    assert infer_sensor_max(ranges, xy)[0] == 50.0


def test_a_wall_seen_by_a_robot_that_stands_still_is_no_sensor_maximum():
    assert infer_sensor_max(*scans_with_no_return_at(50.0, step_m=0.0))[0] == 80.0


def test_without_a_pile_up_the_sensor_reaches_80_m():
    assert infer_sensor_max(*scans_with_no_return_at(2.0))[0] == 80.0


def test_the_sensor_maximum_comes_from_the_parameter_without_a_note(write):
    log = read_carmen(write("PARAM robot_front_laser_max 80.99 1 host 1", *good()))
    assert (log[0].max_range, log.notes) == (80.99, ())


def test_an_assumed_sensor_maximum_is_noted(write):
    assert "80 m" in read_carmen(write(*good())).notes[0]


@pytest.mark.parametrize("line", [flaser(0), robotlaser(0), robotlaser(0, maximum=0)])
def test_a_given_sensor_maximum_overrides_the_log(write, line):
    path = write("PARAM robot_front_laser_max 50 1 host 1", line)
    assert read_carmen(path, sensor_max_range=12)[0].max_range == 12.0


def test_a_given_sensor_maximum_must_be_positive(write):
    with pytest.raises(ConfigError, match="sensor_max_range"):
        open_scans(write(*good()), sensor_max_range=float("nan"))


# ---- bad lines -----------------------------------------------------------------------------------

BAD_LINES = {
    "cut": (flaser(5)[:30], "announces 5 beams, so 16 fields were wanted; found .* cut short"),
    "name alone": ("FLASER", "ends before its number of beams"),
    "one reading too many": (flaser(5).replace("3.0", "3.0 3.0"), "16 fields were wanted; found 17"),
    "absurd count": (flaser(5).replace("FLASER 5", "FLASER 99999999"), "100000010 fields were wanted"),
    "endless count": (flaser(5).replace("FLASER 5", "FLASER " + "9" * 5000), "number of beams is '999"),
    "negative count": (flaser(5).replace("FLASER 5", "FLASER -5"), "number of beams is '-5'"),
    "no beams": (flaser(5, []), "number of beams is '0'"),
    "text in the ranges": (flaser(5, [1, "x", 3]), "reading 2 is 'x'"),
    "underscore in the ranges": (flaser(5, [1, "1_0", 3]), "reading 2 is '1_0'"),
    "text in the pose": (flaser(5, pose=("north", 0, 0)), "x is 'north'"),
    "nan pose": (flaser(5, pose=(0, "nan", 0)), "pose is .*nan"),
    "infinite pose": (flaser(5, pose=(0, 0, "inf")), "pose is .*inf"),
    "text as stamp": (flaser(5, stamp="noon"), "the stamp is 'noon'"),
    "no text": (flaser(5).encode().replace(b"host", b"h\xffst"), "is no text"),
    "no message": ("[1, 2, 3]", r"starts with '\[1,', which is no CARMEN message"),
    "too long": ("FLASER " + "1 " * 600_000, "is longer than 1,000,000 bytes"),
    "robotlaser in degrees": (robotlaser(5, resolution=180.0), "span 360 degrees|span 20626"),
    "robotlaser without maximum": (robotlaser(5, maximum=0), "--sensor-max-range"),
    "robotlaser cut": (robotlaser(5)[:40], "were wanted|ends before"),
    "robotlaser without angle": (robotlaser(5, start="nan"), "start_angle"),
}


@pytest.mark.parametrize(("line", "reason"), BAD_LINES.values(), ids=BAD_LINES.keys())
def test_a_bad_line_stops_with_path_line_and_remedy(write, line, reason):
    with pytest.raises(ScanError, match=rf"some\.log, line 6: .*({reason})(.|\n)*--skip-bad"):
        open_scans(write(*good(5), line, *good()[5:]))


@pytest.mark.parametrize("line", [line for line, _ in BAD_LINES.values()], ids=BAD_LINES.keys())
def test_skip_bad_leaves_the_line_out_counted_and_noted(write, line):
    log = open_scans(write(*good(5), line, *good()[5:]), skip_bad=True)
    assert (len(log), log.n_skipped) == (10, 1)
    assert any("skipped 1 unusable: line 6" in note for note in log.notes)


def test_many_skipped_lines_are_counted_but_only_the_first_are_listed(write):
    log = open_scans(write(*good(), *["FLASER 5"] * 50), skip_bad=True)
    assert log.n_skipped == 50
    assert any("line 11, line 12, line 13, line 14, line 15, ..." in note for note in log.notes)


def test_skip_bad_leaves_unusable_stamps_out(write):
    log = open_scans(write(*good(), flaser(10, stamp="nan"), flaser(11, stamp=1e300)), skip_bad=True)
    assert (len(log), log.n_skipped) == (10, 2)


def test_with_a_rate_no_stamp_is_bad(write):
    log = open_scans(write(*[flaser(i, stamp="nan") for i in range(4)]), clock="rate=5")
    assert [scan.stamp_ns for scan in log] == [0, 200_000_000, 400_000_000, 600_000_000]


def test_a_cut_gzip_file_is_refused(tmp_path):
    path = tmp_path / "cut.log.gz"
    path.write_bytes(gzip.compress("\n".join(good(2000)).encode())[:-3000])
    with pytest.raises(ScanError, match=r"cut\.log\.gz, after line \d+: the gzip file ends early(.|\n)*--skip-bad"):
        open_scans(path)


def test_skip_bad_keeps_what_a_cut_gzip_file_still_holds(tmp_path):
    path = tmp_path / "cut.log.gz"
    content = gzip.compress("\n".join(good(2000)).encode())
    path.write_bytes(content[: len(content) // 2])
    log = open_scans(path, skip_bad=True)
    assert 500 < len(log) < 1500
    assert log.n_skipped == 1


def test_a_damaged_gzip_file_is_refused(tmp_path):
    content = bytearray(gzip.compress("\n".join(good(2000)).encode()))
    content[-6] ^= 0xFF  # in the check sum
    path = tmp_path / "damaged.log.gz"
    path.write_bytes(content)
    with pytest.raises(ScanError, match="damaged"):
        open_scans(path)


def test_a_log_without_this_laser_says_what_it_saw_and_which_option_helps(write):
    with pytest.raises(ScanError, match=r"wanted FLASER .* saw RLASER 2, ODOM 1(.|\n)*--laser rear"):
        open_scans(write("ODOM 0 0 0 0 0 0 1 h 1", *[flaser(i, name="RLASER") for i in range(2)]))


def test_a_log_of_bad_lines_alone_says_so(write):
    with pytest.raises(ScanError, match=r"no usable scan(.|\n)*skipped 2 unusable"):
        open_scans(write("FLASER 5", "FLASER 6"), skip_bad=True)


# ---- files that are no CARMEN logs ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x00\x01\x02garbage" * 100, "no known scan log: it starts with"),
        (b"time,x,y\n1,2,3\n", "no known scan log: it starts with 'time,x,y"),
        (b"#ROSBAG V2.0\n", "no usable scan: wanted sensor_msgs/LaserScan"),
        (b"\x89MCAP0\r\n", "damaged: it ends in the middle"),
        (b"SQLite format 3\x00", "SQLite says"),
        (gzip.compress(b"#ROSBAG V2.0\n"), r"a ROS 1 bag, gzipped\.\n  Unpack it first"),
        (gzip.compress(b""), "holds nothing readable"),
        (b"\x1f\x8b", "holds nothing readable"),
        (b"PK\x05\x06" + bytes(18), "no array t"),
        (b"PK\x03\x04garbage", "cannot be read as .npz"),
    ],
)
def test_unknown_content_is_refused_by_what_it_is(tmp_path, content, message):
    path = tmp_path / "thing"
    path.write_bytes(content)
    with pytest.raises(ScanError, match=message):
        open_scans(path)


def test_unknown_content_is_told_what_is_readable(tmp_path):
    path = tmp_path / "thing.bag"
    path.write_bytes(b"\x00" * 100)
    with pytest.raises(ScanError, match=r"CARMEN logs(.|\n)*npz"):
        open_scans(path)


@pytest.mark.parametrize("read", [open_scans, read_carmen])
def test_a_folder_a_missing_file_and_an_impossible_name_are_scan_errors(read, tmp_path):
    for path in (tmp_path, tmp_path / "absent.log", tmp_path / "a\0b"):
        with pytest.raises(ScanError):
            read(path)


# ---- the public logs -----------------------------------------------------------------------------


def public_log(name):
    path = LASER_LOGS / f"{name}-corrected.log.gz"
    if not path.exists():
        pytest.skip("the public laser logs are not on this machine (../shared/data)")
    return path


@pytest.mark.parametrize(
    ("name", "n_scans", "n_beams", "max_range"),
    [
        ("freiburg-079", 4791, 360, 80.99),
        ("intel", 910, 180, 80.0),
        ("aces", 440, 180, 50.0),
        ("acapulco", 861, 181, 50.0),  # 863 readings of exactly 50.00 m, the others at 51.1..51.25
        ("seattle", 241, 361, 80.0),
    ],
)
def test_the_public_logs_are_read_whole(name, n_scans, n_beams, max_range):
    log = open_scans(public_log(name))
    assert len(log) == n_scans
    assert {len(scan.ranges) for scan in log} == {n_beams}
    assert {scan.max_range for scan in log} == {max_range}
    assert log.n_skipped == 0


def test_the_four_steps_back_of_intel_are_sorted_and_noted():
    log = open_scans(public_log("intel"))
    assert (np.diff([scan.stamp_ns for scan in log]) > 0).all()
    assert log.notes[0].startswith("4 of 910 scans step back in time, by up to 0.86 s")


def test_the_rounded_clock_of_csail_is_refused():
    with pytest.raises(ClockError, match=r"404 of 406 scans repeat(.|\n)*--clock rate=5"):
        open_scans(public_log("csail"))


def test_csail_is_read_at_a_rate():
    log = open_scans(public_log("csail"), clock="rate=5")
    assert (len(log), log[0].max_range, log.duration_s) == (406, 50.0, 81.0)


def test_the_longest_public_log_is_read_in_seconds():
    path = public_log("freiburg-079")
    start = time.perf_counter()
    open_scans(path)
    assert time.perf_counter() - start < 5  # 0.3 s on two cores of 2023; the rest is for busy machines
