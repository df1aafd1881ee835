"""Costs of all pairs as a matrix, from which tests make candidates."""

import numpy as np

from roadscope.trackers.gating import Candidates


def candidates(costs):
    """All pairs of (N, M) costs that are finite."""
    rows, columns = map(np.ascontiguousarray, np.nonzero(np.isfinite(costs)))
    return Candidates(costs.shape, rows, columns, costs[rows, columns])


def matrix(found, missing=np.inf):
    """(N, M) costs of candidates."""
    costs = np.full(found.shape, missing)
    costs[found.rows, found.columns] = found.costs
    return costs
