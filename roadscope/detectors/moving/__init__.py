"""Moving objects in a scan, from comparison with earlier ones."""

from roadscope._lazy import lazy_names
from roadscope.detectors.moving.extraction import Candidate, extract
from roadscope.detectors.moving.view import Memory

__all__ = ["Candidate", "Memory", "extract"]

_PARTS = {
    "box_search": "BINS BIN_M BoxSides DEEP_BINS EvidenceGrid GAP_BINS STRIDE TURNS boxes_in "
    "evidence_grid slide suppress",
    "extraction": "RULE linked sorted_by_body whole_body",
    "lidar": "lidar_of",
    "links": "Chain OFFSETS RIDER_M Sighting TRIED TWO_WHEELERS usual",
    "view": "NOISE_USUAL_M View deskewed imaged range_noise_of tabulate thinned",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
