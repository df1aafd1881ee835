"""Trackers by name, and the parts of which they are made."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.trackers.api import OfflineTracker, Tracker, is_offline

if TYPE_CHECKING:
    from roadscope.trackers.assignment import assign_greedily, assign_in_turn, assign_optimally
    from roadscope.trackers.existence import ExistenceTracker
    from roadscope.trackers.gating import (
        CandidatePairs,
        chi_square_gate,
        pairs_by_distance,
        pairs_by_likelihood,
        pairs_by_overlap,
        suppressed,
    )
    from roadscope.trackers.kalman import Gaussians
    from roadscope.trackers.motion import (
        ConstantAcceleration,
        ConstantVelocity,
        CoordinatedTurn,
        PositionFilter,
    )
    from roadscope.trackers.nearest import NearestTracker, associate_nearest
    from roadscope.trackers.offline import offline_tracks
    from roadscope.trackers.ticks import TrackerTick, in_world
    from roadscope.trackers.tracklets import LifeCycle, Tracklets, TrackManager
    from roadscope.trackers.traits import read_detector, score_log_odds

TRACKERS: Registry[Tracker] = Registry(
    "tracker",
    {
        "nearest": "roadscope.trackers.nearest:NearestTracker",
        "nearest-q": "roadscope.trackers.nearest:NearestTracker?acceleration_m_s2=2.0",
        "nearest-q-confirmed": "roadscope.trackers.nearest:NearestTracker"
        "?acceleration_m_s2=2.0&confirm_hits=3",
        "greedy": "roadscope.trackers.greedy:GreedyTracker",
        "gnn": "roadscope.trackers.gnn:GnnTracker",
        "ab3dmot": "roadscope.trackers.ab3dmot:Ab3dmotTracker",
        "bytetrack": "roadscope.trackers.bytetrack:ByteTracker",
        "oc-sort": "roadscope.trackers.oc_sort:OcSortTracker",
        "simple-track": "roadscope.trackers.simple_track:SimpleTracker",
        "pc3t": "roadscope.trackers.pc3t:Pc3tTracker",
        "mctrack": "roadscope.trackers.mctrack:McTracker",
        "imm": "roadscope.trackers.imm:ImmTracker",
        "pmbm": "roadscope.trackers.pmbm:PmbmTracker",
        "jpda": "roadscope.trackers.jpda:JpdaTracker",
        "existence": "roadscope.trackers.existence:ExistenceTracker",
        "existence-offline": "roadscope.trackers.offline:ExistenceOfflineTracker",
        "norfair": "roadscope.trackers.peers.norfair:NorfairTracker",
        "stonesoup-gnn": "roadscope.trackers.peers.stone_soup:StoneSoupGnnTracker",
        "stonesoup-jpda": "roadscope.trackers.peers.stone_soup:StoneSoupJpdaTracker",
        "roboflow-sort": "roadscope.trackers.peers.roboflow:RoboflowSortTracker",
        "roboflow-bytetrack": "roadscope.trackers.peers.roboflow:RoboflowByteTracker",
        "roboflow-oc-sort": "roadscope.trackers.peers.roboflow:RoboflowOcSortTracker",
    },
    group="roadscope.trackers",
    summaries={
        "nearest": "Nearest association, constant velocity (Lu 2018).",
        "nearest-q": "Likewise, with process noise.",
        "nearest-q-confirmed": "Likewise, confirmed after three hits.",
        "greedy": "Highest scores first, nearest centre (CenterPoint, 2021).",
        "gnn": "Likeliest pairs within a gate (SORT in bird's-eye view).",
        "ab3dmot": "Overlap of boxes in space (AB3DMOT, Weng 2020).",
        "bytetrack": "High scores first, then low ones (ByteTrack, 2022).",
        "oc-sort": "Observations before estimates (OC-SORT, Cao 2023).",
        "simple-track": "Low scores keep tracks alive (SimpleTrack, Pang 2021).",
        "pc3t": "Most confident predictions first (PC3T, Wu 2021).",
        "mctrack": "Bird's-eye view, then the ego's view (MCTrack, Wang 2024).",
        "imm": "Three motion models at once (IMM, Blom 1988).",
        "pmbm": "Many global hypotheses (PMBM, Garcia-Fernandez 2018).",
        "jpda": "All detections, by exact marginals (JIPDA, Musicki 2004).",
        "existence": "Existence from scores, fit and visibility: recommended.",
        "existence-offline": "Likewise, then smoothed with all frames at hand.",
        "norfair": "Norfair's, nearest pairs first; needs norfair.",
        "stonesoup-gnn": "Stone Soup's GNN, likeliest pairs; needs stonesoup.",
        "stonesoup-jpda": "Stone Soup's exact JPDA; needs stonesoup.",
        "roboflow-sort": "Roboflow's SORT, overlap in bird's-eye view; needs trackers.",
        "roboflow-bytetrack": "Roboflow's ByteTrack, likewise; needs trackers.",
        "roboflow-oc-sort": "Roboflow's OC-SORT, likewise; needs trackers.",
    },
)

_PLACES = {
    "CandidatePairs": "roadscope.trackers.gating:CandidatePairs",
    "ConstantAcceleration": "roadscope.trackers.motion:ConstantAcceleration",
    "ConstantVelocity": "roadscope.trackers.motion:ConstantVelocity",
    "CoordinatedTurn": "roadscope.trackers.motion:CoordinatedTurn",
    "ExistenceTracker": "roadscope.trackers.existence:ExistenceTracker",
    "Gaussians": "roadscope.trackers.kalman:Gaussians",
    "LifeCycle": "roadscope.trackers.tracklets:LifeCycle",
    "NearestTracker": "roadscope.trackers.nearest:NearestTracker",
    "PositionFilter": "roadscope.trackers.motion:PositionFilter",
    "TrackManager": "roadscope.trackers.tracklets:TrackManager",
    "TrackerTick": "roadscope.trackers.ticks:TrackerTick",
    "Tracklets": "roadscope.trackers.tracklets:Tracklets",
    "assign_greedily": "roadscope.trackers.assignment:assign_greedily",
    "assign_in_turn": "roadscope.trackers.assignment:assign_in_turn",
    "assign_optimally": "roadscope.trackers.assignment:assign_optimally",
    "associate_nearest": "roadscope.trackers.nearest:associate_nearest",
    "chi_square_gate": "roadscope.trackers.gating:chi_square_gate",
    "in_world": "roadscope.trackers.ticks:in_world",
    "offline_tracks": "roadscope.trackers.offline:offline_tracks",
    "pairs_by_distance": "roadscope.trackers.gating:pairs_by_distance",
    "pairs_by_likelihood": "roadscope.trackers.gating:pairs_by_likelihood",
    "pairs_by_overlap": "roadscope.trackers.gating:pairs_by_overlap",
    "read_detector": "roadscope.trackers.traits:read_detector",
    "score_log_odds": "roadscope.trackers.traits:score_log_odds",
    "suppressed": "roadscope.trackers.gating:suppressed",
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

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES)
