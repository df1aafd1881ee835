"""Counts and removes the files in the cache folder, by kind."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from roadscope.benchmarks.cache import cache_folder
from roadscope.core.names import unknown

RESULTS = "results"
"""The kind of the results database, which `clear_cache` removes only if the caller asks for it."""


@dataclass(frozen=True, slots=True)
class FileKind:
    """One kind of files.

    place: subfolder of the cache, or `.` for the cache folder itself.
    names: pattern of the names of its files; other files are never removed.
    """

    description: str
    place: str
    names: re.Pattern[str]


_DIGEST = r"[0-9a-f]{16,}"
_ARRAYS = re.compile(rf"(.+-)?{_DIGEST}(\.cache|\w*\.part)")

FILE_KINDS: Mapping[str, FileKind] = {
    "timelines": FileKind("recorded traffic", "timelines", _ARRAYS),
    "detections": FileKind("LiDAR detections that trackers share", "detections", _ARRAYS),
    "image-detections": FileKind("detections in images", "image-detections", _ARRAYS),
    "fusions": FileKind("fused detections", "fusions", _ARRAYS),
    "poses": FileKind("poses by odometries", "poses", _ARRAYS),
    "tracks": FileKind("tracks", "tracks", _ARRAYS),
    "answers": FileKind("answers on other boards", "answers", _ARRAYS),
    "papers": FileKind("figures of roadscope reproduce", "papers", _ARRAYS),
    "sources": FileKind(
        "index of our sources", "sources", re.compile(rf"{_DIGEST}(\.json|\w*\.part)")
    ),
    "camera-training": FileKind(
        "pictures and checkpoints of roadscope train",
        "camera-training",
        re.compile(rf"(.+[-.])?{_DIGEST}.*\.(npy|npz|pt|part)"),
    ),
    "pages": FileKind("page of leaderboard --open without --out", ".", re.compile(r"report\.html")),
    RESULTS: FileKind(
        "results of leaderboards without --out",
        ".",
        re.compile(r"results\.sqlite(-journal|-wal|-shm)?"),
    ),
}
"""Kinds by the names that `roadscope cache clear --kind` takes."""


@dataclass(frozen=True, slots=True)
class KindUsage:
    """How many files of a kind there are and how much they hold."""

    kind: str
    description: str
    files: int
    size_bytes: int


def cache_usage() -> tuple[KindUsage, ...]:
    """Return what the cache holds, kind by kind."""
    return tuple(_usage(kind, list(_files(kind))) for kind in FILE_KINDS)


def clear_cache(
    kinds: Collection[str] | None = None, *, results: bool = False
) -> tuple[KindUsage, ...]:
    """Remove files of some kinds and return how many were removed of each.

    Computed files are made again when they are needed; results are lost for good, so they are
    removed only if `results` is true. Links are not followed, and files with other names stay.

    kinds: keys of `FILE_KINDS`; all but results if left out.
    results: whether the results database is removed, too.
    """
    for kind in kinds or ():
        if kind not in FILE_KINDS:
            raise ValueError(unknown("kind of cached files", kind, FILE_KINDS))
    if RESULTS in (kinds or ()) and not results:
        raise ValueError("results are lost for good when they are removed: add --results")
    chosen = [kind for kind in FILE_KINDS if kind != RESULTS and kind in (kinds or FILE_KINDS)]
    return tuple(_removed(kind) for kind in [*chosen, *[RESULTS] * results])


def size_text(size_bytes: int) -> str:
    """Return a size as people write it: `0 B`, `12.3 MB`."""
    size, unit = float(size_bytes), "B"
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000 or unit == "GB":
            break
        size /= 1000
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"


def _files(kind: str) -> Iterator[Path]:
    """Yield the files of a kind; neither folders nor files that are links."""
    file_kind = FILE_KINDS[kind]
    place = cache_folder() / file_kind.place
    if not place.is_dir() or (place.is_symlink() and file_kind.place != "."):
        return
    for path in sorted(place.iterdir()):
        if file_kind.names.fullmatch(path.name) and path.is_file() and not path.is_symlink():
            yield path


def _usage(kind: str, files: list[Path]) -> KindUsage:
    size_bytes = sum(_size(path) for path in files)
    return KindUsage(kind, FILE_KINDS[kind].description, len(files), size_bytes)


def _size(path: Path) -> int:
    """Return the size of a file; 0 if another process removes it meanwhile."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _removed(kind: str) -> KindUsage:
    files = list(_files(kind))
    usage = _usage(kind, files)
    for path in files:
        path.unlink(missing_ok=True)
    place = cache_folder() / FILE_KINDS[kind].place
    if files and FILE_KINDS[kind].place != "." and not any(place.iterdir()):
        place.rmdir()
    return usage
