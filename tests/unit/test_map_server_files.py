"""Maps as map_server of ROS 1 and Nav2 reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tempog.errors import ConfigError, MapError
from tempog.export.map_server import Nav2Map, read_nav2_map, write_nav2_map

# North up: the image's first row is the map's last.
CELLS = np.array([[-1, 0, 0], [100, 0, -1]], dtype=np.int8)
MAP = Nav2Map(CELLS, 0.05, (-1.0, 2.5, 0.0))


def test_an_image_is_a_plain_pgm_with_north_up(tmp_path: Path) -> None:
    yaml, image = write_nav2_map(tmp_path / "hall", MAP)
    assert image.read_bytes() == b"P5\n3 2\n255\n" + bytes([0, 254, 205, 205, 254, 254])
    assert yaml.read_text() == (
        'image: "hall.pgm"\nmode: "trinary"\nresolution: 0.05\norigin: [-1.0, 2.5, 0.0]\nnegate: 0\n'
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def test_shares_become_shades_and_unknown_transparent(tmp_path: Path) -> None:
    _, image = write_nav2_map(
        tmp_path / "hall", Nav2Map(np.array([[-1, 0, 40, 100]], np.int8), 0.05, (0, 0, 0)), "scale"
    )
    assert image.suffix == ".png"
    with Image.open(image) as picture:
        assert picture.mode == "RGBA"
        pixels = np.asarray(picture)[0]
    assert pixels[:, 3].tolist() == [0, 255, 255, 255]
    assert pixels[1:, 0].tolist() == [255, 153, 0]


def test_raw_values_are_the_pixels(tmp_path: Path) -> None:
    _, image = write_nav2_map(
        tmp_path / "speed", Nav2Map(np.array([[-1, 0, 50, 100]], np.int8), 0.05, (0, 0, 0)), "raw"
    )
    assert image.read_bytes()[-4:] == bytes([255, 0, 50, 100])


def test_files_of_map_saver_are_read(tmp_path: Path) -> None:
    (tmp_path / "old.pgm").write_bytes(b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n2 1\n255\n" + bytes([254, 0]))
    (tmp_path / "old.yaml").write_text(
        "image: old.pgm\nresolution: 0.050000\norigin: [-12.200000, -13.800000, 0.000000]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n\n"
    )
    read = read_nav2_map(tmp_path / "old.yaml")
    assert read.cells.tolist() == [[0, 100]]
    assert (read.extent.row0, read.extent.col0) == (-276, -244)


def test_lists_comments_and_quotes_as_people_write_them(tmp_path: Path) -> None:
    write_nav2_map(tmp_path / "m", MAP)
    (tmp_path / "m.yaml").write_text(
        "---\nimage: 'm.pgm'   # beside this file\nresolution: 5e-2\norigin:\n  - -1\n  - 2.5\n  - 0.0\n"
        "negate: false\noccupied_thresh: .65\nfree_thresh: 0.196\n"
    )
    assert read_nav2_map(tmp_path / "m.yaml").extent == MAP.extent


def test_negate_turns_black_and_white(tmp_path: Path) -> None:
    yaml, _ = write_nav2_map(tmp_path / "m", Nav2Map(np.array([[0, 100]], np.int8), 0.05, (0, 0, 0)))
    yaml.write_text(yaml.read_text().replace("negate: 0", "negate: 1"))
    assert read_nav2_map(yaml).cells.tolist() == [[100, 0]]


def test_what_nav2_would_do_with_its_savers_threshold(tmp_path: Path) -> None:
    """205 is unknown only below 0.196: with 0.25 unknown cells come back free."""
    yaml, _ = write_nav2_map(tmp_path / "m", MAP)
    yaml.write_text(yaml.read_text().replace("0.196", "0.25"))
    assert read_nav2_map(yaml).cells.tolist() == [[0, 0, 0], [100, 0, 0]]


@pytest.mark.parametrize(
    ("kind", "pixels"),
    [
        ("16 bits", np.array([[65535, 0, 205 * 257]], dtype=np.uint16)),
        ("colour", np.array([[[255, 255, 255], [0, 0, 0], [205, 205, 205]]], dtype=np.uint8)),
        ("grey and alpha", np.array([[[255, 255], [0, 255], [128, 0]]], dtype=np.uint8)),
        ("black and white", np.array([[True, False]])),
    ],
)
def test_images_of_other_kinds_are_read(tmp_path: Path, kind: str, pixels: np.ndarray) -> None:
    yaml, image = write_nav2_map(tmp_path / "m", MAP)
    Image.fromarray(pixels).save(image.with_suffix(".png"))
    mode = "scale" if kind == "grey and alpha" else "trinary"
    yaml.write_text(yaml.read_text().replace("m.pgm", "m.png").replace("trinary", mode))
    assert read_nav2_map(yaml).cells.tolist() == [[0, 100, -1][: pixels.shape[1]]]


@pytest.mark.parametrize(("resolution", "origin"), [("0.05", "[1e300, 0, 0]"), ("1e-320", "[5, 1, 0]")])
def test_a_map_farther_away_than_the_lattice_reaches_has_no_place_on_it(tmp_path, resolution, origin) -> None:
    yaml, _ = write_nav2_map(tmp_path / "m", MAP)
    text = yaml.read_text().replace("[-1.0, 2.5, 0.0]", origin)
    yaml.write_text(text.replace("resolution: 0.05", f"resolution: {resolution}"))
    with pytest.raises(MapError, match="near the map frame's origin"):
        _ = read_nav2_map(yaml).extent


@pytest.mark.parametrize("origin", ["[0.0, 0.0, 0.5]", "[0.02, 0.0, 0.0]"])
def test_a_turned_map_has_cells_but_no_place_on_the_lattice(tmp_path: Path, origin: str) -> None:
    yaml, _ = write_nav2_map(tmp_path / "m", MAP)
    yaml.write_text(yaml.read_text().replace("[-1.0, 2.5, 0.0]", origin))
    read = read_nav2_map(yaml)
    assert np.array_equal(read.cells, CELLS)
    with pytest.raises(MapError, match="turned, or off the lattice"):
        _ = read.extent


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("image:", "picture:", "image: is missing"),
        ('"m.pgm"', '""', "image is empty"),
        ('"m.pgm"', '"n.pgm"', r"cannot read .*n\.pgm"),
        ('"m.pgm"', '"m.yaml"', "is no image"),
        ("resolution: 0.05", "resolution: -1", "wanted metres above 0"),
        ("resolution: 0.05", "resolution: fine", "'fine' is no number"),
        ("resolution: 0.05", f"resolution: {'9' * 400}", "is no number"),
        ("[-1.0, 2.5, 0.0]", "[1, 2]", "wanted .x, y, yaw."),
        ("[-1.0, 2.5, 0.0]", "[1, 2", "has no end"),
        ("trinary", "binary", "wanted one of trinary, scale, raw"),
        ("negate: 0", "", "negate: None"),
        ("free_thresh: 0.196", "free_thresh:", "free_thresh"),
        ("negate: 0", "what is this", "line 5: 'what is this'"),
    ],
)
def test_what_map_server_refuses_is_said(tmp_path: Path, old: str, new: str, message: str) -> None:
    yaml, _ = write_nav2_map(tmp_path / "m", MAP)
    yaml.write_text(yaml.read_text().replace(old, new))
    with pytest.raises(MapError, match=message):
        read_nav2_map(yaml)


def test_a_missing_file_and_an_image_in_its_place_are_said(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="No such file"):
        read_nav2_map(tmp_path / "none.yaml")
    _, image = write_nav2_map(tmp_path / "m", MAP)
    with pytest.raises(MapError, match="no text"):
        read_nav2_map(image.rename(tmp_path / "m.yaml"))


@pytest.mark.parametrize("cells", [np.full((2, 2), 101), np.full((2, 2), -2), np.empty((0, 3)), np.zeros(4)])
def test_cells_that_are_no_map_are_refused(tmp_path: Path, cells: np.ndarray) -> None:
    with pytest.raises(ConfigError, match="wanted rows and columns from -1 to 100"):
        write_nav2_map(tmp_path / "m", Nav2Map(cells.astype(np.int8), 0.05, (0, 0, 0)))
    assert not list(tmp_path.iterdir())
