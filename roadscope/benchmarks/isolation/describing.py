"""What runs in a plug-in's process: reading traits, describing errors, watching arguments."""

from __future__ import annotations

import ast
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from inspect import getattr_static
from pathlib import Path
from typing import Any

from roadscope.benchmarks.isolation.limits import Traits
from roadscope.core.constructing import binding_problem, parameters_of, positional_parameters_of
from roadscope.core.loading import PARSE_ERRORS, Requirement, file_of
from roadscope.core.text import error_text, one_line
from roadscope.core.wire import WireError, encode

HARNESS = Path(__file__).resolve().parent
"""The folder whose lines errors never name: they only call plug-ins."""
PACKAGE = Path(__file__).resolve().parents[2]
SLOW_LIBRARIES = frozenset({"filterpy", "numba", "scipy", "sklearn", "torch"})
"""Libraries that take long to import, and start no threads: they may be imported before a fork."""
PRELOADED_PACKAGES = frozenset({"core", "detectors", "fusion", "odometry", "trackers"})
"""Packages of roadscope that plug-ins use: their modules may be imported before a fork too."""
MISTAKE = "mistake"
"""Key of a message: the plug-in that the user named does not exist or cannot be imported."""


def traits_of_class(
    plugin_class: type[Any], arguments: Mapping[str, Any], plugin: object = None
) -> Traits:
    """Return the traits of a class, which may differ in its instance `plugin`.

    arguments: of the constructor, which are checked against its parameters.
    """
    described = plugin_class if plugin is None else plugin
    methods = _public_methods(described)
    declared = getattr(plugin_class, "kind", "")
    requirement = getattr(plugin_class, "requires", None)
    module = sys.modules.get(str(getattr(plugin_class, "__module__", "")))
    file = getattr(module, "__file__", None)
    return Traits(
        file=Path(file).resolve() if isinstance(file, str) else None,
        methods=methods,
        kind=one_line(declared, 80) if isinstance(declared, str) else "",
        offline=bool(getattr(plugin_class, "offline", False)),
        weighed=bool(getattr(plugin_class, "weighed", False)),
        takes_imu=getattr(described, "takes_imu", True) is not False,
        takes_wheels="add_wheels" in methods and getattr(described, "wheels", True) is not False,
        requires=(requirement.missing or "") if isinstance(requirement, Requirement) else "",
        parameters=parameters_of(plugin_class),
        positional=positional_parameters_of(plugin_class),
        problem=binding_problem(plugin_class, arguments),
    )


def _public_methods(plugin: object) -> frozenset[str]:
    """Return the names of the public methods of an object or class; no property is computed."""
    named = {
        name: getattr_static(plugin, name, None) for name in dir(plugin) if not name.startswith("_")
    }
    return frozenset(
        name for name, each in named.items() if callable(each) or isinstance(each, classmethod)
    )


def traits_of_source(target: str, failure: str) -> Traits:
    """Return the traits of a class that cannot be loaded, from its source.

    Only the body of the class is read: its methods and a text `kind`, with or without its type.
    """
    place, _, name = target.rpartition(":")
    file = file_of(place)
    try:
        nodes = list(ast.walk(ast.parse(file.read_bytes()))) if file is not None else []
    except PARSE_ERRORS:
        nodes = []
    bodies = [node.body for node in nodes if isinstance(node, ast.ClassDef) and node.name == name]
    body = bodies[0] if bodies else []
    kinds = [
        node.value.value
        for node in body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        and isinstance(node.value, ast.Constant)
        and ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target) == "kind"
    ]
    return Traits(
        file=file,
        methods=frozenset(n.name for n in body if isinstance(n, ast.FunctionDef)),
        kind=one_line(str(kinds[-1]), 80) if kinds else "",
        failure=failure,
    )


def may_preload(module: str) -> bool:
    """Return whether a supervisor may import a module for all later plug-ins."""
    package, _, rest = module.partition(".")
    if package == PACKAGE.name:
        return rest.partition(".")[0] in PRELOADED_PACKAGES
    return package in SLOW_LIBRARIES and "." not in rest and not rest.startswith("_")


def describe(error: BaseException) -> str:
    """Return an error as one line, with the line of the plug-in's own file, or else of ours.

    The plug-in's file is the first file on the stack that is not part of roadscope.
    """
    try:
        frames = [
            (frame.f_code.co_filename, line)
            for frame, line in traceback.walk_tb(error.__traceback__)
            if not Path(frame.f_code.co_filename).is_relative_to(HARNESS)
        ]
        foreign = [name for name, _ in frames if not Path(name).is_relative_to(PACKAGE)]
        lines = [(name, line) for name, line in frames if not foreign or name == foreign[0]]
        place = f" ({Path(lines[-1][0]).name}:{lines[-1][1]})" if lines else ""
    except Exception:
        place = ""
    return error_text(error) + place


class ChangedArgumentError(RuntimeError):
    """A method changed an argument of its call; the message says which."""


def call_watched(function: Callable[..., Any], arguments: Sequence[Any]) -> Any:
    """Call a function and return its answer; `ChangedArgumentError` if it changed an argument.

    It must run in the process of the function, as other processes get copies of the arguments.
    """
    before = [encode(argument) for argument in arguments]
    answer = function(*arguments)
    for number, (argument, expected) in enumerate(zip(arguments, before, strict=True), start=1):
        try:
            changed = encode(argument) != expected
        except WireError:
            changed = True
        if changed:
            name = getattr(function, "__name__", "the call")
            raise ChangedArgumentError(f"{name} changed its argument {number}; copy it first")
    return answer
