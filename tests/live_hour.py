"""A process that is live with a robot for an hour of the robot's time: python live_hour.py MAP MINUTES, prints JSON.

The drive of a minute is driven again and again; time goes on, and doors move as they did.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from live_peers import Memory
from tempog.config import MapConfig
from tempog.live.replay import Replay
from tempog.live.robot import LiveRobot, LiveSettings
from tempog.live.warming import warm_up
from tempog.ros.messages import Codec
from tempog.simulation import corridor, simulate
from tempog.store.live_map import LiveMap

DRIVE_S = 120.0
N_BEAMS = 720


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def main(path: str, minutes: float) -> None:
    from dataclasses import replace

    world = corridor()
    world = replace(world, laser=replace(world.laser, n_beams=N_BEAMS))
    scans = simulate(world, duration_s=DRIVE_S).scans
    memory = Memory()
    warm_up(MapConfig(), Codec("ros2"))
    measured: list[tuple[float, float]] = []
    with LiveMap(path, window="5min") as live:
        robot = LiveRobot(memory, live, LiveSettings(("/scan",)))
        player = Replay(memory, scans, rate=float("inf"))
        done = {"scans": 0}

        def over() -> bool:
            while len(robot._inbox):
                robot.step(0.0)
            for sent in memory.sent.values():
                del sent[:-1]
            if player.n_scans != done["scans"]:
                done["scans"] = player.n_scans
                if player.n_scans % 600 == 0:  # a minute of 10 Hz
                    measured.append((player.n_scans / 600, resident_mb()))
            return player.n_scans >= 600 * minutes

        player.run(over, times=float("inf"))
        robot.close()
        counts = robot.counts
    print(
        json.dumps({"mapped": counts.mapped, "lost": counts.lost, "events": counts.events, "resident_mb": measured})
    )


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
