"""From a cluster to the vehicles that show it, by name."""

from collections.abc import Callable, Mapping

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.iepf import vehicles_by_lines
from roadscope.detectors.shape.recognition import Vehicle

Shape = Callable[[Cluster, Horizon], list[Vehicle]]
"""Returns the vehicles that a cluster shows, none where it shows something else."""

SHAPES: Mapping[str, Callable[..., list[Vehicle]]] = {"iepf": vehicles_by_lines}
"""Name -> a `Shape`; keyword arguments beyond the two are its options."""

__all__ = ["SHAPES", "Cluster", "Shape", "Vehicle"]
