"""open_scans(path): recognises the source by its content and says what it recognised."""

from __future__ import annotations

import gzip
import io
import re
import zlib
from dataclasses import replace
from pathlib import Path

from tempog.errors import ConfigError, ScanError
from tempog.ros.bag_files import files_of, kind_of, kind_of_file
from tempog.ros.raw import ZSTD_MAGIC
from tempog.scans.bag_choice import BagChoice
from tempog.scans.carmen import GZIP_MAGIC, KNOWN_MESSAGES, LASERS, read_carmen
from tempog.scans.json_log import read_json
from tempog.scans.npz import read_npz
from tempog.scans.scan import ScanLog

HEAD_BYTES = 1 << 16  # enough for the first lines of any log
CARMEN_HEADER = b"# message_name"  # the comment that CARMEN's logger writes first
JSON_START = re.compile(rb"(?:\xef\xbb\xbf)?\s*\{\s*\"")
ZIP_MAGICS = (b"PK\x03\x04", b"PK\x05\x06")
READABLE = (
    "Readable are bags (.bag, .mcap, .db3, and folders of them), CARMEN logs (.log, .clf; plain or gzip), .npz with"
    " the arrays t, x, y, theta, angles, ranges, max_range, and JSON logs as in tempog.scans.json_log."
)
UNPACK = "Unpack it first, or use gzip."
UNREADABLE = {
    b"#ROSBAG": ("a ROS 1 bag", "Unpack it first."),  # unpacked ones are read
    b"\x89MCAP": ("an MCAP file", "Unpack it first."),
    b"SQLite format 3": ("an SQLite file, perhaps a ROS 2 bag", "Unpack it first."),
    b"\x93NUMPY": ("a single NumPy array (.npy)", "Save the named arrays together with numpy.savez."),
    b"BZh": ("a bzip2 file", UNPACK),
    b"\xfd7zXZ": ("an xz file", UNPACK),
    b"\x28\xb5\x2f\xfd": ("a Zstandard file with something else than a bag in it", UNPACK),
}


def open_scans(
    path: str | Path,
    *,
    clock: str = "auto",
    skip_bad: bool = False,
    laser: str = "front",
    sensor_max_range: float | None = None,
    bag: BagChoice | None = None,
) -> ScanLog:
    """Read a scan log of any known format, recognised by its content.

    Parameters
    ----------
    path : path of the file
    clock : "auto", "sort" or "rate=HZ"
        What to do about time stamps out of order; see `tempog.scans.clock`.
    skip_bad : bool
        Leave unusable lines or rows out, counted and noted, instead of stopping at the first.
    laser : "front" or "rear"
        Which laser of a CARMEN log.
    sensor_max_range : float, metres, optional
        Overrides the sensor's maximum range that the log says or lets guess.
    bag : BagChoice, optional
        Topics and frames of a bag. Scans of several lasers come as one log, by time; `open_bag` keeps them apart.

    Returns
    -------
    ScanLog
        `format` says what was recognised, `notes` what was mended, skipped or assumed.

    Raises
    ------
    ScanError
        A file that cannot be read, is of no known format, or holds unusable data.
    ClockError
        Stamps that make no usable time axis.
    ConfigError
        An unknown `clock` or `laser`, or a `sensor_max_range` not above 0.

    Examples
    --------
    >>> import tempfile
    >>> lines = [f"FLASER 3 1 2 1 {i} 0 0 {i} 0 0 {i}.5 host {i}.5" for i in range(4)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "corridor.log")
    ...     _ = path.write_text("\\n".join(lines))
    ...     log = open_scans(path, sensor_max_range=80)
    >>> log.format
    'CARMEN log: FLASER, 3 beams, sensor maximum 80 m'
    >>> log[0]
    Scan(t=0.5, pose=(0.0, 0.0, 0.0), 3 beams, 3 returns)
    """
    if laser not in LASERS:
        raise ConfigError(f"laser = {laser!r} is unknown; wanted front or rear")
    kind = recognise(Path(path))
    if kind == "bag":
        from tempog.scans.rosbag import merged, open_bag

        log = merged(open_bag(path, bag, clock=clock, skip_bad=skip_bad, sensor_max_range=sensor_max_range))
        return (
            _with_note(log, f"laser = {laser} has no effect: a bag says which laser is which")
            if laser != "front"
            else log
        )
    if kind in ("npz", "json"):
        read, name = (read_npz, "an .npz") if kind == "npz" else (read_json, "a JSON log")
        log = read(path, clock=clock, skip_bad=skip_bad, sensor_max_range=sensor_max_range)
        if laser != "front":
            log = _with_note(log, f"laser = {laser} has no effect: {name} holds one laser")
        return log
    return read_carmen(path, clock=clock, skip_bad=skip_bad, laser=laser, sensor_max_range=sensor_max_range)


def _with_note(log: ScanLog, note: str) -> ScanLog:
    return replace(log, notes=(*log.notes, note))


def recognise(path: Path) -> str:
    """ "npz", "json", "carmen" or "bag"; ScanError, saying what was seen, for anything else."""
    try:
        if path.is_dir():
            files_of(path)  # says if there is no bag in it
            return "bag"
        if path.exists() and not path.is_file():
            raise ScanError(f"{path} is a pipe or a device; wanted a file, which can be read twice")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except ScanError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        raise ScanError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    if not head:
        raise ScanError(f"{path} is empty.\n  {READABLE}")
    if head.startswith(ZIP_MAGICS):
        return "npz"
    if kind_of(head) or (head.startswith(ZSTD_MAGIC) and kind_of_file(path)):
        return "bag"
    packed = head.startswith(GZIP_MAGIC)
    content = _unpacked(head) if packed else head
    if JSON_START.match(content) and not packed:
        return "json"
    for magic, (name, remedy) in UNREADABLE.items():
        if content.startswith(magic):
            raise ScanError(f"{path} is {name}{', gzipped' if packed else ''}.\n  {remedy}")
    first_words = (line.split(None, 1)[:1] for line in content.removeprefix(b"\xef\xbb\xbf").splitlines())
    if content.startswith(CARMEN_HEADER) or any(word[0] in KNOWN_MESSAGES for word in first_words if word):
        return "carmen"
    if packed and not content:
        raise ScanError(f"{path} is a gzip file that holds nothing readable.\n  {READABLE}")
    seen = content[:30].decode("utf-8", "backslashreplace")
    raise ScanError(
        f"{path} is no known scan log: it starts with {seen!r}{', gzipped' if packed else ''}.\n  {READABLE}"
    )


def _unpacked(head: bytes) -> bytes:
    """The beginning of what a gzip file holds; as much of it as a damaged one gives."""
    parts = []
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(head)) as stream:
            n_left = HEAD_BYTES
            while n_left and (part := stream.read1(n_left)):
                parts.append(part)
                n_left -= len(part)
    except (OSError, EOFError, zlib.error):
        pass
    return b"".join(parts)
