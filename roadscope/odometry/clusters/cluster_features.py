"""Features of some clusters only, under the label of the same cluster in the scan before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.odometry.clusters.cluster_match import ALONE, ClusterMatch
from roadscope.odometry.loam.features import Features


def of_partners(
    now: Features, before: Features, match: ClusterMatch, *, still_only: bool
) -> tuple[Features, Features]:
    """Return the features of clusters that both scans have, labelled as those of before.

    still_only: without clusters that are dynamic.
    """
    common = ~match.dynamic if still_only else match.partners != ALONE
    partners = np.where(common, match.partners, ALONE)
    return relabelled(now, partners), relabelled(before, _known(partners, before))


def relabelled(features: Features, labels: np.ndarray) -> Features:
    """Return features with other labels, (K,) by their own; without those that get -1."""
    edges, planes = labels[features.edge_labels], labels[features.plane_labels]
    sharp, flat = edges != ALONE, planes != ALONE
    return replace(
        features,
        edges=features.edges[sharp], edge_labels=edges[sharp],
        edge_rings=features.edge_rings[sharp], edge_rows=features.edge_rows[sharp],
        planes=features.planes[flat], plane_labels=planes[flat],
        plane_rings=features.plane_rings[flat], plane_rows=features.plane_rows[flat],
        sharp=int(sharp[: features.sharp].sum()), flat=int(flat[: features.flat].sum()),
    )  # fmt: skip


def _known(partners: np.ndarray, before: Features) -> np.ndarray:
    """Return for each label of before itself if it is somebody's partner, else -1."""
    most = max(before.edge_labels.max(initial=-1), before.plane_labels.max(initial=-1),
               partners.max(initial=-1))  # fmt: skip
    known = np.full(most + 1, ALONE)
    known[partners[partners != ALONE]] = partners[partners != ALONE]
    return known
