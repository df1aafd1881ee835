"""Odometries of other libraries as odometries of ours: `pip install roadscope[peers]`."""

from roadscope._lazy import lazy_names

_PARTS = {"adapter": "OdometryAdapter", "interface": "Placed"}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
