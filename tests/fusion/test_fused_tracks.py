"""Fused detections know what is a pedestrian, and so keep it apart from the car beside it."""

import numpy as np
import pytest
from toy_camera import looking_ahead

from roadscope.core import Category, Detections, Family, ImageDetections, Pose, TrackState
from roadscope.fusion import FUSIONS, projected_boxes
from roadscope.trackers import TRACKERS, is_offline

LOOK = looking_ahead(2.0, focal_px=420.0)
FRAMES, PERIOD_S = 30, 0.1
MISSED = (14,)
"""Frames in which no sensor finds the pedestrian."""
SIZES = np.array([[4.4, 1.8, 1.5], [0.5, 0.6, 1.7]])
KINDS = np.array([Category.CAR, Category.PEDESTRIAN], np.int8)
FUSED = ("consistent", "li2021", "union", "lidar-first")


def moment(k: int, rng: np.random.Generator) -> tuple[Detections, ImageDetections]:
    """A car stands, a pedestrian walks past 0.6 m beside it; to LiDAR all are cars."""
    stamp_s = k * PERIOD_S
    walked = np.array([14.0 + 1.4 * stamp_s, 3.8, 0.85])
    centres = np.array([[16.0, 2.0, 0.75], walked])
    centres[:, :2] += 0.08 * rng.standard_normal((2, 2))
    there = np.arange(1 if k in MISSED else 2)
    true = Detections(
        centres, SIZES, np.zeros(2), KINDS, np.array([0.9, 0.7]), "ego", stamp_s
    ).select(there)
    boxes, _ = projected_boxes(true, LOOK)
    boxes = boxes + rng.standard_normal(boxes.shape)
    camera = ImageDetections(boxes, true.categories, np.full(len(there), 0.95), stamp_s + 0.01)
    as_cars = np.full(len(there), Category.CAR, np.int8)
    lidar = Detections(true.centres, true.sizes, true.yaws, as_cars, true.scores, "ego", stamp_s)
    return lidar, camera


def ids_by_family(tracker: str, fusion: str | None) -> list[tuple[set[int], set[int]]]:
    """Return ids of tracks of pedestrians and of others, frame by frame."""
    rng, plugin = np.random.default_rng(3), TRACKERS.make(tracker)
    joins = FUSIONS.make(fusion) if fusion else None
    reported_ids = []
    for k in range(FRAMES):
        lidar, camera = moment(k, rng)
        detections = joins.fuse(lidar, camera, LOOK).detections() if joins else lidar
        tracks = plugin.update(detections, Pose.identity())
        sure = tracks.states != TrackState.TENTATIVE
        people = np.array([Category(c).family is Family.PEDESTRIAN for c in tracks.categories])
        people = people.astype(bool)
        reported_ids.append(
            (set(tracks.ids[sure & people].tolist()), set(tracks.ids[sure & ~people].tolist()))
        )
    return reported_ids


BY_OVERLAP = ("roboflow-bytetrack", "roboflow-oc-sort")
"""They match by overlap alone, which a step leaves little of: they begin anew after a miss."""
ONLINE = [n for n in TRACKERS.installed() if not is_offline(TRACKERS.resolve(n).factory)]


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ONLINE)
def test_a_pedestrian_beside_a_car_keeps_its_own_track(tracker: str) -> None:
    reported_ids = ids_by_family(tracker, "consistent")
    people = set().union(*(p for p, _ in reported_ids))
    others = set().union(*(o for _, o in reported_ids))
    assert not people & others
    assert len(others) == 1
    assert len(people) == 1 or tracker in BY_OVERLAP
    reported = [bool(p) for p, _ in reported_ids[10:]]
    assert np.mean(reported) > 0.8


@pytest.mark.parametrize("fusion", FUSED)
def test_whichever_fusion_names_it(fusion: str) -> None:
    reported_ids = ids_by_family("existence", fusion)
    assert len(set().union(*(p for p, _ in reported_ids))) == 1
    reported = [bool(people) for k, (people, _) in enumerate(reported_ids) if k not in MISSED]
    assert all(reported[5:]), "what is detected again and again is told of"


@pytest.mark.parametrize("tracker", ["existence", "gnn"])
def test_without_a_camera_the_pedestrian_is_not_recognized(tracker: str) -> None:
    assert not set().union(*(p for p, _ in ids_by_family(tracker, None)))
