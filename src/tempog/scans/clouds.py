"""Point clouds -> sweeps: of the points in a band of heights, the nearest in every direction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.errors import MessageError
from tempog.ros.messages import Sweep, frame_name, stamp_ns_of
from tempog.ros.transforms import MAX_POSITION_M

BEAM_DEG = 0.5
N_BEAMS = round(360 / BEAM_DEG)
FLOAT_FIELDS = {7: "f4", 8: "f8"}  # PointField.FLOAT32, FLOAT64
# Where beams point: the middle of each half degree.
BEAM_ANGLES = np.radians(np.arange(N_BEAMS) * BEAM_DEG + BEAM_DEG / 2 - 180.0)
BEAM_ANGLES.flags.writeable = False


def points_of(message: Any) -> NDArray[np.float64]:
    """The points of a PointCloud2, (n, 3) metres in its own frame, without those that are nowhere on Earth.

    Raises
    ------
    MessageError
        No fields x, y and z of float32 or float64, or fewer bytes than it says.
    """
    fields = {field.name: field for field in message.fields}
    if not {"x", "y", "z"} <= fields.keys():
        raise MessageError(f"a cloud with the fields {', '.join(list(fields)[:9]) or 'none'}; wanted x, y and z")
    step, width, height = int(message.point_step), int(message.width), int(message.height)
    order = ">" if message.is_bigendian else "<"
    offsets, kinds = [], []
    for name in "xyz":
        kind = FLOAT_FIELDS.get(int(fields[name].datatype))
        if kind is None or int(fields[name].offset) + int(kind[1]) > step:
            raise MessageError(f"a cloud whose field {name} is no float32 or float64 within {step} bytes")
        offsets.append(int(fields[name].offset))
        kinds.append(order + kind)
    layout = np.dtype({"names": ["x", "y", "z"], "formats": kinds, "offsets": offsets, "itemsize": step})
    data = np.ascontiguousarray(message.data, dtype=np.uint8)
    tight = height <= 1 or (
        not message.row_step and len(data) == height * width * step
    )  # some drivers say no row_step
    row = width * step if tight else int(message.row_step)
    if row < width * step or len(data) < row * height:
        raise MessageError(f"a cloud of {height} rows of {width} points of {step} bytes in {len(data)} bytes")
    rows = data[: row * height].reshape(height, row)[:, : width * step]
    points = np.ascontiguousarray(rows).reshape(-1).view(layout)
    xyz = np.column_stack([points[name].astype(np.float64) for name in "xyz"])
    return xyz[(np.abs(xyz) <= MAX_POSITION_M).all(axis=1)]


def sweep_of_cloud(
    message: Any,
    frame: str,
    band_m: tuple[float, float],
    rotation: NDArray[np.float64] | None = None,
    translation_m: NDArray[np.float64] | None = None,
    origin_m: tuple[float, float] = (0.0, 0.0),
) -> Sweep:
    """The nearest point of a band of heights in every half degree, as a sweep.

    A beam without a point is NaN, which says nothing: the sensor may have seen nothing, or looked above or below the
    band, or its driver dropped what it saw; free space is what lies before points alone.

    Parameters
    ----------
    message : a PointCloud2
    frame : str
        Of the sweep.
    band_m : (low, high), metres
    rotation, translation_m : (3, 3) and (3,), optional
        From the cloud's frame to the one that heights are in. Default: they are the same.
    origin_m : (x, y), metres
        Where the sensor is in that.

    Examples
    --------
    >>> from tempog.ros.messages import Codec, point_cloud
    >>> points = np.array([[2.0, 0.0, 0.3], [3.0, 0.0, 0.3], [1.0, 0.0, 0.9]])
    >>> sweep = sweep_of_cloud(point_cloud(Codec("ros2"), 0, "lidar", points), "lidar", (0.2, 0.4))
    >>> len(sweep.ranges), np.nanmin(sweep.ranges), int(np.isfinite(sweep.ranges).sum())
    (720, np.float32(2.0), 1)
    """
    points = points_of(message)
    if rotation is not None:
        points = points @ rotation.T
    if translation_m is not None:
        points = points + translation_m
    inside = points[(points[:, 2] >= band_m[0]) & (points[:, 2] <= band_m[1])]
    x, y = inside[:, 0] - origin_m[0], inside[:, 1] - origin_m[1]
    away = np.hypot(x, y)
    beam = ((np.degrees(np.arctan2(y, x)) + 180.0) / BEAM_DEG).astype(np.intp) % N_BEAMS
    nearest = np.full(N_BEAMS, np.inf)
    np.minimum.at(nearest, beam[away > 0], away[away > 0])
    ranges = np.where(np.isfinite(nearest), nearest, np.nan).astype(np.float32)
    ranges.flags.writeable = False
    return Sweep(stamp_ns_of(message.header.stamp), frame, BEAM_ANGLES, ranges, math.inf)


def frame_of(message: Any) -> str:
    """Frame of a message with a header."""
    return frame_name(message.header.frame_id)
