"""Keys of results before and after a file of the package is edited."""

import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path

import roadscope

PROGRAM = """
import os, sys
import filterpy.kalman, numba, scipy.ndimage, scipy.optimize, scipy.stats
imports, rest = sys.argv[1:]
exec(imports)
for _ in sys.stdin:
    child = os.fork()
    if not child:
        exec(rest)
        print(flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""
"""Imports are done once, those of other packages too; nothing else is kept between answers."""


class Copy:
    """A copy of the package whose files may be edited, and what a program there prints."""

    def __init__(self, root: Path, process: subprocess.Popen[str]) -> None:
        self.root, self.process = root, process

    def keys(self) -> list[str]:
        """What the program prints now."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return [line.strip() for line in takewhile(str.strip, self.process.stdout)]

    def edit(self, file: str) -> None:
        """Change a file and not what it does."""
        path = self.root / "roadscope" / file
        path.write_text(path.read_text() + "\nEDITED = True\n")


@contextmanager
def copied(code: str, root: Path) -> Iterator[Copy]:
    """Copy the package and run a program beside it; its imports come first."""
    package = Path(roadscope.__file__).parent
    shutil.copytree(package, root / "roadscope", ignore=shutil.ignore_patterns("__pycache__"))
    lines = code.strip().splitlines(keepends=True)
    imports = list(takewhile(lambda line: line.startswith("from "), lines))
    command = [sys.executable, "-c", PROGRAM, "".join(imports), "".join(lines[len(imports) :])]
    with subprocess.Popen(
        command, cwd=root, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield Copy(root, process)


def assert_changed(copy: Copy, edits: Sequence[tuple[str, list[bool]]]) -> list[str]:
    """Edit file after file of a copy; each changes just the keys that it says. Return the last."""
    before = copy.keys()
    assert before
    assert len(set(before)) == len(before)
    for file, changed in edits:
        copy.edit(file)
        after = copy.keys()
        assert [a != b for a, b in zip(before, after, strict=True)] == changed, file
        before = after
    return before
