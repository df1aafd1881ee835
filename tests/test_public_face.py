"""What the package offers, and that README, documentation and examples need nothing else.

`public_names.txt` records it. After a change that is wanted:  python tests/test_public_face.py
"""

import ast
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import roadscope

ROOT = Path(__file__).parents[1]
NAMES = Path(__file__).parent / "public_names.txt"
OFFERED_MODULES = ("metrics", "formats", "testing")
ROOMS = ("envs", "detectors", "odometry", "trackers", "fusion", "driving", "benchmarks")
OFFERING = (
    "roadscope",
    *(f"roadscope.{name}" for name in ("metrics", "formats", "testing", *ROOMS)),
)
"""Modules whose `__all__` is public."""
LAZY = ("roadscope", *(f"roadscope.{name}" for name in ROOMS))


def offered(module: str) -> list[str]:
    return list(importlib.import_module(module).__all__)


@cache
def offered_types() -> set[type]:
    values = (getattr(importlib.import_module(m), name) for m in OFFERING for name in offered(m))
    return {value for value in values if inspect.isclass(value)}


def recorded() -> str:
    """Describe all public names: signatures, the methods of classes, members of enumerations.

    The methods of registries stand under the first one.
    """
    places: dict[int, str] = {}
    described_types: set[type] = set()
    lines = []
    for module in OFFERING:
        lines += ["", module]
        for name in sorted(offered(module)):
            value = getattr(importlib.import_module(module), name)
            known = places.setdefault(id(value), f"{module}.{name}")
            if known != f"{module}.{name}":
                lines.append(f"  {name} = {known}")
            elif not inspect.ismodule(value):
                lines += [wrapped(f"  {line}") for line in described(name, value)]
                kind = type(value)
                if kind.__module__.startswith("roadscope.") and kind not in described_types:
                    described_types.add(kind)
                    lines += [wrapped(f"  {line}") for line in methods_of(kind)]
    return "\n".join(lines).lstrip() + "\n"


def wrapped(line: str) -> str:
    unquoted = re.sub(r"(: |-> )'([^']*)'", r"\1\2", line)
    return textwrap.fill(unquoted, 100, subsequent_indent=" " * 8, break_on_hyphens=False)


def described(name: str, value: Any) -> Iterator[str]:
    if inspect.isclass(value) and issubclass(value, Enum):
        yield f"enum {name}: {', '.join(member.name for member in value)}"
    elif inspect.isclass(value):
        plain = issubclass(value, Exception) or getattr(value, "_is_protocol", False)
        yield f"class {name}{'' if plain else inspect.signature(value)}"
        yield from methods_of(value)
    elif callable(value) and hasattr(value, "__name__"):
        yield f"{name}{inspect.signature(value)}"
    else:
        yield f"{name}: {type(value).__name__}"


def methods_of(kind: type) -> Iterator[str]:
    """Describe the methods of a class, with those of bases that are not offered themselves."""
    bases = [base for base in kind.__mro__[1:] if base.__module__.startswith("roadscope.")]
    members = {
        name: member
        for each in [*(base for base in reversed(bases) if base not in offered_types()), kind]
        for name, member in vars(each).items()
    }
    for name, member in sorted(members.items()):
        if not name.startswith("_"):
            yield from (f"  .{line}" for line in of_class(name, member))


def of_class(name: str, member: Any) -> Iterator[str]:
    if isinstance(member, staticmethod | classmethod):
        yield f"{name}{inspect.signature(member.__func__)}"
    elif inspect.isfunction(member):
        yield f"{name}{inspect.signature(member)}"
    elif isinstance(member, property):
        yield name


def test_names_and_signatures_are_the_recorded_ones() -> None:
    now, before = recorded().splitlines(), NAMES.read_text("utf-8").splitlines()
    lost = [line.strip() for line in before if line not in now]
    new = [line.strip() for line in now if line not in before]
    assert now == before, (
        f"no longer there: {lost}; new: {new}. If that is wanted: python tests/test_public_face.py"
    )


def test_a_moderate_number_of_names_stands_at_the_top() -> None:
    modules = {module.removeprefix("roadscope.") for module in OFFERING[1:]}
    assert 25 <= len(set(roadscope.__all__) - modules) <= 39


@pytest.mark.parametrize("module", OFFERING)
def test_every_name_has_a_docstring(module: str) -> None:
    assert importlib.import_module(module).__doc__
    for name in offered(module):
        value = getattr(importlib.import_module(module), name)
        if inspect.isclass(value) or inspect.isroutine(value) or inspect.ismodule(value):
            doc = vars(value).get("__doc__") if inspect.isclass(value) else value.__doc__
            # A dataclass without a docstring gets its signature as one.
            assert doc, f"{module}.{name}"
            assert not doc.startswith(f"{name}("), f"{module}.{name}"


@pytest.mark.parametrize("module", LAZY)
def test_type_checkers_and_the_table_say_the_same(module: str) -> None:
    loaded = importlib.import_module(module)
    table = loaded._PLACES
    assert set(table) <= set(loaded.__all__)
    (block,) = [
        node
        for node in ast.parse(Path(str(loaded.__file__)).read_text("utf-8")).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    ]
    typed = {}
    for node in block.body:
        assert isinstance(node, ast.ImportFrom)
        for alias in node.names:
            joint = "." if node.module == "roadscope" else ":"
            typed[alias.asname or alias.name] = f"{node.module}{joint}{alias.name}"
    assert typed == table


@pytest.mark.parametrize("module", LAZY)
def test_names_are_listed_and_others_refused(module: str) -> None:
    loaded = importlib.import_module(module)
    assert set(loaded.__all__) <= set(dir(loaded))
    with pytest.raises(AttributeError, match=f"{module}.*no_such_name"):
        _ = loaded.no_such_name


def private_imports(source: str) -> list[str]:
    """Return what a text imports or takes from the package that is not public."""
    private_names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            named = [alias.name for alias in node.names]
            private_names += [
                n for n in named if n.split(".")[0] == "roadscope" and n not in OFFERING
            ]
        elif isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "roadscope":
            public = node.module in OFFERING
            names = importlib.import_module(str(node.module)).__all__ if public else []
            private_names += [f"{node.module}:{a.name}" for a in node.names if a.name not in names]
        elif isinstance(node, ast.Attribute):
            module, name = ast.unparse(node.value), node.attr
            if module in OFFERING and not name.startswith("__"):
                public = name in importlib.import_module(module).__all__
                private_names += [] if public else [f"{module}.{name}"]
    return private_names


def texts() -> Iterator[tuple[str, str]]:
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        blocks = re.findall(
            r"^```(?:python|\{code-cell\}).*?\n(.*?)^```", path.read_text("utf-8"), re.S | re.M
        )
        for block in blocks:
            lines = [line for line in block.splitlines() if not line.startswith(("%", "!"))]
            yield f"{path.name} {next(filter(None, lines), '')}", "\n".join(lines)
    for path in sorted((ROOT / "examples").glob("*.py")):
        yield path.name, path.read_text("utf-8")


@pytest.mark.parametrize("text", [pytest.param(text, id=name) for name, text in texts()])
def test_users_are_shown_public_names_only(text: str) -> None:
    assert private_imports(text) == []


def test_private_imports_are_noticed() -> None:
    assert private_imports("from roadscope.trackers.assignment import assign_greedily") == [
        "roadscope.trackers.assignment:assign_greedily"
    ]
    assert private_imports("from roadscope.trackers import kalman") == ["roadscope.trackers:kalman"]
    assert private_imports("import roadscope.core.pose, numpy") == ["roadscope.core.pose"]
    assert private_imports("from roadscope import Pose, metrics\nimport roadscope.metrics") == []
    taken = "import roadscope\nroadscope.trackers.kalman(roadscope.Pose.identity())\n"
    assert private_imports(taken) == ["roadscope.trackers.kalman"]


if __name__ == "__main__":
    NAMES.write_text(recorded(), "utf-8")


# What tests import, so that files of a folder can be merged or split without touching tests.

PUBLIC_FILES = {"roadscope.__main__", "roadscope.metrics", "roadscope.formats"}
"""Files that are public themselves."""


def imported_modules(source: str) -> Iterator[str]:
    """Yield what a text imports from the package, and what it replaces by its place in a string."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (str(node.module), *(f"{node.module}.{a.name}" for a in node.names))
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(".setattr"):
            places = [a.value for a in node.args[:1] if isinstance(a, ast.Constant)]
            for parts in (str(place).split(".") for place in places):
                yield from (".".join(parts[:count]) for count in range(2, len(parts)))


def is_file(module: str) -> bool:
    return module.startswith("roadscope.") and (ROOT / f"{module.replace('.', '/')}.py").exists()


def test_tests_import_folders_not_files() -> None:
    imported = {
        module
        for path in Path(__file__).parent.rglob("*.py")
        for module in imported_modules(path.read_text("utf-8"))
        if is_file(module)
    }
    assert imported == PUBLIC_FILES


def test_every_access_to_a_file_is_noticed() -> None:
    for source in (
        "import roadscope.core.jit",
        "from roadscope.core.jit import compiled",
        "from roadscope.core import Pose, jit",
        "monkeypatch.setattr('roadscope.core.jit.compiled', None)",
    ):
        assert list(filter(is_file, imported_modules(source))) == ["roadscope.core.jit"]
    assert not any(map(is_file, imported_modules("from roadscope.core import Pose\nimport numpy")))
