"""Which lasers of a recording to map, and what says where they were: chosen, with what else there is as flags."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError, ScanError, TransformError
from tempog.ros.messages import LASER_SCAN, POINT_CLOUD, POSE_WITH_COVARIANCE, StampedTransform, Sweep, yawed
from tempog.ros.transforms import TransformBuffer
from tempog.scans.bag_choice import BagChoice, Poses
from tempog.scans.bag_contents import POSE_TYPES, STATIC_TOPIC, TRANSFORM_TYPES, Contents, Recording, read_poses

# Frames that do not move with the robot, best first: one that localisation corrects, one that drifts (REP 105).
MAP_FRAME, ODOM_FRAME = "map", "odom"
FIXED_FRAMES = (MAP_FRAME, ODOM_FRAME, "world", "earth")
NO_POSES = ("goal", "initialpose", "target", "waypoint")  # wishes, on topics that hold PoseStamped as well
FRAME_OF_POSES = "the frame of the poses"  # that are from elsewhere, and name none
ENOUGH_SHARE = 0.9  # of the scans must have a pose, for corrected poses to be taken before others
SAME_STEP_SHARE = 0.01  # of the angle between beams; topics closer than that say the same sweeps


@dataclass(frozen=True)
class Laser:
    """One laser: its topic, its frame, and its sweeps with their labels."""

    topic: str
    frame: str
    sweeps: list[tuple[str, Sweep]] = field(repr=False)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Of the sweeps."""
        return np.array([sweep.stamp_ns for _, sweep in self.sweeps], dtype=np.int64)


@dataclass(frozen=True)
class Placement:
    """What says where lasers were: transforms, the frame to map in, and both in words."""

    buffer: TransformBuffer
    fixed: str
    source: str
    notes: tuple[str, ...] = ()


# ---- lasers --------------------------------------------------------------------------------------


def check_topics(recording: Recording, names: Sequence[str], msgtypes: Sequence[str], flag: str) -> None:
    """ConfigError for a topic that is not there, or holds something else."""
    for name in names:
        seen = recording.types_of(name)
        if set(seen) & set(msgtypes):
            continue
        others = recording.topics(*msgtypes)
        hint = " or ".join(f"{flag} {other}" for other in others) or f"nothing: there are {recording.listing()}"
        wanted = " or ".join(kind.replace("/msg/", "/") for kind in msgtypes)
        what = f"holds {', '.join(seen)}" if seen else "is not there"
        raise ConfigError(f"{recording.source}: topic {name} {what}; wanted {wanted}.\n  Use {hint}.")


def choose_lasers(recording: Recording, contents: Contents, choice: BagChoice) -> tuple[list[Laser], list[str]]:
    """The lasers to map: those asked for, or one topic for each frame; and what to note about that.

    Raises
    ------
    ConfigError
        A topic that is not there, or that holds no scans.
    ScanError
        No scans, or topics of one frame with different resolutions.
    """
    for name in choice.scan_topics:
        if recording.types_of(name) == [POINT_CLOUD]:
            raise ConfigError(
                f"{recording.source}: topic {name} holds clouds; wanted scans.\n"
                f"  To make scans of points between two heights, use --from-cloud 0.2:0.4 --scan-topic {name}."
            )
    check_topics(recording, choice.scan_topics, [LASER_SCAN], "--scan-topic")
    lasers = [_laser(recording, name, sweeps) for name, sweeps in contents.sweeps.items() if sweeps]
    if not lasers:
        raise ScanError(_no_scans(recording))
    if choice.scan_topics:
        return lasers, []
    notes, chosen = [], []
    places = [(laser.frame, contents.robot_of(laser.topic)) for laser in lasers]
    for frame, robot in dict.fromkeys(places):
        same = [laser for laser, where in zip(lasers, places, strict=True) if where == (frame, robot)]
        alike = sorted(same, key=lambda one: (-len(one.sweeps), one.topic))
        if len(alike) > 1:
            _refuse_different(recording, alike)
            others = ", ".join(f"--scan-topic {one.topic} ({len(one.sweeps)} scans)" for one in alike[1:])
            notes.append(f"{alike[0].topic} is used for {frame}, with {len(alike[0].sweeps)} scans; others: {others}")
        chosen.append(alike[0])
    if len(chosen) > 1:
        flags = " or ".join(f"--scan-topic {laser.topic}" for laser in chosen)
        notes.append(f"all {len(chosen)} lasers are mapped; for one alone, {flags}")
    return chosen, notes


def transforms_for(recording: Recording, contents: Contents, topics: Sequence[str]) -> TransformBuffer:
    """The transforms that hold for the lasers on some topics; ConfigError if those are of several robots."""
    robots = {topic: contents.robot_of(topic) for topic in topics}
    if len(set(robots.values())) > 1:
        flags = "\n".join(f"  --scan-topic {topic}  (with {robot}/tf)" for topic, robot in robots.items())
        raise ConfigError(
            f"{recording.source} holds robots whose frames have the same names; map them one by one.\n{flags}"
        )
    return contents.buffer_of(next(iter(robots.values())))


def _laser(recording: Recording, topic: str, sweeps: list[tuple[str, Sweep]]) -> Laser:
    frames = Counter(sweep.frame for _, sweep in sweeps)
    frame = frames.most_common(1)[0][0]
    if len(frames) > 1:
        for label, sweep in sweeps:
            if sweep.frame != frame:
                recording.bad.add(label, f"it is in frame {sweep.frame!r}, others of this topic in {frame!r}")
    return Laser(topic, frame, [one for one in sweeps if one[1].frame == frame])


def _refuse_different(recording: Recording, alike: Sequence[Laser]) -> None:
    steps = [_step_rad(laser) for laser in alike]
    if max(steps) - min(steps) <= SAME_STEP_SHARE * max(steps):
        return
    candidates = "\n".join(
        f"  --scan-topic {laser.topic}  ({len(laser.sweeps[0][1].angles)} beams,"
        f" {math.degrees(step):.3g} degrees apart, {len(laser.sweeps)} scans)"
        for laser, step in zip(alike, steps, strict=True)
    )
    raise ScanError(
        f"{recording.source}: topics of frame {alike[0].frame} have different resolutions; one laser cannot have two."
        f"\n  Use one of\n{candidates}"
    )


def _step_rad(laser: Laser) -> float:
    angles = laser.sweeps[0][1].angles
    return abs(float(angles[-1] - angles[0])) / (len(angles) - 1) if len(angles) > 1 else 0.0


def _no_scans(recording: Recording) -> str:
    skipped = "".join(f"\n  {note}." for note in recording.all_notes())
    clouds = recording.topics(POINT_CLOUD)
    remedy = "Is the laser in another file of the same recording? Name them all, or their folder."
    if any(clouds.values()):
        name = max(clouds, key=lambda one: clouds[one])
        remedy = f"To make scans of points between two heights, use --from-cloud 0.2:0.4 --scan-topic {name}."
    return (
        f"{recording.source} holds no usable scan: wanted sensor_msgs/LaserScan, saw {recording.listing()}.{skipped}"
        f"\n  {remedy}"
    )


# ---- frames --------------------------------------------------------------------------------------


def place(recording: Recording, buffer: TransformBuffer, lasers: Sequence[Laser], choice: BagChoice) -> Placement:
    """What says where the lasers were.

    Raises
    ------
    ConfigError
        A frame or a pose topic that is not there, or that says nothing about the lasers.
    TransformError
        Nothing says where the lasers were.
    """
    _check_base(recording, buffer, lasers, choice)
    if choice.trajectory is not None:
        return _by_trajectory(buffer, lasers, choice, choice.trajectory)
    if choice.pose_topic:
        check_topics(recording, [choice.pose_topic], POSE_TYPES, "--pose-topic")
        poses = read_poses(recording, [choice.pose_topic])[choice.pose_topic]
        if not poses:
            raise ScanError(f"{recording.source}: topic {choice.pose_topic} has no usable message")
        return _by_poses(recording, buffer, lasers, choice, choice.pose_topic, poses)
    fixed, others = _fixed_frame(recording, buffer, lasers, choice.fixed_frame)
    if fixed:
        corrected = _likely(recording.topics(POSE_WITH_COVARIANCE)) if _short(fixed) == ODOM_FRAME else []
        flags = " or ".join(f"--pose-topic {name}" for name in corrected)
        better = [f"localisation may know better: {flags}"] if flags else []
        return Placement(buffer, fixed, "transforms", (*_about(fixed, others), *better))
    return _by_best_topic(recording, buffer, lasers, choice)


def base_of(buffer: TransformBuffer, frame: str) -> str:
    """The farthest frame up the tree that a frame does not move in: usually the robot's base."""
    parents = buffer.frames()
    seen = {frame}
    while (up := parents.get(frame)) is not None and up not in seen and buffer.is_still(up, frame):
        if up.rpartition("/")[2] in FIXED_FRAMES:
            break
        seen.add(up)
        frame = up
    return frame


def _check_base(recording: Recording, buffer: TransformBuffer, lasers: Sequence[Laser], choice: BagChoice) -> None:
    known = _known(buffer) | {laser.frame for laser in lasers}
    if choice.base_frame and choice.base_frame not in known and not (choice.pose_topic or choice.trajectory):
        raise ConfigError(
            f"{recording.source}: there is no frame {choice.base_frame!r} (--base-frame); there are"
            f" {', '.join(sorted(known))}"
        )


def _known(buffer: TransformBuffer) -> set[str]:
    return {name for names in buffer.frames().items() for name in names}


def _fixed_frame(
    recording: Recording, buffer: TransformBuffer, lasers: Sequence[Laser], wanted: str
) -> tuple[str, list[str]]:
    """The frame to map in, and others that would do; empty if transforms connect the lasers with none."""
    if wanted:
        for laser in lasers:
            try:
                chain = buffer.chain(wanted, laser.frame)
                why = f"{laser.frame} never moves in it" if _is_rigid(buffer, chain) else ""
            except TransformError as error:
                why = str(error)
            if why:
                candidates = _candidates(buffer, [laser])
                hint = "".join(f"\n  Use --fixed-frame {name}." for name in candidates[:1])
                raise ConfigError(f"{recording.source}: --fixed-frame {wanted} cannot work: {why}.{hint}")
        return wanted, []
    candidates = _candidates(buffer, lasers)
    if candidates:
        return candidates[0], candidates[1:]
    alone = [_candidates(buffer, [laser]) for laser in lasers]
    if all(alone):
        flags = "\n".join(
            f"  --scan-topic {laser.topic}  (in {' or '.join(names)})"
            for laser, names in zip(lasers, alone, strict=True)
        )
        raise ConfigError(f"{recording.source}: the lasers move in no common frame; map them one by one.\n{flags}")
    return "", []


def _is_rigid(buffer: TransformBuffer, chain: list[str]) -> bool:
    """Whether static transforms alone connect some frames, as those of one robot; a frame with itself, too."""
    return _short(chain[-1]) not in FIXED_FRAMES and all(
        buffer.is_static(one, other) or buffer.is_static(other, one) for one, other in pairwise(chain)
    )


def _candidates(buffer: TransformBuffer, lasers: Sequence[Laser]) -> list[str]:
    """Frames that all lasers move in, or that are called as if they did; best first."""
    parents = buffer.frames()
    common: list[str] = []
    for k, laser in enumerate(lasers):
        above = [laser.frame]
        while (up := parents.get(above[-1])) is not None and up not in above:
            above.append(up)
        fit = [name for name in above[1:] if _moves(buffer, name, laser.frame) or _short(name) in FIXED_FRAMES]
        common = fit if k == 0 else [name for name in common if name in fit]
    # Of frames with other names, the topmost is the likeliest not to move.
    ranks = {name: FIXED_FRAMES.index(_short(name)) if _short(name) in FIXED_FRAMES else 99 for name in common}
    topmost_first = list(reversed(common))
    return sorted(topmost_first, key=lambda name: ranks[name])


def _short(frame: str) -> str:
    return frame.rpartition("/")[2]


def _moves(buffer: TransformBuffer, fixed: str, frame: str) -> bool:
    steps = pairwise(buffer.chain(fixed, frame))
    return any(not (buffer.is_still(one, other) or buffer.is_still(other, one)) for one, other in steps)


def _about(fixed: str, others: Sequence[str]) -> list[str]:
    notes = []
    if _short(fixed) == ODOM_FRAME:
        notes.append(f"poses are in {fixed}, which drifts: walls may double")
    useful = [name for name in others if _short(name) in FIXED_FRAMES]
    if useful:
        notes.append(f"poses are in {fixed}; others: " + " or ".join(f"--fixed-frame {name}" for name in useful))
    return notes


# ---- poses -----------------------------------------------------------------------------------------


def _linked(
    buffer: TransformBuffer, lasers: Sequence[Laser], poses: Sequence[StampedTransform], body: str
) -> tuple[TransformBuffer, list[str]]:
    """The transforms with poses of a frame in place of what they said about it, and what to note."""
    linked = buffer.without_parents(body)
    for pose in poses:
        linked.add(pose._replace(child=body))
    notes = []
    for laser in lasers:
        try:
            linked.chain(body, laser.frame)
        except TransformError:
            root = base_of(linked, laser.frame)
            linked = linked.without_parents(root)
            linked.add(StampedTransform(0, body, root, (0.0, 0.0, 0.0)), static=True)
            notes.append(f"no transform says where {root} is on {body}: taken as the same place")
    return linked, notes


def _by_poses(
    recording: Recording,
    buffer: TransformBuffer,
    lasers: Sequence[Laser],
    choice: BagChoice,
    name: str,
    poses: Sequence[StampedTransform],
) -> Placement:
    parent = Counter(pose.parent for pose in poses).most_common(1)[0][0] or "world"
    child = Counter(pose.child for pose in poses).most_common(1)[0][0]
    body = choice.base_frame or child or base_of(buffer, lasers[0].frame)
    if parent == body:
        raise TransformError(
            f"{recording.source}: {name} says where {body} is in itself; wanted poses in a fixed frame"
        )
    fitting = [pose._replace(parent=parent) for pose in poses if pose.parent in (parent, "")]
    linked, notes = _linked(buffer, lasers, fitting, body)
    if not child and not choice.base_frame:
        notes.append(f"{name} does not say whose poses it holds: taken as of {body} (--base-frame names another)")
    if len(fitting) < len(poses):
        notes.append(f"{len(poses) - len(fitting)} of {len(poses)} messages of {name} are not in {parent}: left out")
    fixed, others = _fixed_frame(recording, linked, lasers, choice.fixed_frame)
    fixed = fixed or parent
    return Placement(linked, fixed, name, (*notes, *_about(fixed, others)))


def _by_best_topic(
    recording: Recording, buffer: TransformBuffer, lasers: Sequence[Laser], choice: BagChoice
) -> Placement:
    counts = {name: n for name, n in recording.topics(*POSE_TYPES).items() if n}
    found: list[tuple[tuple[bool, bool, float, int], str, Placement]] = []
    for name, poses in read_poses(recording, _likely(counts)).items():
        if not poses:
            continue
        try:
            placement = _by_poses(recording, buffer, lasers, choice, name, poses)
            share = _share_placed(placement, lasers)
        except TransformError:
            continue
        corrected = _short(placement.fixed) == MAP_FRAME
        found.append(((share >= ENOUGH_SHARE, corrected, share, len(poses)), name, placement))
    found.sort(key=lambda one: one[0], reverse=True)
    if not found:
        raise TransformError(_nowhere(recording, buffer, lasers))
    _, name, placement = found[0]
    flags = " or ".join(f"--pose-topic {other}" for other in counts if other != name)
    notes = [f"no transforms say where {lasers[0].frame} was: {name} does" + (f"; others: {flags}" if flags else "")]
    return Placement(placement.buffer, placement.fixed, placement.source, (*notes, *placement.notes))


def _likely(counts: Mapping[str, int]) -> list[str]:
    return [name for name, n in counts.items() if n and not any(word in name.lower() for word in NO_POSES)]


def _share_placed(placement: Placement, lasers: Sequence[Laser]) -> float:
    known = [
        ~np.isnan(placement.buffer.poses(placement.fixed, laser.frame, laser.stamps_ns, partial=True)[0][:, 0])
        for laser in lasers
    ]
    return float(np.concatenate(known).mean())


def _nowhere(recording: Recording, buffer: TransformBuffer, lasers: Sequence[Laser]) -> str:
    frame = lasers[0].frame
    base = base_of(buffer, frame)
    near = [one for one in buffer.connected(frame) if one != frame]
    frames = ", ".join(sorted(_known(buffer))) or "none"
    alone = f"; with {frame} are connected: {', '.join(near) or 'none'}" if _known(buffer) else ""
    still = f" If the laser stood still, --fixed-frame {base}." if base != frame else ""
    lacks = not any(name.endswith(STATIC_TOPIC) for name in recording.topics(*TRANSFORM_TYPES))
    static = f" If another file of the recording holds /{STATIC_TOPIC}, name it as well." if lacks else ""
    return (
        f"{recording.source}: nothing says where {frame} was: no transforms move it (frames: {frames}{alone}), and no"
        f" topic with poses does. Topics: {recording.listing()}.\n"
        f"  Record /tf and /tf_static or odometry as well, or give poses from elsewhere.{still}{static}"
    )


def _by_trajectory(buffer: TransformBuffer, lasers: Sequence[Laser], choice: BagChoice, poses: Poses) -> Placement:
    if not choice.base_frame and len(lasers) > 1:
        flags = " or ".join(f"--scan-topic {laser.topic}" for laser in lasers)
        raise ConfigError(
            f"{poses.source or 'the poses'} can be of one laser alone, and there are {len(lasers)}.\n"
            f"  Use {flags}, or --base-frame if they are of the robot."
        )
    body = choice.base_frame or lasers[0].frame
    fixed = FRAME_OF_POSES
    transforms = [
        StampedTransform(stamp, fixed, body, (x, y, 0.0), yawed(theta))
        for stamp, (x, y, theta) in zip(poses.stamps_ns.tolist(), poses.poses.tolist(), strict=True)
    ]
    linked, notes = _linked(buffer, lasers, transforms, body)
    robot = base_of(buffer, body)
    if not choice.base_frame and robot != body:
        notes.append(f"the poses are taken as of {body} itself; if they are of the robot, --base-frame {robot}")
    return Placement(linked, fixed, poses.source or "poses from elsewhere", tuple(notes))
