"""Sandboxes a supervisor with bubblewrap: no network, no other processes, no files to write."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

SCRATCH = Path("/tmp")
"""The only folder that can be written; it is empty at first and is deleted at the end."""
MASKED = (Path("/run"), Path("/var/run"), Path("/dev/shm"))
"""Folders of sockets and of shared memory, which look empty in the sandbox."""
SCRATCH_BYTES = 2_000_000_000
"""Size of the scratch folder, which is in memory and not part of a plug-in's limit."""
TRY_S = 20.0
"""Seconds that a trial of bubblewrap may take."""


@cache
def sandbox_available() -> str:
    """Return why plug-ins cannot be sandboxed here; empty if they can."""
    if sys.platform != "linux":
        return "a sandbox needs Linux"
    if shutil.which("bwrap") is None:
        return "bubblewrap is not installed: apt-get install bubblewrap"
    try:
        tried = subprocess.run(
            [*sandbox_command(readable=(), hidden=()), sys.executable, "-c", "pass"],
            capture_output=True,
            text=True,
            timeout=TRY_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"bubblewrap does not run here: {error}"
    if tried.returncode:
        return f"bubblewrap does not run here: {' '.join(tried.stderr.split())[:300]}"
    return ""


def sandbox_command(*, readable: Iterable[Path], hidden: Sequence[Path]) -> list[str]:
    """Return the words before a command that run it in a sandbox.

    readable: files and folders that the command needs, even inside the scratch folder or a hidden
        one. hidden: folders that look empty, even inside a readable one. Of a path that is both it
        is hidden.
    """
    masks = [path for path in (*MASKED, *hidden) if path.is_dir() and not path.is_symlink()]
    needed = {path.resolve() for path in (Path(sys.prefix), Path(sys.base_prefix), *readable)}
    words = ["bwrap", "--die-with-parent", "--unshare-all", "--new-session"]
    words += ["--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc"]
    places = (SCRATCH, *masks)
    needed = {path for path in needed if any(path.is_relative_to(place) for place in places)}
    # A folder comes before those inside it.
    for path in sorted({*places, *filter(Path.exists, needed)}):
        if path in places:
            words += ["--size", str(SCRATCH_BYTES), "--tmpfs", str(path)]
        else:
            words += ["--ro-bind", str(path), str(path)]
    for path in masks:
        words += ["--remount-ro", str(path)]
    return [*words, "--setenv", "TMPDIR", str(SCRATCH), "--setenv", "HOME", str(SCRATCH)]


@cache
def folders_behind(folder: Path) -> tuple[Path, ...]:
    """Return an absolute folder and the other folders that links in it lead to, resolved.

    Links to a folder that contains this one are left out.
    """
    found = [folder.resolve()]
    for top in found:
        for place, names, _ in os.walk(top):
            for link in (Path(place, name) for name in names):
                target = link.resolve() if link.is_symlink() else top
                is_new = not any(target.is_relative_to(each) for each in found)
                if is_new and not found[0].is_relative_to(target):
                    found.append(target)
    return tuple(found)


def needed_paths(path: Iterable[str]) -> list[Path]:
    """Return the entries of an import path that exist."""
    return [Path(entry) for entry in path if entry and os.path.exists(entry)]  # noqa: PTH110
