"""The kinds of plug-in: their registries and methods, and which kind an entry is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from roadscope.benchmarks.isolation import Traits, probe
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.noisy_odometry import ODOMETRY_NOISES
from roadscope.core import Registry, Spec, SpecError
from roadscope.core.names import unknown
from roadscope.core.spec import ORACLE, no_class_named
from roadscope.detectors import DETECTORS
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.driving import DRIVERS
from roadscope.fusion import FUSIONS
from roadscope.odometry import ODOMETRIES
from roadscope.trackers import TRACKERS


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of plug-in.

    name: what its class may declare as `kind`.
    registry: its registered names.
    method: that the harness calls at every moment, beside `reset`.
    warm_calls: calls of a throw-away instance before a plug-in of roadscope is timed, so that no
        timed call compiles anything.
    """

    name: str
    registry: Registry[Any]
    method: str
    warm_calls: int = 0

    @property
    def plural(self) -> str:
        """Its name for several plug-ins."""
        return f"{self.name[:-1]}ies" if self.name.endswith("y") else f"{self.name}s"

    def __str__(self) -> str:
        return f"{'an' if self.name[0] in 'aeiou' else 'a'} {self.name}"


DETECTOR = Kind("detector", DETECTORS, "detect", warm_calls=6)
CAMERA_DETECTOR = Kind("camera detector", CAMERA_DETECTORS, "detect", warm_calls=1)
TRACKER = Kind("tracker", TRACKERS, "update")
FUSION = Kind("fusion", FUSIONS, "fuse")
ODOMETRY = Kind("odometry", ODOMETRIES, "update", warm_calls=4)
DRIVER = Kind("driver", DRIVERS, "drive")
KINDS: Mapping[str, Kind] = {
    kind.name: kind for kind in (DETECTOR, CAMERA_DETECTOR, TRACKER, FUSION, ODOMETRY, DRIVER)
}
"""The kinds by name; a board may bring a kind of its own, which `boards.plugin_kinds` has too."""
_IMITATIONS = ((CAMERA_DETECTOR, CAMERA_NOISES), (ODOMETRY, ODOMETRY_NOISES))
"""Noise models that are entries of a board, each with the kind of plug-in that it imitates."""


def entry_kind(spec: Spec, possible: Sequence[Kind] = tuple(KINDS.values())) -> Kind:
    """Return the kind of an entry, one of `KINDS` or of those that are possible.

    A registered name has the kind of its registry; a noise model has the kind of plug-in that it
    imitates. A class has the kind that its attribute `kind` declares, or else the only one of the
    possible kinds whose method it has.

    possible: the kinds of the boards of a run; a board may have a kind of its own.
    """
    kinds_by_name = {kind.name: kind for kind in (*KINDS.values(), *possible)}
    if spec.is_class:
        return _kind_of_class(spec, possible, kinds_by_name)
    if spec.name == ORACLE and "odometry" in spec.parts:
        return ODOMETRY
    for kind in kinds_by_name.values():
        if spec.name in kind.registry:
            return kind
    for kind, noises in _IMITATIONS:
        if spec.name in noises:
            return kind
    if spec.name.endswith(".py"):
        raise SpecError(no_class_named(spec))
    names = [name for kind in possible for name in kind.registry]
    kinds = " or ".join(kind.name for kind in possible)
    raise SpecError(
        f"{unknown(kinds, spec.name, names)}; or name your own: package.module:Class, "
        "path/to/file.py:Class"
    )


def _kind_of_class(spec: Spec, possible: Sequence[Kind], kinds_by_name: Mapping[str, Kind]) -> Kind:
    traits = traits_of(spec)
    if traits.kind:
        if traits.kind not in kinds_by_name:
            raise SpecError(f"'{spec}': {unknown('kind', traits.kind, kinds_by_name)}")
        return kinds_by_name[traits.kind]
    fitting = [kind for kind in possible if kind.method in traits.methods]
    if traits.failure and not fitting:
        fitting = list(possible)
    if len(fitting) == 1:
        return fitting[0]
    if fitting and traits.failure:
        raise SpecError(
            f"{traits.failure}; so it cannot say its kind: name the board, or begin the class with "
            f'kind = "{fitting[0].name}"'
        )
    if fitting:
        names = " or ".join(map(str, fitting))
        raise SpecError(
            f"'{spec}' has a method {fitting[0].method}(): it may be {names}. Name the board or "
            f'the kind, or let the class say it by an attribute: kind = "{fitting[0].name}"'
        )
    wanted = ", ".join(f"{kind.method}() as {kind} has" for kind in possible)
    raise SpecError(f"'{spec}' has no method {wanted}")


def traits_of(spec: Spec) -> Traits:
    """Return what the harness reads from a plug-in's class before it runs."""
    # Only classes come here unresolved, and every registry resolves them in the same way.
    resolved = spec if spec.target else DETECTORS.resolve(spec)
    return probe(resolved.plain)


def check_plugin_spec(spec: Spec, kind: Kind) -> Spec:
    """Return the resolved spec of a plug-in; raise `SpecError` if it does not fit its kind.

    A plug-in of roadscope is made once, so that wrong values are refused too. Another plug-in is
    made only when it runs; an error then fails only its own row.
    """
    if spec.ego is not None and kind is not TRACKER:
        raise SpecError(f"'{spec}': ?ego= is for trackers, not for {kind}")
    resolved = kind.registry.resolve(spec)
    traits = traits_of(resolved)
    if traits.failure:
        # The failure is shown in its own row, like that of one that fails when it is made.
        return resolved
    if kind.method not in traits.methods:
        others = [k for k in KINDS.values() if k.method in traits.methods]
        wrong = f"is {others[0]}" if others else f"has no {kind.method}()"
        raise SpecError(f"'{spec}' {wrong}, not {kind}")
    if "reset" not in traits.methods:
        raise SpecError(f"'{spec}' has no reset()")
    if traits.problem:
        raise SpecError(f"'{spec}': {traits.problem}")
    if resolved.ours and not traits.requires:
        make_once(resolved)
    return resolved


def make_once(spec: Spec) -> None:
    """Make a plug-in of roadscope and load its weights; raise `SpecError` with the spec."""
    try:
        plugin = spec.plain.make()
        if "weights" in spec.arguments and hasattr(plugin, "prepare"):
            plugin.prepare()
    except (TypeError, ValueError) as error:
        text = str(error)
        raise SpecError(text if text.startswith(f"'{spec}") else f"'{spec}': {text}") from error
