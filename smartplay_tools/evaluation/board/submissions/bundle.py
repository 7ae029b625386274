"""Bundles: a run's folder with its metadata in one zip file, written the same for the same run, and read without trust.

    submission.json       who submits what (`metadata`)
    environment.json      the packages that prepared the bundle, and those that played
    manifest.json         the plan of the run, as in its folder
    results.jsonl         the rows
    episodes/KEY.jsonl    the records of finished episodes
    attempts/KEY.N.jsonl  the records of attempts without a result

A bundle comes from a stranger, so nothing in it is trusted when it is unpacked. A name decides where a file goes only
if it is exactly one of those above; sizes are counted while they are unpacked, not read from the file; links, encrypted
files, doubled names and other compressions are refused. What is refused is a `BundleError` with one sentence. Bundles
of older versions also hold a `rollout-card.json`, which is not read.

Findings: what the check of a submission has to say, one sentence each.
"""

from __future__ import annotations

import re
import stat
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, in_one_line

NAMES = re.compile(
    r"(submission|environment|manifest|rollout-card)\.json|results\.jsonl|episodes/[0-9a-f]{16}\.jsonl"
    r"|attempts/[0-9a-f]{16}\.[1-9][0-9]{0,5}\.jsonl",
    re.ASCII,
)
"""The names that a file of a bundle may have."""

ROLLOUT_CARD = "rollout-card.json"

REQUIRED = ("submission.json", "manifest.json", "results.jsonl")

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of every file in a bundle, so that the same run gives the same bytes."""

CHUNK = 1 << 16

_END = b"PK\x05\x06"
_END_64 = b"PK\x06\x07"
_END_SIZE = 22
_LOCATOR_64_SIZE = 20
_LONGEST_COMMENT = 0xFFFF


class BundleError(SmartPlayError, ValueError):
    """A file is not a bundle, or is damaged, too large or hostile."""


@dataclass(frozen=True)
class Limits:
    """How much a bundle, and the check of it, may take."""

    bundle_bytes: int = 1 << 30
    """The zip file itself."""
    directory_bytes: int = 16 << 20
    """The list of files at the end of the zip file."""
    unpacked_bytes: int = 4 << 30
    """All files together."""
    record_bytes: int = 64 << 20
    """One record."""
    line_bytes: int = 8 << 20
    """One line of a record."""
    results_bytes: int = 256 << 20
    """All rows of the results; one of them may have a thousandth of it."""
    json_bytes: int = 16 << 20
    """The manifest; metadata and environment may have a sixteenth of it."""
    seconds: float = 120
    """The check of one record."""
    total_seconds: float = 3 * 3600
    """The check of all records."""
    memory_bytes: int = 4 << 30
    """A process that checks records (on Unix)."""

    def most(self, name: str) -> int:
        """Return the bytes that a file of this name may have."""
        if name == "manifest.json":
            return self.json_bytes
        if name.endswith(".json"):
            return self.json_bytes // 16
        return self.results_bytes if name == "results.jsonl" else self.record_bytes

    def most_line(self, name: str) -> int:
        """Return the bytes that a line of a file of this name may have."""
        if name.endswith(".json"):
            return self.json_bytes
        return self.results_bytes // 1000 if name == "results.jsonl" else self.line_bytes


def write_bundle(path: Path, files: Iterable[tuple[str, bytes | Path]]) -> None:
    """Write a bundle; the same files give the same bytes. An existing file is never overwritten."""
    part = path.with_name(f".{path.name}.part")
    if path.exists():
        raise InvalidArgumentError(f"{path} exists; name a new file for the bundle.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, allowZip64=False) as bundle:
            for name, content in sorted(files):
                entry = zipfile.ZipInfo(name, EPOCH)
                entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o644 << 16
                data = content.read_bytes() if isinstance(content, Path) else content
                bundle.writestr(entry, data, compresslevel=9)
        part.replace(path)
    except zipfile.LargeZipFile:
        raise InvalidArgumentError(
            "The run is too large for one bundle (65,535 files, 4 GB); submit its players one by one."
        ) from None
    except OSError as error:
        raise InvalidArgumentError(f"{path} cannot be written: {error.strerror}.") from None
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def unpacked(path: str | Path, limits: Limits | None = None) -> Iterator[Path]:
    """Unpack a bundle into a temporary folder, and yield it; a bundle that is refused is a `BundleError`."""
    path, limits = Path(path), limits or Limits()
    with tempfile.TemporaryDirectory(prefix="smartplay-bundle-") as folder:
        try:
            size = path.stat().st_size
            if path.is_dir():
                raise InvalidArgumentError(f"{path} is a folder; a bundle is a zip file, which submit prepare writes.")
            _check_directory(path, size, limits)
            with zipfile.ZipFile(path) as bundle:
                _unpack(bundle, Path(folder), limits)
        except FileNotFoundError:
            raise InvalidArgumentError(f"There is no file {path}.") from None
        except (zipfile.BadZipFile, zlib.error, EOFError, struct.error, NotImplementedError, ValueError) as error:
            if isinstance(error, SmartPlayError):
                raise
            why = in_one_line(error)[:200].rstrip(".") or type(error).__name__
            raise BundleError(f"The bundle is not a readable zip file: {why}.") from None
        except OSError as error:
            raise InvalidArgumentError(
                f"{path} cannot be unpacked: {error.strerror or type(error).__name__}."
            ) from None
        yield Path(folder)


def _check_directory(path: Path, size: int, limits: Limits) -> None:
    """Refuse what could make the list of files large before it is read: that list is read as a whole."""
    if size > limits.bundle_bytes:
        raise BundleError(f"The bundle has {size:,} bytes; {limits.bundle_bytes:,} are allowed.")
    with path.open("rb") as file:
        file.seek(max(0, size - _END_SIZE - _LONGEST_COMMENT - _LOCATOR_64_SIZE))
        tail = file.read()
    at = tail.rfind(_END)
    if at < 0 or len(tail) - at < _END_SIZE:
        raise BundleError("The bundle is not a readable zip file: it has no list of files at its end.")
    (listed,) = struct.unpack_from("<L", tail, at + 12)
    if _END_64 in tail[max(0, at - _LOCATOR_64_SIZE) : at] or listed == 0xFFFFFFFF:
        raise BundleError("The bundle is a zip64 file, which a bundle never needs to be.")
    if listed > limits.directory_bytes:
        raise BundleError(f"The bundle's list of files has {listed:,} bytes; {limits.directory_bytes:,} are allowed.")


def _unpack(bundle: zipfile.ZipFile, folder: Path, limits: Limits) -> None:
    entries = bundle.infolist()
    _check_entries(entries, limits)
    for name in ("episodes", "attempts"):
        (folder / name).mkdir()
    left = limits.unpacked_bytes
    for entry in entries:
        with bundle.open(entry) as source:
            most = min(left, limits.most(entry.filename))
            left -= _copy(entry.filename, source, folder / entry.filename, most, limits)


def _check_entries(entries: list[zipfile.ZipInfo], limits: Limits) -> None:
    seen: set[str] = set()
    for entry in entries:
        name = entry.filename
        shown = repr(name[:100])
        if not NAMES.fullmatch(name):
            raise BundleError(f"The bundle holds {shown}, which does not belong in a bundle.")
        if name in seen:
            raise BundleError(f"The bundle holds {shown} twice.")
        seen.add(name)
        if entry.flag_bits & 1:
            raise BundleError(f"{shown} in the bundle is encrypted.")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise BundleError(f"{shown} in the bundle is compressed in a way that is not allowed; use deflate.")
        if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG):
            raise BundleError(f"{shown} in the bundle is a link or a device, not a file.")
    if missing := [name for name in REQUIRED if name not in seen]:
        raise BundleError(f"The bundle has no {', '.join(missing)}.")
    if (total := sum(entry.file_size for entry in entries)) > limits.unpacked_bytes:
        raise BundleError(f"The bundle unpacks to {total:,} bytes; {limits.unpacked_bytes:,} are allowed.")


def _copy(name: str, source: IO[bytes], target: Path, most: int, limits: Limits) -> int:
    """Copy a file in chunks and return its size; one that is larger than `most`, or has a huge line, is refused."""
    size = line = 0
    with target.open("xb") as file:
        while chunk := source.read(CHUNK):
            size += len(chunk)
            if size > most:
                raise BundleError(f"{name} in the bundle has more than the {most:,} bytes that are allowed.")
            first, *others = chunk.split(b"\n")
            longest = max([line + len(first), *map(len, others)])
            line = len(others[-1]) if others else line + len(first)
            if longest > limits.most_line(name):
                raise BundleError(f"{name} in the bundle has a line of more than {limits.most_line(name):,} bytes.")
            file.write(chunk)
    return size


LONGEST_TEXT = 500
"""Characters of a finding; texts in it can come from the bundle."""


@dataclass(frozen=True)
class Finding:
    """Something found in a submission."""

    level: Literal["error", "remark"]
    """An error means that the submission is not verified; a remark is something that a reader should know."""
    kind: str
    """What it is about, in a word: bundle, metadata, plan, seed, suite, coverage, record, row, budget, prompts,
    privileged, engine, end, attempts, results."""
    text: str
    key: str | None = None
    """The episode, if it is about one."""


def error(kind: str, text: str, key: str | None = None) -> Finding:
    """Return an error."""
    return Finding("error", kind, printable(text), key)


def remark(kind: str, text: str, key: str | None = None) -> Finding:
    """Return a remark."""
    return Finding("remark", kind, printable(text), key)


def printable(text: str, longest: int = LONGEST_TEXT) -> str:
    """Return a text as one line without control characters, which a terminal would obey, and cut if it is long."""
    shown = "".join(
        char if char.isprintable() else " " if char.isspace() else "\N{REPLACEMENT CHARACTER}" for char in text
    )
    shown = " ".join(shown.split())
    return shown if len(shown) <= longest else shown[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"


def some(names: Iterable[object], most: int = 5) -> str:
    """Return names with commas between them, and how many more there are."""
    listed = list(names)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(map(str, listed[:most])) + more
