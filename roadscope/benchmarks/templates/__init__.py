"""Files to start from: a suite and a plug-in of each kind, each of which works as it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from shlex import quote

from roadscope.benchmarks.cache import FolderError, usable_file, write_text
from roadscope.core import SpecError
from roadscope.core.names import unknown


@dataclass(frozen=True, slots=True)
class Template:
    """One file to start from.

    source: its name in this package. default_path: where it is written if nothing else is said.
    next_steps: commands to go on with; `{path}` stands for the file.
    """

    source: str
    default_path: str
    next_steps: tuple[str, ...]


def _plugin(source: str, class_name: str, board: str) -> Template:
    """Return the template of a plug-in that is ranked on a board."""
    spec = f"{{path}}:{class_name}"
    steps = f"roadscope check {spec}", f"roadscope leaderboard {board} --entry {spec} --seeds 1"
    return Template(f"{source}.py.txt", f"my_{source}.py", steps)


TEMPLATES: Mapping[str, Template] = {
    "suite": Template(
        "suite.toml",
        "my_suite.toml",
        ("roadscope check {path}", "roadscope leaderboard --suite {path} --out results"),
    ),
    "tracker": _plugin("tracker", "MyTracker", "tracking"),
    "detector": _plugin("detector", "MyDetector", "detection"),
    "camera-detector": _plugin("camera_detector", "MyCameraDetector", "camera"),
    "odometry": _plugin("odometry", "MyOdometry", "odometry"),
    "fusion": _plugin("fusion", "MyFusion", "fusion"),
    "driver": _plugin("driver", "MyDriver", "driving"),
}


@dataclass(frozen=True, slots=True)
class WrittenTemplate:
    """A file that was written, and commands to go on with."""

    path: Path
    next_steps: tuple[str, ...]


def write_template(
    kind: str, path: Path | str | None = None, *, force: bool = False
) -> WrittenTemplate:
    """Write a commented file that works as it is, and return where it is and what to do next.

    kind: a key of `TEMPLATES`, with "-" or " " between words; another one raises `SpecError`.
    path: of the file, or a folder that exists; `default_path` of the template if left out.
    force: write over a file that exists; without it that raises `FolderError`.
    """
    name = kind.replace(" ", "-")
    if name not in TEMPLATES:
        raise SpecError(unknown("template", kind, TEMPLATES))
    template = TEMPLATES[name]
    place = Path(template.default_path if path is None else path)
    if place.is_dir():
        place = place / template.default_path
    ending = Path(template.default_path).suffix
    place = usable_file(place, (ending,), f"a {kind}")
    if place.exists() and not force:
        raise FolderError(f"{place} exists; --force writes over it")
    write_text(place, template_text(name))
    steps = tuple(step.format(path=quote(str(place))) for step in template.next_steps)
    return WrittenTemplate(place, steps)


def template_text(kind: str) -> str:
    """Return the text of a template."""
    return resources.files(__name__).joinpath(TEMPLATES[kind].source).read_text("utf-8")
