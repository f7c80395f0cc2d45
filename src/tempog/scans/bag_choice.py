"""What to take from a bag, where it leaves a choice."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError


class Poses(Protocol):
    """What is wanted of poses from elsewhere: x, y (m) and heading (rad) at stamps."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]: ...
    @property
    def poses(self) -> NDArray[np.float64]: ...
    @property
    def source(self) -> str: ...


@dataclass(frozen=True)
class BagChoice:
    """What to take from a bag, where it leaves a choice.

    Attributes
    ----------
    scan_topics : tuple of str
        Topics of LaserScan, or of PointCloud2 with `from_cloud`. Default: every laser.
    fixed_frame : str
        Frame to map in. Default: map, else odom, else the root of the transforms.
    base_frame : str
        Of the robot. Poses are of it where they do not say whose they are, and heights of `from_cloud` are in it.
    pose_topic : str
        Odometry, PoseWithCovarianceStamped or PoseStamped that says where the robot was. Default: transforms do.
    from_cloud : (low, high), metres, optional
        Make scans of the points of a PointCloud2 between these heights.
    trajectory : Poses, optional
        Poses from elsewhere: of `base_frame` if it is given, else of the laser.

    Raises
    ------
    ConfigError
        Heights that are no band, or more than one source of poses.
    """

    scan_topics: tuple[str, ...] = ()
    fixed_frame: str = ""
    base_frame: str = ""
    pose_topic: str = ""
    from_cloud: tuple[float, float] | None = None
    trajectory: Poses | None = None

    def __post_init__(self) -> None:
        if self.from_cloud is not None and not -math.inf < self.from_cloud[0] < self.from_cloud[1] < math.inf:
            raise ConfigError(
                f"from_cloud = {self.from_cloud!r} is no band; wanted low < high in metres, as in 0.2:0.4"
            )
        if self.trajectory is not None and (self.pose_topic or self.fixed_frame):
            raise ConfigError(
                "poses from a file take the place of a pose topic and of a fixed frame; leave those out"
            )
