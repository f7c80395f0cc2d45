"""A robot that drives now: its scans into the map, what moves out of it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from typing import Any

from tempog.analysis.high_dynamic import HighDynamic
from tempog.analysis.tracker import ObjectTracker
from tempog.errors import ConfigError, ExtentError, MapError, MessageError, ScanError
from tempog.live import outgoing
from tempog.live.accounts import Counts, Notes
from tempog.live.analyst import Analyst, Answer, Question, without_history
from tempog.live.inbox import Inbox, Letter
from tempog.live.placing import FIXED_FRAMES, Placing
from tempog.live.transport import Publisher, Transport
from tempog.ros import messages as ros
from tempog.scans.scan import Scan
from tempog.store.live_map import LiveMap
from tempog.times import NS_PER_S

# Scans of two lasers arrive a little out of order; what is earlier than this against the latest is of another time.
LATE_S = 0.5
# For `LiveMap`, which else judges by the first scans whether its gap fits: few of many, if most were dropped.
LASER_PERIOD_S = 0.1
FIRST_LOOK_S = 30.0  # s of scans before objects are looked for in a new map; the first commit has these
CONNECTED_S = 1.0  # s between two looks at the connection
STATUS_S = 5.0  # s between two status messages
SILENT_S = 5.0  # s without any scan before that is said
# Publishing maps takes at most this share of the time, however large they grow.
MOST_MAP_SHARE = 0.05


@dataclass(frozen=True)
class LiveSettings:
    """How a live robot is mapped.

    Attributes
    ----------
    scan_topics : tuple of str
        Of LaserScans, several for several lasers.
    tf_topic : str
        Of the transforms; the static ones come by the same name with ``_static`` behind it.
    fixed_frame : str
        To map in; empty for map, or else odom if nothing is mapped yet.
    wait_s : float, seconds
        How long a scan waits for its transforms.
    most_scans : int
        That wait to be mapped; older ones are dropped.
    publish_every_s : float, seconds
        Between two current maps; 0 for none.
    objects : bool
        Whether doors and other objects are looked for and followed.
    objects_since_s : float, seconds, optional
        Only history that is not older counts for that. Default: all.
    """

    scan_topics: tuple[str, ...] = ("scan",)
    tf_topic: str = "/tf"
    fixed_frame: str = ""
    wait_s: float = 0.2
    most_scans: int = 40
    publish_every_s: float = 2.0
    objects: bool = True
    objects_since_s: float | None = None

    def __post_init__(self) -> None:
        if not self.scan_topics:
            raise ConfigError("no scan topics were given; wanted one at least, such as scan")
        if not 0 <= self.wait_s <= 60:
            raise ConfigError(f"wait_s = {self.wait_s!r} cannot work; wanted seconds from 0 to 60")
        if self.most_scans < 1:
            raise ConfigError(f"most_scans = {self.most_scans} cannot work; wanted 1 or more")
        if not self.publish_every_s >= 0:
            raise ConfigError(f"publish_every_s = {self.publish_every_s!r} cannot work; wanted seconds from 0")


class LiveRobot:
    """Maps what one robot sees while it drives, follows the doors it knows, and publishes both.

    Messages come in through threads of the transport's; everything else happens in the thread that calls `step`.

    Parameters
    ----------
    transport : Transport
    live : LiveMap
        Grows; is not closed here. Made with a `scan_period_s` it does not mind that scans are lost.
    settings : LiveSettings, optional
    note : callable
        Takes a line for people: what was chosen, what is lost and why.
    clock : callable
        Seconds that only grow.
    guard : context manager, optional
        Held while the map or the tracker changes; for who reads them from another thread.

    Attributes
    ----------
    counts : Counts
    tracker : ObjectTracker or None
        None until objects were looked for the first time.
    """

    def __init__(
        self,
        transport: Transport,
        live: LiveMap,
        settings: LiveSettings | None = None,
        *,
        note: Callable[[str], None] = lambda text: None,
        clock: Callable[[], float] = time.monotonic,
        guard: AbstractContextManager[Any] | None = None,
    ) -> None:
        self.settings = settings or LiveSettings()
        self._guard = guard if guard is not None else nullcontext()
        self.live, self.counts = live, Counts()
        self.tracker: ObjectTracker | None = None
        self._transport, self._note, self._clock = transport, note, clock
        self._codec = ros.Codec(transport.version)
        self._inbox = Inbox(self.settings.most_scans)
        # odom begins anew with every start of a robot: what is mapped already would not fit it.
        frames = FIXED_FRAMES[:1] if live.n_scans else FIXED_FRAMES
        self._placing = Placing(self.settings.fixed_frame, self.settings.wait_s, frames=frames)
        self._analyst = Analyst(live.path)
        self._notes = Notes(note, clock)
        self._has_history = live.n_scans > 0
        self._silent = list(dict.fromkeys(self.settings.scan_topics))  # that nothing came on yet
        self._first_ns = self._last_ns = -1
        self._asked_ns: int | None = None
        self._moving = self._markers_due = False
        self._connected = True
        now_s = self._started_s = clock()
        self._look_s, self._status_s, self._map_s = now_s + CONNECTED_S, now_s + STATUS_S, now_s
        for suffix in ("_static", ""):
            static = bool(suffix)
            topic = self.settings.tf_topic + suffix
            transport.subscribe(topic, ros.TF_MESSAGE, self._take_transforms(static), latched=static)
        for topic in self.settings.scan_topics:
            transport.subscribe(topic, ros.LASER_SCAN, self._take_scans(topic))
        self._publishers: dict[str, Publisher] = {}
        self._advertise()  # last: who sees these topics knows that it is listened to

    def step(self, wait_s: float = 0.1) -> None:
        """Take the next message if there is one within a time, and do what is due."""
        if len(self._placing):
            wait_s = min(wait_s, 0.01)
        letter = self._inbox.get(wait_s)
        if letter is not None:
            self._read(letter)
        now_s = self._clock()
        for _, scan in self._placing.ready(now_s):
            with self._guard:
                self._map(scan)
        self._count()
        self._see_to_objects()
        if now_s >= self._map_s and self.settings.publish_every_s:
            self._publish_maps(now_s)
        if now_s >= self._look_s:
            self._look_s = now_s + CONNECTED_S
            self._look_at_connection()
        if now_s >= self._status_s:
            self._status_s = now_s + STATUS_S
            self._publish(outgoing.STATUS, outgoing.text(self._codec, json.dumps(self.status())))

    def drain(self, most_s: float = 2.0) -> None:
        """Map what has been received already, for so long at most."""
        until_s = self._clock() + most_s
        while (len(self._inbox) or len(self._placing)) and self._clock() < until_s:
            self.step(0.0)

    def close(self) -> None:
        """End what was started here; the map and the transport stay open."""
        self._analyst.close()

    def status(self) -> dict[str, Any]:
        """What the status message says."""
        return {
            "session": self.live.session,
            "frame": self._placing.fixed_frame,
            "stamp": self._last_ns / NS_PER_S if self.counts.mapped else None,
            "objects": 0 if self.tracker is None else len(self.tracker.found.objects),
            "connected": self._connected,
            **asdict(self.counts),
        }

    # ---- in ----------------------------------------------------------------------------------------

    def _take_scans(self, topic: str) -> Callable[[bytes], None]:
        return lambda raw: self._inbox.put_scan(topic, raw)

    def _take_transforms(self, static: bool) -> Callable[[bytes], None]:
        kind = "static" if static else "moving"
        return lambda raw: self._inbox.put_transforms(kind, raw)

    def _read(self, letter: Letter) -> None:
        try:
            if letter.kind in self.settings.scan_topics:
                self.counts.received += 1
                if letter.kind in self._silent:
                    self._silent.remove(letter.kind)
                sweep = ros.sweep_of(self._codec.decode(letter.raw, ros.LASER_SCAN))
                if self._in_time(sweep):
                    self._placing.add_sweep(sweep, letter.kind, self._clock())
            else:
                message = self._codec.decode(letter.raw, ros.TF_MESSAGE)
                self._placing.add_transforms(ros.transforms_of(message), static=letter.kind == "static")
        except MessageError as error:
            self.counts.unusable += 1
            self._notes.say("unusable", f"{letter.kind}: {error}")

    def _in_time(self, sweep: ros.Sweep) -> bool:
        """Whether a sweep is not of a time that was mapped already; a robot's clock does not go back."""
        late_s = (self._last_ns - sweep.stamp_ns) / NS_PER_S
        if not self.counts.mapped or late_s <= LATE_S:
            return True
        self.counts.earlier += 1
        self._notes.say(
            "earlier",
            f"time has gone back by {late_s:.1f} s, as when a bag is played again or a simulation starts anew: scans"
            " are left out until it is as late as it was. To map them now, end this with Ctrl-C and start it again",
        )
        return False

    # ---- the map -----------------------------------------------------------------------------------

    def _map(self, scan: Scan) -> None:
        if self.counts.mapped and scan.stamp_ns < self._last_ns:
            scan = _with_stamp(scan, self._last_ns)
            self.counts.shifted += 1
        try:
            self.live.integrate(scan)
        except (ScanError, ExtentError) as error:
            self.counts.unusable += 1
            self._notes.say("unusable", str(error))
            return
        except MapError as error:
            self.counts.unsaved += 1
            self._notes.say("unsaved", f"{error}. Scans are left out until there is room")
            return
        if not self.counts.mapped:
            self._first_ns = scan.stamp_ns
            self._note(f"mapping {scan.label.removeprefix('the scan of ')} in {self._placing.fixed_frame}")
        self.counts.mapped += 1
        self._last_ns = scan.stamp_ns
        if self.tracker is not None:
            try:
                self._follow(scan, self.tracker)
            except (ScanError, ExtentError) as error:  # the map has it all the same
                self._notes.say("unfollowed", str(error))

    def _follow(self, scan: Scan, tracker: ObjectTracker) -> None:
        events = tracker.update(scan)
        for event in events:
            self._publish(outgoing.EVENTS, outgoing.text(self._codec, outgoing.events_text(event, tracker.found)))
        if events:
            self.counts.events += len(events)
            self._publish_doors(tracker)
        self._publish_moving(tracker.high_dynamic)

    def _count(self) -> None:
        placing, counts = self._placing, self.counts
        dropped = self._inbox.n_dropped
        counts.received += dropped - counts.too_fast
        if placing.n_dropped > counts.unplaced:
            self._notes.say("unplaced", f"scans without a place: {placing.why}")
        if dropped > counts.too_fast:
            self._notes.say(
                "too_fast", "scans come faster than they can be mapped; the oldest that wait are left out"
            )
        counts.too_fast, counts.unplaced = dropped, placing.n_dropped

    # ---- objects -----------------------------------------------------------------------------------

    def _see_to_objects(self) -> None:
        if not self.settings.objects or not self.counts.mapped:
            return
        if (answer := self._analyst.answer()) is not None:
            with self._guard:
                self._take_in(answer)
        if self._analyst.busy or (
            self._asked_ns is not None and self._last_ns - self._asked_ns < FIRST_LOOK_S * NS_PER_S
        ):
            return
        since_s = self.settings.objects_since_s
        since_ns = None if since_s is None else self._last_ns - round(since_s * NS_PER_S)
        if self.tracker is None:
            if self._has_history or self._last_ns - self._first_ns >= FIRST_LOOK_S * NS_PER_S:
                self._asked_ns = self._last_ns
                self._analyst.ask(Question(0, since_ns))  # what is on disk already is enough to begin with
            return
        due = self.tracker.due()
        if due:
            self._asked_ns = self._last_ns
            known = without_history(self.tracker.found)
            self._analyst.ask(Question(self._last_ns, since_ns, known, self.tracker.ids, due[0]))

    def _take_in(self, answer: Answer) -> None:
        if answer.found is None:
            self._notes.say("objects", f"no objects were looked for: {answer.failure}")
            return
        found = replace(answer.found, history=self.live)
        area = answer.question.area
        if area is None or self.tracker is None or answer.learned is None or answer.ids is None:
            self.tracker = ObjectTracker(found)
            self._note(f"{len(found.objects)} objects known, in {answer.took_s:.1f} s")
        else:
            self.tracker.adopt((found, answer.learned, answer.ids), area)
            new, gone = answer.learned.new_objects, answer.learned.retired_objects
            if new or gone:
                self._note(f"{area}: {len(new)} objects more, {len(gone)} fewer, in {answer.took_s:.1f} s")
        extent = found.extent
        self._publish(
            outgoing.STATIC_MAP,
            outgoing.grid(self._codec, self._last_ns, self._frame, extent, outgoing.static_cells(found)),
        )
        self._publish_doors(self.tracker)

    # ---- out ---------------------------------------------------------------------------------------

    @property
    def _frame(self) -> str:
        return self._placing.fixed_frame

    def _advertise(self) -> None:
        latched = [outgoing.STATIC_MAP, outgoing.CURRENT_MAP, outgoing.DOORS, outgoing.DOOR_MARKERS]
        types = {
            outgoing.STATIC_MAP: ros.OCCUPANCY_GRID,
            outgoing.CURRENT_MAP: ros.OCCUPANCY_GRID,
            outgoing.DOORS: ros.STRING,
            outgoing.EVENTS: ros.STRING,
            outgoing.DOOR_MARKERS: outgoing.MARKERS,
            outgoing.HIGH_DYNAMIC: ros.POINT_CLOUD,
            outgoing.STATUS: ros.STRING,
        }
        for topic, msgtype in types.items():
            self._publishers[topic] = self._transport.advertise(topic, msgtype, latched=topic in latched)

    def _publish(self, topic: str, raw: bytes) -> None:
        try:
            self._publishers[topic].publish(raw)
        except Exception as error:  # whatever the transport stumbles over while it is away: mapping goes on
            self._notes.say("publish", f"{topic} could not be published: {error}")

    def _publish_doors(self, tracker: ObjectTracker) -> None:
        """The states at once; markers, which take longer, with the next map."""
        states = outgoing.doors_text(self._last_ns, self._frame, tracker.found, tracker.states())
        self._publish(outgoing.DOORS, outgoing.text(self._codec, states))
        self._markers_due = True

    def _publish_markers(self, tracker: ObjectTracker) -> None:
        self._markers_due = False
        codec, width_m = self._codec, self.live.config.grid.resolution_m
        markers = outgoing.door_markers(codec, self._last_ns, self._frame, tracker.found, tracker.states(), width_m)
        self._publish(outgoing.DOOR_MARKERS, markers)

    def _publish_moving(self, moving: HighDynamic) -> None:
        """Who is on the move; one empty cloud says that nobody is any more."""
        if len(moving.points_map) or self._moving:
            self._moving = bool(len(moving.points_map))
            points = outgoing.cloud(self._codec, moving.stamp_ns, self._frame, moving.points_map)
            self._publish(outgoing.HIGH_DYNAMIC, points)

    def _publish_maps(self, now_s: float) -> None:
        started_s = time.perf_counter()
        if self.counts.mapped:
            now = self.live.at(self._last_ns / NS_PER_S, hold=float("inf"))
            cells = outgoing.current_cells(now.value)
            self._publish(
                outgoing.CURRENT_MAP, outgoing.grid(self._codec, self._last_ns, self._frame, now.extent, cells)
            )
        if self._markers_due and self.tracker is not None:
            self._publish_markers(self.tracker)
        took_s = time.perf_counter() - started_s
        self._map_s = now_s + max(self.settings.publish_every_s, took_s / MOST_MAP_SHARE)

    def _look_at_connection(self) -> None:
        connected = self._transport.connected()
        if connected != self._connected:
            self._note(f"{self._transport.where}: {'there again' if connected else 'gone; waiting for it'}")
        self._connected = connected
        if self._silent and self._clock() - self._started_s > SILENT_S:
            self._notes.say("silent", self._silence())

    def _silence(self) -> str:
        """That nothing has come, and what could be listened to instead."""
        published = self._transport.topics_of(ros.LASER_SCAN)
        others = [f"--scan-topic {topic}" for topic in published if topic not in self.settings.scan_topics]
        if set(published) & set(self._silent):
            there = "a publisher is there, and says nothing"
        elif others:
            there = f"LaserScans are published elsewhere: {' '.join(others)}"
        else:
            there = "nobody is seen to publish any"
        return f"no scan has come on {' '.join(self._silent)} yet; {there}"


def _with_stamp(scan: Scan, stamp_ns: int) -> Scan:
    pose = scan.x, scan.y, scan.theta
    return Scan(0.0, pose, scan.angles, scan.ranges, scan.max_range, stamp_ns=stamp_ns, label=scan.label)
