"""``tempog replay``: a log played as the robot that recorded it."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Annotated, Literal

import typer

from tempog.cli._output import QuietFlag, count_text, counted, print_note, status, wants_progress
from tempog.cli._robots import (
    BridgeFlag,
    DomainOption,
    NamespaceOption,
    Ros1Flag,
    ZenohOption,
    connection_of,
    patience,
)
from tempog.errors import ConfigError, LinkError

DELAY_S = 1.0  # s; until those who listen are connected


def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Any log that tempog map reads.")],
    rate: Annotated[str, typer.Option(metavar="N", help="How many times faster than it was; max: no waiting.")] = "1",
    zenoh: ZenohOption = None,
    bridge: BridgeFlag = False,
    ros1: Ros1Flag = False,
    domain: DomainOption = 0,
    namespace: NamespaceOption = "",
    scan_topic: Annotated[str, typer.Option(metavar="TOPIC", help="Of the LaserScans.")] = "scan",
    fixed_frame: Annotated[str, typer.Option(metavar="FRAME", help="That the log's poses are in.")] = "map",
    stamps: Annotated[
        Literal["log", "now"], typer.Option(help="As they are in the log, or as if it happened now.")
    ] = "log",
    loop: Annotated[bool, typer.Option("--loop", help="Begin anew at the end; time goes on.")] = False,
    delay: Annotated[float, typer.Option(min=0, help="Seconds before the first scan, for who listens.")] = DELAY_S,
    quiet: QuietFlag = False,
) -> None:
    """Play a log as the robot that recorded it: LaserScan, /tf and /tf_static."""
    speed = _rate(rate)
    from tempog.live.replay import Replay
    from tempog.live.stopping import Stop
    from tempog.live.transport import connect
    from tempog.scans.bag_writer import Frames, Mount
    from tempog.scans.open import open_scans

    with status(f"reading {log}", wants_progress(quiet)):
        scans = open_scans(log)
    connection = connection_of(zenoh, bridge, ros1, domain, namespace, node="replay", patient=True)
    with Stop() as stop:
        try:
            transport = connect(connection, patience(stop, quiet))
        except LinkError:
            if stop():
                return
            raise
        mount = Mount(topic=connection.full_name(scan_topic))
        start_ns = time.time_ns() + round(delay * 1e9) if stamps == "now" else None
        player = Replay(
            transport, scans, mount=mount, frames=Frames(fixed=fixed_frame), rate=speed, start_ns=start_ns
        )
        if not quiet:
            typer.echo(f"{counted(len(scans), 'scan', 'scans')} on {mount.topic}, through {transport.where}")
        until_s = time.monotonic() + delay
        while time.monotonic() < until_s and not stop():
            time.sleep(0.05)
        try:
            player.run(stop, times=math.inf if loop else 1)
            time.sleep(min(delay, DELAY_S))  # what was sent last is on its way
        except KeyboardInterrupt:
            pass  # asked twice
        finally:
            transport.close()
    if not quiet:
        print_note(f"{count_text(player.n_scans)} scans were played")
        if player.n_spaced:
            print_note(
                f"{count_text(player.n_spaced)} of them had beams that no LaserScan can hold: moved to even angles"
            )


def _rate(text: str) -> float:
    if text == "max":
        return math.inf
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0 < rate < math.inf:
        raise ConfigError(f"--rate {text} is no rate; wanted a number above 0, such as 1 or 2.5, or max")
    return rate
