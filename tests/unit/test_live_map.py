"""What a live map promises beside the answers of a grid: windows that are held, settings, sessions, what stays."""

from __future__ import annotations

import numpy as np

from same_history import CONFIG, room_scans
from tempog import LiveMap, map_dynamics
from tempog.scans.scan import Scan


def moved(scans: list[Scan], x_m: float) -> list[Scan]:
    """The same room elsewhere."""
    return [
        Scan(0.0, (scan.x + x_m, scan.y, scan.theta), scan.angles, scan.ranges, stamp_ns=scan.stamp_ns)
        for scan in scans
    ]


def test_windows_and_areas_that_are_held_do_not_change_when_a_second_robot_maps_on(tmp_path):
    scans = room_scans(120)
    with LiveMap(tmp_path / "m", CONFIG, robot="a") as live:
        live.integrate_many(scans[40:])
    with LiveMap(tmp_path / "m", robot="b", flush_s=1.0) as live:
        live.integrate_many(room_scans(40, seed=1)[:20])
        window, area = live.window(scans[50].t, scans[90].t), live.area(-1.0, 1.0, -1.0, 2.0)
        n_scans = live.n_scans

        def answers():
            start_ns, stop_ns = (int(window.stamps_ns[k]) for k in (window.first_scan, window.last_scan))
            return start_ns, stop_ns, list(window.history(0.0, 1.95)), map_dynamics(window), map_dynamics(area)

        before = answers()
        assert before[:2] == (scans[50].stamp_ns, scans[90].stamp_ns)
        assert before[2]
        live.integrate_many(moved(room_scans(40, seed=1)[20:], 20.0))  # new tiles, and scans between the others
        assert live.n_scans == n_scans + 20
        after = answers()
    assert after[:3] == before[:3]
    for mine, yours in zip(after[3:], before[3:], strict=True):
        np.testing.assert_array_equal(mine, yours)
    assert window.poses.shape == (n_scans, 3)
