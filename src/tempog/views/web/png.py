"""PNG pictures of a few colours: a palette, and as few bits for each pixel as it takes."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tempog.views.web.kernels import packed

Rgba = tuple[int, int, int, int]
LEVEL = (
    1  # of zlib: a tile of walls takes 0.2 ms; higher ones save a third of its bytes, and take three times as long
)


def encode_png(codes: NDArray[np.uint8], palette: Sequence[Rgba]) -> bytes:
    """A picture whose pixels are places in a palette of up to 256 colours.

    Parameters
    ----------
    codes : (n_rows, n_cols) uint8
        The first row is at the top. A multiple of 8 columns.
    palette : sequence of (red, green, blue, alpha), 0..255

    Examples
    --------
    >>> encode_png(np.zeros((8, 8), np.uint8), [(0, 0, 0, 0)])[:8]
    b'\\x89PNG\\r\\n\\x1a\\n'
    """
    n_rows, n_cols = codes.shape
    bits = next(bits for bits in (1, 2, 4, 8) if len(palette) <= 1 << bits)
    rows = np.empty((n_rows, 1 + n_cols * bits // 8), dtype=np.uint8)
    packed(codes, bits, rows)
    colours = bytes(part for colour in palette for part in colour[:3])
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            _chunk(b"IHDR", struct.pack(">IIBBBBB", n_cols, n_rows, bits, 3, 0, 0, 0)),
            _chunk(b"PLTE", colours),
            _chunk(b"tRNS", bytes(colour[3] for colour in palette)),
            _chunk(b"IDAT", zlib.compress(rows.tobytes(), LEVEL)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
