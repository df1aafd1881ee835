"""Keys of results before and after a file of the package is edited."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import roadscope


def keys(code: str, root: Path) -> list[str]:
    """What a program prints that runs beside a package of its own."""
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    return result.stdout.split()


def assert_changed(code: str, root: Path, edits: Sequence[tuple[str, list[bool]]]) -> list[str]:
    """Edit file after file of a copy; each changes just the keys that it says. Return the last."""
    shutil.copytree(Path(roadscope.__file__).parent, root / "roadscope")
    before = keys(code, root)
    assert len(set(before)) == len(before)
    for file, changed in edits:
        path = root / "roadscope" / file
        path.write_text(path.read_text() + "\n# edited\n")
        after = keys(code, root)
        assert [a != b for a, b in zip(before, after, strict=True)] == changed, file
        before = after
    return before
