"""Zhang 2022's steps on clusters: segments, which of them move, features of each."""

from roadscope._lazy import lazy_names

_PARTS = {
    "features": "ClusterMatch LEAST MOST NOISE_M NO_PARTNER REACH_M limit_of match_clusters "
    "ring_roughness",
    "segments": "Clustering Segments centres_of parts segments_of",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
