"""The files of a recording: which they are, of which kind each is, and their messages."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tempog._extras import need
from tempog.errors import ScanError
from tempog.ros.bag_readers import read_mcap, read_ros1
from tempog.ros.raw import ZSTD_MAGIC, RawMessage, Reading, Wanted
from tempog.ros.sqlite_file import read_sqlite

MCAP, ROS1, ROS2 = "MCAP", "ROS 1 bag", "ROS 2 bag (SQLite)"
MAGICS = {b"\x89MCAP": MCAP, b"#ROSBAG V": ROS1, b"SQLite format 3\0": ROS2}
READERS = {MCAP: read_mcap, ROS1: read_ros1, ROS2: read_sqlite}
HEAD_BYTES = 16
BLOCK_BYTES = 1 << 20
METADATA = "metadata.yaml"
BAG_ENDINGS = (".mcap", ".bag", ".db3", ".mcap.zstd", ".db3.zstd")
LISTED = re.compile(r"^\s*relative_file_paths:\s*\n((?:\s*-[^\n]*\n?)+)", re.MULTILINE)


def kind_of(head: bytes) -> str | None:
    """What kind of bag begins so, packed ones aside; None for anything else."""
    return next((kind for magic, kind in MAGICS.items() if head.startswith(magic)), None)


def kind_of_file(path: Path) -> str | None:
    """What kind of bag a file is, also if it is packed as a whole; None for anything else, OSError if unreadable."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        if not head.startswith(ZSTD_MAGIC):
            return kind_of(head)
        file.seek(0)
        try:
            return kind_of(need("zstandard", "bags").ZstdDecompressor().stream_reader(file).read(HEAD_BYTES))
        except need("zstandard", "bags").ZstdError:
            return None


def files_of(path: Path) -> tuple[list[Path], list[str]]:
    """The bag files that a path stands for, and those that should be there and are not.

    A folder stands for what its metadata.yaml lists, or else for all bags in it, by name.

    Raises
    ------
    ScanError
        A folder without bags, or with bags of several kinds and no metadata.yaml to tell which belong together.
    """
    if not path.is_dir():
        return [path], []
    listed = _listed(path / METADATA)
    if listed is not None:
        # Old recorders wrote the folder's name before the file's.
        found = {name: [p for p in (path / name, path / Path(name).name) if p.is_file()] for name in listed}
        if not any(found.values()):
            found = {}
        if found:
            return [places[0] for places in found.values() if places], [
                n for n, places in found.items() if not places
            ]
    files = sorted(file for file in path.iterdir() if file.name.endswith(BAG_ENDINGS) and file.is_file())
    if not files:
        raise ScanError(f"{path} is a folder without bags; wanted files that end in {', '.join(BAG_ENDINGS)}")
    endings = {file.name.removesuffix(".zstd").rpartition(".")[2] for file in files}
    if len(endings) > 1:
        some = ", ".join(file.name for file in files[:4])
        raise ScanError(
            f"{path} holds bags of several kinds: {some}{', ...' if len(files) > 4 else ''}; they may be the same"
            " recording.\n  Name the files that belong together, instead of the folder."
        )
    return files, []


def _listed(metadata: Path) -> list[str] | None:
    try:
        found = LISTED.search(metadata.read_text(encoding="utf-8"))
    except (OSError, UnicodeError):
        return None
    if found is None:
        return None
    names = [line.strip().removeprefix("-").strip().strip("'\"") for line in found[1].splitlines()]
    return [name for name in names if name and "\0" not in name] or None


def read_messages(path: Path, kind: str, wants: Wanted, reading: Reading) -> Generator[RawMessage, None, None]:
    """Messages of wanted topics, in the order of the file or of recording; what is damaged is told to `reading`."""
    with _unpacked_file(path, reading) as file:
        yield from READERS[kind](file, wants, reading)
        reading.moved_on(file.stat().st_size)


@contextmanager
def _unpacked_file(path: Path, reading: Reading) -> Iterator[Path]:
    """The file itself, or what was packed in it, in a temporary place."""
    with path.open("rb") as packed:
        if packed.read(len(ZSTD_MAGIC)) != ZSTD_MAGIC:
            yield path
            return
        packed.seek(0)
        module = need("zstandard", "bags")
        with tempfile.TemporaryDirectory(prefix="tempog-") as folder:
            file = Path(folder, path.name.removesuffix(".zstd"))
            with file.open("wb") as whole:
                stream = module.ZstdDecompressor().stream_reader(packed)
                try:
                    while block := stream.read(BLOCK_BYTES):
                        whole.write(block)
                except module.ZstdError as error:
                    reading.lose(f"it cannot be unpacked whole: {error}")
            yield file


def bytes_of(files: Sequence[Path]) -> int:
    """How large files are together."""
    return sum(file.stat().st_size for file in files)
