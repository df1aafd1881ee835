"""Trackers by name."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.trackers.api import Tracker

if TYPE_CHECKING:
    from roadscope.trackers.api import OfflineTracker
    from roadscope.trackers.assignment import assign_greedily
    from roadscope.trackers.ticks import in_world

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
        "existence-offline": "roadscope.trackers.existence_offline:ExistenceOfflineTracker",
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
        "greedy": "Surest detections first, nearest centre (CenterPoint, 2021).",
        "gnn": "Likeliest pairs within a gate (SORT in bird's-eye view).",
        "ab3dmot": "Overlap of boxes in space (AB3DMOT, Weng 2020).",
        "bytetrack": "Sure detections first, then unsure (ByteTrack, 2022).",
        "oc-sort": "Observations before estimates (OC-SORT, Cao 2023).",
        "simple-track": "Unsure detections keep tracks (SimpleTrack, Pang 2021).",
        "pc3t": "The surest predictions choose first (PC3T, Wu 2021).",
        "mctrack": "Seen from above, then from the ego (MCTrack, Wang 2024).",
        "imm": "Three models of motion at once (IMM, Blom 1988).",
        "pmbm": "Many global hypotheses (PMBM, Garcia-Fernandez 2018).",
        "jpda": "All detections, by exact marginals (JIPDA, Musicki 2004).",
        "existence": "Existence by scores, fit and visibility: the one to take.",
        "existence-offline": "Likewise, then all over with all frames at hand.",
        "norfair": "Norfair's, nearest pairs first; needs norfair.",
        "stonesoup-gnn": "Stone Soup's GNN, likeliest pairs; needs stonesoup.",
        "stonesoup-jpda": "Stone Soup's exact JPDA; needs stonesoup.",
        "roboflow-sort": "Roboflow's SORT, overlap seen from above; needs trackers.",
        "roboflow-bytetrack": "Roboflow's ByteTrack, likewise; needs trackers.",
        "roboflow-oc-sort": "Roboflow's OC-SORT, likewise; needs trackers.",
    },
)

_PLACES = {
    "OfflineTracker": "roadscope.trackers.api:OfflineTracker",
    "assign_greedily": "roadscope.trackers.assignment:assign_greedily",
    "in_world": "roadscope.trackers.ticks:in_world",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = [
    "TRACKERS",
    "OfflineTracker",
    "Tracker",
    "assign_greedily",
    "in_world",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES)
