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
"""Folders of sockets and of shared memory; they look empty in the sandbox."""
SCRATCH_BYTES = 2_000_000_000
"""Size of the scratch folder, which is in memory; it does not count as memory of the plug-in."""
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

    Files outside of the scratch folder and of hidden folders can be read.

    readable: files and folders that can be read too, even inside the scratch folder or a hidden
        folder.
    hidden: folders that look empty, even inside a readable one. A path that is in both is hidden.
    """
    masks = [path for path in (*MASKED, *hidden) if path.is_dir() and not path.is_symlink()]
    empty = (SCRATCH, *masks)
    needed = {path.resolve() for path in (Path(sys.prefix), Path(sys.base_prefix), *readable)}
    shown_again = {
        path
        for path in needed
        if path.exists() and any(path.is_relative_to(folder) for folder in empty)
    }
    words = ["bwrap", "--die-with-parent", "--unshare-all", "--new-session"]
    # Root would keep its capabilities, with which it can mount over all that follows.
    words += ["--cap-drop", "ALL"]
    words += ["--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc"]
    # A folder comes before those inside it: each covers what the earlier ones put in its place.
    for path in sorted({*empty, *shown_again}):
        if path in empty:
            words += ["--size", str(SCRATCH_BYTES), "--tmpfs", str(path)]
        else:
            words += ["--ro-bind", str(path), str(path)]
    # Only now: places for the folders shown again had to be made inside.
    for path in masks:
        words += ["--remount-ro", str(path)]
    return [*words, "--setenv", "TMPDIR", str(SCRATCH), "--setenv", "HOME", str(SCRATCH)]


@cache
def folders_behind(folder: Path) -> tuple[Path, ...]:
    """Return an absolute folder and the other folders that links in it lead to, resolved.

    Links to a folder that contains this one are left out.
    """
    start = folder.resolve()
    folders = [start]
    for top in folders:  # It grows while links are followed.
        for place, names, _ in os.walk(top):
            targets = [path.resolve() for name in names if (path := Path(place, name)).is_symlink()]
            for target in targets:
                is_new = not any(target.is_relative_to(each) for each in folders)
                if is_new and not start.is_relative_to(target):
                    folders.append(target)
    return tuple(folders)


def needed_paths(path: Iterable[str]) -> list[Path]:
    """Return the entries of an import path that exist."""
    return [Path(entry) for entry in path if entry and os.path.exists(entry)]  # noqa: PTH110
