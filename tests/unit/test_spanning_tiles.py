"""Several tiles in one picture are the same tiles side by side."""

import io
import json
import urllib.error
import urllib.request

import numpy as np
import pytest

from tempog import build_grid
from tempog.simulation import corridor, simulate

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")


@pytest.fixture(scope="module")
def home():
    from tempog.views.web.serve import serve_in_thread
    from tempog.views.web.sources import HistorySource

    grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    with serve_in_thread(HistorySource(grid, "corridor"), port=0) as viewer:
        yield viewer.url


def picture(home, address):
    from PIL import Image

    with urllib.request.urlopen(home + address) as answer:
        return np.asarray(Image.open(io.BytesIO(answer.read())).convert("RGBA"))


@pytest.mark.parametrize("layer", ["occupancy", "age", "static"])
def test_several_tiles_in_one_picture_are_the_same_as_one_by_one(home, layer):
    t = "" if layer == "static" else "t=13&"
    spanned = picture(home, f"api/tiles/{layer}/0/-1/-1.png?{t}cols=3&rows=2")
    assert spanned.shape == (512, 768, 4)
    assert spanned[..., 3].any()
    for row in (-1, 0):
        for col in (-1, 0, 1):
            top, left = 256 * (0 - row), 256 * (col + 1)
            alone = picture(home, f"api/tiles/{layer}/0/{col}/{row}.png?{t}")
            np.testing.assert_array_equal(spanned[top : top + 256, left : left + 256], alone)


@pytest.mark.parametrize("span", ["cols=65", "cols=9&rows=9", "cols=0", "rows=-1", "cols=x"])
def test_too_many_tiles_are_refused(home, span):
    with pytest.raises(urllib.error.HTTPError, match="400") as refused:
        urllib.request.urlopen(f"{home}api/tiles/occupancy/0/0/0.png?{span}")
    assert "error" in json.loads(refused.value.read())
    refused.value.close()
