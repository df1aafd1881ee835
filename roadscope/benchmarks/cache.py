"""The cache folder, and files in it that are computed once: traffic, detections, answers."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache, partial
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Protocol, TypeVar

from roadscope.core import RecordError

ENVIRONMENT_VARIABLE = "ROADSCOPE_CACHE"
MAGIC = b"rscache1"
"""First bytes of a kept file; the SHA-256 of the content follows."""
HEADER_BYTES = len(MAGIC) + 32
REASON_LENGTH = 300
"""Longest reason in a warning, characters; chosen by hand."""


class FolderError(ValueError):
    """A folder or file cannot be written to."""


def cache_folder() -> Path:
    """Return the folder for computed files, without making it or testing that it can be written."""
    if named := os.environ.get(ENVIRONMENT_VARIABLE):
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("roadscope", appauthor=False)


def cache_dir() -> Path:
    """Return the folder for computed files, made if need be.

    The environment variable `ROADSCOPE_CACHE` names it; otherwise it is the user's cache folder. If
    it cannot be written, a temporary folder takes its place, with a warning.
    """
    return _usable_or_temporary(cache_folder())


def usable_folder(path: Path | str) -> Path:
    """Make a folder and return it; raise `FolderError` if it cannot be written."""
    folder = Path(path)
    try:
        return _writable_folder(folder)
    except FileExistsError as error:
        raise FolderError(f"cannot write to folder {folder}: a file is in the way") from error
    except OSError as error:
        raise FolderError(f"cannot write to folder {folder}: {error.strerror or error}") from error


def usable_file(path: Path | str, endings: Sequence[str], what: str) -> Path:
    """Return the path; raise `FolderError` if no file of these endings can be written there.

    what: name of the file in the error, such as `a picture`.
    """
    place = Path(path)
    if place.suffix.lower() not in endings:
        raise FolderError(f"{what} ends in {' or '.join(endings)}, got {place}")
    if place.is_dir():
        raise FolderError(f"cannot write {what} to {place}: it is a folder")
    usable_folder(place.parent)
    return place


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file so that no reader ever sees half of it, even if several processes write it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=path.stem, suffix=".part", dir=path.parent)
    os.close(handle)
    try:
        write(Path(name))
        # A temporary file can be read by its owner only; this file gets the usual rights.
        mask = os.umask(0)
        os.umask(mask)
        Path(name).chmod(0o666 & ~mask)
        Path(name).replace(path)
    finally:
        Path(name).unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file so that no reader ever sees half of it."""
    write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))


class Saved(Protocol):
    """A record that can be written to a file."""

    def save(self, file: BinaryIO, /) -> None:
        """Write it."""


S = TypeVar("S")
V = TypeVar("V", bound=Saved)


@dataclass(slots=True)
class Ledger:
    """The digests of the kept files that a task of a run may read, and those that it wrote.

    digests: by path, of files that existed when the run began or that it wrote since; None for a
        file that did not exist. A file that is not listed may be used as it is.
    written: digests of the files that the task wrote, by path.
    notes: warnings about damaged files.
    """

    digests: Mapping[str, str | None] = field(default_factory=dict)
    written: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def usable(self, path: Path) -> bool:
        """Return whether a file may be read: not if another program made it during the run."""
        return str(path) in _written or self.digests.get(str(path), "") is not None

    def expects(self, path: Path, digest: str) -> bool:
        """Return whether this is the digest of the file that the run began with or wrote."""
        return digest in (_written.get(str(path)), self.digests.get(str(path), digest))


_ledger: ContextVar[Ledger | None] = ContextVar("ledger", default=None)
_written: dict[str, str] = {}
"""The digests of all files that this process wrote."""


@contextmanager
def checked_by(ledger: Ledger) -> Iterator[Ledger]:
    """Read only the kept files that a ledger allows; put warnings about them in its notes."""
    token = _ledger.set(ledger)
    try:
        yield ledger
    finally:
        _ledger.reset(token)


def read_or_make(
    path: Path, load: Callable[[BinaryIO], V], make: Callable[[], V], *, recompute: bool = False
) -> V:
    """Read a kept file, or make its content and write it.

    A damaged file is removed with a warning and made again; so is one that another program changed
    since the run began (`checked_by`). recompute: make it although it exists.
    """
    ledger = _ledger.get() or Ledger()
    if not recompute and ledger.usable(path):
        try:
            return _read(path, load, partial(ledger.expects, path))
        except FileNotFoundError:
            pass
        except RecordError as error:
            _note(f"{error}; it is made again")
            with suppress(OSError):
                path.unlink(missing_ok=True)
    content = make()
    ledger.written[str(path)] = _written[str(path)] = write_kept(path, content)
    return content


def _note(text: str) -> None:
    """Warn about a file; within a task of a run, add the warning to the notes of its ledger."""
    ledger = _ledger.get()
    if ledger is None:
        warnings.warn(text, stacklevel=4)
    else:
        ledger.notes.append(text)


def write_kept(path: Path, content: Saved) -> str:
    """Write a header with the digest of the content, and the content; return the digest."""
    buffer = BytesIO()
    content.save(buffer)
    payload = buffer.getbuffer()
    digest = sha256(payload)

    def write(part: Path) -> None:
        with part.open("wb") as file:
            file.write(MAGIC + digest.digest())
            file.write(payload)

    write_atomically(path, write)
    return digest.hexdigest()


def read_kept(path: Path, load: Callable[[BinaryIO], S]) -> S:
    """Read a file of `write_kept`; raise `RecordError` if it is damaged."""
    return _read(path, load, lambda digest: True)


def _read(path: Path, load: Callable[[BinaryIO], S], expects: Callable[[str], bool]) -> S:
    """Read a file if its digest is expected."""
    try:
        with path.open("rb") as file:
            header, payload = file.read(HEADER_BYTES), file.read()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror or error}") from error
    if header != MAGIC + sha256(payload).digest():
        raise RecordError(f"{path} is damaged: its digest does not fit its content")
    if not expects(header[len(MAGIC) :].hex()):
        raise RecordError(f"{path} was changed by another program since the run began")
    # Damaged archives raise errors of zipfile, zlib and NumPy, and MemoryError for absurd shapes.
    try:
        return load(BytesIO(payload))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"[:REASON_LENGTH]
        raise RecordError(f"{path} is damaged: {reason}") from error


def digest_of(path: Path) -> str | None:
    """Return the digest in the header of a file, or None if `write_kept` did not write it.

    The content is not read: the digest tells whether the file was replaced.
    """
    try:
        with path.open("rb") as file:
            header = file.read(HEADER_BYTES)
    except OSError:
        return None
    if len(header) < HEADER_BYTES or not header.startswith(MAGIC):
        return None
    return header[len(MAGIC) :].hex()


@cache
def _usable_or_temporary(folder: Path) -> Path:
    try:
        return _writable_folder(folder)
    except OSError as error:
        spare = Path(tempfile.mkdtemp(prefix="roadscope-"))
        # Worker processes inherit the variable and so share the one spare folder.
        os.environ[ENVIRONMENT_VARIABLE] = str(spare)
        warnings.warn(
            f"cannot write to {folder} ({error.strerror}); computed files go to {spare} and "
            f"are not found again next time; set {ENVIRONMENT_VARIABLE} to a writable folder",
            stacklevel=3,
        )
        return spare


def _writable_folder(folder: Path) -> Path:
    """Make a folder and return it; raise `OSError` if no file can be written in it."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        return folder
