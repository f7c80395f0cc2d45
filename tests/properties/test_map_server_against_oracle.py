"""Files of map_server: what is written comes back, and pixels mean what map_server's own code says."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from oracle.map_server import nav2_cell, ros1_cell
from tempog.errors import MapError
from tempog.export.map_server import (
    SCALE_THRESHOLDS,
    TRINARY_THRESHOLDS,
    Nav2Map,
    cells_of,
    image_bytes,
    read_nav2_map,
    write_nav2_map,
)
from tempog.export.yaml_text import read_flat_yaml, to_yaml
from tempog.sensing.grid_spec import Extent

SHAPES = array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12)
PERCENT = arrays(np.int8, SHAPES, elements=st.integers(-1, 100))
TRINARY = arrays(np.int8, SHAPES, elements=st.sampled_from([-1, 0, 100]))
PIXELS = arrays(np.uint8, st.tuples(st.integers(1, 6), st.integers(1, 6), st.sampled_from([1, 3, 4])))


@settings(deadline=None, max_examples=150)
@given(
    data=st.data(),
    mode=st.sampled_from(["trinary", "scale", "raw"]),
    row0=st.integers(-(10**6), 10**6),
    col0=st.integers(-(10**6), 10**6),
    resolution_m=st.sampled_from([0.01, 0.025, 0.05, 0.1, 0.2, 1.0]),
)
def test_what_is_written_comes_back(data, mode, row0, col0, resolution_m) -> None:
    cells = data.draw(TRINARY if mode == "trinary" else PERCENT)
    extent = Extent(row0, col0, *cells.shape, resolution_m)
    with tempfile.TemporaryDirectory() as folder:
        yaml, _ = write_nav2_map(Path(folder) / "a", Nav2Map.over(cells, extent), mode)
        back = read_nav2_map(yaml)
    assert np.array_equal(back.cells, cells)
    assert back.extent == extent


@settings(deadline=None, max_examples=300)
@given(
    pixels=PIXELS,
    mode=st.sampled_from(["trinary", "scale", "raw"]),
    negate=st.booleans(),
    thresholds=st.lists(st.floats(0.01, 0.99), min_size=2, max_size=2, unique=True),
)
def test_pixels_mean_what_nav2_makes_of_them(pixels, mode, negate, thresholds) -> None:
    free_thresh, occupied_thresh = sorted(thresholds)
    cells = cells_of(pixels, mode, negate, occupied_thresh, free_thresh)
    n_rows, n_cols, n_channels = pixels.shape
    for row in range(n_rows):
        for col in range(n_cols):
            of_pixel = pixels[n_rows - 1 - row, col].tolist()
            rgb = of_pixel * 3 if n_channels == 1 else of_pixel[:3]
            rgba = (*rgb, of_pixel[3] if n_channels == 4 else 255)
            wanted = nav2_cell(rgba, n_channels == 4, mode, negate, occupied_thresh, free_thresh)
            assert cells[row, col] == wanted


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_ros_1_reads_free_occupied_and_unknown_alike(mode: str) -> None:
    occupied_thresh, free_thresh = SCALE_THRESHOLDS if mode == "scale" else TRINARY_THRESHOLDS
    for value in (-1, 0, 100):
        image = image_bytes(np.array([[value]], dtype=np.int8), mode)
        if mode == "scale":
            grey, opaque = {-1: (128, 0), 0: (255, 255), 100: (0, 255)}[value]
            channels: tuple[int, ...] = (grey, grey, grey, opaque)
        else:
            channels = (image[-1],)
        assert ros1_cell(channels, mode, False, occupied_thresh, free_thresh) == value


def test_ros_1_is_off_by_one_percent_at_most_in_scale_mode() -> None:
    for value in range(101):
        grey = round(255 * (1 - value / 100))
        assert abs(ros1_cell((grey, grey, grey, 255), "scale", False, *SCALE_THRESHOLDS) - value) <= 2


@settings(deadline=None, max_examples=300)
@given(
    st.dictionaries(
        st.sampled_from(["image", "mode", "negate", "origin", "on", "x_1"]),
        st.one_of(
            st.booleans(),
            st.integers(-(2**40), 2**40),
            st.floats(-1e9, 1e9).map(lambda value: round(value, 6)),
            st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=8),
            st.lists(st.integers(-5, 5), max_size=4),
        ),
    )
)
def test_flat_yaml_comes_back(document) -> None:
    import yaml

    document = {key: value + 0.0 if isinstance(value, float) else value for key, value in document.items()}
    text = to_yaml(document, "a comment: with [a list")
    assert yaml.safe_load(text) == (document or None)
    if "on" not in document:  # quoted keys are for parsers
        assert read_flat_yaml(text, "it") == document


@settings(deadline=None, max_examples=300)
@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.yaml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(MapError):
            read_nav2_map(path)
