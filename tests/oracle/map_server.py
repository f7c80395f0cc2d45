"""What map_server makes of one pixel, as its C++ does it: Nav2's map_io.cpp, and ROS 1's image_loader.cpp."""

from __future__ import annotations

import math


def nav2_cell(
    rgba: tuple[int, int, int, int], matte: bool, mode: str, negate: bool, occupied_thresh: float, free_thresh: float
) -> int:
    """One pixel by loadMapFromFile of nav2_map_server; `matte` says whether the image has alpha (255 opaque)."""
    channels = list(rgba[:3])
    if mode == "trinary" and matte:
        channels.append(rgba[3])
    shade = sum(channels) / len(channels) / 255
    occ = shade if negate else 1.0 - shade
    if mode == "trinary":
        if occupied_thresh < occ:
            return 100
        return 0 if occ < free_thresh else -1
    if mode == "scale":
        if matte and rgba[3] != 255:
            return -1
        if occupied_thresh < occ:
            return 100
        if occ < free_thresh:
            return 0
        return round((occ - free_thresh) / (occupied_thresh - free_thresh) * 100.0)  # rint: half to even, as round
    percent = math.floor(shade * 255 + 0.5)
    return percent if 0 <= percent <= 100 else -1


def ros1_cell(channels: tuple[int, ...], mode: str, negate: bool, occupied_thresh: float, free_thresh: float) -> int:
    """One pixel by loadMapFromFile of ROS 1's map_server; one channel is grey, four are colour and alpha."""
    n_averaged = len(channels) if mode == "trinary" or len(channels) < 4 else len(channels) - 1
    mean = sum(channels[:n_averaged]) / n_averaged
    alpha = 1 if len(channels) == 1 else channels[-1]
    if negate:
        mean = 255 - mean
    if mode == "raw":
        return int(mean) - 256 * (mean >= 128)  # an unsigned char that becomes a signed one
    occ = (255 - mean) / 255.0
    if occ > occupied_thresh:
        return 100
    if occ < free_thresh:
        return 0
    if mode == "trinary" or alpha < 1.0:
        return -1
    return int(99 * (occ - free_thresh) / (occupied_thresh - free_thresh))
