"""Maps of surfaces in voxels, and scans matched with them."""

from roadscope._lazy import lazy_names

_PARTS = {
    "free_space": "CERTAIN FreeSpace",
    "matching": "GRAZING PosePrior TILT TRACED_RAD contradicts match normal_equations surface_at",
    "surfaces": "FLOOR_M MOST VoxelMap",
    "sweep": "ENOUGH ThinnedScan",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
