"""HOTA and its parts over alpha, of simulated traffic."""

import numpy as np
import pytest
from toy_boxes import tracks, truth

from roadscope import load_suite
from roadscope.benchmarks import Eligibility, Outcome, plan
from roadscope.benchmarks.metrics import part_name
from roadscope.benchmarks.metrics.tracking import (
    ALPHA_BANDS,
    BY_ALPHA,
    CURVES,
    score_each_alpha,
    score_tracks,
)
from roadscope.benchmarks.report import breakdown_tables
from roadscope.benchmarks.results import gather

RULE = Eligibility(range_m=(0.0, 60.0), min_returns=10)
NAMES = ("hota", *CURVES)


def scored(seed, objects):
    """An episode of ten frames, objects 5 m apart, followed more or less closely."""
    rng = np.random.default_rng(seed)
    truths, reported_tracks = [], []
    for _ in range(10):
        places = np.column_stack([5.0 * np.arange(objects) + 5, np.zeros(objects)])
        truths.append(truth(list(places), ids=list(range(objects))))
        detected = np.flatnonzero(rng.random(objects) < 0.8)
        near = places[detected] + rng.uniform(-1, 1, (len(detected), 2))
        reported_tracks.append(tracks(list(near), [int(i) + 50 for i in detected]))
    pairings = RULE.pairings(reported_tracks, truths)
    scores = score_each_alpha(reported_tracks, truths, pairings)
    assert scores.items() >= score_tracks(reported_tracks, truths, pairings).named().items()
    return scores


def test_the_mean_over_alphas_is_the_figure_of_the_episode():
    scores = scored(0, 4)
    for name in NAMES:
        parts = [scores[part_name(name, BY_ALPHA, band)] for band in ALPHA_BANDS]
        assert len({part.value for part in parts}) > 1
        assert np.mean([part.value for part in parts]) == pytest.approx(scores[name].value)
        assert {part.weight for part in parts} == {scores[name].weight}


def test_without_objects_there_is_none():
    pairings = RULE.pairings([tracks([], [])], [truth([], ids=[])])
    scores = score_each_alpha([tracks([], [])], [truth([], ids=[])], pairings)
    curves = [scores[part_name(name, BY_ALPHA, band)] for name in NAMES for band in ALPHA_BANDS]
    assert all(np.isnan(score.value) and score.n == 0 for score in curves)


@pytest.mark.slow
def test_the_board_of_simulated_traffic_has_a_curve_whose_mean_is_its_figure():
    jobs = plan(load_suite("quick"), ["gnn", "nearest"], boards=["tracking"], only=True).jobs
    outcomes = {job.key: Outcome(scored(k, 2 + k % 4)) for k, job in enumerate(jobs)}
    results = gather(jobs, outcomes, {})
    rows = [row for row in results.breakdown(BY_ALPHA, "tracking") if row.entry == "gnn"]
    for name in NAMES:
        curve = [row.value for row in rows if row.metric == name]
        assert len(curve) == len(ALPHA_BANDS)
        assert np.mean(curve) == pytest.approx(results.row("tracking", "gnn", name).value)
    titles = [table.title for table in breakdown_tables(results, "tracking", BY_ALPHA, 160)]
    assert titles == ["HOTA by alpha", "DetA by alpha", "AssA by alpha", "LocA by alpha"]
