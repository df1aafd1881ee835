"""The ray caster: exact hits of rays on the world."""

from roadscope._lazy import lazy_names

_PARTS = {
    "casting": "Columns GROUND Hits NOTHING cast",
    "kernels": "cast_all",
    "scene": "Scene",
    "shapes": "CACHED_SHAPES clear_shapes shapes_of",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
