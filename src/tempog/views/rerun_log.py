"""A map's past for the Rerun viewer: the map over time, objects and their states, people, the robot."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog._extras import need
from tempog._files import whole_file
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.objects import MovingObject
from tempog.errors import ConfigError, MapError, ViewerError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.sensing.grid_spec import Extent
from tempog.times import NS_PER_S, is_unix_time
from tempog.views.canvas import GREY, Colour, as_rgb, paler, thinned
from tempog.views.maps import static_drawing
from tempog.views.objects import object_colour
from tempog.views.pauses import pauses_s
from tempog.views.timeline import PALE

TIMELINE = "time"
MOST_SNAPSHOTS = 200  # of the map over time
MOST_SNAPSHOT_BYTES = 400_000_000  # that the viewer unpacks them to
FEWEST_SNAPSHOTS = 10
MOST_MEASUREMENTS = 2000  # at which people are shown
LONGEST_SIDE_CELLS = 2000
FREE, OCCUPIED, UNKNOWN = 0, 100, 255  # of a nav_msgs/OccupancyGrid, which the viewer colours
PEOPLE_COLOUR = (214, 39, 40)
ROBOT_COLOUR = (240, 190, 0)
NOWHERE_COLOUR = (150, 150, 150)
UNSEEN = ""  # what the viewer leaves a gap for
# By itself the viewer takes data from any machine that can reach it; this one takes it from nobody else.
VIEWER = (sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", "auto")
ABOVE_M = 0.02  # from one layer to the next, so that none hides another
ARROW_M = 0.5
WIDE_VIEW = 2.4  # times as wide as high, of the map's view on a common screen


def log_to_rerun(
    history: History,
    found: FoundObjects | None = None,
    rrd: str | os.PathLike[str] | None = None,
    *,
    every_s: float | None = None,
    name: str = "map",
    force: bool = False,
) -> None:
    """Show a map's past in the Rerun viewer, or write it to a file that the viewer opens.

    The viewer gets a layout of its own: the map over time with objects, people and the robot, the static map, the
    states of each object, and how much was on the move. Needs ``pip install 'tempog[rerun]'``.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    found : FoundObjects, optional
        Default: found now, by the method ``evidence``.
    rrd : path, optional
        The file to write, all of it or nothing. Default: a viewer is started on this machine; this returns when it
        is closed.
    every_s : float, seconds, optional
        Time from one picture of the map to the next. Default: so that there are 200, or as many of a large map as the
        viewer can unpack to 400 MB, but at least 10.
    name : str
        What the recording is called.
    force : bool
        Replace a file that is there.

    Raises
    ------
    ExtraError
        Rerun is not installed.
    MapError
        The file exists and `force` is not set.
    ConfigError
        `every_s` is no time.
    ViewerError
        The viewer cannot be started, as on a machine without a screen.
    TimeError
        There are no scans.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
    >>> path = Path(tempfile.mkdtemp()) / "corridor.rrd"
    >>> log_to_rerun(grid, rrd=path)
    >>> path.read_bytes()[:4]
    b'RRF2'
    """
    rerun = need("rerun", "rerun")
    history.require_scans()
    if every_s is not None and not 0 < every_s < math.inf:
        raise ConfigError(f"every_s = {every_s!r} cannot work; wanted seconds above 0")
    if rrd is not None and Path(rrd).exists() and not force:
        raise MapError(f"{rrd} exists already; use --force (force=True) to replace it, or choose another name")
    found = found or find_objects(history)
    if rrd is not None:
        with whole_file(Path(rrd)) as unfinished:
            _write(unfinished, rerun, history, found, every_s, name)
        return
    with TemporaryDirectory(prefix="tempog-") as folder:
        path = Path(folder) / "map.rrd"
        _write(path, rerun, history, found, every_s, name)
        _show(path)


def _write(path: Path, rerun: Any, history: History, found: FoundObjects, every_s: float | None, name: str) -> None:
    recording = rerun.RecordingStream("tempog")
    recording.save(path)
    try:
        recording.set_log_time_enabled(False)  # when the map was logged is no part of its past
        recording.set_log_tick_enabled(False)
        recording.send_recording_name(name)
        _Log(rerun, recording, history, found).all(every_s)
    finally:
        recording.disconnect()  # writes what is left, and closes the file


def _show(path: Path) -> None:
    """Open a recording in a viewer, until that is closed."""
    ended = subprocess.run([*VIEWER, str(path)], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    if ended.returncode:
        said = ended.stderr.decode(errors="replace").strip().splitlines()
        raise ViewerError(
            f"the Rerun viewer ended with code {ended.returncode}: {said[-1] if said else 'it said nothing'};"
            " where there is no screen, write a file (--rrd, rrd=) and open it elsewhere"
        )


class _Log:
    """What is logged of a map, an entity after the other."""

    def __init__(self, rerun: Any, recording: Any, history: History, found: FoundObjects) -> None:
        self.rr, self.to, self.history, self.found = rerun, recording, history, found
        self.start_ns = history.start_ns
        self.dated = is_unix_time(self.start_ns)
        stamps = history.stamps_ns
        self.first_ns, self.stop_ns = (int(stamps[k]) for k in (history.first_scan, history.last_scan))

    def all(self, every_s: float | None) -> None:
        self.to.send_blueprint(self._blueprint())
        self._static_map()
        self._robot()
        self._occupancy(every_s)
        for k, one in enumerate(self.found.objects):
            self._places(k, one)
            self._states(k, one)
        self._people()

    def _at(self, stamp_ns: int) -> None:
        """What is logged next was so from this moment on."""
        if self.dated:
            self.to.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
        else:
            self.to.set_time(TIMELINE, duration=np.timedelta64(stamp_ns - self.start_ns, "ns"))

    def _times(self, stamps_ns: NDArray[np.int64]) -> Any:
        if self.dated:
            return self.rr.TimeColumn(TIMELINE, timestamp=stamps_ns.astype("datetime64[ns]"))
        return self.rr.TimeColumn(TIMELINE, duration=(stamps_ns - self.start_ns).astype("timedelta64[ns]"))

    def _static_map(self) -> None:
        drawing = static_drawing(self.history)
        rgb, extent = thinned(drawing.rgb, drawing.extent, LONGEST_SIDE_CELLS)
        pixels = np.empty((*extent.shape, 4), dtype=np.uint8)
        pixels[..., :3] = np.round(rgb * 255)
        pixels[..., 3] = np.where(np.any(rgb != as_rgb(GREY), axis=-1), 255, 0)
        self.to.log("static", self._grid_map(pixels, extent, "RGBA"), static=True)

    def _occupancy(self, every_s: float | None) -> None:
        extent = self.history.extent
        lasted_s = max((self.stop_ns - self.first_ns) / NS_PER_S, 1e-3)
        n = min(MOST_SNAPSHOTS, max(FEWEST_SNAPSHOTS, MOST_SNAPSHOT_BYTES // (extent.n_rows * extent.n_cols)))
        step_ns = round((lasted_s / n if every_s is None else every_s) * NS_PER_S)
        previous = None
        for stamp_ns in [*range(self.first_ns, self.stop_ns, max(step_ns, 1)), self.stop_ns]:
            snapshot = self.history.at(np.datetime64(stamp_ns, "ns"), math.inf)
            cells, where = thinned_states(snapshot.value, snapshot.extent, LONGEST_SIDE_CELLS)
            if previous is None or not np.array_equal(cells, previous):
                self._at(stamp_ns)
                self.to.log("world/map", self._grid_map(cells, where, "L"))
                previous = cells

    def _grid_map(self, cells: NDArray[np.uint8], extent: Extent, colours: str) -> Any:
        """Cells as an image, whose first row the viewer puts at the top."""
        x_min, _, y_min, _ = extent.bounds
        form = self.rr.components.ImageFormat(
            width=extent.n_cols, height=extent.n_rows, color_model=colours, channel_datatype="U8"
        )
        return self.rr.GridMap(
            data=np.ascontiguousarray(cells[::-1]).tobytes(),
            format=form,
            cell_size=extent.resolution_m,
            translation=[x_min, y_min, 0.0],
            colormap=self.rr.components.Colormap.RvizMap if colours == "L" else None,
        )

    def _robot(self) -> None:
        period = slice(self.history.first_scan, self.history.last_scan + 1)
        poses = self.history.poses[period]
        points = np.column_stack([poses[:, :2], np.full(len(poses), 3 * ABOVE_M)])
        half = poses[:, 2] / 2
        turns = np.column_stack([np.zeros((len(poses), 2)), np.sin(half), np.cos(half)])
        self.to.log(
            "world/robot",
            self.rr.Arrows3D(vectors=[[ARROW_M, 0, 0]], radii=[ARROW_M / 12], colors=[ROBOT_COLOUR]),
            static=True,
        )
        columns = self.rr.Transform3D.columns(translation=points, quaternion=turns)
        self.to.send_columns("world/robot", [self._times(self.history.stamps_ns[period])], columns)
        way = self.rr.LineStrips3D([points], radii=[-0.75], colors=[[*ROBOT_COLOUR, 90]])
        self.to.log("world/way", way, static=True)

    def _places(self, k: int, one: MovingObject) -> None:
        """All places of an object, pale, joined by a line."""
        pale = _bytes(paler(object_colour(k), PALE))
        points = np.concatenate([place.points_map for place in one.configurations])
        centres = np.array([place.centre_m for place in one.configurations])
        self.to.log(f"world/places/{one.id}", self._points(points, pale, ABOVE_M), static=True)
        line = self.rr.LineStrips3D(
            [_raised(centres, 2 * ABOVE_M)],
            radii=[-1.0],
            colors=[_bytes(object_colour(k))],
            labels=[f"object {one.id}"],
            show_labels=True,
        )
        self.to.log(f"world/places/{one.id}/line", line, static=True)

    def _states(self, k: int, one: MovingObject) -> None:
        """Where an object is, as cells and as a state; nothing while nobody looks."""
        colour = _bytes(object_colour(k))
        texts = {place.id: f"place {place.id}" for place in one.configurations}
        nowhere = "away" if len(texts) == 1 else "unclear"
        shades = [_bytes(paler(object_colour(k), 1 - 0.7 * i / max(len(texts) - 1, 1))) for i in range(len(texts))]
        path = f"objects/object_{one.id}"
        colours = np.array([_rgba(shade) for shade in (*shades, NOWHERE_COLOUR)], dtype=np.uint32)
        look = self.rr.StateConfiguration(values=[*texts.values(), nowhere], colors=colours)
        self.to.log(path, look, static=True)
        cells = {place.id: place.points_map for place in one.configurations}
        gaps, shown = dict(one.gaps), UNSEEN
        changes: list[tuple[int, str]] = []
        for period in one.timeline:
            state = nowhere if period.configuration is None else texts[period.configuration]
            if state != shown:
                changes.append((period.start_ns, state))
                self._at(period.start_ns)
                points = cells[period.configuration] if period.configuration in cells else np.empty((0, 2))
                self.to.log(f"world/objects/{one.id}", self._points(points, colour, 2 * ABOVE_M))
                shown = state
            if period.stop_ns in gaps:
                changes.append((period.stop_ns, UNSEEN))
                shown = UNSEEN
        if not changes:
            return
        stamps = np.array([stamp_ns for stamp_ns, _ in changes], dtype=np.int64)
        states = self.rr.StateChange.columns(state=[state for _, state in changes])
        self.to.send_columns(path, [self._times(stamps)], states)

    def _people(self) -> None:
        lasted_s = (self.stop_ns - self.first_ns) / NS_PER_S
        area_m2 = self.history.tiles.spec.resolution_m**2
        style = self.rr.SeriesLines(colors=[PEOPLE_COLOUR], names=["on the move (m²)"])
        self.to.log("activity/on_the_move", style, static=True)
        for measured in self.found.high_dynamics(every_s=lasted_s / MOST_MEASUREMENTS):
            self._at(measured.stamp_ns)
            self.to.log("world/people", self._points(measured.points_map, PEOPLE_COLOUR, 3 * ABOVE_M))
            self.to.log("activity/on_the_move", self.rr.Scalars([len(measured.cells) * area_m2]))
        period = self.history.stamps_ns[self.history.first_scan : self.history.last_scan + 1]
        for begin_s, _ in pauses_s((period - self.start_ns) / NS_PER_S).tolist():
            self._at(self.start_ns + round(begin_s * NS_PER_S) + 1)  # nobody stands still for a pause without scans
            self.to.log("world/people", self._points(np.empty((0, 2)), PEOPLE_COLOUR, 0.0))

    def _points(self, points_map: NDArray[np.float64], colour: Sequence[int], height_m: float) -> Any:
        """Cells as points of their size."""
        radius = self.history.tiles.spec.resolution_m / 2
        return self.rr.Points3D(_raised(points_map, height_m), radii=[radius], colors=[colour])

    def _blueprint(self) -> Any:
        layout = need("rerun.blueprint", "rerun")
        x_min, x_max, y_min, y_max = self.history.extent.bounds
        x, y = (x_min + x_max) / 2, (y_min + y_max) / 2
        away = max(
            (x_max - x_min) / WIDE_VIEW, y_max - y_min
        )  # from there, the viewer's eye sees that and a tenth more
        from_above = layout.EyeControls3D(
            kind=layout.Eye3DKind.Orbital, position=(x, y, away), look_target=(x, y, 0.0), eye_up=(0.0, 1.0, 0.0)
        )
        maps = layout.Tabs(
            layout.Spatial3DView(origin="/world", name="map over time", eye_controls=from_above, line_grid=False),
            layout.Spatial3DView(
                origin="/",
                contents=["/static", "/world/places/**"],
                name="static map",
                eye_controls=from_above,
                line_grid=False,
            ),
        )
        zero_ns = 0 if self.dated else self.start_ns
        edges = [self.rr.TimeRangeBoundary.absolute(nanos=ns - zero_ns) for ns in (self.first_ns, self.stop_ns)]
        whole = layout.TimeAxis(view_range=self.rr.TimeRange(start=edges[0], end=edges[1]))
        states = layout.StateTimelineView(origin="/objects", name="objects", time_view=whole)
        activity = layout.TimeSeriesView(origin="/activity", name="on the move", axis_x=whole)
        return layout.Blueprint(
            layout.Vertical(maps, states, activity, row_shares=[5, 2, 1]),
            layout.TimePanel(timeline=TIMELINE, expanded=False),
            collapse_panels=True,
        )


def thinned_states(value: NDArray[np.float32], extent: Extent, most_cells: int) -> tuple[NDArray[np.uint8], Extent]:
    """Free, occupied and unknown cells; of those that become one, occupied wins, and then free.

    >>> value = np.array([[0.1, 0.9, np.nan], [0.1, 0.1, np.nan]], dtype=np.float32)
    >>> cells, where = thinned_states(value, Extent(1, 1, 2, 3, 0.05), most_cells=2)
    >>> cells.tolist(), where
    ([[0, 100], [0, 0]], Extent(row0=0, col0=0, n_rows=2, n_cols=2, resolution_m=0.1))
    """
    rank = np.where(np.isnan(value), 0, np.where(value > OCCUPIED_ABOVE, 2, 1)).astype(np.uint8)
    step = math.ceil(max(extent.shape) / most_cells)
    row0, col0 = extent.row0 // step, extent.col0 // step
    n_rows = -(-(extent.row0 + extent.n_rows) // step) - row0
    n_cols = -(-(extent.col0 + extent.n_cols) // step) - col0
    part = Extent(row0 * step, col0 * step, n_rows * step, n_cols * step, extent.resolution_m)
    padded = np.zeros(part.shape, dtype=np.uint8)
    padded[extent.part_of(part)] = rank
    most = padded.reshape(n_rows, step, n_cols, step).max(axis=(1, 3))
    where = Extent(row0, col0, n_rows, n_cols, extent.resolution_m * step)
    return np.array([UNKNOWN, FREE, OCCUPIED], dtype=np.uint8)[most], where


def _raised(points_map: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
    return np.column_stack([points_map, np.full(len(points_map), height_m)])


def _bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in colour)
    return red, green, blue


def _rgba(colour: Sequence[int]) -> int:
    red, green, blue = colour
    return red << 24 | green << 16 | blue << 8 | 255
