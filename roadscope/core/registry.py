"""The registered names of one kind of plug-in; other packages add names by entry points."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from importlib.metadata import entry_points
from typing import Generic, TypeVar, cast

from roadscope.core.loading import SpecError
from roadscope.core.spec import Spec, no_class_named, unknown_name

T = TypeVar("T")


class Registry(Generic[T]):
    """Names of one kind of plug-in."""

    def __init__(
        self,
        kind: str,
        entries: Mapping[str, str],
        *,
        group: str | None = None,
        summaries: Mapping[str, str] | None = None,
        composition: str = "",
    ) -> None:
        """Take the kind of plug-in, such as `tracker`, and for each name the spec of its class.

        group: the entry point group by which other packages add names.
        summaries: one line on each name, for lists.
        composition: for error messages, how a plug-in can be composed of parts.
        """
        self.kind, self._composition = kind, composition
        self.summaries = dict(summaries or {})
        self._entries = dict(entries)
        self._group = group

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def names(self) -> list[str]:
        """Return all registered names, our own first, then those of installed packages."""
        return list(self._entries) + sorted(set(self._external()) - set(self._entries))

    def installed(self) -> list[str]:
        """Return those of `names` whose requirements are installed."""
        return [name for name in self.names() if not self.missing(name)]

    def missing(self, spec: str | Spec) -> str | None:
        """Return what is not installed that the spec needs, or None if it can be made."""
        return self.resolve(spec).missing

    def resolve(self, spec: str | Spec, *, also_possible: Iterable[str] = ()) -> Spec:
        """Return the spec with its kind, its class and all arguments; nothing is imported.

        also_possible: names that are not registered but allowed there, for the error text.
        """
        parsed = Spec.parse(spec) if isinstance(spec, str) else spec
        if parsed.target and parsed.kind == self.kind:
            return parsed
        if parsed.is_class:
            return replace(parsed, kind=self.kind, target=parsed.name)
        if parsed.name.endswith(".py"):
            raise SpecError(no_class_named(parsed))
        registered = Spec.parse(self.target(parsed.name, also_possible=also_possible))
        return replace(
            parsed,
            arguments={**registered.arguments, **parsed.arguments},
            kind=self.kind,
            target=registered.name,
        )

    def make(self, spec: str | Spec) -> T:
        """Construct the plug-in that the spec names, in this process."""
        return cast("T", self.resolve(spec).make())

    def target(self, name: str, *, also_possible: Iterable[str] = ()) -> str:
        """Return the spec behind a registered name; `SpecError` if there is none.

        also_possible: as in `resolve`.
        """
        registered = self._entries.get(name) or self._external().get(name)
        if registered is None:
            names = [*self.names(), *also_possible]
            raise SpecError(unknown_name(self.kind, name, names, self._composition))
        return registered

    def _external(self) -> Mapping[str, str]:
        return _entry_points(self._group) if self._group else {}


@cache
def _entry_points(group: str) -> Mapping[str, str]:
    return {point.name: point.value for point in entry_points(group=group)}
