"""Shows an episode in Rerun, a viewer of recordings with a timeline."""

from roadscope._lazy import lazy_names

_PARTS = {
    "curves": "Curve",
    "program": "ViewerError arguments environment show",
    "recording": "save_recording",
    "stored_answers": "EpisodeChoice StoredAnswersError view_of_results",
    "view": "EpisodeView view_of_scenario",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
