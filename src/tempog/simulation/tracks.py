"""People who go where they once went: recorded, or scripted."""

from __future__ import annotations

import gzip
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import WorldError

SAME_TIME_S = 1e-9  # far below any step, far above rounding errors
UNUSED = "-"  # a column that is skipped


@dataclass(frozen=True, eq=False)
class Track:
    """A person who is replayed: straight from each sample to the next, absent before the first and after the last.

    Doors, the robot and walking people mind this person, who minds nobody, and so may walk into them.

    Attributes
    ----------
    samples : (n_samples, 3) float64
        t, x, y: seconds since the start of the simulation (may be negative), metres, metres; t rises.

    Examples
    --------
    >>> Track([(0.0, 1.0, 0.0), (2.0, 3.0, 0.0)]).positions([1.0, 2.0, 2.5]).tolist()
    [[2.0, 0.0], [3.0, 0.0], [nan, nan]]
    """

    samples: NDArray[np.float64]

    def __init__(self, samples: ArrayLike) -> None:
        rows = np.array(samples, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
            raise WorldError(f"a track of shape {rows.shape}; wanted one row t, x, y or more")
        if not np.isfinite(rows).all():
            raise WorldError(f"a track's sample {int(np.argmin(np.isfinite(rows).all(axis=1)))} is not finite")
        if (np.diff(rows[:, 0]) <= 0).any():
            k = int(np.argmax(np.diff(rows[:, 0]) <= 0)) + 1
            raise WorldError(
                f"a track's sample {k} is at {rows[k, 0]:g} s, after {rows[k - 1, 0]:g} s; wanted rising times"
            )
        object.__setattr__(self, "samples", rows)

    def positions(self, t: ArrayLike) -> NDArray[np.float64]:
        """Where the person is at the times `t` (any shape, seconds); (..., 2) metres, NaN while absent."""
        times = np.asarray(t, dtype=np.float64)
        known = self.samples[:, 0]
        here = (times >= known[0] - SAME_TIME_S) & (times <= known[-1] + SAME_TIME_S)
        xy = [np.interp(times, known, self.samples[:, k]) for k in (1, 2)]
        return np.where(here[..., None], np.stack(xy, axis=-1), np.nan)


def read_tracks(
    path: Path,
    columns: Sequence[str] | None = None,
    rate_hz: float = 1.0,
    scale: float = 1.0,
    rotation_rad: float = 0.0,
    offset: tuple[float, float] = (0.0, 0.0),
    start_s: float | None = None,
) -> list[Track]:
    """Read recorded people from a text file, plain or gzip: a row for each person and moment.

    Values are separated by blanks or commas. Empty lines, and what follows a "#", are skipped. Rows may be in any
    order in which each person's times rise.

    Parameters
    ----------
    path : Path
    columns : sequence of str, optional
        What the first columns hold: "t", "x", "y", "person" (any number; without it all rows are one person's) and
        "-" for what is not used. Columns after these are not used. Default: t person x y, or t x y if the first row
        has three values.
    rate_hz : float
        Of t, for files that count frames; 1 if t is in seconds.
    scale, rotation_rad, offset
        From the recording to the map: x and y times `scale` (0.01 for centimetres), turned to the left, and then
        moved by `offset` metres.
    start_s : float, seconds, optional
        When the earliest row is replayed. Default: at its t.

    Returns
    -------
    list of Track
        In the order in which people first appear in the file.

    Raises
    ------
    WorldError
        The file cannot be read, a row is no such row, or a person's times do not rise.
    """
    if not (0 < rate_hz < math.inf and 0 < scale < math.inf):
        raise WorldError(f"rate_hz = {rate_hz!r}, scale = {scale!r}; wanted numbers above 0")
    names = None if columns is None else _checked(columns)
    rows: dict[float, list[tuple[float, float, float]]] = {}
    for number, line in enumerate(read_recording(path).splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        if names is None:
            names = ["t", "x", "y"] if len(words) == 3 else ["t", "person", "x", "y"]
        try:
            if len(words) < len(names):
                raise ValueError
            row = {name: float(word) for name, word in zip(names, words, strict=False) if name != UNUSED}
            if not all(math.isfinite(value) for value in row.values()):
                raise ValueError
        except ValueError:
            raise WorldError(
                f"{path}, line {number} is {line[:60]!r}; wanted the numbers {' '.join(names)}"
            ) from None
        person = rows.setdefault(row.get("person", 0.0), [])
        if person and row["t"] <= person[-1][0]:
            raise WorldError(
                f"{path}, line {number} is at t = {row['t']:g}, after this person's row at t = {person[-1][0]:g};"
                " wanted rising times. Does `columns` name the right ones?"
            )
        person.append((row["t"], row["x"], row["y"]))
    if not rows:
        raise WorldError(f"{path} has no rows; wanted numbers t person x y")
    first = min(person[0][0] for person in rows.values())
    shift_s = 0.0 if start_s is None else start_s - first / rate_hz
    c, s = scale * math.cos(rotation_rad), scale * math.sin(rotation_rad)
    tracks = []
    for person in rows.values():
        t, x, y = np.array(person).T
        x_map, y_map = offset[0] + c * x - s * y, offset[1] + s * x + c * y
        tracks.append(Track(np.column_stack([t / rate_hz + shift_s, x_map, y_map])))
    return tracks


def read_recording(path: Path) -> str:
    """The text of a file, plain or gzip."""
    try:
        data = path.read_bytes()
        return (gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data).decode()
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise WorldError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error


def _checked(columns: Sequence[str]) -> list[str]:
    used = [name for name in columns if name != UNUSED]
    if sorted(name for name in used if name != "person") != ["t", "x", "y"] or len(used) != len(set(used)):
        raise WorldError(
            f'columns = {list(columns)!r}; wanted "t", "x", "y" once each, "person" at most once, and "-" for others'
        )
    return list(columns)
