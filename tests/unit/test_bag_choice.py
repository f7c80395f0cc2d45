"""What is taken from a bag by itself, what is asked for, and what is said about both."""

from __future__ import annotations

import numpy as np
import pytest

from bags import (
    START_S,
    amcl_pose,
    moving,
    odometry,
    pose_at,
    room_scans,
    stamped_pose,
    sweep_messages,
    tf,
    transform,
    wall_distance,
    write_messages,
)
from tempog import ScanError, open_scans
from tempog.errors import ConfigError, TransformError
from tempog.ros.bag_writers import OutMessage
from tempog.ros.messages import Codec, point_cloud
from tempog.scans.bag_choice import BagChoice
from tempog.scans.rosbag import open_bag

CODEC = Codec("ros2")
TIMES = np.arange(-1, 25) / 10
ON_BASE = [tf(CODEC, transform(0, "base_link", "laser"), topic="/tf_static")]
SCANS = room_scans(20)


@pytest.fixture
def bag(tmp_path):
    """Writes messages, and gives the path."""

    def write(*messages):
        flat = [one for part in messages for one in (part if isinstance(part, list) else [part])]
        return write_messages(tmp_path / "run.mcap", flat)

    return write


def assert_placed(log, scans=SCANS, within_m=1e-5):
    assert len(log) == len(scans)
    assert [scan.stamp_ns for scan in log] == [scan.stamp_ns for scan in scans]
    assert max(np.nanmax(wall_distance(scan)) for scan in log) < within_m


def notes_of(log):
    return " | ".join(log.notes)


# ---- frames --------------------------------------------------------------------------------------


def test_odom_is_used_where_there_is_no_map_and_said_to_drift(bag):
    log = open_scans(bag(ON_BASE, moving(CODEC, TIMES), sweep_messages(CODEC, SCANS)))
    assert_placed(log)
    assert "placed in odom by transforms" in log.format
    assert "poses are in odom, which drifts" in notes_of(log)


def test_map_is_preferred_and_odom_named(bag):
    over = [tf(CODEC, transform(t, "map", "odom", x=100.0)) for t in TIMES]
    path = bag(ON_BASE, over, moving(CODEC, TIMES), sweep_messages(CODEC, SCANS))
    log = open_scans(path)
    assert log[0].x == pytest.approx(102)
    assert "others: --fixed-frame odom" in notes_of(log)
    assert_placed(open_scans(path, bag=BagChoice(fixed_frame="odom")))


def test_frames_with_a_robots_name_before_them_are_found(bag):
    base = [tf(CODEC, transform(0, "r1/base_link", "r1/laser"), topic="/r1/tf_static")]
    path = bag(
        base,
        moving(CODEC, TIMES, "r1/odom", "r1/base_link"),
        [tf(CODEC, transform(t, "r1/map", "r1/odom"), topic="/r1/tf") for t in TIMES],
        sweep_messages(CODEC, SCANS, "/r1/scan", "/r1/laser"),
    )
    log = open_scans(path)
    assert_placed(log)
    assert "placed in r1/map" in log.format


def test_a_root_of_another_name_is_used(bag):
    log = open_scans(bag(ON_BASE, moving(CODEC, TIMES, "vicon"), sweep_messages(CODEC, SCANS)))
    assert_placed(log)
    assert "placed in vicon" in log.format


def test_a_laser_that_stands_still_in_the_map(bag):
    log = open_scans(
        bag(tf(CODEC, transform(0, "map", "laser", 1.0), topic="/tf_static"), sweep_messages(CODEC, SCANS))
    )
    assert {scan.x for scan in log} == {1.0}


def test_static_transforms_that_are_said_again_and_again_move_nothing(bag):
    repeated = [tf(CODEC, transform(t, "base_link", "laser")) for t in TIMES]
    path = bag(repeated, [odometry(CODEC, t) for t in TIMES], sweep_messages(CODEC, SCANS))
    assert_placed(open_scans(path))
    with pytest.raises(TransformError, match="nothing says where laser was"):
        open_scans(bag(repeated, sweep_messages(CODEC, SCANS)))


def test_robots_in_maps_of_their_own_are_mapped_one_by_one(bag):
    path = bag(
        moving(CODEC, TIMES, "r1/odom", "r1/laser"),
        moving(CODEC, TIMES, "r2/odom", "r2/laser"),
        sweep_messages(CODEC, SCANS, "/r1/scan", "r1/laser"),
        sweep_messages(CODEC, SCANS, "/r2/scan", "r2/laser"),
    )
    with pytest.raises(ConfigError, match="no common frame") as caught:
        open_scans(path)
    assert "--scan-topic /r1/scan  (in r1/odom)\n  --scan-topic /r2/scan  (in r2/odom)" in str(caught.value)
    assert_placed(open_scans(path, bag=BagChoice(("/r2/scan",))))


def test_robots_whose_frames_have_the_same_names_are_not_mixed(bag):
    def robot(name, x_m):
        mounted = tf(CODEC, transform(0, "base_link", "laser"), topic=f"{name}/tf_static")
        placed = [tf(CODEC, transform(t, "map", "base_link", x_m), topic=f"{name}/tf") for t in TIMES]
        return [mounted, *placed, *sweep_messages(CODEC, SCANS, f"{name}/scan")]

    path = bag(robot("/r1", 1.0), robot("/r2", 2.0))
    with pytest.raises(ConfigError, match="robots whose frames have the same names") as caught:
        open_scans(path)
    assert "--scan-topic /r1/scan  (with /r1/tf)\n  --scan-topic /r2/scan  (with /r2/tf)" in str(caught.value)
    for name, x_m in (("/r1", 1.0), ("/r2", 2.0)):
        log = open_scans(path, bag=BagChoice((f"{name}/scan",)))
        assert {scan.x for scan in log} == {x_m}


def test_an_unknown_fixed_frame_lists_the_known(bag):
    path = bag(ON_BASE, moving(CODEC, TIMES), sweep_messages(CODEC, SCANS))
    with pytest.raises(
        ConfigError, match=r"no frame 'mpa'; there are base_link, laser, odom.\n  Use --fixed-frame odom"
    ):
        open_scans(path, bag=BagChoice(fixed_frame="mpa"))
    with pytest.raises(ConfigError, match=r"no frame 'bse' \(--base-frame\); there are base_link, laser, odom"):
        open_scans(path, bag=BagChoice(base_frame="bse"))


@pytest.mark.parametrize("frame", ["laser", "base_link"])
def test_a_fixed_frame_that_moves_with_the_robot_is_refused(bag, frame):
    path = bag(ON_BASE, moving(CODEC, TIMES), sweep_messages(CODEC, SCANS))
    with pytest.raises(ConfigError, match=r"laser never moves in it.\n  Use --fixed-frame odom"):
        open_scans(path, bag=BagChoice(fixed_frame=frame))


def test_a_chain_that_is_broken_says_where(bag):
    path = bag(
        tf(CODEC, transform(0, "torso", "laser"), topic="/tf_static"),
        moving(CODEC, TIMES),
        sweep_messages(CODEC, SCANS),
    )
    with pytest.raises(ConfigError, match="on one side are base_link, odom, on the other laser, torso"):
        open_scans(path, bag=BagChoice(fixed_frame="odom"))
    with pytest.raises(TransformError, match="frames: base_link, laser, odom, torso") as caught:
        open_scans(path)
    assert "with laser are connected: torso)" in str(caught.value)
    assert "--fixed-frame torso" in str(caught.value)
    assert "/tf_static, name it" not in str(caught.value)


def test_static_transforms_that_another_file_holds_are_asked_for(bag):
    with pytest.raises(
        TransformError, match=r"with laser are connected: none(.|\n)*another file.*/tf_static, name it"
    ):
        open_scans(bag(moving(CODEC, TIMES), sweep_messages(CODEC, SCANS)))


def test_scans_whose_header_names_no_frame_can_be_placed_by_poses(bag):
    path = bag(moving(CODEC, TIMES), sweep_messages(CODEC, SCANS, frame=""))
    with pytest.raises(TransformError, match="nothing says where a frame without a name was"):
        open_scans(path)
    poses = FromElsewhere(TIMES, [pose_at(t) for t in TIMES])
    assert_placed(open_scans(path, bag=BagChoice(trajectory=poses)))


def test_scans_that_say_nothing_are_noted(bag):
    near = sweep_messages(CODEC, SCANS)
    for one in near:
        one.message.range_min = 100.0
    assert "no beam of /scan says anything" in notes_of(open_scans(bag(ON_BASE, moving(CODEC, TIMES), near)))
    assert "says anything" not in notes_of(
        open_scans(bag(ON_BASE, moving(CODEC, TIMES), sweep_messages(CODEC, SCANS)))
    )


def test_transforms_of_another_time_are_told_of(bag):
    path = bag(ON_BASE, moving(CODEC, TIMES + 1000), sweep_messages(CODEC, SCANS))
    text = rf"20 of 20 scans.*connected from {START_S + 999.9:.3f}.*\n.*scans are from {START_S:.3f} to .*same clock"
    for skip_bad in (False, True):
        with pytest.raises(TransformError, match=text):
            open_scans(path, skip_bad=skip_bad)


def test_a_laser_that_leans_is_refused(bag):
    half = np.radians(20) / 2
    leaning = transform(0, "base_link", "laser")._replace(
        quaternion=(0.0, float(np.sin(half)), 0.0, float(np.cos(half)))
    )
    path = bag(tf(CODEC, leaning, topic="/tf_static"), moving(CODEC, TIMES), sweep_messages(CODEC, SCANS))
    with pytest.raises(TransformError, match="laser leans by up to 20 degrees, wanted 3 at most") as caught:
        open_scans(path)
    assert "--poses FILE --scan-topic /scan" in str(caught.value)
    assert "clock" not in str(caught.value)
    assert_placed(open_scans(path, bag=BagChoice(trajectory=FromElsewhere(TIMES, [pose_at(t) for t in TIMES]))))


# ---- topics --------------------------------------------------------------------------------------


def test_of_topics_with_the_same_sweeps_the_fullest_is_used(bag):
    path = bag(
        ON_BASE,
        moving(CODEC, TIMES),
        sweep_messages(CODEC, SCANS[::2], "/a_filtered"),
        sweep_messages(CODEC, SCANS, "/scan"),
    )
    log = open_scans(path)
    assert_placed(log)
    assert "/scan is used for laser, with 20 scans; others: --scan-topic /a_filtered (10 scans)" in notes_of(log)
    assert len(open_scans(path, bag=BagChoice(scan_topics=("/a_filtered",)))) == 10


def test_topics_of_one_frame_with_different_resolutions_must_be_chosen(bag):
    path = bag(
        ON_BASE,
        moving(CODEC, TIMES),
        sweep_messages(CODEC, SCANS, "/scan"),
        sweep_messages(CODEC, SCANS, "/coarse", every=2),
    )
    with pytest.raises(ScanError, match="different resolutions") as caught:
        open_scans(path)
    assert "--scan-topic /scan  (121 beams, 2.86 degrees apart, 20 scans)" in str(caught.value)
    assert "--scan-topic /coarse  (61 beams, 5.73 degrees apart, 20 scans)" in str(caught.value)
    assert len(open_scans(path, bag=BagChoice(scan_topics=("/coarse",)))[0].ranges) == 61


def test_a_topic_of_another_type_is_refused(bag):
    path = bag(ON_BASE, moving(CODEC, TIMES), sweep_messages(CODEC, SCANS))
    with pytest.raises(ConfigError, match=r"topic /tf holds tf2_msgs/msg/TFMessage; wanted sensor_msgs/LaserScan"):
        open_scans(path, bag=BagChoice(scan_topics=("/tf",)))
    with pytest.raises(ConfigError, match=r"topic /nope is not there; .*\n  Use --scan-topic /scan"):
        open_scans(path, bag=BagChoice(scan_topics=("/nope",)))
    with pytest.raises(
        ConfigError, match=r"topic /scan holds sensor_msgs/msg/LaserScan; wanted nav_msgs/Odometry or"
    ):
        open_scans(path, bag=BagChoice(pose_topic="/scan"))


# ---- poses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("pose_of", [odometry, amcl_pose, stamped_pose])
def test_a_topic_with_poses_takes_the_place_of_transforms(bag, pose_of):
    log = open_scans(bag(ON_BASE, [pose_of(CODEC, t) for t in TIMES], sweep_messages(CODEC, SCANS)))
    assert_placed(log)
    assert f"no transforms say where laser was: {pose_of(CODEC, 0).topic} does" in notes_of(log)
    assert ("taken as of base_link (--base-frame names another)" in notes_of(log)) == (pose_of is not odometry)


def test_where_odom_alone_is_connected_topics_of_localisation_are_named(bag):
    poses = [amcl_pose(CODEC, t) for t in TIMES]
    wish = amcl_pose(CODEC, 0, topic="/initialpose")
    path = bag(ON_BASE, moving(CODEC, TIMES), poses, wish, sweep_messages(CODEC, SCANS))
    notes = notes_of(open_scans(path))
    assert "drifts: walls may double | localisation may know better: --pose-topic /amcl_pose" in notes
    assert "initialpose" not in notes
    path = bag(ON_BASE, moving(CODEC, TIMES, "map"), poses, sweep_messages(CODEC, SCANS))
    assert "localisation" not in notes_of(open_scans(path))


def test_a_laser_without_transforms_is_taken_to_be_where_the_poses_are(bag):
    log = open_scans(bag([odometry(CODEC, t) for t in TIMES], sweep_messages(CODEC, SCANS)))
    assert_placed(log)
    assert "no transform says where laser is on base_link: taken as the same place" in notes_of(log)


def test_corrected_poses_are_preferred_where_they_cover_the_scans(bag):
    goals = [stamped_pose(CODEC, 0.5, topic="/goal_pose")]
    often = [odometry(CODEC, t) for t in TIMES]
    rarely = [amcl_pose(CODEC, t) for t in TIMES[::4]]
    log = open_scans(bag(goals, often, rarely, sweep_messages(CODEC, SCANS)))
    assert "placed in map by /amcl_pose" in log.format
    assert "others: --pose-topic /goal_pose or --pose-topic /odom" in notes_of(log)
    log = open_scans(bag(goals, often, rarely[:2], sweep_messages(CODEC, SCANS)))
    assert "placed in odom by /odom" in log.format


def test_a_pose_topic_is_used_in_place_of_transforms_when_asked_for(bag):
    wrong = [tf(CODEC, transform(t, "odom", "base_link", 50.0)) for t in TIMES]
    path = bag(ON_BASE, wrong, [odometry(CODEC, t, frame="world") for t in TIMES], sweep_messages(CODEC, SCANS))
    assert open_scans(path)[0].x == 50
    log = open_scans(path, bag=BagChoice(pose_topic="/odom"))
    assert_placed(log)
    assert "placed in world by /odom" in log.format


def test_poses_of_a_base_that_no_transform_knows_are_not_mixed_with_transforms(bag):
    wrong = [tf(CODEC, transform(t, "odom", "base_link", 50.0)) for t in TIMES]
    poses = [odometry(CODEC, t, frame="world", child="base_footprint") for t in TIMES]
    log = open_scans(bag(ON_BASE, wrong, poses, sweep_messages(CODEC, SCANS)), bag=BagChoice(pose_topic="/odom"))
    assert_placed(log)


def test_odometry_under_a_map_frame_gives_poses_in_the_map(bag):
    over = [tf(CODEC, transform(t, "map", "odom", x=100.0)) for t in TIMES]
    log = open_scans(bag(ON_BASE, over, [odometry(CODEC, t) for t in TIMES], sweep_messages(CODEC, SCANS)))
    assert "placed in map by /odom" in log.format
    assert log[0].x == pytest.approx(102)


def test_nothing_that_says_where_the_robot_was(bag):
    with pytest.raises(TransformError, match=r"nothing says where laser was: no transforms move it \(frames: none\)"):
        open_scans(bag(sweep_messages(CODEC, SCANS)))


class FromElsewhere:
    def __init__(self, times, poses):
        self.stamps_ns = np.array([SCANS[0].stamp_ns + round(t * 1e9) for t in times])
        self.poses = np.array(poses)
        self.source = "traj.tum"


def test_poses_from_elsewhere_are_of_the_laser_or_of_the_base(bag):
    mounted = [tf(CODEC, transform(0, "base_link", "laser", 0.5), topic="/tf_static")]
    path = bag(mounted, sweep_messages(CODEC, SCANS))
    poses = FromElsewhere(TIMES, [pose_at(t) for t in TIMES])
    log = open_scans(path, bag=BagChoice(trajectory=poses))
    assert_placed(log)
    assert "by traj.tum" in log.format
    assert "taken as of laser itself; if they are of the robot, --base-frame base_link" in notes_of(log)
    log = open_scans(path, bag=BagChoice(trajectory=poses, base_frame="base_link"))
    assert log[0].x == pytest.approx(2.5)


def test_poses_from_elsewhere_at_other_times_can_be_shifted(bag):
    path = bag(sweep_messages(CODEC, SCANS))
    for times in (TIMES + 1000, TIMES[:15]):
        poses = FromElsewhere(times, [pose_at(t) for t in times])
        with pytest.raises(TransformError, match="--pose-offset S adds") as caught:
            open_scans(path, bag=BagChoice(trajectory=poses))
        assert "--fixed-frame" not in str(caught.value)


def test_poses_from_elsewhere_are_of_one_laser(bag):
    path = bag(sweep_messages(CODEC, SCANS), sweep_messages(CODEC, SCANS, "/rear", "rear_laser"))
    poses = FromElsewhere(TIMES, [pose_at(t) for t in TIMES])
    with pytest.raises(
        ConfigError, match=r"there are 2.\n  Use --scan-topic /scan or --scan-topic /rear, or --base-frame"
    ):
        open_scans(path, bag=BagChoice(trajectory=poses))


def test_choices_that_contradict_each_other(bag):
    with pytest.raises(ConfigError, match="is no band"):
        BagChoice(from_cloud=(0.4, 0.2))
    with pytest.raises(ConfigError, match="take the place of"):
        BagChoice(trajectory=FromElsewhere([0], [(0, 0, 0)]), pose_topic="/odom")


# ---- clouds --------------------------------------------------------------------------------------


def cloud_messages(topic="/points", height_m=1.0, frame="lidar"):
    """Points on the walls, and before them at other heights, seen from a lidar `height_m` above the ground."""
    messages = []
    for scan in SCANS:
        x, y = scan.ranges * np.cos(scan.angles), scan.ranges * np.sin(scan.angles)
        layers = [
            np.column_stack([x * s, y * s, np.full(len(x), z - height_m)])
            for z, s in ((0.05, 0.3), (0.3, 1), (2, 0.6))
        ]
        points = np.vstack([*layers, [[np.nan, 0, 0]]])
        messages.append(OutMessage(topic, scan.stamp_ns, point_cloud(CODEC, scan.stamp_ns, frame, points)))
    return messages


def test_a_band_of_a_cloud_becomes_scans(bag):
    mounted = [tf(CODEC, transform(0, "base_link", "lidar", z=1.0), topic="/tf_static")]
    path = bag(mounted, moving(CODEC, TIMES), cloud_messages())
    log = open_scans(path, bag=BagChoice(from_cloud=(0.2, 0.4)))
    assert len(log[0].ranges) == 720
    assert np.isfinite(log[0].ranges).sum() == 121
    assert np.isnan(log[0].ranges).sum() == 599
    assert_placed(log, within_m=0.06)  # beams are half a degree wide
    assert "from 0.2 to 0.4 m above base_link" in notes_of(log)
    with pytest.raises(ScanError, match=r"no usable scan.*\n.*--from-cloud 0\.2:0\.4 --scan-topic /points"):
        open_scans(path)


def test_the_sensor_of_a_cloud_may_sit_anywhere_on_the_base(bag):
    # The lidar is 0.5 m ahead of the base and turned by half a right angle; heights are above the base all the same.
    mounted = [tf(CODEC, transform(0, "base_link", "lidar", 0.5, 0.2, np.pi / 4, z=1.0), topic="/tf_static")]
    inverse = []
    for t in TIMES:
        x, y, theta = pose_at(t)
        turn = theta - np.pi / 4
        inverse.append(
            tf(
                CODEC,
                transform(
                    t,
                    "odom",
                    "base_link",
                    x - np.cos(turn) * 0.5 + np.sin(turn) * 0.2,
                    y - np.sin(turn) * 0.5 - np.cos(turn) * 0.2,
                    turn,
                ),
            )
        )
    log = open_scans(bag(mounted, inverse, cloud_messages()), bag=BagChoice(from_cloud=(0.2, 0.4)))
    assert_placed(log, within_m=0.06)
    assert (log[5].x, log[5].y) == pytest.approx(pose_at(0.5)[:2])


def test_a_cloud_without_transforms_has_heights_of_its_own(bag):
    path = bag([odometry(CODEC, t, child="lidar") for t in TIMES], cloud_messages(height_m=0.0))
    log = open_scans(path, bag=BagChoice(from_cloud=(0.2, 0.4)))
    assert_placed(log, within_m=0.06)
    assert "heights are above lidar itself" in notes_of(log)


def test_one_of_several_clouds_must_be_chosen(bag):
    mounted = [tf(CODEC, transform(0, "base_link", "lidar", z=1.0), topic="/tf_static")]
    path = bag(mounted, moving(CODEC, TIMES), cloud_messages(), cloud_messages("/points_2"))
    with pytest.raises(ConfigError, match=r"--scan-topic /points  \(20 clouds\)\n  --scan-topic /points_2"):
        open_bag(path, BagChoice(from_cloud=(0.2, 0.4)))
    assert len(open_bag(path, BagChoice(("/points_2",), from_cloud=(0.2, 0.4)))[0]) == 20


def test_a_topic_of_clouds_needs_heights(bag):
    path = bag(moving(CODEC, TIMES), cloud_messages(), sweep_messages(CODEC, SCANS))
    with pytest.raises(
        ConfigError, match=r"holds clouds; wanted scans.\n.*--from-cloud 0\.2:0\.4 --scan-topic /points"
    ):
        open_scans(path, bag=BagChoice(("/points",)))


def test_rows_of_a_cloud_whose_length_is_not_said_follow_each_other(bag):
    messages = cloud_messages(height_m=0.0)
    for one in messages:
        one.message.height, one.message.width, one.message.row_step = 4, one.message.width // 4, 0
    path = bag([odometry(CODEC, t, child="lidar") for t in TIMES], messages)
    assert_placed(open_scans(path, bag=BagChoice(from_cloud=(0.2, 0.4))), within_m=0.06)


def test_a_cloud_that_is_none(bag):
    messages = cloud_messages()
    messages[3].message.fields = messages[3].message.fields[:2]
    messages[4].message.width = 1_000_000
    messages[5].message.fields[0].datatype = 2
    path = bag([odometry(CODEC, t, child="lidar") for t in TIMES], messages)
    with pytest.raises(
        ScanError, match=r"3 unusable: /points message 4.*a cloud with the fields x, y; wanted x, y and z"
    ):
        open_scans(path, bag=BagChoice(from_cloud=(-1, 1)))
    log = open_scans(path, bag=BagChoice(from_cloud=(-1, 1)), skip_bad=True)
    assert (len(log), log.n_skipped) == (17, 3)


def test_a_bag_without_clouds(bag):
    path = bag(ON_BASE, moving(CODEC, TIMES), sweep_messages(CODEC, SCANS))
    with pytest.raises(ScanError, match=r"holds no clouds .*leave --from-cloud out"):
        open_bag(path, BagChoice(from_cloud=(0.2, 0.4)))
