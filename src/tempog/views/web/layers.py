"""The layers of the viewer: what their pixels' codes mean, and in which colours they are drawn."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from tempog.views.web.png import Rgba

Theme = Literal["light", "dark"]
THEMES: tuple[Theme, ...] = ("light", "dark")
N_AGES = 15  # classes of age; with "unknown" they fit four bits
N_SHADES = 15  # of what has an amount
CLEAR: Rgba = (0, 0, 0, 0)
FAINTEST = 0.25  # opacity of the least amount that is drawn
MOST_FADED = 0.85  # opacity of the veil over what was seen longest ago

WALL: dict[Theme, Rgba] = {"light": (18, 18, 23, 255), "dark": (242, 243, 245, 255)}
FLOOR: dict[Theme, Rgba] = {"light": (255, 255, 255, 255), "dark": (29, 32, 38, 255)}
VEIL: dict[Theme, Rgba] = {"light": (189, 191, 196, 255), "dark": (58, 61, 66, 255)}
CHANGING: dict[Theme, Rgba] = {"light": (230, 159, 0, 255), "dark": (230, 159, 0, 255)}
WALKED: dict[Theme, Rgba] = {"light": (0, 114, 178, 255), "dark": (86, 180, 233, 255)}
MOVING: dict[Theme, Rgba] = {"light": (204, 0, 119, 255), "dark": (255, 121, 198, 255)}
# From yellow to red, getting darker: told apart without colours, too. In the dark the strongest is the brightest.
STRENGTHS: dict[Theme, tuple[Rgba, ...]] = {
    "light": ((254, 217, 118, 255), (253, 141, 60, 255), (227, 26, 28, 255), (128, 0, 38, 255)),
    "dark": ((122, 30, 40, 255), (214, 69, 45, 255), (253, 160, 70, 255), (255, 237, 160, 255)),
}


class LayerOfPage(NamedTuple):
    """A layer that can be asked for.

    Attributes
    ----------
    id, title : str
    kind : "moment" or "period"
        Whether it shows one moment or all that is known.
    """

    id: str
    title: str
    kind: Literal["moment", "period"]


LAYERS = {
    layer.id: layer
    for layer in (
        LayerOfPage("occupancy", "Occupancy", "moment"),
        LayerOfPage("age", "Age", "moment"),
        LayerOfPage("static", "Static map", "period"),
        LayerOfPage("dynamics", "Dynamics", "period"),
        LayerOfPage("people", "Where people walk", "period"),
        LayerOfPage("people-now", "On the move", "moment"),
    )
}


def palette(layer: str, theme: Theme) -> tuple[Rgba, ...]:
    """The colour of each code of a layer; code 0 is where there is nothing to show."""
    return PALETTES[layer, theme]


def _palette(layer: str, theme: Theme) -> tuple[Rgba, ...]:
    if layer == "occupancy":
        return (CLEAR, FLOOR[theme], WALL[theme])
    if layer == "age":
        opacities = [MOST_FADED * k / (N_AGES - 1) for k in range(N_AGES)]
        return (CLEAR, *(_faded(VEIL[theme], opacity) for opacity in opacities))
    if layer == "static":
        return (CLEAR, FLOOR[theme], CHANGING[theme], WALL[theme])
    if layer == "people-now":
        return (CLEAR, MOVING[theme])
    shares = [k / (N_SHADES - 1) for k in range(N_SHADES)]
    colours = [_between(STRENGTHS[theme], share) if layer == "dynamics" else WALKED[theme] for share in shares]
    return (
        CLEAR,
        *(_faded(colour, FAINTEST + (1 - FAINTEST) * s) for colour, s in zip(colours, shares, strict=True)),
    )


def _faded(colour: Rgba, opacity: float) -> Rgba:
    return (*colour[:3], round(255 * opacity))


def _between(colours: tuple[Rgba, ...], share: float) -> Rgba:
    at = share * (len(colours) - 1)
    k = min(int(at), len(colours) - 2)
    parts = [round(a + (b - a) * (at - k)) for a, b in zip(colours[k], colours[k + 1], strict=True)]
    return (parts[0], parts[1], parts[2], parts[3])


PALETTES = {(layer, theme): _palette(layer, theme) for layer in LAYERS for theme in THEMES}


def layer_entries(most_faded_s: float, most_walked: int) -> list[dict[str, Any]]:
    """All layers with their legends as JSON has them.

    Parameters
    ----------
    most_faded_s : float, seconds
        Age from which on the veil is densest.
    most_walked : int
        How often somebody came to the cell where most walk.
    """
    labels: dict[str, list[tuple[int, str]]] = {
        "occupancy": [(2, "occupied"), (1, "free")],
        "age": [(1, "seen just now"), (N_AGES, f"last seen {_duration(most_faded_s)} before, or longer")],
        "static": [(3, "static"), (1, "free"), (2, "changing")],
        "dynamics": [(1, "changes a little"), (N_SHADES, "changes often")],
        "people": [(1, "once"), (N_SHADES, f"{most_walked} times or more")],
        "people-now": [(1, "on the move")],
    }
    return [
        {
            "id": layer.id,
            "title": layer.title,
            "kind": layer.kind,
            "legend": [
                {
                    "colour": css_colour(palette(layer.id, "light")[code]),
                    "colour_dark": css_colour(palette(layer.id, "dark")[code]),
                    "label": label,
                }
                for code, label in labels[layer.id]
            ],
        }
        for layer in LAYERS.values()
    ]


def css_colour(colour: Rgba) -> str:
    """A colour as style sheets have it.

    >>> css_colour((255, 128, 0, 255)), css_colour((0, 0, 0, 51))
    ('#ff8000', '#00000033')
    """
    opaque = colour[3] == 255
    return "#" + bytes(colour[:3] if opaque else colour).hex()


def _duration(seconds: float) -> str:
    for unit, size in (("d", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
