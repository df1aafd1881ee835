"""Shapes by name: from a cluster to the vehicles in it."""

from collections.abc import Callable, Mapping

from roadscope._lazy import lazy_names
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.body import vehicles_by_body
from roadscope.detectors.shape.cluster import Cluster, clusters
from roadscope.detectors.shape.l_shape import vehicles_by_l_shape, vehicles_by_rectangle
from roadscope.detectors.shape.matched import vehicles_by_matched_filter
from roadscope.detectors.shape.recognition import Segment, Vehicle, fit_iepf, vehicles_by_lines

Shape = Callable[[Cluster, Horizon], list[Vehicle]]
"""Returns the vehicles in a cluster; none if it is something else."""

SHAPES: Mapping[str, Callable[..., list[Vehicle]]] = {
    "iepf": vehicles_by_lines,
    "rectangle": vehicles_by_rectangle,
    "l-shape": vehicles_by_l_shape,
    "matched-filter": vehicles_by_matched_filter,
    "body": vehicles_by_body,
}
"""Name -> a `Shape`; keyword arguments beyond the two are its options."""

__all__ = ["SHAPES", "Cluster", "Segment", "Shape", "Vehicle", "clusters", "fit_iepf"]

_PARTS = {
    "bodies": "BODIES body_table",
    "cluster": "DEPTH_M contours",
    "completion": "cut",
    "l_shape": "AREA CLOSENESS VARIANCE hull_heading line_heading searched_heading",
    "recognition": "FACES GAP_M HALF_FACE_M JOIN_M face_ends recognise split_ends",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
