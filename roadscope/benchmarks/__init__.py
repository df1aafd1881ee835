"""Suites, runner, metrics, results and reports."""

from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.runner import run
from roadscope.benchmarks.single import run_episode
from roadscope.benchmarks.suite import Suite, load_suite

__all__ = ["Episode", "Results", "Suite", "load_suite", "run", "run_episode"]
