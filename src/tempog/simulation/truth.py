"""The truth about a simulated log: what was where at each scan, and what the beams really met.

It is kept as two files beside the log. ``LOG.truth.json`` holds what does not fit into arrays: walls, the laser, and
for each door and box its places and its states over time. ``LOG.truth.npz`` holds, for each scan, the arrays of
`Truth`. Both together are all a judge needs; the world itself is not.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog._files import whole_file
from tempog.errors import EmptyWindowError, TruthError
from tempog.simulation.cell_sets import cells_at, contained, unique_cells
from tempog.simulation.polygons import covered_cells
from tempog.simulation.simulation import MOVING, START_S, Hit, Simulation, turned

FORMAT = "tempog-truth"
VERSION = 1
ARRAYS = ("t", "poses", "sweep_ends", "distances", "hits", "hit_things", "places", "corners", "people")
SUFFIXES = (".truth.json", ".truth.npz")
SAME_STAMP_S = 1e-3  # logs keep microseconds, and no laser takes a thousand scans a second
INTO_M = 1e-6  # an end point on the border of two cells belongs to the one that the beam would go into


@dataclass(frozen=True, eq=False)
class WallTruth:
    """A wall: a convex polygon (n_corners, 2) in metres; glass is a wall that nobody has to find."""

    corners: NDArray[np.float64]
    glass: bool = False


@dataclass(frozen=True, eq=False)
class ThingTruth:
    """A door or a box: its kind ("hinged", "sliding" or "box") and its corners (4, 2), metres, at each place."""

    name: str
    kind: str
    places: dict[str, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Truth:
    """Everything true about a simulated log, and what of it beams met.

    Attributes
    ----------
    world : str
    start_s : float, seconds
        The scans' clock when the simulation starts.
    walls : tuple of WallTruth
    things : tuple of ThingTruth
    angles : (n_beams,) float64, radians
        In the laser frame.
    max_range_m, person_radius_m : float, metres
    t : (n_scans,) float64, seconds
        Since `start_s`.
    poses : (n_scans, 3) float64
        Of the laser at its first beam: x, y, theta; metres, metres, radians.
    sweep_ends : (n_scans, 3) float64
        The same at its last beam; in between it moves evenly, and turns the shorter way round.
    distances : (n_scans, n_beams) float64, metres
        +inf where nothing was within the laser's range.
    hits : (n_scans, n_beams) uint8
        What each beam has hit, see `Hit`.
    hit_things : (n_scans, n_beams) int16
        Which of `things` it has hit, or -1.
    places : (n_scans, n_things) int16
        At which of its places each thing stands, or `MOVING`.
    corners : (n_scans, n_things, 4, 2) float64, metres
        NaN while a box is carried.
    people : (n_scans, n_people, 2) float64, metres
        NaN while somebody is not there.
    """

    world: str
    start_s: float
    walls: tuple[WallTruth, ...]
    things: tuple[ThingTruth, ...]
    angles: NDArray[np.float64]
    max_range_m: float
    person_radius_m: float
    t: NDArray[np.float64]
    poses: NDArray[np.float64]
    sweep_ends: NDArray[np.float64]
    distances: NDArray[np.float64]
    hits: NDArray[np.uint8]
    hit_things: NDArray[np.int16]
    places: NDArray[np.int16]
    corners: NDArray[np.float64]
    people: NDArray[np.float64]

    @classmethod
    def of(cls, simulation: Simulation) -> Truth:
        """The truth about a simulation."""
        world = simulation.world
        return cls(
            world=world.name,
            start_s=float(START_S),
            walls=(
                *(WallTruth(np.array(wall.corners, dtype=np.float64)) for wall in world.walls),
                *(WallTruth(np.array(pane.corners, dtype=np.float64), glass=True) for pane in world.glass),
            ),
            things=tuple(
                ThingTruth(thing.name, thing.kind, {place: thing.corners(place) for place in thing.places})
                for thing in world.things
            ),
            angles=world.laser.angles,
            max_range_m=float(world.laser.max_range_m),
            person_radius_m=float(world.people.radius_m),
            **{name: getattr(simulation, name) for name in ARRAYS},
        )

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """(n_scans,) stamps in seconds of the scans' clock."""
        return self.start_s + self.t

    def window(self, start_s: float, stop_s: float) -> Truth:
        """The truth restricted to the scans from `start_s` to `stop_s`, both included.

        Raises
        ------
        EmptyWindowError
            No scan is in between.
        """
        stamps = self.stamps_s
        inside = (stamps >= start_s - SAME_STAMP_S) & (stamps <= stop_s + SAME_STAMP_S)
        if not inside.any():
            known = f"{stamps[0]:.3f} s to {stamps[-1]:.3f} s" if len(stamps) else "no scan at all"
            raise EmptyWindowError(f"no scan from {start_s:.3f} s to {stop_s:.3f} s; the truth covers {known}")
        if inside.all():
            return self
        return replace(self, **{name: getattr(self, name)[inside] for name in ARRAYS})

    def states(self, thing: int) -> list[tuple[float, str]]:
        """A thing's states as (stamp in seconds, state from then on), of places' names and "moving"."""
        names = list(self.things[thing].places)
        column = self.places[:, thing]
        firsts = np.flatnonzero(np.append(True, np.diff(column) != 0)[: len(column)]).tolist()
        stamps = self.stamps_s
        return [(float(stamps[i]), "moving" if column[i] == MOVING else names[column[i]]) for i in firsts]

    def beams(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """x, y (metres) and direction (radians) of each beam in the map frame; (n_scans, n_beams) each."""
        scans, beams = np.nonzero(np.ones(self.distances.shape, dtype=np.bool_))
        x, y, angle = (values.reshape(self.distances.shape) for values in self._starts(scans, beams))
        return x, y, angle

    def ends(self, scans: NDArray[np.int64], beams: NDArray[np.int64]) -> NDArray[np.float64]:
        """Where some beams ended, and a hair further, inside what they met; (n, 2) metres."""
        x, y, angle = self._starts(scans, beams)
        reach = self.distances[scans, beams] + INTO_M
        return np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])

    def _starts(
        self, scans: NDArray[np.int64], beams: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        done = np.linspace(0.0, 1.0, len(self.angles))[beams]  # share of the sweep
        x, y, theta = (
            first[scans] + done * step[scans]
            for first, step in zip(self.poses.T, turned(self.sweep_ends - self.poses).T, strict=True)
        )
        return x, y, theta + self.angles[beams]

    def end_cells(self, hit: Hit, resolution_m: float) -> NDArray[np.int64]:
        """The cells in which beams ended on something of a kind, in any scan; (n_cells, 2), sorted."""
        return unique_cells(cells_at(self.ends(*np.nonzero(self.hits == hit)), resolution_m))

    def static_cells(self, resolution_m: float, glass: bool = False) -> NDArray[np.int64]:
        """The cells that walls cover, inside included, or those that only glass covers; (n_cells, 2), sorted."""
        none = np.empty((0, 2), dtype=np.int64)
        of_walls, of_glass = (
            unique_cells(
                none, *(covered_cells(wall.corners, resolution_m) for wall in self.walls if wall.glass == is_glass)
            )
            for is_glass in (False, True)
        )
        return of_glass[~contained(of_glass, of_walls)] if glass else of_walls

    def static_seen(self, resolution_m: float) -> NDArray[np.int64]:
        """Those of `static_cells` in which beams ended on a wall; (n_cells, 2), sorted."""
        ends = self.end_cells(Hit.WALL, resolution_m)
        return ends[contained(ends, self.static_cells(resolution_m))]

    def glass_seen(self, resolution_m: float) -> NDArray[np.int64]:
        """Cells that only glass covers and in which beams ended on it; (n_cells, 2), sorted."""
        ends = self.end_cells(Hit.GLASS, resolution_m)
        return ends[contained(ends, self.static_cells(resolution_m, glass=True))]


def truth_paths(log: Path) -> tuple[Path, Path]:
    """Where the truth about a log is kept: the .json and the .npz.

    >>> [path.name for path in truth_paths(Path("drive.npz"))]
    ['drive.npz.truth.json', 'drive.npz.truth.npz']
    """
    as_json, as_npz = (log.with_name(f"{log.name}{suffix}") for suffix in SUFFIXES)
    return as_json, as_npz


def write_truth(log: Path, simulation: Simulation | Truth) -> tuple[Path, Path]:
    """Write the truth beside a log, each file whole or not at all; return where."""
    truth = simulation if isinstance(simulation, Truth) else Truth.of(simulation)
    as_json, as_npz = truth_paths(log)
    with whole_file(as_json) as unfinished:
        unfinished.write_text(json.dumps(_document(truth), indent=1) + "\n", encoding="utf-8")
    with whole_file(as_npz) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **{name: getattr(truth, name) for name in ARRAYS})
    return as_json, as_npz


def _document(truth: Truth) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "world": truth.world,
        "start_s": truth.start_s,
        "duration_s": float(truth.t[-1]) if len(truth.t) else 0.0,
        "n_scans": len(truth.t),
        "n_people": truth.people.shape[1],
        "person_radius_m": truth.person_radius_m,
        "laser": {"angles_rad": truth.angles.tolist(), "max_range_m": truth.max_range_m},
        "things": [
            {
                "name": thing.name,
                "kind": thing.kind,
                "places": {place: corners.tolist() for place, corners in thing.places.items()},
                "states": [{"from_s": t, "state": state} for t, state in truth.states(k)],
            }
            for k, thing in enumerate(truth.things)
        ],
        "walls": [{"corners": wall.corners.tolist(), "glass": wall.glass} for wall in truth.walls],
    }


def read_truth(path: str | Path) -> Truth:
    """Read what `write_truth` wrote.

    Parameters
    ----------
    path : path of the log, or of either file of its truth

    Raises
    ------
    TruthError
        A file that is missing, damaged, none of tempog's, or of a newer tempog.
    """
    path = Path(path)
    for suffix in SUFFIXES:
        path = path.with_name(path.name.removesuffix(suffix)) if path.name != suffix else path
    as_json, as_npz = truth_paths(path)
    try:
        document = json.loads(as_json.read_bytes())
    except OSError as error:
        raise TruthError(
            f"cannot read {as_json}: {error.strerror or error}; tempog simulate writes it beside the log"
        ) from error
    except ValueError as error:
        raise TruthError(f"{as_json} is no JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TruthError(f'{as_json} is no truth about a log; wanted "format": "{FORMAT}". Simulate the log again')
    if document.get("version") != VERSION:
        raise TruthError(
            f"{as_json} has version {document.get('version')!r}, this tempog reads {VERSION};"
            " use the tempog that wrote it, or simulate the log again"
        )
    arrays = _read_arrays(as_npz)
    try:
        truth = Truth(
            world=str(document["world"]),
            start_s=float(document["start_s"]),
            walls=tuple(WallTruth(_polygon(wall["corners"]), bool(wall["glass"])) for wall in document["walls"]),
            things=tuple(
                ThingTruth(
                    str(thing["name"]),
                    str(thing["kind"]),
                    {str(place): _polygon(corners) for place, corners in thing["places"].items()},
                )
                for thing in document["things"]
            ),
            angles=np.array(document["laser"]["angles_rad"], dtype=np.float64),
            max_range_m=float(document["laser"]["max_range_m"]),
            person_radius_m=float(document["person_radius_m"]),
            **arrays,
        )
    except KeyError as error:
        raise TruthError(f"{as_json} lacks {error}; simulate the log again") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise TruthError(f"{as_json} is damaged: {error}; simulate the log again") from error
    n_scans, n_beams, n_things, n_people = (
        len(truth.t),
        len(truth.angles),
        len(truth.things),
        document.get("n_people"),
    )
    wanted = {
        "t": (n_scans,),
        "poses": (n_scans, 3),
        "sweep_ends": (n_scans, 3),
        "distances": (n_scans, n_beams),
        "hits": (n_scans, n_beams),
        "hit_things": (n_scans, n_beams),
        "places": (n_scans, n_things),
        "corners": (n_scans, n_things, 4, 2),
        "people": (n_scans, n_people, 2),
    }
    for name, shape in wanted.items():
        if arrays[name].shape != shape:
            raise TruthError(
                f"{as_npz}: array {name} has shape {arrays[name].shape}, but {as_json.name} speaks of {shape};"
                " they are not of one log"
            )
    return truth


def _polygon(corners: Any) -> NDArray[np.float64]:
    points = np.array(corners, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.isfinite(points).all():
        raise ValueError(f"corners {str(corners)[:60]} are no polygon of [x, y]")
    return points


def _read_arrays(path: Path) -> dict[str, Any]:
    kinds = {"hits": np.uint8, "hit_things": np.int16, "places": np.int16}
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name].astype(kinds.get(name, np.float64)) for name in ARRAYS}
    except OSError as error:
        raise TruthError(
            f"cannot read {path}: {error.strerror or error}; tempog simulate writes it beside the log"
        ) from error
    except KeyError as error:
        raise TruthError(f"{path}: {error}; wanted the arrays {', '.join(ARRAYS)}. Simulate the log again") from error
    except (ValueError, EOFError, TypeError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        raise TruthError(f"{path} is no archive of arrays: {error}; simulate the log again") from error
