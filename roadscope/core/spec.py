"""A plug-in named by one string, parsed once.

A spec is a registered name (`nearest`), a class of a module (`package.module:Class`) or of a file
(`path/to/file.py:Class`), with arguments if there are any: `nearest?gate_m=2.5&coast_frames=20`.
Values are read as Python literals and otherwise taken as text. Arguments are those of the
constructor, or the fields of the settings that it takes (see `roadscope.core.constructing`).

Some specs are composed of others, their parts:

- `TRACKER?ego=ODOMETRY`: a tracker that gets the ego's poses from an odometry. `ego=` comes last,
  everything behind it belongs to the odometry.
- `oracle?odometry=ODOMETRY`: an odometry that gets scans without the returns of moving objects.
  Everything behind `odometry=` belongs to the odometry.
- `fused?lidar=DETECTOR&camera=DETECTOR&fusion=FUSION`: the fused detections of two detectors.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from roadscope.core.constructing import binding_problem, construct, wrong_literal
from roadscope.core.loading import (
    PARSE_ERRORS,
    NotInstalledError,
    Requirement,
    SpecError,
    load_class,
)
from roadscope.core.names import unknown

ORACLE, FUSED = "oracle", "fused"
TRUE_POSES, NO_POSES = "truth", "none"
"""The values of `ego=` that name no odometry; without `ego=`, trackers get the true poses."""
EGO, ODOMETRY = "ego", "odometry"
FUSED_PARTS = ("lidar", "camera", "fusion")
_EGO_PART = re.compile(rf"[?&]{EGO}=")


@dataclass(frozen=True, eq=False)
class Spec:
    """A plug-in named by a string.

    text: the string, as the user wrote it.
    name: the part before `?`.
    arguments: of its constructor, by name.
    parts: the specs that it is composed of, by key: `ego`, `odometry`, `lidar`, `camera`, `fusion`.
    kind: that of its registry, such as `tracker`; empty until a registry resolved the spec.
    target: `module:Class` or `path/file.py:Class`; empty until a registry resolved the spec.

    Specs are equal when text and kind are. Their mappings are read-only copies. They hold strings
    and literals only, so they can be sent to other processes.
    """

    text: str
    name: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    parts: Mapping[str, Spec] = field(default_factory=dict)
    kind: str = ""
    target: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "arguments", MappingProxyType(dict(self.arguments)))
        object.__setattr__(self, "parts", MappingProxyType(dict(self.parts)))

    def __reduce__(self) -> tuple[type[Spec], tuple[Any, ...]]:
        # Read-only mappings cannot be pickled.
        mappings = dict(self.arguments), dict(self.parts)
        return Spec, (self.text, self.name, *mappings, self.kind, self.target)

    @staticmethod
    @lru_cache(maxsize=4096)
    def parse(text: str) -> Spec:
        """Read a spec; `SpecError` says what is wrong with it. Nothing is loaded.

        Specs do not change, so each text is parsed once.
        """
        before_ego, *ego = _EGO_PART.split(text, maxsplit=1)
        parts = {EGO: Spec.parse(ego[0])} if ego else {}
        name, _, query = before_ego.partition("?")
        if not name:
            raise SpecError(f"'{text}' names nothing")
        if name == ORACLE and query.startswith(f"{ODOMETRY}="):
            inner = Spec.parse(text.partition(f"{ODOMETRY}=")[2])
            return Spec(text, name, {}, {ODOMETRY: inner})
        arguments: dict[str, Any] = {}
        for item in filter(None, query.split("&")):
            key, equals, value = item.partition("=")
            if not equals or not key.isidentifier():
                raise SpecError(
                    f"'{text}': arguments look like name?key=value&key=value, got '{item}'"
                )
            if key in arguments or key in parts:
                raise SpecError(f"'{text}': the argument '{key}' is given twice")
            if name == FUSED and key in FUSED_PARTS:
                parts[key] = Spec.parse(value)
            else:
                arguments[key] = _literal(value)
        return Spec(text, name, arguments, parts)

    def __str__(self) -> str:
        return self.text

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Spec):
            return NotImplemented
        return (self.text, self.kind) == (other.text, other.kind)

    def __hash__(self) -> int:
        return hash((self.text, self.kind))

    @property
    def ego(self) -> Spec | None:
        """Where a tracker gets the ego's poses from; None if the spec does not say."""
        return self.parts.get(EGO)

    @property
    def plain(self) -> Spec:
        """The spec without `ego=`: the plug-in alone."""
        if self.ego is None:
            return self
        parts = {key: part for key, part in self.parts.items() if key != EGO}
        return replace(self, text=_EGO_PART.split(self.text, maxsplit=1)[0], parts=parts)

    def with_ego(self, ego: str) -> Spec:
        """Return the spec with the ego's poses from `truth`, `none` or an odometry."""
        text = self.plain.text
        return replace(
            Spec.parse(f"{text}{'&' if '?' in text else '?'}{EGO}={ego}"),
            arguments=self.arguments,
            kind=self.kind,
            target=self.target,
        )

    @property
    def is_class(self) -> bool:
        """Whether the name is that of a class in a module or file, not a registered name."""
        return ":" in self.name

    @property
    def ours(self) -> bool:
        """Whether the plug-in is part of roadscope. A file never is, whatever its name."""
        place = self.target.partition(":")[0]
        return place.startswith("roadscope.") and not place.endswith(".py")

    @property
    def factory(self) -> Any:
        """The class, imported into this process; only a resolved spec names one."""
        if not self.target:
            raise SpecError(
                f"'{self.text}' is not resolved: a registry, or `check`, finds its class"
            )
        return load_class(self.target)

    @property
    def requirement(self) -> Requirement | None:
        """What a plug-in of roadscope needs and roadscope does not install, if anything."""
        required = getattr(self.factory, "requires", None) if self.ours else None
        return required if isinstance(required, Requirement) else None

    @property
    def missing(self) -> str | None:
        """Why a plug-in of roadscope cannot be made here, or None if it can."""
        return self.requirement.missing if self.requirement else None

    @property
    def isolated(self) -> bool:
        """Whether it runs in a process of its own: plug-ins of others, and our wrappers of them."""
        return not self.ours or self.requirement is not None

    def make(self) -> Any:
        """Construct the plug-in in this process.

        Raises `SpecError` for arguments that do not fit the constructor's parameters, `ValueError`
        for values of a wrong type, and `NotInstalledError` if a library is missing.
        """
        factory = self.factory
        if problem := binding_problem(factory, self.arguments):
            raise SpecError(f"'{self.text}': {problem}")
        if self.ours and (wrong := wrong_literal(factory, self.arguments)):
            raise ValueError(wrong)
        required = getattr(factory, "requires", None)
        if isinstance(required, Requirement) and required.missing:
            raise NotInstalledError(required.missing)
        return construct(factory, self.arguments)


def _literal(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except PARSE_ERRORS:
        return {"true": True, "false": False, "none": None}.get(text.lower(), text)


def no_class_named(spec: Spec) -> str:
    """Return the error text for a spec that names a file and no class in it."""
    try:
        nodes = ast.parse(Path(spec.name).read_text("utf-8")).body
    except (OSError, *PARSE_ERRORS):
        nodes = []
    classes = [node.name for node in nodes if isinstance(node, ast.ClassDef)] or ["Class"]
    choices = " or ".join(f"{spec.name}:{name}" for name in classes)
    return f"'{spec}': name the class in the file too: {choices}"


def unknown_name(kind: str, name: str, possible: list[str], composition: str = "") -> str:
    """Return the error text for a name that no plug-in of a kind has, with what is possible.

    composition: how a plug-in can be composed of parts; empty if it cannot.
    """
    more = f"or put one together: {composition}; " if composition else ""
    return (
        f"{unknown(kind, name, possible)}; {more}"
        "or name your own: package.module:Class, path/to/file.py:Class"
    )
