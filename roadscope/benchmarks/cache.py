"""Files that are computed once: traffic timelines and detections."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Protocol, TypeVar

from roadscope.core import RecordError

ENVIRONMENT_VARIABLE = "ROADSCOPE_CACHE"


class FolderError(ValueError):
    """A folder or file cannot be written to."""


def cache_dir() -> Path:
    """Return the folder for computed files, made if need be.

    `ROADSCOPE_CACHE` names it, otherwise it is the user's cache folder. Where neither can be
    written a temporary folder is used, with a warning.
    """
    named = os.environ.get(ENVIRONMENT_VARIABLE)
    return _usable(Path(named) if named else _user_cache_dir())


def usable_folder(path: Path | str) -> Path:
    """Make a folder for results and make sure that it can be written."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
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


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
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


class Saved(Protocol):
    """What can be written to a file."""

    def save(self, path: Path) -> None:
        """Write it."""


S = TypeVar("S", bound=Saved)


def kept(path: Path, load: Callable[[Path], S], make: Callable[[], S], *, anew: bool = False) -> S:
    """Read what an earlier run has kept, or make and keep it; what is damaged is made again.

    load: raises `RecordError` where a file is damaged.
    anew: make it in any case.
    """
    if path.exists() and not anew:
        try:
            return load(path)
        except RecordError:
            path.unlink(missing_ok=True)
    made = make()
    write_atomically(path, made.save)
    return made


def _user_cache_dir() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("roadscope", appauthor=False)


@cache
def _usable(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
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
