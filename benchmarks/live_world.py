"""A robot with two lasers among doors that swing often, as messages."""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Iterator, Sequence
from heapq import merge
from typing import NamedTuple

import numpy as np

from tempog.ros.bag_writers import OutMessage
from tempog.ros.messages import Codec, StampedTransform, tf_message
from tempog.scans.bag_writer import Mount, messages_of
from tempog.scans.scan import Scan
from tempog.simulation import World, simulate
from tempog.simulation.world_file import world_from_tables
from tempog.times import NS_PER_S

RATE_HZ = 20  # of each laser
TF_HZ = 50
TF_PHASE_S = 0.003  # transforms do not come just when scans do: each scan waits for the next
N_BEAMS = 720
N_DOORS = 8
MOUNTS = (Mount("/scan", "laser"), Mount("/upper", "upper", z_m=0.6))


class Said(NamedTuple):
    """A message, and when it is sent, in seconds from the start."""

    at_s: float
    message: OutMessage


def world(duration_s: float) -> World:
    """A hall of 20 m by 8 m with gates along both sides, each of which swings every few seconds, and two people."""
    parts = [
        f'name = "gates"\nduration_s = {duration_s}\n',
        "[robot]\nwaypoints = [[1, 0], [19, 0]]\n",
        "[people]\nnumber = 2\nlegs = true\ngoals = [[2, 1], [18, -1], [10, 0.8]]\n",
        f"[laser]\nn_beams = {N_BEAMS}\nfov_deg = 359.5\nrate_hz = {2 * RATE_HZ}\nmax_range_m = 25\n",
        "[[wall]]\nline = [[0, -4], [20, -4], [20, 4], [0, 4]]\nclosed = true\n",
    ]
    for k in range(N_DOORS):
        x, side = 2.5 + 5 * (k // 2), 1 if k % 2 else -1
        parts.append(
            f"[[wall]]\nline = [[{x}, {side * 4}], [{x}, {side * 3}]]\n"
            f"[door.D{k}]\nhinge = [{x}, {side * 2.95}]\nlength_m = 0.9\nmove_s = 0.6\n"
            f"places = {{ across = {-90 * side}, along = 0 }}\n"
            f"schedule.dwell_s = {{ across = {3 + k % 3}, along = {3 + k % 2} }}\n"
        )
    return world_from_tables(tomllib.loads("\n".join(parts)))


def scans_of(duration_s: float) -> list[Scan]:
    """Scans of both lasers in turn."""
    return list(simulate(world(duration_s), seed=7).scans)


def said(codec: Codec, scans: Sequence[Scan]) -> Iterator[Said]:
    """What the robot says, in the order that it does: every transform and every scan at its stamp."""
    start_ns = scans[0].stamp_ns
    sweeps = (
        messages_of(scan, codec, mount)[-1] for scan, mount in zip(scans, itertools.cycle(MOUNTS), strict=False)
    )
    for message in merge(_transforms(codec, scans), sweeps, key=lambda one: one.stamp_ns):
        yield Said((message.stamp_ns - start_ns) / NS_PER_S, message)


def _transforms(codec: Codec, scans: Sequence[Scan]) -> Iterator[OutMessage]:
    t_s = np.array([(scan.stamp_ns - scans[0].stamp_ns) / NS_PER_S for scan in scans])
    x, y, theta = np.array([(scan.x, scan.y, scan.theta) for scan in scans]).T
    theta = np.unwrap(theta)
    for at_s in np.arange(-1 / TF_HZ + TF_PHASE_S, t_s[-1] + 2 / TF_HZ, 1 / TF_HZ).tolist():
        here = tuple(float(np.interp(at_s, t_s, values)) for values in (x, y, theta))
        half = here[2] / 2
        turned = (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
        stamp_ns = scans[0].stamp_ns + round(at_s * NS_PER_S)
        moved = [
            StampedTransform(stamp_ns, "map", "odom", (0.0, 0.0, 0.0)),
            StampedTransform(stamp_ns, "odom", "base_link", (here[0], here[1], 0.0), turned),
        ]
        yield OutMessage("/tf", stamp_ns, tf_message(codec, moved))
