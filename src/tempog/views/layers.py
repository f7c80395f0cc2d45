"""What can be drawn. Kept apart from the drawing, so that the command line can name layers without Matplotlib."""

from __future__ import annotations

from typing import Literal

Layer = Literal["occupancy", "static", "dynamics", "classic", "age", "objects", "high-dynamic", "timeline"]
FOUND_LAYERS = ("objects", "high-dynamic", "timeline")  # layers that need objects to be found
MOMENT_LAYERS = ("occupancy", "age")  # layers of one moment; the others are of a period
