"""What pictures show of a world."""

import numpy as np
from matplotlib.colors import to_rgb

from tempog import build_grid
from tempog.analysis.find_objects import find_objects
from tempog.simulation import Glass, Route, Thing, Wall, World, simulate
from tempog.views.canvas import BLACK
from tempog.views.side_by_side import Row, draw_table_1
from tempog.views.worlds import BLUE, CYAN, PALE_BLUE, YELLOW, bounds, draw_world

WORLD = World(
    robot=Route(((0.0, 0.0),)),
    walls=(Wall.box(2.0, -1.0, 2.2, 1.0),),
    glass=(Glass((-3.0, -1.0), (-3.0, 1.0)),),
    things=(Thing("B", "box", 0.4, 0.4, {"here": (0.0, 1.0, 0.0), "there": (0.0, -1.0, 0.0)}),),
)


def texts(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_glass_and_boxes_are_drawn_and_explained():
    figure = draw_world(simulate(WORLD, 1.0))
    drawn = [to_rgb(patch.get_facecolor()) for patch in figure.axes[0].patches]
    np.testing.assert_allclose(drawn, [BLACK, CYAN, PALE_BLUE, BLUE])
    assert texts(figure) == ["wall", "glass", "box", "its other places", "robot's way"]
    low, high = bounds(WORLD)
    np.testing.assert_allclose([*low, *high], [-3.51, -1.7, 2.7, 1.7])


def test_the_legend_of_three_pictures_names_what_is_in_any_world_and_fits():
    simulation = simulate(WORLD, 1.0)
    figure = draw_table_1([Row("a", simulation, find_objects(build_grid(simulation.scans)))])
    assert texts(figure)[3:] == ["glass", "box", "its other places", "robot's way"]
    figure.canvas.draw()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width
    assert to_rgb(legend.get_patches()[-1].get_facecolor()) == YELLOW
