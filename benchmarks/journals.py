"""What keeping each scan until its intervals are written costs, and what survives: MCAP against framed records."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from report import Row, Section, Target, at_least, at_most
from scan_journals import Frames, Mcap, Opener, read_frames, read_mcap, read_mcap_seeking, to_payload

from tempog import Scan

BEAM_COUNTS = (180, 1080)
SCANS_PER_S = 40
N_SCANS = 4000
N_SYNCED = 1000  # when each of them is synced
N_KEPT = 50  # scans in the files that are damaged
N_CUT = 3  # of these, the last ones, at every byte
N_FLIPS = 2000
N_ZEROS = 4096  # what a file may end in after a power cut: its size was written, its bytes were not

OPENERS: dict[str, Opener] = {
    "frames": Frames,
    "mcap": partial(Mcap, chunked=False),
    "mcap, a chunk each": partial(Mcap, chunked=True),
}
Reader = Callable[[bytes], Iterator[bytes]]
READERS: dict[tuple[str, str], Reader] = {
    ("frames", ""): read_frames,
    ("mcap", "StreamReader"): read_mcap,
    ("mcap, a chunk each", "StreamReader"): read_mcap,
    ("mcap", "make_reader"): read_mcap_seeking,
    ("mcap, a chunk each", "make_reader"): read_mcap_seeking,
}


def sections(quick: bool) -> list[Section]:
    """Cost and survival, for each number of beams."""
    return [part for n_beams in BEAM_COUNTS for part in (_cost(n_beams, quick), _survival(n_beams, quick))]


def _scans(n_scans: int, n_beams: int) -> list[Scan]:
    rng = np.random.default_rng(0)
    angles = np.linspace(-1.5, 1.5, n_beams)
    ranges = rng.uniform(0.5, 29, (n_scans, n_beams)).astype(np.float32)
    step_ns = 10**9 // SCANS_PER_S
    return [Scan(0.0, (1.0, 2.0, 0.5), angles, ranges[k], 30.0, stamp_ns=k * step_ns) for k in range(n_scans)]


def _cost(n_beams: int, quick: bool) -> Section:
    section = Section(f"Journal of scans, {n_beams} beams: microseconds for each scan")
    scans = _scans(N_SCANS // 4 if quick else N_SCANS, n_beams)
    with tempfile.TemporaryDirectory() as folder:
        for what, sync_every, n_scans in (
            ("handed to the operating system", 0, len(scans)),
            ("fsync each second of 40 scans", SCANS_PER_S, len(scans)),
            ("fsync each scan", 1, N_SYNCED // 4 if quick else N_SYNCED),
        ):
            micros, n_bytes = _append_all(Path(folder), scans[:n_scans], sync_every)
            ours = np.array(micros["frames"])
            for name in list(OPENERS)[1:]:
                peer = np.array(micros[name])
                value = float(np.mean(ours) / np.mean(peer))
                row = f"{what}, mean over {name}'s"
                section.rows.append(Row(row, _describe(ours), _describe(peer), value, at_most(1.0)))
            if sync_every == 0:
                for name in OPENERS:
                    section.rows.append(
                        Row(
                            f"bytes of a scan: {name}",
                            *_sides(name, f"{n_bytes[name]:.1f}"),
                            n_bytes[name],
                            unit="bytes",
                        )
                    )
    section.notes.append(
        f"The payload of a scan is {len(to_payload(scans[0]))} bytes. Packing it is part of the time."
    )
    return section


def _append_all(folder: Path, scans: list[Scan], sync_every: int) -> tuple[dict[str, list[float]], dict[str, float]]:
    """Microseconds of each scan, and bytes of one; who goes first changes with every scan."""
    paths = {name: folder / f"{name}-{sync_every}" for name in OPENERS}
    journals = {name: opener(paths[name]) for name, opener in OPENERS.items()}
    micros: dict[str, list[float]] = {name: [] for name in OPENERS}
    names = list(OPENERS)
    for k, scan in enumerate(scans):
        first = k % len(names)
        for name in names[first:] + names[:first]:
            journal = journals[name]
            start = time.perf_counter()
            journal.append(to_payload(scan), scan.stamp_ns)
            if sync_every and k % sync_every == sync_every - 1:
                journal.sync()
            micros[name].append((time.perf_counter() - start) * 1e6)
    for journal in journals.values():
        journal.close()
    return micros, {name: path.stat().st_size / len(scans) for name, path in paths.items()}


def _describe(micros: NDArray[np.float64]) -> str:
    return f"mean {np.mean(micros):.1f}, median {np.median(micros):.1f}, p99 {np.percentile(micros, 99):.0f}"


@dataclass
class Written:
    """A journal without an end, as a process leaves it that is killed.

    Attributes
    ----------
    data : bytes
    ends : list of int
        Where each scan ends.
    payloads : list of bytes
    """

    data: bytes
    ends: list[int]
    payloads: list[bytes]


def _survival(n_beams: int, quick: bool) -> Section:
    section = Section(f"Journal of scans, {n_beams} beams: what can be read of a damaged file")
    written = {name: _write(opener, n_beams) for name, opener in OPENERS.items()}
    n_flips = N_FLIPS // 10 if quick else N_FLIPS
    for (name, by), read in READERS.items():
        file, who = written[name], f"{name} {by}".strip()
        n_cuts, n_whole, n_missed = _cut(file, read, every=20 if quick else 1)
        row = f"{who}: whole scans found, cut anywhere in the last {N_CUT}"
        shown = f"{n_cuts} cuts, {n_missed:.1f} scans missed in each"
        section.rows.append(
            Row(row, *_sides(name, shown), 100 * (1 - n_missed / n_whole), _ours(name, at_least(100, "%")), "%")
        )
        n_wrong, n_gaps, n_early = _flip(file, read, n_flips)
        shown = f"{n_flips} flips: {n_gaps} passed over, {n_early / n_flips:.1f} good scans before it missed"
        row = f"{who}: flipped bit handed out as good"
        section.rows.append(
            Row(row, *_sides(name, shown), 100 * n_wrong / n_flips, _ours(name, at_most(0, "%")), "%")
        )
        n_after_zeros = sum(payload in file.payloads for payload in read(file.data + bytes(N_ZEROS)))
        n_invented = sum(payload not in file.payloads for payload in read(file.data + bytes(N_ZEROS)))
        row, shown = f"{who}: scans found before {N_ZEROS} zeros", f"{n_invented} invented"
        target = _ours(name, at_least(N_KEPT, "scans"))
        section.rows.append(Row(row, *_sides(name, shown), n_after_zeros, target, "scans"))
    section.notes += [
        "Passed over: the damaged scan is left out, later ones are handed out, and nothing says so.",
        "CRCs are checked wherever the library can. Frames stop at the first that does not hold.",
        "An MCAP file without its footer cannot be appended to; frames are cut back to the last whole one.",
    ]
    return section


def _ours(name: str, target: Target) -> Target | None:
    """Targets are for what is our own."""
    return target if name == "frames" else None


def _sides(name: str, text: str) -> tuple[str, str]:
    return (text, "") if name == "frames" else ("", text)


def _write(opener: Opener, n_beams: int) -> Written:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "journal")
        journal = opener(path)
        ends, payloads = [], []
        for scan in _scans(N_KEPT, n_beams):
            payloads.append(to_payload(scan))
            journal.append(payloads[-1], scan.stamp_ns)
            ends.append(path.stat().st_size)
        journal.close()
        return Written(path.read_bytes(), ends, payloads)


def _cut(file: Written, read: Reader, every: int) -> tuple[int, float, float]:
    """How many cuts were tried; the mean number of whole scans, and of those not found."""
    cuts = range(file.ends[-1 - N_CUT], len(file.data) + 1, every)
    n_whole = n_right = 0
    for cut in cuts:
        whole = file.payloads[: sum(end <= cut for end in file.ends)]
        found = list(read(file.data[:cut]))
        n_whole += len(whole)
        n_right += sum(a == b for a, b in zip(found, whole, strict=False))
    return len(cuts), n_whole / len(cuts), (n_whole - n_right) / len(cuts)


def _flip(file: Written, read: Reader, n_flips: int) -> tuple[int, int, int]:
    """How often wrong bytes were handed out, a scan was passed over, and good scans before the damage missed."""
    rng = np.random.default_rng(1)
    right = set(file.payloads)
    n_wrong = n_gaps = n_early = 0
    for place in rng.integers(file.ends[0], len(file.data), n_flips):
        data = bytearray(file.data)
        data[place] ^= 1 << rng.integers(8)
        damaged = int(np.searchsorted(file.ends, place, side="right"))
        found = list(read(bytes(data)))
        there = set(found)
        wrong = bool(there - right)
        n_wrong += wrong
        n_gaps += (
            not wrong and file.payloads[damaged] not in there and bool(there & set(file.payloads[damaged + 1 :]))
        )
        n_early += sum(payload not in there for payload in file.payloads[:damaged])
    return n_wrong, n_gaps, n_early
