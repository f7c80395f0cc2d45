"""Pictures of maps in a page: an embedded image of the cells, with signs and a legend that the page lays out."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_hex
from numpy.typing import NDArray
from PIL import Image

from tempog.analysis.find_objects import FoundObjects
from tempog.sensing.grid_spec import Extent
from tempog.texts import count_text
from tempog.views.canvas import GREY, Colour, Rgb, as_rgb, cropped, round_length, thinned
from tempog.views.maps import Drawing
from tempog.views.markup import Html, joined, tag
from tempog.views.objects import (
    base_legend,
    chain,
    counts,
    lone_legend,
    object_cells,
    object_colour,
)

LONGEST_SIDE_CELLS = 1600  # of an embedded image; a map of more cells is thinned out
FEW_CELLS = 1000  # across: with more, cells are smaller than pixels on most screens
MOST_NUMBERED = 256  # that a PNG can number
CROWD = 60  # numbers on a picture, from which on they are small
SCALE_STEPS = 12  # colours of a gradient
SCALE_SHARE = 5  # the scale bar is at most such a part of the width


class Sign(NamedTuple):
    """A number on a picture, at a point in metres."""

    text: str
    colour: Colour
    x: float
    y: float


def picture(
    drawing: Drawing,
    title: str,
    caption: str,
    *,
    wide: bool = False,
    signs: Sequence[Sign] = (),
    lines: Html | None = None,
) -> Html:
    """A figure of the page.

    Parameters
    ----------
    drawing : Drawing
    title, caption : str
        What it shows, in a few words and in a sentence.
    wide : bool
        Whether the picture is as wide as the page.
    signs : sequence of Sign
    lines : Html, optional
        Elements of an SVG image in metres, y up.
    """
    rgb, extent = thinned(*cropped(drawing.rgb, drawing.extent), LONGEST_SIDE_CELLS)
    coarse = "coarse" if wide and extent.n_cols <= FEW_CELLS else None
    size = {"width": extent.n_cols, "height": extent.n_rows}
    image = tag("img", src=png_address(rgb), alt=drawing.title, class_=coarse, **size)
    parts = [image, *_overlay(extent, lines), *(_label(extent, sign) for sign in signs), _scale_bar(extent)]
    keys = [_key(colour, text) for colour, text in drawing.legend]
    if drawing.colours is not None:
        keys.append(_colour_scale(drawing.colours, drawing.colours_label))
    return tag(
        "figure",
        tag("div", *parts, class_="map tinted crowded" if len(signs) > CROWD else "map tinted"),
        tag("figcaption", tag("strong", title), tag("br"), caption),
        tag("ul", *keys, class_="keys"),
        style=f"--aspect:{aspect(extent):.3f}",
    )


def objects_picture(found: FoundObjects) -> Html:
    """Walls, places and objects, each with its number."""
    lines, signs = [], []
    for k, one in enumerate(found.objects):
        centres = np.array([place.centre_m for place in one.configurations])
        points = " ".join(f"{x:.2f},{y:.2f}" for x, y in centres[chain(centres)].tolist())
        dotted = "4 4" if any(place.hypothesis for place in one.configurations) else None
        lines.append(tag("polyline", points=points, stroke=to_hex(object_colour(k)), stroke_dasharray=dotted))
        x, y = centres.mean(axis=0).tolist()
        signs.append(Sign(str(one.id), object_colour(k), x, y))
    legend = [*base_legend([found]), *lone_legend([found])]
    drawing = Drawing(object_cells(found), found.extent, counts(found), legend)
    caption = "Each object has a colour and a number, as in the table; a line joins its places."
    if any(place.hypothesis for one in found.objects for place in one.configurations):
        caption += " A dotted line leads to a place that was hardly ever seen free."
    return picture(drawing, counts(found), caption, wide=True, signs=signs, lines=joined(*lines))


def aspect(extent: Extent) -> float:
    """How much wider than high."""
    return extent.n_cols / extent.n_rows


def swatch(colour: Colour, style: str = "") -> Html:
    """A little square of a colour; where no style sheet gives it a size, `style` does."""
    return tag("span", class_="swatch tinted", style=f"{style}background:{to_hex(colour)}")


def png_address(rgb: Rgb, transparent: bool = True) -> str:
    """A ``data:`` address of an image whose first row is at the top of the map; unexplored is transparent.

    >>> png_address(np.ones((2, 2, 3), dtype=np.float32))[:22]
    'data:image/png;base64,'
    """
    seen = np.any(rgb != as_rgb(GREY), axis=-1)
    bytes_ = np.round(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
    pixels = np.concatenate([bytes_, np.where(seen, 255, 0).astype(np.uint8)[..., None]], axis=-1)
    if not transparent:
        pixels[..., 3] = 255
    pixels[pixels[..., 3] == 0] = 0
    file = io.BytesIO()
    _image_of(np.ascontiguousarray(pixels[::-1])).save(file, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode("ascii")


def _image_of(pixels: NDArray[np.uint8]) -> Image.Image:
    """An image of numbered colours where there are few enough: a third of the bytes."""
    colours, numbers = np.unique(pixels.view(np.uint32)[..., 0], return_inverse=True)
    if len(colours) > MOST_NUMBERED:
        return Image.fromarray(pixels, "RGBA")
    image = Image.fromarray(numbers.reshape(pixels.shape[:2]).astype(np.uint8), "P")
    table = colours.view(np.uint8).reshape(-1, 4)
    image.putpalette(table[:, :3].tobytes(), "RGB")
    image.info["transparency"] = table[:, 3].tobytes()
    return image


def _overlay(extent: Extent, lines: Html | None) -> Iterable[Html]:
    if not lines:
        return []
    x_min, x_max, y_min, y_max = extent.bounds
    # y grows downwards in an SVG.
    view = f"{x_min:g} {-y_max:g} {x_max - x_min:g} {y_max - y_min:g}"
    flipped = tag("g", lines, transform="scale(1,-1)")
    return [tag("svg", flipped, viewBox=view, preserveAspectRatio="none", aria_hidden="true")]


def _label(extent: Extent, sign: Sign) -> Html:
    x_min, x_max, y_min, y_max = extent.bounds
    left, top = (sign.x - x_min) / (x_max - x_min), (y_max - sign.y) / (y_max - y_min)
    where = f"left:{left:.2%};top:{top:.2%};color:{to_hex(sign.colour)}"
    return tag("span", sign.text, class_="number", style=where)


def _scale_bar(extent: Extent) -> Html:
    width = extent.n_cols * extent.resolution_m
    length = round_length(width / SCALE_SHARE)
    return tag("span", f"{length:g} m", class_="scale", style=f"width:{length / width:.2%}")


def _key(colour: Colour, text: str) -> Html:
    if colour == GREY:
        return tag("li", tag("span", class_="swatch unexplored"), text)
    return tag("li", swatch(colour), text)


def _colour_scale(colours: ScalarMappable, label: str) -> Html:
    low, high = colours.get_clim()
    assert low is not None
    assert high is not None
    shades = ", ".join(to_hex(tuple(shade)) for shade in colours.get_cmap()(np.linspace(0, 1, SCALE_STEPS)).tolist())
    bar = tag("span", class_="gradient tinted", style=f"background:linear-gradient(90deg, {shades})")
    return tag(
        "li", tag("span", f"{_number_text(low)} ", bar, f" {_number_text(high)}", class_="ends"), label, class_="wide"
    )


def _number_text(value: float) -> str:
    """A number at the end of a scale.

    >>> _number_text(0.5), _number_text(2650.93)
    ('0.5', '2 651')
    """
    return f"{value:.3g}" if value < 100 else count_text(round(value))
