"""Clouds as sweeps."""

from __future__ import annotations

import numpy as np
import pytest

from tempog.ros.messages import Codec, point_cloud
from tempog.scans.clouds import sweep_of_cloud


@pytest.mark.parametrize("far", [np.nan, np.inf, 3e38])
def test_points_nowhere_on_earth_say_nothing(far: float) -> None:
    codec = Codec("ros2")
    points = np.array([[2.0, 0.0, 0.3], [0.0, far, 0.3]])
    sweep = sweep_of_cloud(point_cloud(codec, 0, "lidar", points), "lidar", (0.2, 0.4))
    assert sweep.ranges[~np.isnan(sweep.ranges)].tolist() == [2.0]
