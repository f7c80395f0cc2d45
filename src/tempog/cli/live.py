"""``tempog live``: map a robot while it drives."""

from __future__ import annotations

import gc
import math
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tempog.cli._output import (
    JsonFlag,
    QuietFlag,
    count_text,
    counted,
    print_json,
    print_note,
    status,
    wants_progress,
)
from tempog.cli._robots import (
    BridgeFlag,
    DomainOption,
    NamespaceOption,
    Ros1Flag,
    ZenohOption,
    connection_of,
    patience,
)
from tempog.config import GridConfig, MapConfig, SensingConfig, parse_gap
from tempog.errors import ConfigError, LinkError
from tempog.times import parse_duration

if TYPE_CHECKING:
    from tempog.live.robot import LiveRobot
    from tempog.store.live_map import LiveMap
    from tempog.views.web.sources import LiveSource

MAP_SETTINGS = ("resolution", "max_range", "gap")
SAY_S = 60.0  # s between two lines about how it goes, where there is no terminal
# s; whoever else works in this process, as commits do, lets go of Python's lock after so long. A scan takes it
# a dozen times: at Python's own 5 ms, one that met a commit took 0.1 s longer.
SWITCH_S = 0.0005
LINE_S = 0.5  # s between two changes of the line on a terminal


def live(
    context: typer.Context,
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="To go on with, or to make.")],
    zenoh: ZenohOption = None,
    bridge: BridgeFlag = False,
    ros1: Ros1Flag = False,
    domain: DomainOption = 0,
    namespace: NamespaceOption = "",
    scan_topic: Annotated[
        list[str] | None, typer.Option(metavar="TOPIC", help="Of LaserScans; may be repeated. Default: scan")
    ] = None,
    tf_topic: Annotated[str, typer.Option(metavar="TOPIC", help="The static ones: the same with _static.")] = "/tf",
    fixed_frame: Annotated[
        str, typer.Option(metavar="FRAME", help="To map in. Default: map, or odom for a new map where there is none.")
    ] = "",
    robot: Annotated[str, typer.Option(metavar="NAME", help="Kept with the session.")] = "",
    session: Annotated[str, typer.Option(metavar="ID", help="A name for the session. Default: from the date.")] = "",
    window: Annotated[
        str, typer.Option(metavar="DURATION", help="How much history stays in memory; all is on disk.")
    ] = "10min",
    publish_every: Annotated[
        float, typer.Option(metavar="S", min=0, help="Seconds between two current maps; 0: none.")
    ] = 2.0,
    no_objects: Annotated[bool, typer.Option("--no-objects", help="Do not look for doors and follow them.")] = False,
    objects_since: Annotated[
        str | None, typer.Option(metavar="DURATION", help="Look for objects in no older history, such as 7d.")
    ] = None,
    wait: Annotated[float, typer.Option(min=0, max=60, help="Seconds a scan waits for its transforms.")] = 0.2,
    queue: Annotated[int, typer.Option(min=1, help="Scans that wait to be mapped; older ones are dropped.")] = 40,
    resolution: Annotated[float, typer.Option(help="Side of a cell of a new map, metres.")] = GridConfig.resolution_m,
    max_range: Annotated[
        float, typer.Option(help="Of a new map: readings beyond are no hits. Metres.")
    ] = SensingConfig.max_range_m,
    gap: Annotated[str, typer.Option(help="Of a new map: a cell unseen for longer starts a new interval.")] = "2s",
    duration: Annotated[str | None, typer.Option(metavar="DURATION", help="End after so long.")] = None,
    view: Annotated[
        str | None,
        typer.Option(metavar="[HOST:]PORT", help="Also show the map in a page, as tempog view does. Such as 8765."),
    ] = None,
    quiet: QuietFlag = False,
    json: JsonFlag = False,
) -> None:
    """Map a robot while it drives, follow doors, and publish both. Ends with Ctrl-C or SIGTERM, and saves."""
    sources = {name: context.get_parameter_source(name) for name in MAP_SETTINGS}
    chosen = [name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"]
    if chosen and (map_path / "map.json").is_file():
        names = ", ".join(f"--{name.replace('_', '-')}" for name in chosen)
        raise ConfigError(f"{map_path} goes on with its own settings; leave out {names}, or make another map")
    config = MapConfig(
        SensingConfig(max_range_m=max_range), GridConfig(resolution_m=resolution, gap_s=parse_gap(gap, math.nan))
    )
    parse_duration(window)
    page = None if view is None else _address(view)
    ends_s = math.inf if duration is None else parse_duration(duration)
    from tempog.live.robot import LASER_PERIOD_S, LiveRobot, LiveSettings
    from tempog.live.stopping import Stop
    from tempog.live.transport import connect
    from tempog.live.warming import warm_up
    from tempog.ros.messages import Codec
    from tempog.store.live_map import LiveMap

    if page is not None:
        from tempog.views.web.serve import serve_in_thread
        from tempog.views.web.sources import LiveSource
    connection = connection_of(zenoh, bridge, ros1, domain, namespace, node="tempog")
    settings = LiveSettings(
        tuple(dict.fromkeys(connection.full_name(topic) for topic in scan_topic or ["scan"])),
        connection.full_name(tf_topic),
        fixed_frame.lstrip("/"),
        wait,
        queue,
        publish_every,
        not no_objects,
        None if objects_since is None else parse_duration(objects_since),
    )
    is_new = not (map_path / "map.json").is_file()
    sys.setswitchinterval(SWITCH_S)
    with (
        Stop() as stop,
        LiveMap(
            map_path,
            config if is_new else None,
            robot=robot,
            session=session,
            window=window,
            scan_period_s=LASER_PERIOD_S,
        ) as map_on_disk,
    ):
        for repaired in map_on_disk.repaired:
            print_note(repaired)
        with status("getting ready", wants_progress(quiet or json)):
            try:
                warm_up(map_on_disk.config, Codec("ros1" if ros1 else "ros2"))
            except Exception:
                if stop.asked > 1:  # what was interrupted is a compiler, with errors of its own
                    raise KeyboardInterrupt from None
                raise
        gc.collect()
        gc.freeze()  # what is here by now stays; looking through it again and again would delay scans
        try:
            transport = connect(connection, patience(stop, quiet))
        except LinkError:
            if stop():
                return
            raise
        quiet_note: Callable[[str], None] = lambda text: None  # noqa: E731
        note = quiet_note if quiet else print_note
        source = None if page is None else LiveSource(map_on_disk)
        mapper = LiveRobot(transport, map_on_disk, settings, note=note, guard=source.lock if source else None)
        if not quiet and not json:
            typer.echo(f"{map_path}: listening to {transport.where}; Ctrl-C ends and saves", err=True)
        hurried = False
        viewer: AbstractContextManager[Any] = nullcontext()
        try:
            if source is not None and page is not None:
                viewer = serve_in_thread(source, *page)
                typer.echo(f"the map as it grows: {viewer.url}", err=True)
            with viewer:
                _run(mapper, stop, time.monotonic() + ends_s, source, quiet=quiet or json)
            mapper.drain()
            mapper.close()
            map_on_disk.close()
        except KeyboardInterrupt:
            hurried = True
            map_on_disk.abandon()
        finally:
            mapper.close()
            transport.close()
    _say_end(mapper, map_on_disk, map_path, hurried, quiet=quiet, json=json)


def _address(text: str) -> tuple[str, int]:
    """Host and port of a page.

    >>> _address("8765"), _address("0.0.0.0:80")
    (('127.0.0.1', 8765), ('0.0.0.0', 80))
    """
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        raise ConfigError(f"--view {text} names no port; wanted for example 8765, or 0.0.0.0:8765 for other machines")
    return host or "127.0.0.1", int(port)


def _run(
    mapper: LiveRobot, stop: Callable[[], bool], until_s: float, source: LiveSource | None, *, quiet: bool
) -> None:
    progress = wants_progress(quiet)
    with status("waiting for scans", progress) as say:
        began_s = said_s = time.monotonic()
        before = 0
        while not stop() and (now_s := time.monotonic()) < until_s:
            mapper.step()
            if source is not None:
                source.tracker = mapper.tracker
            if now_s - said_s < (LINE_S if progress else SAY_S):
                continue
            rate = (mapper.counts.received - before) / (now_s - said_s)
            said_s, before = now_s, mapper.counts.received
            line = f"{_line(mapper)}, {rate:.1f} scans/s"
            if progress:
                say(line)
            elif not quiet:
                print_note(f"+{now_s - began_s:.0f} s: {line}")


def _line(mapper: LiveRobot) -> str:
    from tempog.live.accounts import lost_text

    counts = mapper.counts
    objects = 0 if mapper.tracker is None else len(mapper.tracker.found.objects)
    parts = [
        counted(counts.mapped, "scan mapped", "scans mapped"),
        counted(objects, "object", "objects"),
        counted(counts.events, "event", "events"),
    ]
    lost = lost_text(counts)
    return ", ".join(parts) + (f" (lost: {lost})" if lost else "")


def _say_end(mapper: LiveRobot, map_on_disk: LiveMap, path: Path, hurried: bool, *, quiet: bool, json: bool) -> None:
    if json:
        print_json({"map": str(path), "session": map_on_disk.session, "hurried": hurried, **asdict(mapper.counts)})
    elif not quiet:
        typer.echo(
            f"{_line(mapper)}. Session {map_on_disk.session} of {path}, {count_text(mapper.counts.received)} received"
        )
    if hurried and not quiet:
        print_note("the last scans are in the map's journal: who opens the map next puts them in")
