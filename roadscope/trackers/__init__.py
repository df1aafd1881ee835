"""Trackers by name, and the parts of which they are made."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.trackers.api import OfflineTracker, Tracker, is_offline

if TYPE_CHECKING:
    from roadscope.trackers._assignment import assign_greedily, assign_in_turn, assign_optimally
    from roadscope.trackers._existence import ExistenceTracker
    from roadscope.trackers._gating import (
        CandidatePairs,
        chi_square_gate,
        pairs_by_distance,
        pairs_by_likelihood,
        pairs_by_overlap,
        suppressed,
    )
    from roadscope.trackers._kalman import Gaussians
    from roadscope.trackers._motion import (
        ConstantAcceleration,
        ConstantVelocity,
        CoordinatedTurn,
        PositionFilter,
    )
    from roadscope.trackers._nearest import NearestTracker, associate_nearest
    from roadscope.trackers._offline import offline_tracks
    from roadscope.trackers._ticks import TrackerTick, in_world
    from roadscope.trackers._tracklets import LifeCycle, Tracklets, TrackManager
    from roadscope.trackers._traits import UnknownDetectorWarning, read_detector, score_log_odds

TRACKERS: Registry[Tracker] = Registry(
    "tracker",
    {
        "nearest": "roadscope.trackers._nearest:NearestTracker",
        "nearest-q": "roadscope.trackers._nearest:NearestTracker?acceleration_m_s2=2.0",
        "nearest-q-confirmed": "roadscope.trackers._nearest:NearestTracker"
        "?acceleration_m_s2=2.0&confirm_hits=3",
        "greedy": "roadscope.trackers._greedy:GreedyTracker",
        "gnn": "roadscope.trackers._gnn:GnnTracker",
        "ab3dmot": "roadscope.trackers._ab3dmot:Ab3dmotTracker",
        "bytetrack": "roadscope.trackers._bytetrack:ByteTracker",
        "oc-sort": "roadscope.trackers._oc_sort:OcSortTracker",
        "simple-track": "roadscope.trackers._simple_track:SimpleTracker",
        "pc3t": "roadscope.trackers._pc3t:Pc3tTracker",
        "mctrack": "roadscope.trackers._mctrack:McTracker",
        "imm": "roadscope.trackers._imm:ImmTracker",
        "pmbm": "roadscope.trackers._pmbm:PmbmTracker",
        "jpda": "roadscope.trackers._jpda:JpdaTracker",
        "existence": "roadscope.trackers._existence:ExistenceTracker",
        "existence-offline": "roadscope.trackers._offline:ExistenceOfflineTracker",
        "norfair": "roadscope.trackers._peers.norfair:NorfairTracker",
        "stonesoup-gnn": "roadscope.trackers._peers.stone_soup:StoneSoupGnnTracker",
        "stonesoup-jpda": "roadscope.trackers._peers.stone_soup:StoneSoupJpdaTracker",
        "roboflow-sort": "roadscope.trackers._peers.roboflow:RoboflowSortTracker",
        "roboflow-bytetrack": "roadscope.trackers._peers.roboflow:RoboflowByteTracker",
        "roboflow-oc-sort": "roadscope.trackers._peers.roboflow:RoboflowOcSortTracker",
    },
    group="roadscope.trackers",
    summaries={
        "nearest": "Nearest association, constant velocity (Lu 2018).",
        "nearest-q": "nearest, with process noise.",
        "nearest-q-confirmed": "nearest-q, confirmed after three hits.",
        "greedy": "Highest scores first, nearest centre (CenterPoint, 2021).",
        "gnn": "Likeliest pairs within a gate (SORT in bird's-eye view).",
        "ab3dmot": "Overlap of boxes in space (AB3DMOT, Weng 2020).",
        "bytetrack": "High scores first, then low ones (ByteTrack, 2022).",
        "oc-sort": "Observations before estimates (OC-SORT, Cao 2023).",
        "simple-track": "Low scores keep tracks alive (SimpleTrack, Pang 2021).",
        "pc3t": "Most confident predictions first (PC3T, Wu 2021).",
        "mctrack": "Overlap from above, then as seen by the ego (MCTrack 2024).",
        "imm": "Three motion models at once (IMM, Blom 1988).",
        "pmbm": "Many global hypotheses (PMBM, Garcia-Fernandez 2018).",
        "jpda": "All detections, by marginals (JIPDA 2004, JPDA* 2000).",
        "existence": "Existence from scores, distances, visibility: recommended.",
        "existence-offline": "existence, then smoothed with all frames known.",
        "norfair": "Norfair's, nearest pairs first; needs norfair.",
        "stonesoup-gnn": "Stone Soup's GNN, likeliest pairs; needs stonesoup.",
        "stonesoup-jpda": "Stone Soup's exact JPDA; needs stonesoup.",
        "roboflow-sort": "Roboflow's SORT, overlap in bird's-eye view; needs trackers.",
        "roboflow-bytetrack": "Roboflow's ByteTrack, in bird's-eye view; needs trackers.",
        "roboflow-oc-sort": "Roboflow's OC-SORT, in bird's-eye view; needs trackers.",
    },
)

_PLACES = {
    "CandidatePairs": "roadscope.trackers._gating:CandidatePairs",
    "ConstantAcceleration": "roadscope.trackers._motion:ConstantAcceleration",
    "ConstantVelocity": "roadscope.trackers._motion:ConstantVelocity",
    "CoordinatedTurn": "roadscope.trackers._motion:CoordinatedTurn",
    "ExistenceTracker": "roadscope.trackers._existence:ExistenceTracker",
    "Gaussians": "roadscope.trackers._kalman:Gaussians",
    "LifeCycle": "roadscope.trackers._tracklets:LifeCycle",
    "NearestTracker": "roadscope.trackers._nearest:NearestTracker",
    "PositionFilter": "roadscope.trackers._motion:PositionFilter",
    "TrackManager": "roadscope.trackers._tracklets:TrackManager",
    "TrackerTick": "roadscope.trackers._ticks:TrackerTick",
    "Tracklets": "roadscope.trackers._tracklets:Tracklets",
    "UnknownDetectorWarning": "roadscope.trackers._traits:UnknownDetectorWarning",
    "assign_greedily": "roadscope.trackers._assignment:assign_greedily",
    "assign_in_turn": "roadscope.trackers._assignment:assign_in_turn",
    "assign_optimally": "roadscope.trackers._assignment:assign_optimally",
    "associate_nearest": "roadscope.trackers._nearest:associate_nearest",
    "chi_square_gate": "roadscope.trackers._gating:chi_square_gate",
    "in_world": "roadscope.trackers._ticks:in_world",
    "offline_tracks": "roadscope.trackers._offline:offline_tracks",
    "pairs_by_distance": "roadscope.trackers._gating:pairs_by_distance",
    "pairs_by_likelihood": "roadscope.trackers._gating:pairs_by_likelihood",
    "pairs_by_overlap": "roadscope.trackers._gating:pairs_by_overlap",
    "read_detector": "roadscope.trackers._traits:read_detector",
    "score_log_odds": "roadscope.trackers._traits:score_log_odds",
    "suppressed": "roadscope.trackers._gating:suppressed",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = [
    "TRACKERS",
    "CandidatePairs",
    "ConstantAcceleration",
    "ConstantVelocity",
    "CoordinatedTurn",
    "ExistenceTracker",
    "Gaussians",
    "LifeCycle",
    "NearestTracker",
    "OfflineTracker",
    "PositionFilter",
    "TrackManager",
    "Tracker",
    "TrackerTick",
    "Tracklets",
    "UnknownDetectorWarning",
    "assign_greedily",
    "assign_in_turn",
    "assign_optimally",
    "associate_nearest",
    "chi_square_gate",
    "in_world",
    "is_offline",
    "offline_tracks",
    "pairs_by_distance",
    "pairs_by_likelihood",
    "pairs_by_overlap",
    "read_detector",
    "score_log_odds",
    "suppressed",
]

_PARTS = {
    "_assignment": "AssignmentStage assign_in_stages components",
    "_detection_model": "ClutterDensity DetectionModel Existence ScoreCalibration",
    "_existence": "log_odds_of_both",
    "_existence_targets": "BoxEstimates DetectedBoxes Measurements Neighbours corrected_boxes "
    "corrected_states expected_velocities hidden_shares oriented_covariances predicted_states",
    "_gating": "FAMILIES",
    "_imm": "ImmFilter mixed",
    "_jpda": "mixture_moments one_to_one_pairs",
    "_jpda_marginals": "EXACT_LIMIT association_marginals loopy_marginals",
    "_kalman": "corrected corrected_with_likelihood predicted",
    "_mctrack": "birds_eye_pairs ego_view_pairs",
    "_motion": "NewTracks planar predicted_by_model",
    "_nearest": "ConstantVelocityFilter FilterNoise process_noise",
    "_oc_sort": "Observations unit_vectors",
    "_offline": "OfflineRules TargetTrajectory TrackNoise smoothed_states trajectories",
    "_pmbm_hypotheses": "Hypotheses HypothesisLimits PairCosts Sizes best_assignments continue_all "
    "continue_hypotheses",
    "_score_meaning": "PendingDetections ScoreMeaning rising",
    "_traits": "EDGES FOLDER TraitsChoice detector_names",
}
"""What else the tests of this repository use, by the file that defines it. It is not public."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES, _PARTS)
