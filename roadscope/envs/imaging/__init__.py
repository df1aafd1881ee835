"""Images of the world: rasterisation, lighting, shading."""

from roadscope._lazy import lazy_names

_PARTS = {
    "ground": "Ground",
    "light": "LIGHTS Light light_named",
    "lighting": "cast_shadows",
    "pinhole": "Pinhole mounted",
    "raster": "FACES lens_of rasterise solids_of",
    "shading": "CameraView shade",
    "vehicle_patterns": "axles bodywork glass",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
