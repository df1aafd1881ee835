"""Joins the scores of jobs into rows, ranks and intervals."""

from roadscope._lazy import lazy_names
from roadscope.benchmarks.results.job_scores import JobScores
from roadscope.benchmarks.results.results import Results, gather, results_of
from roadscope.benchmarks.results.rows import Row
from roadscope.benchmarks.results.standing import Standing

__all__ = ["JobScores", "Results", "Row", "Standing", "gather", "results_of"]

_PARTS = {
    "agreement": "BoardAgreement spearman",
    "prediction": "Prediction predictions",
    "results": "BreakdownError Failure check_breakdown",
    "rows": "EntryResult part_rows whole_rows",
    "standing": "standings",
    "statistics": "mean_interval merged paired_interval pooled_interval",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
