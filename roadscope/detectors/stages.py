"""Stages by name, and the options that each takes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, get_args, get_origin

import numpy as np

from roadscope.core.names import unknown
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.detectors.ground import GROUNDS
from roadscope.detectors.shape import SHAPES

Option = float | int | str
Stage = Callable[..., Any]
STAGES: Mapping[str, Mapping[str, Stage]] = {
    "ground": GROUNDS,
    "clustering": CLUSTERINGS,
    "shape": SHAPES,
}


def options_of(stage: Stage) -> dict[str, inspect.Parameter]:
    """Return those keyword arguments of a stage that are numbers or names, in order."""
    parameters = inspect.signature(stage, eval_str=True).parameters.values()
    return {
        p.name: p
        for p in parameters
        if p.kind is p.KEYWORD_ONLY and isinstance(p.default, float | int | str)
    }


def chosen_stages(
    names: Mapping[str, str], options: Mapping[str, Option | None], hint: str = ""
) -> dict[str, Stage]:
    """Return the chosen stage of each part (ground, clustering, shape), with its options set.

    names: part -> name. options: name -> value, None for the default. An option goes to every
    chosen stage that has it; one that none has is refused. hint: what else can be set, for the
    error message.
    """
    stages = {part: _named(part, name) for part, name in names.items()}
    values = {key: value for key, value in options.items() if value is not None}
    for key in values:
        if not any(key in options_of(stage) for stage in stages.values()):
            raise ValueError(_unknown_option(key, names) + hint)
    return {part: _with_options(stage, values) for part, stage in stages.items()}


def _named(part: str, name: str) -> Stage:
    known = STAGES[part]
    if name not in known:
        raise ValueError(unknown(f"{part} stage", name, known))
    return known[name]


def _with_options(stage: Stage, values: Mapping[str, Option]) -> Stage:
    known = options_of(stage)
    return partial(stage, **{k: _checked(known[k], v) for k, v in values.items() if k in known})


def _unknown_option(key: str, names: Mapping[str, str]) -> str:
    owners = [
        f"{part} '{name}'"
        for part, known in STAGES.items()
        for name, stage in known.items()
        if key in options_of(stage)
    ]
    taken = "; ".join(
        f"{part} '{name}' takes {listed(options_of(STAGES[part][name]))}"
        for part, name in names.items()
    )
    if owners:
        return f"option '{key}' belongs to {', '.join(owners)}, not chosen; {taken}"
    return f"no stage has an option '{key}'; {taken}"


def listed(options: Mapping[str, inspect.Parameter]) -> str:
    """Return options with their defaults in one line."""
    return ", ".join(f"{key}={p.default}" for key, p in options.items()) or "none"


def _checked(parameter: inspect.Parameter, value: Option) -> Option:
    """Return an option's value; raise `ValueError` where it is not a possible one."""
    name = parameter.name
    if get_origin(parameter.annotation) is Literal:
        known = get_args(parameter.annotation)
        if value not in known:
            raise ValueError(f"no {name} {value!r}; known: {', '.join(known)}")
        return value
    if isinstance(parameter.default, bool):
        if not isinstance(value, bool):
            raise ValueError(f"{name} must be True or False, got {value!r}")
        return value
    whole = isinstance(parameter.default, int)
    accepted = int if whole else (int, float)
    if isinstance(value, bool) or not isinstance(value, accepted) or not 0 < value < np.inf:
        what = "whole number" if whole else _quantity(name)
        raise ValueError(f"{name} must be a positive {what}, got {value!r}")
    return value


def _quantity(name: str) -> str:
    if name.endswith("_m"):
        return "length in metres"
    return "angle in degrees" if name.endswith("_deg") else "number"
