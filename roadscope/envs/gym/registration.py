"""The Gymnasium ids of this package, known as soon as both packages are imported."""

from __future__ import annotations

import sys

# Every import of the package pays for this module: importlib.abc alone would double its cost.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType
    from typing import Any

NAMESPACE = "roadscope"

IDS: dict[str, dict[str, str]] = {
    "Highway-v0": {"scenario": "motorway"},
    "HighwayDense-v0": {"scenario": "dense-motorway"},
    "Merge-v0": {"scenario": "merge"},
    "Roundabout-v0": {"scenario": "roundabout"},
    "Intersection-v0": {"scenario": "intersection"},
    "Racetrack-v0": {"scenario": "racetrack"},
    "TwoWay-v0": {"scenario": "two-way"},
    "ParkingLot-v0": {"scenario": "parking-lot"},
    "Street-v0": {"scenario": "street"},
    "TownCrossing-v0": {"scenario": "town-crossing"},
    "Lu2018TwoVehicles-v0": {"scenario": "lu2018-two-vehicles", "rig": "lux"},
    "Lu2018Occlusion-v0": {"scenario": "lu2018-occlusion", "rig": "lux"},
    "Lu2018ThreeVehicles-v0": {"scenario": "lu2018-three-vehicles", "rig": "lux"},
}
"""Name of each id below the namespace, and the arguments of its `ScenarioEnv`."""


def env_ids() -> tuple[str, ...]:
    """Return the full ids, `roadscope/Highway-v0` and so on."""
    return tuple(f"{NAMESPACE}/{name}" for name in IDS)


def register() -> None:
    """Make the ids known to Gymnasium; calling it again changes nothing."""
    from gymnasium.envs import registration

    for name, arguments in IDS.items():
        if f"{NAMESPACE}/{name}" not in registration.registry:
            registration.register(
                id=f"{NAMESPACE}/{name}",
                entry_point="roadscope.envs.gym.highway:ScenarioEnv",
                kwargs=dict(arguments),
            )


def register_on_import() -> None:
    """Register now if Gymnasium is loaded, otherwise right after someone imports it.

    Gymnasium brings NumPy, a quarter of a second of processor time that `roadscope --help` and
    programs without environments should not pay.
    """
    if "gymnasium" in sys.modules:
        register()
    elif not any(isinstance(finder, _GymnasiumFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _GymnasiumFinder())


class _GymnasiumFinder:
    """Finds Gymnasium as the other finders do, and has `register` run once it is loaded."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        for finder in sys.meta_path:
            if finder is self or not hasattr(finder, "find_spec"):
                continue
            spec = finder.find_spec(fullname, path, target)
            if spec is not None:
                if spec.loader is not None:
                    spec.loader = _RegisteringLoader(spec.loader, self)  # type: ignore[assignment]
                return spec
        return None


class _RegisteringLoader:
    """Loads by the loader that it stands in for, then registers and steps aside."""

    def __init__(self, loader: Any, finder: _GymnasiumFinder) -> None:
        self._loader = loader
        self._finder = finder

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        made: ModuleType | None = self._loader.create_module(spec)
        return made

    def exec_module(self, module: ModuleType) -> None:
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        if self._finder in sys.meta_path:
            sys.meta_path.remove(self._finder)
        register()
