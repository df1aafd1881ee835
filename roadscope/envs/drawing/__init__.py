"""Pictures of scans, road users, detections and tracks."""

from roadscope._lazy import lazy_names

_PARTS = {
    "birds_eye": "BirdsEyeView box_corners write_distances write_ids",
    "canvas": "Canvas text_px",
    "composed": "Snapshot composed_frame view_from_above",
    "labels": "LabelPlacer LegendRow draw_legend legend_of",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
