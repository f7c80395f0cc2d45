"""The figures of `tempog.views.figures`: their common face, their files, their colours."""

from __future__ import annotations

import base64
import inspect
import io
import re
from itertools import combinations, pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from tempog import TimeError, build_grid, find_objects, map_diff
from tempog.sensing.grid_spec import Extent
from tempog.simulation import corridor, simulate
from tempog.views import canvas, diff, figures, objects, worlds
from tempog.views.canvas import BLACK, GREY, WHITE, thinned
from tempog.views.layers import Layer

# How full protanopia, deuteranopia and tritanopia change linear RGB: Machado, Oliveira and Fernandes 2009.
SEEN_BY = {
    "everybody": np.eye(3),
    "without red cones": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "without green cones": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "without blue cones": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
XYZ_OF_RGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
LEAST_APART = 12.0  # in CIELAB: colours of patches that lie beside each other are told apart from 2 or 3 on


def lab(colour, seen_by):
    rgb = np.asarray(colour, dtype=float)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ_OF_RGB @ np.clip(np.asarray(seen_by) @ linear, 0, 1) / [0.9505, 1.0, 1.089]
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize(
    "colours",
    [
        [*objects.OBJECT_COLOURS, objects.LONE_COLOUR, objects.UNCERTAIN_COLOUR, BLACK, WHITE, GREY],
        [canvas.ORANGE, BLACK, WHITE, GREY],
        [diff.APPEARED, diff.VANISHED, diff.OCCUPIED, diff.NOT_SEEN_AGAIN, diff.NOT_SEEN_WALL, GREY, WHITE],
        [worlds.RED, worlds.PALE_RED, worlds.BLUE, worlds.PALE_BLUE, worlds.CYAN, worlds.YELLOW, worlds.GREEN, BLACK],
    ],
    ids=["objects", "static", "diff", "worlds"],
)
@pytest.mark.parametrize("who", SEEN_BY)
def test_colours_of_one_picture_can_be_told_apart(colours, who):
    for one, other in combinations(colours, 2):
        apart = np.linalg.norm(lab(one, SEEN_BY[who]) - lab(other, SEEN_BY[who]))
        assert apart > LEAST_APART, (one, other)


@pytest.fixture(scope="module")
def simulation():
    return simulate(corridor(), 90.0)


@pytest.fixture(scope="module")
def grid(simulation):
    return build_grid(simulation.scans)


@pytest.fixture(scope="module")
def found(grid):
    return find_objects(grid)


@pytest.fixture
def drawn_of(simulation, grid, found):
    """What each function that takes axes is given first."""
    of_history = dict.fromkeys(("occupancy", "age", "static", "dynamics", "classic"), (grid,))
    of_found = dict.fromkeys(("objects", "people", "timeline"), (found,))
    rest = {"cell": (grid, 6.98, 2.53), "diff": (map_diff(grid, "+40", "+80"),), "world": (simulation,)}
    return {f"draw_{name}": given for name, given in {**of_history, **of_found, **rest}.items()}


def test_all_but_layers_and_tables_are_drawn_on_given_axes_with_the_legend_below(drawn_of):
    public = {name for name in figures.__all__ if name.startswith("draw_")}
    assert public - set(drawn_of) == {"draw_layer", "draw_table_1"}
    for name, given in drawn_of.items():
        whole = Figure(figsize=(12, 6), layout="constrained")
        left, right = whole.subplots(1, 2)
        assert getattr(figures, name)(*given, title="mine", axes=left) is whole
        whole.draw_without_rendering()
        assert left.get_title(loc="left").replace("\n", " ").startswith("mine · ")
        assert left._left_title.get_window_extent().x1 < right.get_window_extent().x0, name
        below, ticks = left.get_legend().get_window_extent(), left.xaxis.get_tightbbox()
        assert 0 <= below.y0 < below.y1 <= ticks.y0, name
        assert not whole.legends
        assert not right.has_data()


def test_every_function_of_a_layer_names_its_parameters_alike():
    for name in figures.__all__:
        names = list(inspect.signature(getattr(figures, name)).parameters)
        if name.startswith("draw_") and name not in ("draw_layer", "draw_table_1"):
            assert names[-2:] == ["title", "axes"], name


@pytest.mark.parametrize("layer", Layer.__args__)
def test_a_layer_by_name_is_the_figure_of_its_function(grid, found, layer):
    name = {"high-dynamic": "people"}.get(layer, layer)
    ours = figures.draw_layer(grid, layer, title="t")
    other = getattr(figures, f"draw_{name}")(found if name in ("objects", "people", "timeline") else grid, title="t")
    pixels = []
    for figure in (ours, other):
        file = io.BytesIO()
        figure.savefig(file, dpi=40)
        pixels.append(file.getvalue())
    assert pixels[0] == pixels[1]


def test_a_cell_that_nobody_saw_has_no_picture(grid):
    with pytest.raises(TimeError, match=r"the cell at \(99, 2.5\) m was not seen"):
        figures.draw_cell(grid, 99.0, 2.5)


def test_a_cell_s_picture_shows_each_state_as_high_as_its_probability(grid):
    axes = figures.draw_cell(grid, 6.98, 2.53).axes[0]
    states = grid.history(6.98, 2.53)
    white, bars = axes.containers
    assert len(white) == len(bars) == len(states)
    assert [bar.get_height() for bar in bars] == pytest.approx([state.value for state in states])
    assert [bar.get_x() for bar in bars] == pytest.approx([(s.start_ns - grid.start_ns) / 1e9 for s in states])
    assert all(one.get_x() + one.get_width() <= later.get_x() + 1e-9 for one, later in pairwise(bars))


def test_vector_files_hold_each_cell_once_and_fonts_that_journals_take(grid, tmp_path):
    for suffix in (".pdf", ".svg"):
        for name in ("one", "two"):
            figures.save_figure(figures.draw_static(grid), tmp_path / f"{name}{suffix}")
        assert (tmp_path / f"one{suffix}").read_bytes() == (tmp_path / f"two{suffix}").read_bytes()
    assert b"/Type3" not in (tmp_path / "one.pdf").read_bytes()
    text = (tmp_path / "one.svg").read_text(encoding="utf-8")
    (data,) = re.findall(r"data:image/png;base64,([^\"]+)", text)
    image = Image.open(io.BytesIO(base64.b64decode(data)))
    shown = figures.draw_static(grid).axes[0].images[0].get_array()
    assert image.size == shown.shape[1::-1]
    assert "image-rendering:pixelated" in text


def test_a_picture_that_cannot_be_written_leaves_what_was_there(grid, tmp_path):
    path = tmp_path / "walls.png"
    path.write_bytes(b"mine")
    with pytest.raises(ValueError, match="pixels"):
        figures.save_figure(figures.draw_static(grid), path, dpi=1e7)
    assert path.read_bytes() == b"mine"
    assert list(tmp_path.iterdir()) == [path]


def test_a_map_of_more_cells_than_pixels_keeps_its_walls_closed():
    chosen = np.random.default_rng(3)
    rgb = np.ones((400, 900, 3), dtype=np.float32)
    rgb[:40] = GREY
    rgb[100, :] = BLACK
    rgb[:, 333] = BLACK
    extent = Extent(int(chosen.integers(-50, 50)), int(chosen.integers(-50, 50)), 400, 900, 0.05)
    fewer, where = thinned(rgb, extent, most_cells=100)
    assert max(fewer.shape) <= 101
    assert where.resolution_m == pytest.approx(0.45)
    dark = np.all(fewer == np.array(BLACK, dtype=np.float32), axis=-1)
    assert dark.all(axis=1).sum() == dark.all(axis=0).sum() == 1
    for (row, col), cell in np.ndenumerate(dark):
        assert cell == (row == (100 + extent.row0) // 9 - where.row0 or col == (333 + extent.col0) // 9 - where.col0)
    x_min, x_max, y_min, y_max = where.bounds
    assert x_min <= extent.bounds[0] < extent.bounds[1] <= x_max
    assert y_min <= extent.bounds[2] < extent.bounds[3] <= y_max
