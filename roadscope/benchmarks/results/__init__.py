"""Joins the scores of jobs into rows, ranks and intervals."""

from roadscope._lazy import lazy_names
from roadscope.benchmarks.results.results import Results, Standing, gather, results_of
from roadscope.benchmarks.results.rows import JobScores, Row

__all__ = ["JobScores", "Results", "Row", "Standing", "gather", "results_of"]

_PARTS = {
    "agreement": "BoardAgreement predictions spearman",
    "results": "BreakdownError Failure check_breakdown standings",
    "rows": "EntryResult part_rows whole_rows",
    "statistics": "mean_interval merged paired_interval pooled_interval",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
