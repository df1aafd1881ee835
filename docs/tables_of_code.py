"""Tables and lists that are made from the code itself; `conf.py` puts them into pages.

    ```{from-code} rigs
    On the site. Here: roadscope list rigs
    ```

The word names a function below; what it returns is Markdown. It replaces the text, which is for
those who read the page on GitHub.
"""

import importlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from enum import Enum
from typing import Any

import gymnasium
import numpy as np
from sphinx.pycode import ModuleAnalyzer

from roadscope import CAMERA_DETECTORS, DETECTORS, FUSIONS, ODOMETRIES, TRACKERS
from roadscope.benchmarks import names_of
from roadscope.core.tables import ArrayTable
from roadscope.envs import env_ids, find_rig
from roadscope.envs.sensors import CAMERAS, IMUS, SPECS

FIELDS = re.compile(r"((?:\*{0,2}[A-Za-z_]\w*)(?:, \*{0,2}[A-Za-z_]\w*)*): +(?=\S)")
"""`name: text` or `name, name: text` at the beginning of a line: arguments, fields, results."""
NEXT_FIELD = re.compile(r"(?<=[.;]) (?=\*{0,2}[a-z_]\w*(?:, \*{0,2}[a-z_]\w*)*: )")
"""The space before such a name behind a sentence."""


def as_restructured_text(lines: list[str]) -> list[str]:
    """Return a docstring of ours, which is plain text with `names`, as reStructuredText.

    Lines `name: text` become a list; a block that is indented after a blank line is code.
    """
    out: list[str] = []
    place = "text"
    for before, line in zip(["", *lines], lines, strict=False):
        indented, new = line.startswith("    "), not before.strip()
        field = FIELDS.match(line) if out else None  # the first line is a sentence
        if place == "code" and (indented or not line.strip()):
            out.append(line)
        elif indented and new and place != "fields":
            out += ["::", "", line]
            place = "code"
        elif (field and new) or (place == "fields" and line.strip() and not new):
            out += [""] * (place != "fields")
            for number, part in enumerate(NEXT_FIELD.split(line.strip())):
                named = FIELDS.match(part) if number else field
                if named:
                    names = ", ".join(f"``{name}``" for name in named[1].split(", "))
                    out.append(f"- {names}: {inline(part[named.end() :])}")
                else:
                    out.append(f"  {inline(part)}")
            place = "fields"
        elif line.strip():
            out += [*[""] * (place != "text"), inline(line)]
            place = "text"
        else:
            out.append("")
    return [*out, ""]


def inline(text: str) -> str:
    """Return a line with `code` as a literal and nothing else that means something to Sphinx."""
    parts = re.split(r"(`+[^`]+`+)", text)
    escaped = [re.sub(r"([*|\\])|(?<=\w)(_)(?!\w)", r"\\\1\2", part) for part in parts[::2]]
    code = [f"``{part.strip('`')}``" for part in parts[1::2]]
    return "".join(a + b for a, b in zip(escaped, [*code, ""], strict=True))


REGISTRIES = {
    "detectors": DETECTORS,
    "camera-detectors": CAMERA_DETECTORS,
    "trackers": TRACKERS,
    "odometries": ODOMETRIES,
    "fusions": FUSIONS,
}


def table(head: str, rows: list[list[str]]) -> str:
    """Return a Markdown table. head: names of columns with commas between them."""
    names = head.split(",")
    lines = [names, ["---"] * len(names), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def lidars() -> str:
    """Return the data sheets of LiDARs."""
    rows = []
    for name, s in SPECS.items():
        low, high = np.degrees(s.elevations[[0, -1]])
        rows.append(
            [
                f"`{name}`",
                str(s.beams),
                f"{low:.4g} to {high:.4g}",
                f"{abs(np.degrees(s.azimuth_span)):.4g}",
                f"{s.columns} ({abs(np.degrees(s.azimuth_span)) / s.columns:.3f})",
                f"{1 / s.period_s:.4g}",
                f"{s.range_min_m:g} to {s.range_max_m:g}",
                f"{100 * s.range_noise_m:g}",
                f"{1000 * s.range_resolution_m:g}",
                f"{s.dropout:g}",
                f"{s.detection_limit:.2g}",
            ]
        )
    head = (
        "name,beams,elevation (deg),field (deg),columns (step in deg),rate (Hz),range (m),"
        "range noise (cm),range step (mm),dropout,detection limit"
    )
    return table(head, rows) + "\n\n" + "\n".join(_lidar_sources())


def _lidar_sources() -> Iterator[str]:
    module = importlib.import_module("roadscope.envs.sensors.lidar_spec")
    for name in SPECS:
        lines = (inspect.getdoc(getattr(module, f"_{name}")) or "").splitlines()
        text = " ".join(line.strip() for line in lines).removeprefix("Return the ")
        yield f"- `{name}`: {text}"


def cameras() -> str:
    """Return the data sheets of cameras."""
    rows = []
    for name, s in CAMERAS.items():
        p = s.pinhole
        angle = 2 * np.degrees(np.arctan(p.width / 2 / p.focal_px[0]))
        rows.append(
            [
                f"`{name}`",
                f"{p.width} x {p.height}",
                f"{p.focal_px[0]:g}",
                f"{angle:.0f}",
                f"{1 / s.period_s:g}",
                f"{1000 * s.exposure_s:g}",
                f"{s.full_well:g}",
                f"{s.read_noise:g}",
                f"{s.vignetting:g}",
            ]
        )
    head = (
        "name,pixels,focal length (px),field (deg),rate (Hz),exposure (ms),full well (electrons),"
        "read noise (electrons),light lost in corners"
    )
    return table(head, rows)


def imus() -> str:
    """Return the data sheets of inertial units."""
    quantities = [
        ("rate (Hz)", "rate_hz", 1.0),
        ("gyro noise (rad/s/√Hz)", "gyro_noise", 1.0),
        ("gyro walk (rad/s²/√Hz)", "gyro_walk", 1.0),
        ("gyro bias at start (deg/s)", "gyro_turn_on", np.degrees(1.0)),
        ("accelerometer noise (m/s²/√Hz)", "accelerometer_noise", 1.0),
        ("accelerometer walk (m/s³/√Hz)", "accelerometer_walk", 1.0),
        ("accelerometer bias at start (m/s²)", "accelerometer_turn_on", 1.0),
        ("bandwidth (Hz)", "bandwidth_hz", 1.0),
        ("gyro range (deg/s)", "gyro_range", np.degrees(1.0)),
        ("accelerometer range (m/s²)", "accelerometer_range", 1.0),
    ]
    rows = [
        # No data sheet says 1e+03.
        [title, *(f"{float(f'{factor * getattr(spec, name):.3g}'):g}" for spec in IMUS.values())]
        for title, name, factor in quantities
    ]
    return table(",".join(["", *(f"`{name}`" for name in IMUS)]), rows)


def rigs() -> str:
    """Return which sensors the rigs have and where they sit."""
    rows = []
    for name, _ in names_of("rigs"):
        rig = find_rig(name)
        rows.append(
            [
                f"`{name}`",
                f"`{rig.lidar.spec.name}` at {_place(rig.lidar.ego_from_lidar)}",
                f"`{rig.camera.spec.name}` at {_place(rig.camera.ego_from_camera)}"
                if rig.camera
                else "",
                f"`{rig.imu.spec.name}` at {_place(rig.imu.ego_from_imu)}" if rig.imu else "",
                "yes" if rig.wheels else "",
            ]
        )
    return table("rig,LiDAR,camera,IMU,wheel speed and sway", rows)


def _place(pose: Any) -> str:
    x, _, z = pose.matrix[:3, 3]
    return f"{x:g}; {z:g} m"


def scenarios() -> str:
    """Return all scenarios, each with its picture."""
    ids = {gymnasium.spec(each).kwargs["scenario"]: each for each in env_ids()}
    assert len(ids) == len(env_ids())
    parts = []
    for name, description in names_of("scenarios"):
        known = f" Id: `{ids[name]}`." if name in ids else ""
        parts += [
            f"### {name}",
            f"{description}{known}",
            f"![A picture of {name}](images/scenarios/{name}.png)",
        ]
    return "\n\n".join(parts)


def names(kind: str) -> str:
    """Return a table of the names of one kind, as `roadscope list` shows them."""
    return table("name,what it is", [[f"`{name}`", text] for name, text in names_of(kind)])


def methods(kind: str) -> str:
    """Return each registered class of a kind: its names, what it is, and where its code is."""
    registry = REGISTRIES[kind]
    by_class: dict[str, list[str]] = {}
    for name in registry.summaries:
        by_class.setdefault(registry.resolve(name).target, []).append(name)
    parts = []
    for target, own in by_class.items():
        module, _, class_name = target.partition(":")
        lines = ["### " + ", ".join(f"`{name}`" for name in own), ""]
        lines += [f"- `{name}`: {registry.summaries[name]}" for name in own]
        file = f"{module.replace('.', '/')}.py"
        text = _docstrings(module, class_name)
        parts.append("\n".join([*lines, "", *text, "", f"Code: `{file}`, class `{class_name}`."]))
    return "\n\n".join(parts)


def _docstrings(module: str, class_name: str) -> list[str]:
    """Return the docstrings of a file and of its class as a block of reStructuredText."""
    loaded = importlib.import_module(module)
    both = [inspect.getdoc(each) or "" for each in (loaded, getattr(loaded, class_name))]
    texts = [as_restructured_text(text.splitlines()) for text in both]
    return ["```{eval-rst}", *texts[0], *texts[1], "```"]


def commands() -> str:
    """Return what each command prints for `--help`."""
    from typer.main import get_command

    from roadscope.__main__ import app

    def helps(command: Any, path: str) -> Iterator[str]:
        context = command.make_context(path, [], resilient_parsing=True, max_content_width=96)
        yield f"### `{path}`\n\n```text\n{context.get_help()}\n```"
        for name in getattr(command, "commands", ()):
            yield from helps(command.get_command(context, name), f"{path} {name}")

    return "\n\n".join(helps(get_command(app), "roadscope"))


def public(module: str) -> str:
    """Return the documentation of all public names of a module; each name once."""
    loaded = importlib.import_module(module)
    text = (inspect.getdoc(loaded) or "").splitlines()
    lines = ["```{eval-rst}", *as_restructured_text(text), ""]
    elsewhere = []
    for name in sorted(loaded.__all__, key=str.lower):
        value = getattr(loaded, name)
        if inspect.ismodule(value):
            continue
        first = _first_place(value, name, module)
        if first != module:
            elsewhere.append(f":py:obj:`~{first}.{name}`")
        elif inspect.isclass(value):
            members = ["   :members:", *["   :undoc-members:"] * issubclass(value, Enum)]
            members += ["   :inherited-members:"] * issubclass(value, ArrayTable)
            lines += [f".. autoclass:: {module}.{name}", *members, ""]
        elif callable(value):
            lines += [f".. autofunction:: {module}.{name}", ""]
        else:
            text = as_restructured_text(_text_of_constant(name, value))
            lines += [f".. py:data:: {module}.{name}", "", *(f"   {line}" for line in text), ""]
    if elsewhere:
        lines += ["Also here: " + ", ".join(elsewhere) + "."]
    return "\n".join([*lines, "```"])


def _text_of_constant(name: str, value: object) -> list[str]:
    """Return the text below a constant in the file that defines it."""
    for each in [each for each in sys.modules if each.startswith("roadscope.")]:
        if vars(sys.modules[each]).get(name) is value:
            texts = ModuleAnalyzer.for_module(each).find_attr_docs()
            if ("", name) in texts:
                return list(texts["", name])
    return [type(value).__doc__.partition("\n")[0] if hasattr(value, "names") else ""]


MODULES = (
    "roadscope",
    *(f"roadscope.{name}" for name in ("metrics", "formats", "testing", "envs", "detectors")),
    *(f"roadscope.{name}" for name in ("odometry", "trackers", "fusion", "driving", "benchmarks")),
)
"""The modules whose names are public."""


def _first_place(value: object, name: str, module: str) -> str:
    """Return the first module that offers the same thing by the same name."""
    for each in MODULES:
        loaded = importlib.import_module(each)
        if name in loaded.__all__ and getattr(loaded, name) is value:
            return each
    return module


MAKERS: dict[str, Callable[..., str]] = {
    maker.__name__: maker
    for maker in (lidars, cameras, imus, rigs, scenarios, names, methods, commands, public)
}


def with_tables(text: str) -> str:
    """Return the text of a page with what the functions of this file make in their places."""

    def made(match: re.Match[str]) -> str:
        maker, *arguments = match[1].split()
        return MAKERS[maker](*arguments)

    return re.sub(r"^```\{from-code\} (.+)\n(?:(?!```).*\n)*```$", made, text, flags=re.MULTILINE)
