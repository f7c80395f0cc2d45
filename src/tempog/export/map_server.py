"""Files that map_server of ROS 1 and Nav2 read: an image of cells and a YAML file beside it.

What a pixel becomes follows nav2_map_server's map_io.cpp and, where they agree, ROS 1's image_loader.cpp. The image's
first row is the map's last: row 0 of our arrays is the southern edge.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tempog._files import whole_file
from tempog.errors import ConfigError, MapError
from tempog.export.yaml_text import read_flat_yaml, to_yaml
from tempog.sensing.grid_spec import Extent
from tempog.sensing.tiles import FARTHEST_CELL

Mode = Literal["trinary", "scale", "raw"]
MODES: tuple[Mode, ...] = get_args(Mode)
UNKNOWN, FREE, OCCUPIED = -1, 0, 100
FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL = 254, 205, 0
RAW_UNKNOWN_PIXEL = 255
HALF_GREY = 128  # below a transparent pixel; ROS 1 looks at thresholds before it looks at transparency

# 205 is occupied by 50/255 = 0.19608: unknown, as it is not below 0.196. With the 0.25 that Nav2's saver takes if
# nothing is said, unknown cells would come back free.
TRINARY_THRESHOLDS = (0.65, 0.196)
# Every percent is a pixel of its own, and 0 and 100 come back as themselves by ROS 1's rule, too.
SCALE_THRESHOLDS = (0.998, 0.002)
LATTICE_M = 1e-6  # by how much an origin may lie off the lattice: what rounding in a file does


@dataclass(frozen=True, eq=False)
class Nav2Map:
    """A map as nav_msgs/OccupancyGrid has it.

    Attributes
    ----------
    cells : (n_rows, n_cols) int8
        0 free to 100 occupied, -1 unknown; row 0 is the southern edge.
    resolution_m : float, metres
    origin : (x, y, yaw), metres and radians
        Pose of the lower left corner of cell [0, 0] in the map frame.
    """

    cells: NDArray[np.int8]
    resolution_m: float
    origin: tuple[float, float, float]

    @classmethod
    def over(cls, cells: NDArray[np.int8], extent: Extent) -> Nav2Map:
        """Cells over an extent of our lattice."""
        x_min, _, y_min, _ = extent.bounds
        return cls(cells, extent.resolution_m, (x_min, y_min, 0.0))

    @property
    def extent(self) -> Extent:
        """Where the cells lie on our lattice, which has a corner at the map frame's origin.

        Raises
        ------
        MapError
            The map is turned, lies between the lattice's lines, or farther away than it reaches.
        """
        x, y, yaw = self.origin
        if not max(abs(x), abs(y)) < FARTHEST_CELL * self.resolution_m:
            raise MapError(
                f"the map's origin is [{x}, {y}, {yaw}]: that is more than {FARTHEST_CELL} cells of"
                f" {self.resolution_m} m away; wanted metres, near the map frame's origin"
            )
        row0, col0 = round(y / self.resolution_m), round(x / self.resolution_m)
        off_m = max(abs(row0 * self.resolution_m - y), abs(col0 * self.resolution_m - x))
        if yaw != 0 or off_m > LATTICE_M:
            raise MapError(
                f"the map's origin is [{x}, {y}, {yaw}]: it is turned, or off the lattice of {self.resolution_m} m by"
                f" {off_m:.4f} m; wanted no yaw, and multiples of the resolution"
            )
        n_rows, n_cols = self.cells.shape
        return Extent(row0, col0, n_rows, n_cols, self.resolution_m)


def write_nav2_map(path: Path, written: Nav2Map, mode: Mode = "trinary", *, comment: str = "") -> tuple[Path, Path]:
    """Write a map as ``PATH.yaml`` and an image: PGM for ``trinary`` and ``raw``, a PNG for ``scale``.

    Parameters
    ----------
    path : Path
        Without a suffix. Files that are there are replaced.
    written : Nav2Map
    mode : "trinary", "scale" or "raw"
        ``trinary`` keeps free (below 50), occupied and unknown; ``scale`` and ``raw`` every percent.
    comment : str
        Put at the top of the YAML file.

    Returns
    -------
    (yaml, image)

    Raises
    ------
    ConfigError
        An unknown mode, or cells outside -1..100.
    """
    check_mode(mode)
    image = path.with_name(f"{path.name}.{'png' if mode == 'scale' else 'pgm'}")
    yaml = path.with_name(f"{path.name}.yaml")
    with whole_file(image) as unfinished:
        unfinished.write_bytes(image_bytes(written.cells, mode))
    occupied_thresh, free_thresh = SCALE_THRESHOLDS if mode == "scale" else TRINARY_THRESHOLDS
    document = {
        "image": image.name,
        "mode": mode,
        "resolution": float(written.resolution_m),
        "origin": [float(part) for part in written.origin],
        "negate": 0,
        "occupied_thresh": occupied_thresh,
        "free_thresh": free_thresh,
    }
    with whole_file(yaml) as unfinished:
        unfinished.write_text(to_yaml(document, comment), encoding="utf-8")
    return yaml, image


def check_mode(mode: str) -> None:
    """ConfigError for what is no mode of map_server."""
    if mode not in MODES:
        raise ConfigError(f"mode = {mode!r} is none of map_server's; wanted one of {', '.join(MODES)}")


def image_bytes(cells: NDArray[np.int8], mode: Mode) -> bytes:
    """The image file of some cells, (n_rows, n_cols) int8 with row 0 at the bottom."""
    if cells.ndim != 2 or not cells.size or cells.min() < UNKNOWN or cells.max() > OCCUPIED:
        raise ConfigError(f"cells of shape {cells.shape} cannot be a map; wanted rows and columns from -1 to 100")
    rows = cells[::-1].astype(np.float64)
    unknown = rows < 0
    if mode == "scale":
        shade = np.where(unknown, HALF_GREY, np.rint(255 * (1 - rows / OCCUPIED))).astype(np.uint8)
        opaque = np.where(unknown, 0, 255).astype(np.uint8)
        return _png(np.stack([shade, shade, shade, opaque], axis=-1))
    if mode == "raw":
        pixels = np.where(unknown, RAW_UNKNOWN_PIXEL, rows)
    else:
        pixels = np.where(unknown, UNKNOWN_PIXEL, np.where(rows < OCCUPIED / 2, FREE_PIXEL, OCCUPIED_PIXEL))
    n_rows, n_cols = cells.shape
    return f"P5\n{n_cols} {n_rows}\n255\n".encode() + pixels.astype(np.uint8).tobytes()


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """Red, green, blue and alpha: GraphicsMagick, by which Nav2 reads, loses the alpha of a grey image."""
    from io import BytesIO

    from PIL import Image

    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", compress_level=9)
    return buffer.getvalue()


def read_nav2_map(path: str | Path) -> Nav2Map:
    """Read a map as map_server does, by the rules of nav2_map_server's map_io.cpp.

    Parameters
    ----------
    path : str or Path
        The YAML file; its image is looked up beside it. PGM, PNG, BMP and what else Pillow reads.

    Returns
    -------
    Nav2Map

    Raises
    ------
    MapError
        A file that is missing or damaged, a key that is missing, or a value that map_server refuses.

    Notes
    -----
    Where Nav2 and ROS 1 differ, Nav2 is followed: ``raw`` heeds no ``negate``, ``scale`` rounds to 0..100 (ROS 1 cuts
    to 0..99), and what is transparent in ``scale`` is unknown whatever its shade.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise MapError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise MapError(f"{path} is no text; wanted the YAML file of a map, not its image") from error
    entries = read_flat_yaml(text, str(path))
    name = _entry(entries, "image", path, str)
    if not name:
        raise MapError(f"{path}: image is empty; wanted the name of the map's image")
    resolution_m = _number(entries, "resolution", path)
    if not 0 < resolution_m < math.inf:
        raise MapError(f"{path}: resolution: {resolution_m} cannot work; wanted metres above 0")
    origin = _entry(entries, "origin", path, list)
    if len(origin) != 3 or not all(_is_number(part) for part in origin):
        raise MapError(f"{path}: origin: {origin} cannot work; wanted [x, y, yaw]")
    mode = entries.get("mode", "trinary")
    if mode not in MODES:
        raise MapError(f"{path}: mode: {mode!r} is none of map_server's; wanted one of {', '.join(MODES)}")
    negate = entries.get("negate")
    if not isinstance(negate, bool | int):
        raise MapError(f"{path}: negate: {negate!r} cannot work; wanted 0 or 1")
    thresholds = _number(entries, "occupied_thresh", path), _number(entries, "free_thresh", path)
    pixels = _read_image(path.parent / name)
    x, y, yaw = (float(part) for part in origin)
    return Nav2Map(cells_of(pixels, mode, bool(negate), *thresholds), resolution_m, (x, y, yaw))


def _entry(entries: dict[str, Any], key: str, path: Path, kind: type) -> Any:
    value = entries.get(key)
    if kind is str and _is_number(value):  # a file may be called 1
        value = str(value)
    if not isinstance(value, kind):
        seen = "is missing" if key not in entries else f"{value!r} cannot work"
        raise MapError(
            f"{path}: {key}: {seen}; wanted a map_server file with image, resolution, origin, negate,"
            " occupied_thresh and free_thresh"
        )
    return value


def _number(entries: dict[str, Any], key: str, path: Path) -> float:
    value = entries.get(key)
    if not _is_number(value):
        seen = "is missing" if key not in entries else f"{value!r} is no number"
        raise MapError(f"{path}: {key}: {seen}; wanted a number")
    return float(str(value))


def _is_number(value: Any) -> bool:
    # Comparing, as math.isfinite raises for integers of hundreds of digits.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _read_image(path: Path) -> NDArray[np.uint8]:
    """Pixels as (n_rows, n_cols, 1 grey or 4 of colour and alpha), top row first."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            if "A" in image.getbands() or "transparency" in image.info:
                return np.asarray(image.convert("RGBA"))
            if image.mode in ("L", "1"):
                return np.asarray(image.convert("L"))[..., None]
            if image.mode.startswith("I"):  # 16 bits
                return np.rint(np.asarray(image)[..., None] / 257).astype(np.uint8)
            return np.asarray(image.convert("RGB"))
    except UnidentifiedImageError as error:
        raise MapError(f"{path} is no image; wanted PGM, PNG or BMP") from error
    except OSError as error:
        raise MapError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise MapError(f"{path} is no image that can be read: {error}") from error


def cells_of(
    pixels: NDArray[np.uint8], mode: Mode, negate: bool, occupied_thresh: float, free_thresh: float
) -> NDArray[np.int8]:
    """What map_server makes of pixels, (n_rows, n_cols, n_channels) with the top row first and alpha fourth.

    >>> grey = np.array([[[254], [205], [0]]], dtype=np.uint8)
    >>> cells_of(grey, "trinary", False, 0.65, 0.196).tolist()
    [[0, -1, 100]]
    """
    has_alpha = pixels.shape[2] == 4
    # To preserve what it did before it knew modes, map_server takes alpha for a fourth colour in trinary mode.
    averaged = pixels if mode == "trinary" or not has_alpha else pixels[..., :3]
    shade = averaged.astype(np.float64).mean(axis=2) / 255
    if mode == "raw":
        percent = np.floor(shade * 255 + 0.5)
        cells = np.where(percent <= OCCUPIED, percent, UNKNOWN)
    else:
        occupied = shade if negate else 1 - shade
        between = np.full(occupied.shape, float(UNKNOWN))
        if mode == "scale" and occupied_thresh > free_thresh:
            between = np.rint((occupied - free_thresh) / (occupied_thresh - free_thresh) * 100)
        cells = np.where(occupied > occupied_thresh, OCCUPIED, np.where(occupied < free_thresh, FREE, between))
        if mode == "scale" and has_alpha:
            cells = np.where(pixels[..., 3] < 255, UNKNOWN, cells)
    return cells[::-1].astype(np.int8)
