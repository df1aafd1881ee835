"""Our traffic as objects of highway-env: the slow twin of `roadscope.envs.traffic.flow`.

It was the product until the kernels replaced it, and says in plain terms what they compute.
"""

from research.object_traffic.lanes import coordinates
from research.object_traffic.stage import ObjectStage

__all__ = ["ObjectStage", "coordinates"]
