"""Common parts of the LOAM family: edges and planes, their pairs, and motion between scans."""

from roadscope._lazy import lazy_names

_PARTS = {
    "feature_match": "DEVIATION FeatureMatch NOISE_M NONE Pairs RINGS_AWAY SLIM TUKEY descend "
    "distances joined lines_of match_features moved nearest normal_equations pair_weights "
    "planes_of ring_table settle",
    "features": "ADJACENT FeatureLimits Features GRAZING JUMP PickRule SAME_M "
    "cluster_roughness extract members picked roughness sectors_of sweep_of unreliable",
    "progress": "ImuPrediction PATIENCE Progress SURE deskewed_between misfit_of with_prediction",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
