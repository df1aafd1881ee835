"""The metrics as plain functions, for anybody's detections, tracks and poses.

Tracking metrics take a `TrackedSequence`: `TrackedSequence.of` makes one from ids and similarities
or distances, `tracked_sequence` from records. Counts of several sequences add up (`one + other`).
Metrics of odometry take estimated and true poses of the same stamps. Units are in the names:
metres, radians, seconds; shares are 0 to 1.

All are compared in our tests with reference implementations: TrackEval, Stone Soup, nuScenes'
and KITTI's evaluation, pycocotools and evo.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.metrics import calibration as _calibration
from roadscope.benchmarks.metrics.image_detection import LabelledImage as _LabelledImage
from roadscope.benchmarks.metrics.image_detection import PrecisionCurve
from roadscope.benchmarks.metrics.image_detection import image_precision as _image_precision
from roadscope.benchmarks.metrics.matching import Pairing as _Pairing
from roadscope.benchmarks.metrics.matching import centre_distances as _centre_distances
from roadscope.benchmarks.metrics.ranked_precision import average_precision as _average_precision
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.amota import Amota, NuscenesAmota, amota, amota_nuscenes
from roadscope.benchmarks.metrics.tracking.clear import Clear, clear
from roadscope.benchmarks.metrics.tracking.hota import ALPHAS, Hota, hota
from roadscope.benchmarks.metrics.tracking.identity import Identity, identity
from roadscope.benchmarks.metrics.tracking.ospa import Gospa, Ospa, gospa, ospa
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence, tracked_sequence
from roadscope.benchmarks.metrics.tracking.state_accuracy import Nees
from roadscope.benchmarks.metrics.tracking.state_accuracy import StateErrors as _StateErrors
from roadscope.benchmarks.metrics.tracking.state_accuracy import nees as _nees
from roadscope.benchmarks.metrics.trajectory_errors import (
    KITTI_EVERY,
    KITTI_M,
    AbsoluteErrors,
    Alignment,
    Drift,
    RelativeErrors,
    absolute_errors,
    drift,
    relative_errors,
)
from roadscope.benchmarks.metrics.trajectory_errors import Trajectories as _Trajectories
from roadscope.core import Detections, ImageDetections, Pose, Truth

__all__ = [
    "ALPHAS",
    "KITTI_M",
    "METRIC_VERSION",
    "AbsoluteErrors",
    "Amota",
    "Clear",
    "Drift",
    "Gospa",
    "Hota",
    "Identity",
    "Nees",
    "NuscenesAmota",
    "Ospa",
    "PrecisionCurve",
    "RelativeErrors",
    "Score",
    "TrackedSequence",
    "amota",
    "amota_nuscenes",
    "ate",
    "average_precision",
    "calibration_error",
    "clear",
    "gospa",
    "hota",
    "identity",
    "image_average_precision",
    "kitti_drift",
    "nees",
    "ospa",
    "rpe",
    "tracked_sequence",
]

Poses = np.ndarray | Sequence[Pose]
"""(N, 4, 4) float64 rigid motions, metres, or as many `Pose`s."""


def ate(estimate: Poses, truth: Poses, *, alignment: Alignment = "se3") -> AbsoluteErrors:
    """Return the absolute trajectory error of each pose (Sturm et al. 2012), metres and radians.

    ATE is `rmse_m`, the root mean square of the positions' errors; 0 and more, nan without a pose.

    estimate, truth: (N, 4, 4), poses of the same sensor at the same stamps.
    alignment: `none`: both are in the same frame. `origin`: first pose on first pose. `yaw`:
        shift and turn about z, `se3`: shift and rotation, with the least squared distances
        (Umeyama 1991, without scale).
    """
    return absolute_errors(_trajectories(estimate, truth), alignment)


def rpe(estimate: Poses, truth: Poses, *, step: int = 1) -> RelativeErrors:
    """Return the relative pose errors (Sturm et al. 2012) of motions over `step` frames.

    RPE is `rmse_m` and `rmse_rad`, the root mean square errors of the motions; 0 and more, nan
    without a motion.

    estimate, truth: (N, 4, 4), poses of the same sensor at the same stamps, each in a frame of
        its own.
    """
    return relative_errors(_trajectories(estimate, truth), step)


def kitti_drift(
    estimate: Poses, truth: Poses, *, lengths_m: Sequence[float] = KITTI_M, every: int = KITTI_EVERY
) -> Drift:
    """Return KITTI's drift (Geiger et al. 2012): `t_rel` in %, `r_rel` in degrees per 100 m.

    It is the mean error of motions over stretches, divided by their length; 0 and more, nan if no
    stretch is long enough.

    estimate, truth: (N, 4, 4), poses of the same sensor at the same stamps, each in a frame of
        its own.
    lengths_m: lengths of the stretches. every: number of frames from the beginning of one stretch
        to the next. The defaults are KITTI's; trajectories of less than 100 m need shorter
        stretches.
    """
    return drift(_trajectories(estimate, truth), lengths_m, every=every)


def nees(
    errors: np.ndarray, covariances: np.ndarray, *, velocity_errors: np.ndarray | None = None
) -> Nees:
    """Return the normalised estimation error squared (Bar-Shalom et al. 2001, chapter 5.4).

    NEES is e' P^-1 e of an error e with covariance P: 0 and more, no unit. Its mean is the degrees
    of freedom if the covariances are right, more if they are too small; nan without an error.

    errors: (K, 2) metres, estimated less true x and y. covariances: (K, 4, 4), of x, y and their
        velocities, as `Tracks.covariances` has them; pairs whose covariance is not positive
        definite are left out.
    velocity_errors: (K, 2) m/s; with them NEES has four degrees of freedom, without them two.
    """
    count = len(errors)
    velocities = np.zeros((count, 2)) if velocity_errors is None else np.asarray(velocity_errors)
    states = _StateErrors(
        np.asarray(errors, float),
        velocities,
        np.zeros(count),
        np.zeros(count, bool),
        np.asarray(covariances, float),
    )
    return _nees(states, velocity=velocity_errors is not None)


def average_precision(
    detections: Sequence[Detections],
    truths: Sequence[Truth],
    *,
    gate_m: float = 2.0,
    required: Sequence[np.ndarray] | None = None,
) -> Score:
    """Return average precision by distance of centres (Caesar et al. 2020, nuScenes), 0 to 1.

    Detections are matched from the highest score down, each to the nearest free object within
    the gate, seen from above; interpolated precision is averaged over 101 recalls. nan without an
    object. Classes are not compared: select one class first for a mean over classes.

    detections, truths: T frames, in the same coordinate frame. gate_m: metres.
    required: T arrays (M,) bool, which objects are to be detected; others count neither as
        missed nor as false alarms. None: all objects of the truth.
    """
    pairings = []
    for t, (detected, truth) in enumerate(zip(detections, truths, strict=True)):
        eligible = np.ones(len(truth), bool) if required is None else np.asarray(required[t], bool)
        distances = _centre_distances(detected.centres, truth.centres)
        pairings.append(_Pairing(distances, eligible, np.ones(len(detected), bool)))
    scores = [detected.scores for detected in detections]
    return _average_precision(pairings, scores, gate_m=gate_m)


def image_average_precision(
    detections: Sequence[ImageDetections], boxes: Sequence[np.ndarray], *, least_iou: float = 0.5
) -> PrecisionCurve:
    """Return average precision of boxes in images as COCO defines it (Lin et al. 2014).

    `ap` is 0 to 1, nan without an object. Classes are not compared: select one class first.

    detections: of T images. boxes: T arrays (M, 4) of true boxes, pixels, left top right bottom.
    least_iou: intersection over union from which on a detection is right.
    """
    images = []
    for detected, true in zip(detections, boxes, strict=True):
        objects = np.asarray(true, float).reshape(-1, 4)
        eligible, counted = np.ones(len(objects), bool), np.ones(len(detected), bool)
        images.append(_LabelledImage(detected.boxes, detected.scores, objects, eligible, counted))
    return _image_precision(images, least_iou)


def calibration_error(scores: np.ndarray, right: np.ndarray) -> Score:
    """Return the expected calibration error (Naeini et al. 2015) in ten bins, 0 to 1.

    ECE is the mean over detections of |mean score - share of right ones| of the bin that the
    detection is in; nan without a detection.

    scores: (N,) in 0 to 1. right: (N,) bool, which detections are right.
    """
    excess = _calibration.excess(np.asarray(scores, float), np.asarray(right, bool))
    return _calibration.calibration_error(excess)


def _trajectories(estimate: Poses, truth: Poses) -> _Trajectories:
    return _Trajectories(_matrices(estimate), _matrices(truth))


def _matrices(poses: Poses) -> np.ndarray:
    """Return (N, 4, 4) matrices of poses."""
    if isinstance(poses, np.ndarray):
        return poses
    return np.array([p.matrix for p in poses], float).reshape(-1, 4, 4)
