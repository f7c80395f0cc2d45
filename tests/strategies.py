"""Hypothesis recipes shared by the property tests."""

from __future__ import annotations

import gzip
import io
import json
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from tempog.grid.segments import Runs
from tempog.scans.scan import Scan

N_SCANS = 12
SOME_CELL = st.integers(0, 40) | st.integers(0, 3000)
LARGEST_SCAN = 2**31 - 1


def flaser(i: int, n_beams: int = 5, name: str = "FLASER") -> str:
    ranges = " ".join(f"{1 + 0.1 * beam + 0.01 * i:.2f}" for beam in range(n_beams))
    pose = f"{0.1 * i:.2f} 0.5 0.1"
    return f"{name} {n_beams} {ranges} {pose} {pose} {10 + 0.2 * i:.2f} host {i}"


def robotlaser(i: int, n_beams: int = 5) -> str:
    ranges = " ".join(["2.5"] * n_beams)
    return (
        f"ROBOTLASER1 0 -1.57 3.14 0.785 80.0 0.01 0 {n_beams} {ranges} 1 0.5 {0.1 * i:.2f} 0 0 0 0 0"
        f" 0 0 0.2 0.2 0 {10 + 0.2 * i:.2f} host {i}"
    )


def carmen_text() -> bytes:
    """A small log with every kind of line the reader knows."""
    lines = [
        "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
        "PARAM robot_front_laser_max 80.99 0 host 0",
        "PARAM laser_front_laser_resolution 36 0 host 0",
    ]
    for i in range(N_SCANS):
        lines += [f"ODOM {0.1 * i} 0 0 0 0 0 {10 + 0.2 * i:.2f} host {i}", flaser(i)]
    lines += [robotlaser(N_SCANS + 1), flaser(N_SCANS + 2, name="RLASER"), "NEFF 0.7", ""]
    return "\n".join(lines).encode()


def json_text() -> bytes:
    """A small JSON log, a value a line, as the public ones are."""
    scans = {
        f"{10 + 0.2 * i:.2f}": {"range": [2.0, 2.5, 81.83], "theta": 0.1, "x": 0.1 * i, "y": 0.5}
        for i in range(N_SCANS)
    }
    return json.dumps({"map": scans}, indent=1).encode()


def npz_bytes(*, compressed: bool = False) -> bytes:
    """A small archive as `write_npz` writes it."""
    rows = np.arange(N_SCANS)
    file = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(
        file,
        t=10 + 0.2 * rows,
        x=0.1 * rows,
        y=0.0 * rows,
        theta=0.0 * rows,
        angles=np.linspace(-1, 1, 5),
        ranges=np.full((N_SCANS, 5), 2.0, dtype=np.float32),
        max_range=np.float64(30.0),
    )
    return file.getvalue()


CARMEN = carmen_text()
CARMEN_WITHOUT_ROBOTLASER = b"\n".join(line for line in CARMEN.split(b"\n") if b"ROBOT" not in line)
JSON = json_text()
NPZ = npz_bytes()
NPZ_COMPRESSED = npz_bytes(compressed=True)
STRANGE_NUMBERS = ["nan", "inf", "-inf", "1e300", "-1e300", "1e99999", "9" * 20, "-1", "0", "0.0", "1e-300"]
STRANGE_TEXTS = ["1_0", "0x10", "text", "--", "é"]
STRANGE_FIELDS = st.sampled_from(
    [text.encode() for text in STRANGE_NUMBERS + STRANGE_TEXTS] + [b"\xff\xfe", b"\0", b"9" * 5000, b""]
)


@st.composite
def damaged_bytes(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` with bytes flipped, cut out, doubled or cut off."""
    damaged = bytearray(data)
    for _ in range(draw(st.integers(0, 4))):
        if not damaged:
            break
        at = draw(st.integers(0, len(damaged) - 1))
        kind = draw(st.sampled_from(["flip", "flip", "set", "insert", "delete", "cut"]))
        if kind == "flip":
            damaged[at] ^= 1 << draw(st.integers(0, 7))
        elif kind == "set":
            damaged[at] = draw(st.integers(0, 255))
        elif kind == "insert":
            damaged[at:at] = draw(st.binary(min_size=1, max_size=8))
        elif kind == "delete":
            del damaged[at : at + draw(st.integers(1, 40))]
        else:
            del damaged[at:]
    return bytes(damaged)


@st.composite
def damaged_lines(draw: st.DrawFn, text: bytes) -> bytes:
    """`text` with lines shuffled, doubled or dropped, and fields replaced."""
    lines = text.split(b"\n")
    if draw(st.booleans()):
        lines = draw(st.permutations(lines))
    for _ in range(draw(st.integers(0, 5))):
        at = draw(st.integers(0, len(lines) - 1))
        fields = lines[at].split(b" ")
        kind = draw(st.sampled_from(["field", "field", "field", "repeat", "drop", "shorten"]))
        if kind == "field":
            # half the time near the end, where pose and stamp are
            i = draw(st.integers(0, len(fields) - 1) | st.integers(max(0, len(fields) - 10), len(fields) - 1))
            fields[i] = draw(STRANGE_FIELDS)
            lines[at] = b" ".join(fields)
        elif kind == "repeat":
            lines[at:at] = [lines[at]] * draw(st.integers(1, 3))
        elif kind == "drop" and len(lines) > 1:
            del lines[at]
        else:
            lines[at] = b" ".join(fields[: draw(st.integers(0, len(fields)))])
    return b"\n".join(lines)


@st.composite
def strange_npz(draw: st.DrawFn) -> bytes:
    """A sound archive whose arrays have the wrong shapes, kinds, names or values."""
    with np.load(io.BytesIO(NPZ)) as archive:
        arrays = dict(archive)
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(arrays))) if arrays else "t"
        kind = draw(st.sampled_from(["value", "value", "reshape", "cast", "drop", "scalar", "empty"]))
        if kind == "drop" or name not in arrays:
            arrays.pop(name, None)
        elif kind == "value" and arrays[name].size and arrays[name].dtype in ("f4", "f8"):
            value = draw(st.floats(width=32) | st.just(float("nan")))
            arrays[name].flat[draw(st.integers(0, arrays[name].size - 1))] = value
        elif kind == "reshape":
            arrays[name] = arrays[name].reshape(1, -1)
        elif kind == "cast" and arrays[name].dtype.kind == "f":
            with np.errstate(all="ignore"):
                dtype = draw(st.sampled_from(["S4", "U4", "complex64", "bool", "float16", "object"]))
                arrays[name] = arrays[name].astype(dtype)
        elif kind == "scalar":
            arrays[name] = np.array(draw(st.integers(-(2**40), 2**40)))
        else:
            arrays[name] = arrays[name][:0] if arrays[name].ndim else arrays[name]
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


@st.composite
def mutated_log_bytes(draw: st.DrawFn) -> bytes:
    """Content of a scan log (CARMEN plain or gzip, .npz or JSON) that something has damaged.

    Now and then nothing is damaged at all, so what is tested is tested on readable logs, too.
    """
    kind = draw(
        st.sampled_from(["lines", "lines", "bytes", "gzip", "gzip lines", "npz", "strange npz", "json", "json lines"])
    )
    if kind == "strange npz":
        return draw(strange_npz())
    if kind == "npz":
        return draw(damaged_bytes(draw(st.sampled_from([NPZ, NPZ_COMPRESSED]))))
    if kind == "json":
        return draw(damaged_bytes(JSON))
    if kind == "json lines":
        return draw(damaged_lines(JSON))
    text = draw(st.sampled_from([CARMEN, CARMEN_WITHOUT_ROBOTLASER]))
    if kind in ("lines", "gzip lines"):
        text = draw(damaged_lines(text))
    if kind == "bytes":
        text = draw(damaged_bytes(text))
    if kind.startswith("gzip"):
        level = draw(st.sampled_from([0, 1]))  # 0 stores, so that damage reaches the text
        return draw(damaged_bytes(gzip.compress(text, compresslevel=level, mtime=0)))
    return text


# Statement streams: what many scans say about a few cells.

NS = 1_000_000_000
STREAM_START_NS = 1_071_078_718_000_000_000
# Two tiles far apart, one of them at negative coordinates; corners and borders of tiles.
STREAM_CELLS = [(0, 0), (0, 7), (7, 7), (-1, -1), (-400, 3), (-393, 0)]
STREAM_PROBS = [0.1, 0.9, 0.5, 0.3, 0.30000001, 0.7, 0.45, 0.05]


@dataclass(frozen=True)
class Stream:
    """What each of many scans says: ``statements[k]`` holds ``(cell, prob)`` and belongs to ``stamps_ns[k]``."""

    stamps_ns: list[int]
    statements: list[list[tuple[tuple[int, int], float]]]
    gap_ns: int
    tolerance: float

    @property
    def measurements(self):
        """``(now, cell, value)`` in time order, as the paper's Fig. 4 wants them."""
        return [
            (now, cell, prob)
            for now, said in zip(self.stamps_ns, self.statements, strict=True)
            for cell, prob in said
        ]


@st.composite
def streams(draw: st.DrawFn, max_scans: int = 40) -> Stream:
    """Random statement streams; pauses lie on and beside the gap threshold, values beside the tolerance."""
    gap_ns = draw(st.sampled_from([200_000_000, 1_000_000_000, 2_500_000_000]))
    steps = st.sampled_from([0, 1, gap_ns // 10, gap_ns // 10, gap_ns - 1, gap_ns, gap_ns + 1, 5 * gap_ns])
    if draw(st.booleans()):
        steps = st.just(gap_ns // 10)  # many looks in a row, so that intervals become long
    probs = st.sampled_from(STREAM_PROBS if draw(st.booleans()) else [0.1, 0.9])
    said = st.lists(
        st.tuples(st.sampled_from(STREAM_CELLS), probs), max_size=6, unique_by=lambda statement: statement[0]
    )
    statements = draw(st.lists(said, min_size=1, max_size=max_scans))
    now, stamps = STREAM_START_NS, []
    for _ in statements:
        now += draw(steps)
        stamps.append(now)
    return Stream(stamps, statements, gap_ns, draw(st.sampled_from([0.0, 0.2, 0.4, 0.6, 1.0])))


# Scans, with coordinates at which no beam meets a cell's corner.

ODD = [0.0137, 0.02718, 0.031415, 0.0444, 0.00577]  # metres off the lattice
FAR = [(0.0, 0.0), (-3.0, -7.0), (40_000.0, -40_000.0), (-41_234.5, 12.0)]


@st.composite
def odd_poses(draw: st.DrawFn, origin: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float, float]:
    """Poses within a metre of `origin`, off the lattice."""
    x = draw(st.integers(-20, 20)) * 0.0497 + draw(st.sampled_from(ODD)) / 1.37
    y = draw(st.integers(-20, 20)) * 0.0503 + draw(st.sampled_from(ODD)) / 1.61
    return origin[0] + x, origin[1] + y, draw(st.integers(-30, 30)) * 0.10473


@st.composite
def odd_ranges(draw: st.DrawFn, n_beams: int, farthest: float = 5.0) -> list[float]:
    """Readings of all kinds: hits, too far, no return, and those that say nothing."""
    reading = st.one_of(
        st.integers(1, 400).map(lambda k: k * farthest / 397),
        st.integers(1, 400).map(lambda k: k * farthest / 397),
        st.sampled_from([float("inf")] * 4 + [float("nan"), float("-inf"), 0.0, -1.0, 4.0, 1e-6]),
    )
    return draw(st.lists(reading, min_size=n_beams, max_size=n_beams))


@st.composite
def odd_scans(draw: st.DrawFn, max_scans: int = 1, max_beams: int = 12) -> list[Scan]:
    """A few scans from near one place, which may be 40 km from the origin, 0.1 s to 3 s apart."""
    origin = draw(st.sampled_from(FAR))
    n_beams = draw(st.integers(1, max_beams))
    angles = np.array([-1.5 + 0.2718 * k for k in range(n_beams)])
    sensor_max = draw(st.sampled_from([4.0, 4.5, float("inf")]))
    t, scans = 100.0, []
    for _ in range(draw(st.integers(1, max_scans))):
        t += draw(st.sampled_from([0.0, 0.1, 0.1, 0.1, 3.0]))
        ranges = draw(odd_ranges(n_beams))
        scans.append(Scan(t, draw(odd_poses(origin)), angles, ranges, sensor_max))
    return scans


@st.composite
def runs_of_cells(draw: st.DrawFn) -> Runs:
    """Cells that have much in common, and something of their own; values that compare strangely, too."""
    values = st.sampled_from([0.1, 0.9, 0.5, -0.0, 0.0, float("nan")])
    common = draw(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 3), values), max_size=6))
    own = st.tuples(st.integers(0, 30) | st.integers(0, LARGEST_SCAN), st.integers(0, 50), values)
    cells, offsets, intervals = [], [0], []
    for cell in sorted(draw(st.sets(SOME_CELL, max_size=25))):
        looks = draw(st.lists(st.sampled_from(common) | own if common else own, min_size=1, max_size=5))
        ends = -1
        for first, span, value in sorted(looks, key=lambda look: look[0]):
            if first > ends:
                ends = min(first + span, LARGEST_SCAN)
                intervals.append((first, ends, value))
        cells.append(cell)
        offsets.append(len(intervals))
    first, last, value = zip(*intervals, strict=True) if intervals else ((), (), ())
    return Runs(
        np.array(cells, np.int32),
        np.array(offsets, np.int64),
        np.array(first, np.int32),
        np.array(last, np.int32),
        np.array(value, np.float32),
    )
