"""Driver constants that some environments overwrite for the whole process, kept apart."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from roadscope.envs.traffic.conversion import DRIVER_CONSTANTS, restore_driver_constants

Constants = dict[type, dict[str, float]]


@contextmanager
def original_constants(kept: Constants) -> Iterator[None]:
    """Run with highway-env's own constants, keep what became of them, put back what was there."""
    before = _read()
    restore_driver_constants()
    with _putting_back(before):
        yield
        kept.clear()
        kept.update(_read())


@contextmanager
def own_constants(kept: Constants) -> Iterator[None]:
    """Run with the constants that an environment's reset has left, put back what was there.

    So an environment drives the same whatever other environments of the process do.
    """
    before = _read()
    _write(kept)
    with _putting_back(before):
        yield


@contextmanager
def _putting_back(before: Constants) -> Iterator[None]:
    try:
        yield
    finally:
        _write(before)


def _read() -> Constants:
    from highway_env.vehicle.behavior import IDMVehicle

    return {
        kind: {name: vars(kind)[name] for name in DRIVER_CONSTANTS if name in vars(kind)}
        for kind in _heirs(IDMVehicle)
    }


def _write(constants: Constants) -> None:
    for kind, values in constants.items():
        for name in DRIVER_CONSTANTS:
            if name in values:
                setattr(kind, name, values[name])
            elif name in vars(kind):
                delattr(kind, name)


def _heirs(kind: type[object]) -> Iterator[type]:
    yield kind
    heirs: list[type[object]] = kind.__subclasses__()
    for heir in heirs:
        yield from _heirs(heir)
