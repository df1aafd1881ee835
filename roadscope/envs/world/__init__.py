"""The world that sensors measure: bodies and the roadside."""

from roadscope._lazy import lazy_names

_PARTS = {
    "bodies": "BY_SIZE body_prisms",
    "borders": "LaneDistances border_sites distances_to without_duplicates",
    "ground": "Surface surface_of",
    "materials": "GREY MATERIALS RUBBER",
    "prisms": "Prisms ellipse padded placed rectangle rounded",
    "road_memo": "CACHED_ROADS cached_per_road",
    "roadside": "KINDS OBSTACLE_KIND OVERHEAD STYLES Scenery grow kinds_of",
    "saloon_body": "CORNER_RADII_M HEIGHT_M LENGTH_M NARROWING SLABS WIDTH_M ford_saloon "
    "with_corners",
    "world": "World actor_bodies build_world obstacle_prisms",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
