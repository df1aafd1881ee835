"""Costs of all pairs as a matrix."""

import numpy as np

from roadscope.trackers import CandidatePairs


def candidates(costs):
    """All pairs of (N, M) costs that are finite."""
    rows, columns = map(np.ascontiguousarray, np.nonzero(np.isfinite(costs)))
    return CandidatePairs(costs.shape, rows, columns, costs[rows, columns])


def matrix(pairs):
    """(N, M) costs of candidates, inf elsewhere."""
    costs = np.full(pairs.shape, np.inf)
    costs[pairs.rows, pairs.columns] = pairs.costs
    return costs
