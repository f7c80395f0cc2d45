"""Pictures as arrays, read by another program than the one that wrote them."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image


def pixels_of(picture: bytes) -> np.ndarray:
    """``(n_rows, n_cols, 4)`` red, green, blue, alpha; the first row is the top one."""
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGBA"))
