"""Calls constructors of plug-ins with a spec's arguments, and says which parameters they have.

A constructor takes keyword arguments, or one record of settings: a frozen dataclass with defaults,
as its only parameter `settings`. A spec's arguments are then fields of that record, or of a record
inside it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from types import NoneType
from typing import Any, TypeVar, get_args, get_type_hints

R = TypeVar("R")
SETTINGS = "settings"
"""The parameter that takes a record of settings."""
LITERAL_TYPES: Mapping[Any, str] = {bool: "True or False", int: "a whole number", float: "a number"}
"""Types of arguments that are checked, in words."""


def construct(factory: Callable[..., R], arguments: Mapping[str, Any]) -> R:
    """Return what a constructor makes of a spec's arguments."""
    default = _default_settings(factory)
    if default is None:
        return factory(**arguments)
    return factory(with_values(default, arguments))


def with_values(record: R, values: Mapping[str, Any]) -> R:
    """Return a record of settings with other values of its fields and of records inside it.

    Raises `TypeError` for a name that no record has.
    """
    known = {parameter.name for parameter in _fields_of(record)}
    if strange := [name for name in values if name not in known]:
        raise TypeError(f"got an unexpected keyword argument {strange[0]!r}")
    changed: dict[str, Any] = {}
    for field in fields(record):  # type: ignore[arg-type]
        value = getattr(record, field.name)
        if is_dataclass(value):
            inside = {p.name for p in _fields_of(value)}
            changed[field.name] = with_values(
                value, {name: each for name, each in values.items() if name in inside}
            )
        elif field.name in values:
            changed[field.name] = values[field.name]
    return replace(record, **changed)  # type: ignore[type-var]


def signature_of(factory: Callable[..., Any], *, eval_str: bool = False) -> inspect.Signature:
    """Return the parameters of a constructor, or the fields of its settings as parameters.

    eval_str: whether annotations are types instead of texts. `TypeError` or `ValueError` says
    that a constructor cannot be inspected.
    """
    default = _default_settings(factory)
    if default is None:
        return inspect.signature(factory, eval_str=eval_str)
    return inspect.Signature(list(_fields_of(default, eval_str)))


def _default_settings(factory: Callable[..., Any]) -> Any:
    """Return the settings that a constructor takes unless others are given, None if it has none."""
    try:
        parameters = inspect.signature(factory).parameters
    except (TypeError, ValueError):
        return None
    if list(parameters) != [SETTINGS]:
        return None
    default = parameters[SETTINGS].default
    return default if is_dataclass(default) and not isinstance(default, type) else None


def _fields_of(record: Any, eval_str: bool = False) -> Iterator[inspect.Parameter]:
    """Yield the fields of a record and of the records inside it as keyword parameters."""
    types = get_type_hints(type(record)) if eval_str else {}
    for field in fields(record):
        name, value = field.name, getattr(record, field.name)
        if is_dataclass(value):
            yield from _fields_of(value, eval_str)
        else:
            kind = inspect.Parameter.KEYWORD_ONLY
            annotation = types.get(name, field.type)
            yield inspect.Parameter(name, kind, default=value, annotation=annotation)


def parameters_of(factory: type[Any]) -> dict[str, str]:
    """Return the names of a constructor's parameters with their defaults as text.

    A parameter without a default has an empty text. The result is empty for a class whose
    parameters cannot be inspected.
    """
    try:
        parameters = signature_of(factory).parameters.values()
    except (TypeError, ValueError):
        return {}
    return {p.name: "" if p.default is p.empty else str(p.default) for p in parameters}


def positional_parameters_of(factory: type[Any]) -> tuple[str, ...]:
    """Return the names of a constructor's parameters that can be given by position."""
    try:
        parameters = signature_of(factory).parameters.values()
    except (TypeError, ValueError):
        return ()
    possible = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return tuple(p.name for p in parameters if p.kind in possible)


def binding_problem(factory: type[Any], arguments: Mapping[str, Any]) -> str:
    """Return why a constructor does not take the arguments; empty if it does."""
    try:
        signature = signature_of(factory)
    except (TypeError, ValueError):
        return ""
    try:
        signature.bind(**arguments)
    except TypeError as error:
        possible = [
            f"{name}={default}" if default else name
            for name, default in parameters_of(factory).items()
        ]
        return f"{error}; its arguments: {', '.join(possible) or 'none'}"
    return ""


def wrong_literal(factory: Callable[..., Any], arguments: Mapping[str, Any]) -> str:
    """Return an error text for the first argument whose type is wrong; empty if there is none.

    Only annotations of bool, int, float and None, alone or in a union, are compared.
    """
    parameters = signature_of(factory, eval_str=True).parameters
    for name, value in arguments.items():
        if name not in parameters or value is None:
            continue
        annotation = parameters[name].annotation
        types = set(get_args(annotation) or (annotation,)) - {NoneType}
        if not types or not types <= LITERAL_TYPES.keys():
            continue
        # An int is taken for a float; True is not taken for an int.
        accepted = types | ({int} if float in types else set())
        if type(value) not in accepted:
            expected = " or ".join(words for each, words in LITERAL_TYPES.items() if each in types)
            return f"{name} must be {expected}, got {value!r}"
    return ""
