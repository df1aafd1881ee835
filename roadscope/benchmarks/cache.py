"""Files that are computed once: traffic timelines and detections."""

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
"""First bytes of a file of computed content; the SHA-256 of the content follows."""
HEADER_BYTES = len(MAGIC) + 32
REASON_LENGTH = 300
"""Longest reason in a warning, characters; chosen by hand."""


class FolderError(ValueError):
    """A folder or file cannot be written to."""


def cache_folder() -> Path:
    """Return the folder that computed files go to; it is not made, nor tried."""
    if named := os.environ.get(ENVIRONMENT_VARIABLE):
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("roadscope", appauthor=False)


def cache_dir() -> Path:
    """Return the folder for computed files, made if need be.

    `ROADSCOPE_CACHE` names it, otherwise it is the user's cache folder. Where neither can be
    written a temporary folder is used, with a warning.
    """
    return _usable(cache_folder())


def usable_folder(path: Path | str) -> Path:
    """Make a folder for results and make sure that it can be written."""
    folder = Path(path)
    try:
        return _tried(folder)
    except FileExistsError as error:
        raise FolderError(f"cannot write to folder {folder}: a file is in the way") from error
    except OSError as error:
        raise FolderError(f"cannot write to folder {folder}: {error.strerror or error}") from error


def usable_file(path: Path | str, endings: Sequence[str], what: str) -> Path:
    """Refuse a path to which no file of such endings can be written, before anything is computed.

    what: in the words of the error, such as `a picture`.
    """
    place = Path(path)
    if place.suffix.lower() not in endings:
        raise FolderError(f"{what} ends in {' or '.join(endings)}, got {place}")
    if place.is_dir():
        raise FolderError(f"cannot write {what} to {place}: it is a folder")
    usable_folder(place.parent)
    return place


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file so that no reader ever sees half of it, whoever else writes it too."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=path.stem, suffix=".part", dir=path.parent)
    os.close(handle)
    try:
        write(Path(name))
        # Temporary files are for their owner alone; this one is to be as any other.
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
    """What can be written to a file."""

    def save(self, file: BinaryIO, /) -> None:
        """Write it."""


S = TypeVar("S")
V = TypeVar("V", bound=Saved)


@dataclass(slots=True)
class Ledger:
    """What a run knows of the kept files that a task reads.

    digests: by path, of files that were there when the run began or that it wrote since; None
        where there was none. A file that is not listed may be used as it is.
    written: the digests of the files that the task wrote.
    notes: what was wrong with files, for the reader.
    """

    digests: Mapping[str, str | None] = field(default_factory=dict)
    written: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def usable(self, path: Path) -> bool:
        """Return whether a file may be read: not one that appeared since the run began."""
        return str(path) in _written or self.digests.get(str(path), "") is not None

    def expects(self, path: Path, digest: str) -> bool:
        """Return whether a file is the one that the run or this process wrote or began with."""
        return digest in (_written.get(str(path)), self.digests.get(str(path), digest))


_ledger: ContextVar[Ledger | None] = ContextVar("ledger", default=None)
_written: dict[str, str] = {}
"""The digests of all files that this process wrote."""


@contextmanager
def checked_by(ledger: Ledger) -> Iterator[Ledger]:
    """Read kept files only as a ledger knows them, and put warnings of them in its notes."""
    token = _ledger.set(ledger)
    try:
        yield ledger
    finally:
        _ledger.reset(token)


def kept(
    path: Path, load: Callable[[BinaryIO], V], make: Callable[[], V], *, recompute: bool = False
) -> V:
    """Read what an earlier run has written, or make and write it.

    A damaged file is removed with a warning and made again; so is one that somebody else changed
    since the run began (`checked_by`). recompute: make it in any case.
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
    made = make()
    ledger.written[str(path)] = _written[str(path)] = write_kept(path, made)
    return made


def _note(text: str) -> None:
    """Warn of a file, or note the warning where a task of a run hands it on."""
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
    """Read what `write_kept` wrote; whatever is wrong with it raises `RecordError`."""
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
        raise RecordError(f"{path} was changed by somebody else since the run began")
    # Damaged archives raise errors of zipfile, zlib and NumPy, and MemoryError for absurd shapes.
    try:
        return load(BytesIO(payload))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"[:REASON_LENGTH]
        raise RecordError(f"{path} is damaged: {reason}") from error


def digest_of(path: Path) -> str | None:
    """Return the digest in the header of a file, or None if `write_kept` did not write it.

    The content is not read, so the digest says whether the file is another one than before.
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
def _usable(folder: Path) -> Path:
    try:
        return _tried(folder)
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


def _tried(folder: Path) -> Path:
    """Make a folder and write a file in it."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        return folder
