"""What a recording holds that maps need: sweeps, clouds, transforms and poses, decoded, and what of it is broken."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tempog.errors import MessageError, ScanError, TransformError
from tempog.ros.bag_files import METADATA, bytes_of, files_of, kind_of_file, read_messages
from tempog.ros.messages import (
    LASER_SCAN,
    ODOMETRY,
    OLD_TF_MESSAGE,
    POINT_CLOUD,
    POSE,
    POSE_WITH_COVARIANCE,
    TF_MESSAGE,
    Codec,
    StampedTransform,
    Sweep,
    pose_of,
    sweep_of,
    transforms_of,
)
from tempog.ros.raw import RawMessage, Reading, Topic
from tempog.ros.topic_codec import codec_of
from tempog.ros.transforms import TransformBuffer
from tempog.scans.scan import MAX_ANGLE_RAD, BadRows
from tempog.times import NS_PER_S

TRANSFORM_TYPES = (TF_MESSAGE, OLD_TF_MESSAGE)
POSE_TYPES = (ODOMETRY, POSE_WITH_COVARIANCE, POSE)
STATIC_TOPIC = "tf_static"
NO_FRAME = "a frame without a name"  # of messages whose header names none; poses of it can still be given
Progress = Callable[[int, int], None]  # bytes dealt with, and of how many


@dataclass
class Recording:
    """The files that make one recording, and what reading them has found so far.

    Attributes
    ----------
    source : str
        Its name in messages.
    files : list of (Path, kind)
    bad : BadRows
        Messages that cannot be used.
    n_messages : Counter of Topic
    notes : list of str
    losses : list of str
        What of each file cannot be read; `n_losses` parts in all.
    """

    source: str
    files: list[tuple[Path, str]]
    bad: BadRows
    n_messages: Counter[Topic] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    progress: Progress | None = None
    skip_bad: bool = False
    losses: list[str] = field(default_factory=list)
    n_losses: int = 0
    _codecs: dict[Topic, Codec | MessageError] = field(default_factory=dict)
    _was_read: bool = False

    @property
    def kinds(self) -> str:
        """What kinds of files there are, for people."""
        count = f", {len(self.files)} files" if len(self.files) > 1 else ""
        return " and ".join(sorted({kind for _, kind in self.files})) + count

    def topics(self, *msgtypes: str) -> dict[str, int]:
        """Names of the topics of some types, and how many messages each has."""
        counts: Counter[str] = Counter()
        for topic, count in self.n_messages.items():
            if topic.msgtype in msgtypes:
                counts[topic.name] += count
        return dict(sorted(counts.items()))

    def types_of(self, name: str) -> list[str]:
        """Types of the messages on a topic; none if there is no such topic."""
        return sorted({topic.msgtype or "of no type" for topic in self.n_messages if topic.name == name})

    def listing(self) -> str:
        """All topics, with types and counts, for messages."""
        if not self.n_messages:
            return "no topics at all"
        lines = [f"{topic.name} ({topic.msgtype or topic.encoding}, {n})" for topic, n in self.n_messages.items()]
        return ", ".join(sorted(lines)[:20]) + (", ..." if len(lines) > 20 else "")

    def messages(self, wants: Callable[[Topic], bool]) -> Iterator[tuple[str, RawMessage, Any]]:
        """Label, bytes and decoded message of all wanted ones that can be decoded.

        The first time through, what is lost and what is broken is noted.
        """
        first, self._was_read = not self._was_read, True
        total, done = bytes_of([file for file, _ in self.files]), 0
        counts: Counter[str] = Counter()
        for file, kind in self.files:
            reading = Reading()
            if self.progress is not None:
                reading.moved_on = _moved_on(self.progress, done, total)
            for one in _told(read_messages(file, kind, wants, reading), file):
                counts[one.topic.name] += 1
                label = f"{one.topic.name} message {counts[one.topic.name]}"
                try:
                    yield label, one, self._codec(one.topic).decode(one.raw, one.topic.msgtype)
                except MessageError as error:
                    if first:
                        self.bad.add(label, str(error))
            done += file.stat().st_size
            if first:
                for topic, count in reading.n_messages.items():
                    self.n_messages[topic] += count
                self._tell(file, reading)

    def _codec(self, topic: Topic) -> Codec:
        if topic not in self._codecs:
            try:
                self._codecs[topic], note = codec_of(topic)
                self.notes += [note] if note else []
            except MessageError as error:
                self._codecs[topic] = error
        codec = self._codecs[topic]
        if isinstance(codec, MessageError):
            raise codec
        return codec

    def _tell(self, file: Path, reading: Reading) -> None:
        """Note that a recorder did not end properly, and what is lost."""
        count = sum(reading.n_messages.values())
        n_scans = sum(n for topic, n in reading.n_messages.items() if topic.msgtype in (LASER_SCAN, POINT_CLOUD))
        until = "" if reading.last_ns is None else f", the last of {reading.last_ns / NS_PER_S:.3f} s"
        readable = f"{count} messages can be read, {n_scans} of them scans{until}"
        name = "" if len(self.files) == 1 else f"{file.name}: "
        if reading.unfinished:
            self.notes.append(f"{name}{reading.unfinished}; {readable}")
        if not reading.losses:
            return
        more = f", and {len(reading.losses) - 1} more parts" if len(reading.losses) > 1 else ""
        lost = f", which loses {reading.lost_bytes} bytes" if reading.lost_bytes else ""
        self.losses.append(f"{name}damaged: {reading.losses[0]}{more}{lost}; {readable}")
        self.n_losses += len(reading.losses)

    def check(self) -> None:
        """Raise ScanError if something is damaged or cannot be used, unless that is to be skipped."""
        if self.skip_bad:
            return
        if self.losses:
            raise ScanError(f"{self.source}, {self.losses[0]}.\n  Use --skip-bad to map what is intact.")
        for note in self.bad.notes():
            raise ScanError(
                f"{self.source}: {note.removeprefix('skipped ')}.\n  Use --skip-bad to leave such data out."
            )

    def all_notes(self) -> list[str]:
        """What is damaged, what was skipped, and what else there is to say of the files."""
        return [*self.losses, *self.bad.notes(), *self.notes]


def _told(messages: Iterable[RawMessage], file: Path) -> Iterator[RawMessage]:
    """The same messages; ScanError where the disk, not the file, is at fault."""
    try:
        yield from messages
    except OSError as error:
        raise ScanError(f"cannot read {file}: {error.strerror or error}") from error


def _any_topic(topic: Topic) -> bool:
    del topic
    return True


def _moved_on(progress: Progress, done: int, total: int) -> Callable[[int], None]:
    return lambda now: progress(done + now, total)


def open_recording(
    paths: Iterable[str | Path], skip_bad: bool = False, progress: Progress | None = None
) -> Recording:
    """The files behind some paths, as one recording; ScanError if one is no bag, or cannot be read."""
    places = [Path(path) for path in paths]
    source = " + ".join(str(path) for path in places)
    bad = BadRows(source, skip_bad=True)  # all of it is to be heard of first
    files: list[tuple[Path, str]] = []
    for path in places:
        try:
            found, missing = files_of(path)
            for file in found:
                kind = kind_of_file(file)
                if kind is None:
                    raise ScanError(f"{file} is no bag; wanted an MCAP file, a ROS 1 bag, or a ROS 2 bag in SQLite")
                files.append((file, kind))
        except (OSError, ValueError) as error:
            if isinstance(error, ScanError):
                raise
            raise ScanError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
        for name in missing:
            bad.add(name, f"{path / METADATA} names this file, but it is not there")
    if not files:
        raise ScanError("no bags were given; wanted at least one")
    files = list({file.resolve(): (file, kind) for file, kind in reversed(files)}.values())[::-1]
    if len(files) > 1:
        files.sort(key=lambda file: _start_ns(*file))
    return Recording(source, files, bad, progress=progress, skip_bad=skip_bad)


def _start_ns(file: Path, kind: str) -> int:
    """When the first message of a file was recorded, or 0 if there is none."""
    with closing(read_messages(file, kind, _any_topic, Reading())) as messages:
        return next((one.log_ns for one in _told(messages, file)), 0)


@dataclass
class Contents:
    """Sweeps by topic, each with its label, and all transforms, of a whole recording.

    Transforms are kept by what stands before the topics tf and tf_static, such as "/r1": robots with topics of their
    own often have frames of the same names.
    """

    sweeps: dict[str, list[tuple[str, Sweep]]] = field(default_factory=dict)
    buffers: dict[str, TransformBuffer] = field(default_factory=dict)

    @property
    def robots(self) -> list[str]:
        """What stands before the topics of robots whose frames have the same names; none if all go together."""
        links = [buffer.links() for buffer in self.buffers.values()]
        overlap = sum(map(len, links)) > len(set().union(*links))
        return sorted(self.buffers) if overlap else []

    def robot_of(self, topic: str) -> str:
        """Which of `robots` a topic belongs to."""
        return max((name for name in self.robots if topic.startswith(f"{name}/")), key=len, default="")

    def buffer_of(self, robot: str) -> TransformBuffer:
        """The transforms of one of `robots`, and those of no robot; or all, if they go together."""
        own = self.buffers.get(robot, TransformBuffer())
        for name, other in self.buffers.items():
            if name != robot and (not name or not self.robots):
                own = own.joined(other)
        return own


def read_contents(recording: Recording, wants_scans: Callable[[Topic], bool]) -> Contents:
    """Read all transforms, and the sweeps of wanted topics."""
    contents = Contents()

    def wanted(topic: Topic) -> bool:
        return topic.msgtype in TRANSFORM_TYPES or (topic.msgtype == LASER_SCAN and wants_scans(topic))

    for label, one, message in recording.messages(wanted):
        try:
            if one.topic.msgtype == LASER_SCAN:
                contents.sweeps.setdefault(one.topic.name, []).append((label, _checked(sweep_of(message))))
                continue
            robot, _, name = one.topic.name.rpartition("/")
            buffer = contents.buffers.setdefault(robot, TransformBuffer())
            for transform in transforms_of(message):
                buffer.add(transform, static=name == STATIC_TOPIC)
        except (MessageError, TransformError) as error:
            recording.bad.add(label, str(error))
        except (AttributeError, TypeError, ValueError, OverflowError) as error:
            recording.bad.add(label, f"its {one.topic.msgtype} lacks something: {error}")
    return contents


def _checked(sweep: Sweep) -> Sweep:
    if not sweep.frame:
        sweep = replace(sweep, frame=NO_FRAME)
    if len(sweep.angles) and not np.abs(sweep.angles[[0, -1]]).max() <= MAX_ANGLE_RAD:
        raise MessageError(f"its beams point at {sweep.angles[0]:g} to {sweep.angles[-1]:g} rad")
    return sweep


def read_poses(recording: Recording, names: Iterable[str]) -> dict[str, list[StampedTransform]]:
    """Poses of some topics, in time order; their `child` is empty where the message does not say whose they are."""
    wanted = set(names)
    poses: dict[str, list[StampedTransform]] = {name: [] for name in sorted(wanted)}
    trial = TransformBuffer(keep_s=0)
    for label, one, message in recording.messages(lambda t: t.name in wanted and t.msgtype in POSE_TYPES):
        try:
            pose = pose_of(message)
            trial.add(pose._replace(parent="parent", child="child"))
            poses[one.topic.name].append(pose)
        except (TransformError, AttributeError, TypeError, ValueError, OverflowError) as error:
            recording.bad.add(label, f"no usable pose: {error}")
    for found in poses.values():
        found.sort(key=lambda pose: pose.stamp_ns)
    return poses


def read_clouds(recording: Recording, name: str) -> Iterator[tuple[str, Any]]:
    """Label and message of each cloud on a topic."""
    for label, _, message in recording.messages(lambda t: t.name == name and t.msgtype == POINT_CLOUD):
        yield label, message
