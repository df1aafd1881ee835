"""Li and Huang 2021: boxes joined by overlap in the image, classes by Dempster-Shafer."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, ImageDetections
from roadscope.core.checks import require
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views, assemble
from roadscope.fusion.evidence import camera_masses, combine_or_keep, lidar_masses
from roadscope.fusion.overlap import coverage

RANKS = ("class", "any")


class Li2021Fusion:
    """Decision-level fusion as in the paper."""

    def __init__(
        self,
        *,
        threshold_1: float = 0.2,
        threshold_2: float = 0.3,
        evidence: bool = True,
        rank: str = "class",
    ) -> None:
        """Set the fusion up.

        threshold_1, threshold_2: the paper's shares of a camera box that a LiDAR box covers (5.1).
            Above the first both overlap. Where several LiDAR boxes overlap one camera box, only a
            share above the second is a match.
        evidence: whether the masses of both sensors are combined; if not, the camera's are taken.
        rank: what the score of a target is, which the paper does not say: the mass of its `class`,
            as in Table 1, or of `any` class, that is 1 minus ignorance.
        """
        require(rank in RANKS, self, "rank", f"one of {', '.join(RANKS)}", rank)
        self.rank = rank
        for name, value in (("threshold_1", threshold_1), ("threshold_2", threshold_2)):
            require(0 <= value < 1, self, name, "a share from 0 to below 1", value)
        self.threshold_1 = threshold_1
        self.threshold_2 = threshold_2
        self.evidence = evidence

    def reset(self) -> None:
        """Do nothing: a fusion keeps no state."""

    def fuse(
        self, lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> FusedDetections:
        """Join the boxes (5.1), then the evidence (5.2).

        Dempster's rule has no result in full conflict; the masses are then those of the camera.
        """
        views = Views.of(lidar, camera, projection)
        lidar_row, replaced = self._join_boxes(views)
        of_lidar = lidar_masses(views.lidar)
        masses = camera_masses(views.camera).copy()
        both = lidar_row >= 0
        if self.evidence and both.any():
            masses[both] = combine_or_keep(of_lidar[lidar_row[both]], masses[both])
        alone = np.flatnonzero(~replaced)
        masses = np.concatenate([masses, of_lidar[alone]])
        return assemble(
            views,
            np.concatenate([lidar_row, alone]),
            np.concatenate([np.arange(len(lidar_row)), np.full(len(alone), -1)]),
            masses,
            1 - masses[:, -1] if self.rank == "any" else None,
        )

    def _join_boxes(self, views: Views) -> tuple[np.ndarray, np.ndarray]:
        """Return the LiDAR row (M,) of each camera box, and which LiDAR boxes (N,) are replaced.

        The row is -1 for a camera box that gets none. A camera box replaces a LiDAR box that covers
        more than threshold 1 of it. The paper uses threshold 2 where one object has several boxes:
        the better match gives its number and distance to the camera box. Our reading: of several
        LiDAR boxes that with the greatest overlap gives them, if the overlap is above threshold 2;
        otherwise the match is unclear, and the camera box gets neither. One LiDAR box may give
        them to several camera boxes.
        """
        covered = coverage(views.lidar_boxes, views.camera.boxes)
        covered[~views.in_image] = 0.0
        if covered.size == 0:
            return np.full(covered.shape[1], -1), np.zeros(covered.shape[0], bool)
        overlapping = covered > self.threshold_1
        several = overlapping.sum(axis=0) > 1
        matches = overlapping & (~several | (covered > self.threshold_2))
        lidar_row = np.where(matches.any(axis=0), (covered * matches).argmax(axis=0), -1)
        replaced = np.asarray(overlapping.any(axis=1))
        return lidar_row, replaced
