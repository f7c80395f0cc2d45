"""Public logs by name: what there is, and fetching it from where it lies."""

from __future__ import annotations

import hashlib
import os
import shutil
import tomllib
from dataclasses import asdict, dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol
from urllib.parse import urlsplit

from tempog._extras import need
from tempog._files import whole_file
from tempog.errors import ConfigError, DatasetError

CACHE_VARIABLE = "TEMPOG_CACHE"
LICENCE = "no licence stated by its source, so not redistributed with tempog"
TIMEOUT_S = 30.0  # of a server that says nothing
CHUNK_BYTES = 1 << 16


class ProgressBar(Protocol):
    """What pooch tells how far it is."""

    total: int

    def update(self, n: int) -> None: ...
    def reset(self) -> None: ...
    def close(self) -> None: ...


@dataclass(frozen=True)
class Dataset:
    """A file that somebody else keeps.

    Attributes
    ----------
    name, what : str
    url : str
        At a fixed commit, so that it stays the same file.
    sha256 : str
        Measured on a copy of the file.
    size : int, bytes
    licence : str
    pitfalls : tuple of str
        What to know before using it.
    try_it : str
        A command for it; ``{file}`` stands for where it is.
    """

    name: str
    what: str
    url: str
    sha256: str
    size: int
    licence: str
    pitfalls: tuple[str, ...]
    try_it: str

    @property
    def file_name(self) -> str:
        """Name of the file."""
        return urlsplit(self.url).path.rpartition("/")[2]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "pitfalls": list(self.pitfalls)}


@cache
def datasets() -> MappingProxyType[str, Dataset]:
    """Everything that `fetch` knows, by name.

    >>> datasets()["intel"].file_name
    'intel-corrected.log.gz'
    """
    table = tomllib.loads(resources.files("tempog.scans").joinpath("datasets.toml").read_text(encoding="utf-8"))
    return MappingProxyType(
        {
            name: Dataset(
                name=name,
                what=row["what"],
                url=row["url"],
                sha256=row["sha256"],
                size=row["size"],
                licence=row.get("licence", LICENCE),
                pitfalls=tuple(row["pitfalls"]),
                try_it=row["try"],
            )
            for name, row in table.items()
        }
    )


def dataset(name: str) -> Dataset:
    """One of `datasets`; ConfigError, listing them, for an unknown name."""
    known = datasets()
    if name not in known:
        raise ConfigError(f"there is no dataset {name!r}; there are {', '.join(sorted(known))}")
    return known[name]


def cache_folder() -> Path:
    """Where fetched files are kept: ``TEMPOG_CACHE``, or the system's place for what can be fetched again."""
    named = os.environ.get(CACHE_VARIABLE)
    return Path(named).expanduser() if named else Path(need("pooch", extra="datasets").os_cache("tempog"))


def fetch(name: str, *, to: str | Path | None = None, progress: ProgressBar | None = None) -> Path:
    """The file of a dataset, from the cache or from its source.

    Parameters
    ----------
    name : str
        See `datasets`.
    to : path of a folder, optional
        Put a copy there, and return that.
    progress : optional
        A progress bar as pooch takes it.

    Returns
    -------
    Path

    Raises
    ------
    DatasetError
        The source cannot be reached, or what it sent is not the file whose SHA-256 is known, or there is no place.
    ConfigError
        An unknown name, or `to` is a file.
    ExtraError
        pooch is not installed: ``pip install 'tempog[datasets]'``.
    """
    wanted = dataset(name)
    if to is not None and Path(to).exists() and not Path(to).is_dir():
        raise ConfigError(f"{to} is a file; name a folder")
    folder = cache_folder()
    cached = _fetched(wanted, folder, progress)
    if to is None:
        return cached
    try:
        Path(to).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DatasetError(f"{to} cannot be made: {error.strerror or error}") from error
    target = Path(to) / wanted.file_name
    if target.exists() and _sha256(target) != wanted.sha256:
        raise DatasetError(f"{target} exists already and is another file; move it away, or choose another folder")
    if not target.exists():
        try:
            with whole_file(target) as unfinished:
                shutil.copyfile(cached, unfinished)
        except OSError as error:
            raise DatasetError(f"cannot write {target}: {error.strerror or error}") from error
    return target


def _fetched(wanted: Dataset, folder: Path, progress: ProgressBar | None) -> Path:
    """The file in the cache, fetched if it is not there or damaged."""
    path = folder / wanted.file_name
    try:
        if path.is_file() and _sha256(path) == wanted.sha256:
            return path
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror or error}") from error
    pooch = need("pooch", extra="datasets")
    from requests.exceptions import HTTPError, RequestException  # comes with pooch

    downloader = pooch.HTTPDownloader(
        progressbar=False if progress is None else progress, chunk_size=CHUNK_BYTES, timeout=TIMEOUT_S
    )
    by_hand = f"Fetch it by hand, and save it as {path}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as fetched:
            downloader(wanted.url, str(fetched), None)
            seen = _sha256(fetched)
            if seen != wanted.sha256:
                raise DatasetError(
                    f"{wanted.url} is not the file that {wanted.name} was: its SHA-256 is {seen}"
                    f" ({fetched.stat().st_size} bytes); wanted {wanted.sha256} ({wanted.size} bytes). Not kept."
                    "\n  Try again, in case the transfer was cut short; else the source has changed, or something on"
                    " the way answers in its place."
                )
    except HTTPError as error:
        status = error.response.status_code if error.response is not None else error
        raise DatasetError(f"{wanted.url} answered {status}.\n  {by_hand}, if it lies elsewhere now.") from error
    except RequestException as error:
        host = urlsplit(wanted.url).netloc
        raise DatasetError(
            f"cannot fetch {wanted.name} from {host} ({type(error).__name__}); is this machine online?\n"
            f"  {by_hand}: {wanted.url}"
        ) from error
    except OSError as error:
        raise DatasetError(
            f"cannot write to {folder}: {error.strerror or error}.\n  Name another folder in {CACHE_VARIABLE}."
        ) from error
    return path


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
