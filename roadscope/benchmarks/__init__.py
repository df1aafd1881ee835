"""Suites, boards, runs, metrics, results and reports."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names

if TYPE_CHECKING:
    from roadscope.benchmarks.eligibility import Eligibility
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.isolation import Limits
    from roadscope.benchmarks.recorded.result_files import score_kitti_results, score_mot_results
    from roadscope.benchmarks.results import Results
    from roadscope.benchmarks.single import run_episode, save_picture
    from roadscope.benchmarks.suite import BoardSettings, Suite
    from roadscope.benchmarks.suite_files import load_suite

_PLACES = {
    "BoardSettings": "roadscope.benchmarks.suite:BoardSettings",
    "Eligibility": "roadscope.benchmarks.eligibility:Eligibility",
    "Episode": "roadscope.benchmarks.episode:Episode",
    "Limits": "roadscope.benchmarks.isolation:Limits",
    "Results": "roadscope.benchmarks.results:Results",
    "Suite": "roadscope.benchmarks.suite:Suite",
    "load_suite": "roadscope.benchmarks.suite_files:load_suite",
    "run_episode": "roadscope.benchmarks.single:run_episode",
    "save_picture": "roadscope.benchmarks.single:save_picture",
    "score_kitti_results": "roadscope.benchmarks.recorded.result_files:score_kitti_results",
    "score_mot_results": "roadscope.benchmarks.recorded.result_files:score_mot_results",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = [
    "BoardSettings",
    "Eligibility",
    "Episode",
    "Limits",
    "Results",
    "Suite",
    "load_suite",
    "run_episode",
    "save_picture",
    "score_kitti_results",
    "score_mot_results",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES)
