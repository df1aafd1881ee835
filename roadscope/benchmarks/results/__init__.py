"""Joins the scores of jobs into rows, ranks and intervals."""

from roadscope.benchmarks.results.job_scores import JobScores
from roadscope.benchmarks.results.results import Results, gather, results_of
from roadscope.benchmarks.results.rows import Row
from roadscope.benchmarks.results.standing import Standing

__all__ = ["JobScores", "Results", "Row", "Standing", "gather", "results_of"]
