"""KITTI's camera frame and our ego frame, and objects converted between them.

The ego frame of recorded data is KITTI's rectified camera frame with the axes of ISO 8855: x = z,
y = -x, z = -y. Its origin is in the camera, not on the rear axle, because KITTI's files do not say
where the axle is. So the conversion loses nothing. No other file converts between the two frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadscope.benchmarks.formats.kitti_labels import KittiObjects, KittiType
from roadscope.benchmarks.formats.tracking_rows import ImageSize, logistic
from roadscope.core import Category, Detections, Pose, Tracks, Truth, wrap_angle
from roadscope.core.fused import FusedDetections

EGO_FROM_CAMERA = Pose(
    np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
)
CAMERA_FROM_EGO = EGO_FROM_CAMERA.inverse()
NEAR_PLANE_M = 0.1
"""The part of a box that is nearer to the camera is cut off before it is projected. Chosen by
hand."""
EDGES = np.array(
    [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)], np.int64
)
"""(12, 2) numbers of the two corners that each edge of a box joins, as in `box_corners`."""
PERIOD_S = 0.1
"""KITTI records 10 frames per second."""
NOT_COUNTED = -1
"""Recorded truth has no numbers of returns and pixels and no occluded fraction."""
TYPE_FROM_CATEGORY = {
    Category.CAR: KittiType.CAR,
    Category.VAN: KittiType.VAN,
    Category.TRUCK: KittiType.TRUCK,
    Category.BUS: KittiType.MISC,
    Category.MOTORCYCLE: KittiType.MISC,
    Category.CYCLIST: KittiType.CYCLIST,
    Category.PEDESTRIAN: KittiType.PEDESTRIAN,
}
"""KITTI has no types for buses and motorcycles."""
UNKNOWN_BOX, UNKNOWN_SIZE, UNKNOWN_PLACE, UNKNOWN_ANGLE = -1.0, -1.0, -1000.0, -10.0
"""What stands in KITTI's results for what is not known of an object."""


def centres_from_bottoms(bottoms: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return (N, 3) box centres in the ego frame.

    bottoms: (N, 3) metres, centres of the bottom faces, camera frame.
    sizes: (N, 3) metres, length width height.
    """
    raised = np.array(bottoms, np.float64).reshape(-1, 3)
    raised[:, 1] -= sizes[:, 2] / 2
    return EGO_FROM_CAMERA.apply(raised)


def bottoms_from_centres(centres: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return (N, 3) centres of the bottom faces: the inverse of `centres_from_bottoms`."""
    lowered = CAMERA_FROM_EGO.apply(centres)
    lowered[:, 1] += sizes[:, 2] / 2
    return lowered


def yaws_from_rotations(rotations_y: np.ndarray) -> np.ndarray:
    """Return (N,) yaws of ISO 8855 from (N,) angles about the camera's y axis, 0 along x."""
    return wrap_angle(-np.asarray(rotations_y) - np.pi / 2)


def rotations_from_yaws(yaws: np.ndarray) -> np.ndarray:
    """Return (N,) angles about y: the inverse of `yaws_from_rotations`, up to whole turns."""
    return wrap_angle(-np.asarray(yaws) - np.pi / 2)


def observation_angles(bottoms: np.ndarray, rotations_y: np.ndarray) -> np.ndarray:
    """Return (N,) alpha, radians: the rotation about y minus the direction to the object."""
    return wrap_angle(rotations_y - np.arctan2(bottoms[:, 0], bottoms[:, 2]))


def box_corners(bottoms: np.ndarray, sizes: np.ndarray, rotations_y: np.ndarray) -> np.ndarray:
    """Return (N, 8, 3) corners, metres, camera frame.

    The bits of a corner's number say where it is: bit 0 front, bit 1 side, bit 2 top.
    """
    bits = np.array([[(k >> b) & 1 for b in range(3)] for k in range(8)], np.float64)
    along = (bits[:, 0] - 0.5) * sizes[:, :1]
    across = (bits[:, 1] - 0.5) * sizes[:, 1:2]
    cosine, sine = np.cos(rotations_y)[:, None], np.sin(rotations_y)[:, None]
    x = bottoms[:, :1] + cosine * along + sine * across
    y = bottoms[:, 1:2] - bits[:, 2] * sizes[:, 2:]
    z = bottoms[:, 2:] - sine * along + cosine * across
    return np.stack([x, y, z], axis=-1)


def image_boxes(corners: np.ndarray, projection: np.ndarray) -> np.ndarray:
    """Return (N, 4) left top right bottom, pixels, around projected corners; NaN if all are behind.

    corners: (N, 8, 3) metres, camera frame, as from `box_corners`.
    projection: (3, 4), pixels from metres in the camera frame.
    A box that reaches behind the camera is cut at the near plane first.
    """
    ends = corners[:, EDGES]
    start, end = ends[:, :, 0], ends[:, :, 1]
    depth = end[..., 2] - start[..., 2]
    # How far along each edge the near plane cuts it; -1 for an edge parallel to the plane.
    share = np.full(depth.shape, -1.0)
    np.divide(NEAR_PLANE_M - start[..., 2], depth, out=share, where=np.abs(depth) > 1e-12)
    cuts = start + share[..., None] * (end - start)
    points = np.concatenate([corners, cuts], axis=1)
    is_corner = corners[..., 2] >= NEAR_PLANE_M
    valid = np.concatenate([is_corner, (share > 0) & (share < 1)], axis=1)
    homogeneous = points @ projection[:, :3].T + projection[:, 3]
    pixels = homogeneous[..., :2] / np.where(valid, homogeneous[..., 2], 1.0)[..., None]
    lowest = np.where(valid[..., None], pixels, np.inf).min(axis=1)
    highest = np.where(valid[..., None], pixels, -np.inf).max(axis=1)
    boxes = np.concatenate([lowest, highest], axis=1)
    boxes[~valid.any(axis=1)] = np.nan
    return boxes


def clipped_image_boxes(
    corners: np.ndarray, projection: np.ndarray, image_size: ImageSize
) -> np.ndarray:
    """Return `image_boxes` clipped to the image; those of boxes outside of it are 0 0 0 0.

    One that kept its height would be a false alarm in KITTI's own evaluation, which leaves out
    detections by their height alone.
    """
    width, height = image_size
    boxes = np.nan_to_num(image_boxes(corners, projection), nan=0.0)
    last = np.array([width - 1, height - 1] * 2, np.float64)
    clipped: np.ndarray = np.clip(boxes, 0.0, last)
    clipped[(clipped[:, 2:] <= clipped[:, :2]).any(axis=1)] = 0.0
    return clipped


def detections_from_rows(
    rows: KittiObjects, category: Category, *, stamp_s: float, normalized: bool = False
) -> Detections:
    """Return the rows of one frame as detections of one class in the ego frame.

    normalized: scores are from 0 to 1 already; otherwise the logistic function maps them.
    """
    return Detections(
        centres=centres_from_bottoms(rows.bottoms, rows.sizes),
        sizes=rows.sizes,
        yaws=yaws_from_rotations(rows.rotations_y),
        categories=np.full(len(rows), category, np.int8),
        scores=rows.scores if normalized else logistic(rows.scores),
        frame="ego",
        stamp_s=stamp_s,
    )


def truths_from_rows(
    labels: KittiObjects, category: Category, world_from_ego: Sequence[Pose]
) -> tuple[Truth, ...]:
    """Return the labels of one class as the truth of each frame, in the world.

    world_from_ego: the pose of each frame.
    Velocities are differences of the centres, see `KittiSequence`.
    """
    scored = replace(labels, scores=np.ones(len(labels)))
    boxes = detections_from_rows(scored, category, stamp_s=0.0, normalized=True)
    rows = [np.flatnonzero(labels.frames == t) for t in range(len(world_from_ego))]
    in_world = [
        boxes.select(r).moved(pose, "world") for r, pose in zip(rows, world_from_ego, strict=True)
    ]
    centres = np.empty((len(labels), 3))
    for r, box in zip(rows, in_world, strict=True):
        centres[r] = box.centres
    velocities = _velocities(labels, centres)
    return tuple(
        truth_of_labels(labels.ids[r], box, velocities[r], pose, stamp_s=PERIOD_S * t)
        for t, (r, box, pose) in enumerate(zip(rows, in_world, world_from_ego, strict=True))
    )


def kitti_objects(
    tracks: Tracks,
    frame: int,
    world_from_ego: Pose,
    projection: np.ndarray,
    image_size: ImageSize,
    *,
    all_around: bool = False,
) -> KittiObjects:
    """Return the tracks of one frame as KITTI's rows; tracks outside of the image are left out.

    frame: the frame number, from 0.
    world_from_ego: the pose of the same frame; see this module for the ego frame.
    projection: (3, 4), pixels from metres in the rectified camera frame.
    image_size: boxes are clipped to it.
    all_around: keep the tracks outside of the image too, with empty image boxes.
    """
    in_ego = tracks.moved(world_from_ego.inverse(), "ego") if tracks.frame == "world" else tracks
    # The exact inverse of what `Detections.moved` does to yaws. The inverse of a tilted pose would
    # give yaws that differ by a few hundredths of a degree.
    yaws = tracks.yaws - world_from_ego.yaw if tracks.frame == "world" else tracks.yaws
    rows = _rows_in_space(in_ego, yaws, projection, image_size)
    rows = replace(rows, frames=np.full(len(rows), frame), ids=in_ego.ids)
    return rows if all_around else rows.select(rows.in_image)


@dataclass(frozen=True, slots=True)
class LabelCamera:
    """The camera in whose rectified frame label files are.

    projection: (3, 4), pixels from metres in that frame; None if it is not known.
    image_size: image boxes are clipped to it; None if it is not known.
    """

    camera_from_ego: Pose
    projection: np.ndarray | None = None
    image_size: ImageSize | None = None


def kitti_results(fused: FusedDetections, camera: LabelCamera) -> KittiObjects:
    """Return the detections of one frame, ego frame, as KITTI's rows; all around, not in view only.

    A box in space without an image box gets that around its corners, if the projection is known
    and shows it.
    """
    in_camera = fused.detections().moved(EGO_FROM_CAMERA @ camera.camera_from_ego, "ego")
    in_space = _rows_in_space(in_camera, in_camera.yaws, camera.projection, camera.image_size)
    rows = _rows_of(fused.categories, fused.scores)
    columns: dict[str, np.ndarray] = {}
    for name in ("boxes", "alphas", "sizes", "bottoms", "rotations_y"):
        columns[name] = getattr(rows, name).copy()
        columns[name][fused.has_box] = getattr(in_space, name)
    columns["boxes"][fused.has_image_box] = fused.image_boxes[fused.has_image_box]
    return replace(rows, **columns)


def _rows_in_space(
    boxes: Detections | Tracks,
    yaws: np.ndarray,
    projection: np.ndarray | None,
    image_size: ImageSize | None,
) -> KittiObjects:
    """Return boxes in the ego frame as rows without frame and id.

    yaws: of the boxes, in place of their own.
    Image boxes are those around the corners, empty where the image does not show the box; -1
    without a projection.
    """
    rows = _rows_of(boxes.categories, boxes.scores)
    bottoms = bottoms_from_centres(boxes.centres, boxes.sizes)
    rotations = rotations_from_yaws(yaws)
    around = rows.boxes
    if projection is not None:
        corners = box_corners(bottoms, boxes.sizes, rotations)
        around = (
            np.nan_to_num(image_boxes(corners, projection), nan=0.0)
            if image_size is None
            else clipped_image_boxes(corners, projection, image_size)
        )
    return replace(
        rows,
        alphas=observation_angles(bottoms, rotations),
        boxes=around,
        sizes=boxes.sizes,
        bottoms=bottoms,
        rotations_y=rotations,
    )


def _rows_of(categories: np.ndarray, scores: np.ndarray) -> KittiObjects:
    """Return rows of which only category and score are known."""
    n = len(scores)
    unknown = np.full(n, -1)
    return KittiObjects(
        frames=np.zeros(n, np.int64),
        ids=unknown,
        types=np.array([TYPE_FROM_CATEGORY[Category(c)] for c in categories], np.int8),
        truncated=unknown,
        occluded=unknown,
        alphas=np.full(n, UNKNOWN_ANGLE),
        boxes=np.full((n, 4), UNKNOWN_BOX),
        sizes=np.full((n, 3), UNKNOWN_SIZE),
        bottoms=np.full((n, 3), UNKNOWN_PLACE),
        rotations_y=np.full(n, UNKNOWN_ANGLE),
        scores=scores,
    )


def truth_of_labels(
    ids: np.ndarray,
    boxes: Detections,
    velocities: np.ndarray,
    world_from_ego: Pose,
    *,
    stamp_s: float,
    image_boxes: np.ndarray | None = None,
) -> Truth:
    """Return labelled boxes, world frame, as truth; labels do not say what shows of an object."""
    unknown = np.full(len(ids), NOT_COUNTED)
    return Truth(
        ids=ids,
        categories=boxes.categories,
        centres=boxes.centres,
        sizes=boxes.sizes,
        yaws=boxes.yaws,
        velocities=velocities,
        lidar_returns=unknown,
        visible_pixels=unknown,
        occluded_fraction=unknown.astype(np.float64),
        world_from_ego=world_from_ego,
        stamp_s=stamp_s,
        sources=np.empty(0, np.int64),
        image_boxes=image_boxes,
    )


def _velocities(labels: KittiObjects, centres: np.ndarray) -> np.ndarray:
    """Return (N, 2) m/s: differences of each object's (N, 3) world centres over its frames."""
    velocities = np.zeros((len(labels), 2))
    for number in np.unique(labels.ids):
        rows = np.flatnonzero(labels.ids == number)
        rows = rows[np.argsort(labels.frames[rows])]
        if len(rows) > 1:
            stamps = PERIOD_S * labels.frames[rows]
            velocities[rows] = np.gradient(centres[rows, :2], stamps, axis=0)
    return velocities
