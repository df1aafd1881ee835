"""Reads TOML into config records; all problems of a file are reported at once."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

import msgspec

from roadscope.core.names import unknown

T = TypeVar("T", bound=msgspec.Struct)
PLACE = re.compile(r" - at `\$(.*)`$")
"""The end of an error message of msgspec, which says where in the TOML the wrong value is."""


class ConfigError(ValueError):
    """A file of settings cannot be read; `problems` has one text for each problem."""

    def __init__(self, problems: Iterable[str]) -> None:
        """Take one text for each problem."""
        self.problems = tuple(problems)
        several = [f"{len(self.problems)} problems:"] if len(self.problems) > 1 else []
        super().__init__("\n- ".join([*several, *self.problems]))

    def __reduce__(self) -> tuple[type[ConfigError], tuple[tuple[str, ...]]]:
        # The text alone, which exceptions are made from, would be taken for the problems.
        return type(self), (self.problems,)


def read_config(content: str, record_type: type[T]) -> T:
    """Return the record of TOML text; unknown, missing and wrong keys raise `ConfigError`."""
    try:
        table = tomllib.loads(content)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError([f"not TOML: {error}"]) from error
    problems = list(_problems(table, record_type, ""))
    if problems:
        raise ConfigError(problems)
    return msgspec.convert(table, record_type)


def _problems(
    table: Mapping[str, Any], record_type: type[msgspec.Struct], prefix: str
) -> Iterator[str]:
    """Yield the problems of a table and of the tables inside it.

    prefix: stands before its keys in messages, such as `camera.` for the table `camera`.
    """
    fields = {field.encode_name: field for field in msgspec.structs.fields(record_type)}
    known = [prefix + name for name in fields]
    for key in table:
        if key not in fields:
            yield unknown("key", prefix + key, known)
    missing = [
        f"'{prefix}{name}'" for name, f in fields.items() if f.required and name not in table
    ]
    if missing:
        keys, are = ("key", "is") if len(missing) == 1 else ("keys", "are")
        yield f"{keys} {', '.join(missing)} {are} missing"
    for name, field in fields.items():
        if name not in table:
            continue
        value = table[name]
        if _is_table(field.type) and isinstance(value, Mapping):
            inside = list(_problems(value, field.type, f"{prefix}{name}."))
            # A record may check its fields together, once each of them is right.
            yield from inside or _value_problem(value, field.type, prefix + name)
        else:
            yield from _value_problem(value, field.type, prefix + name)


def _is_table(field_type: Any) -> bool:
    return isinstance(field_type, type) and issubclass(field_type, msgspec.Struct)


def _value_problem(value: Any, field_type: Any, key: str) -> Iterator[str]:
    """Yield why a value is not of its field's type, if it is not."""
    try:
        msgspec.convert(value, field_type)
    except msgspec.ValidationError as error:
        reason, place = str(error), PLACE.search(str(error))
        where = key + (place.group(1) if place else "")
        reason = PLACE.sub("", reason)
        yield f"{where}: {reason[0].lower()}{reason[1:]} (given: {value!r})"
