import numpy as np
import pytest

from roadscope.core import Category
from roadscope.envs.traffic import Timeline, record, rounded_path

PEOPLE = (Category.PEDESTRIAN, Category.CYCLIST)


@pytest.fixture(scope="module", params=["street", "town-crossing"])
def timeline(request: pytest.FixtureRequest) -> Timeline:
    return record(request.param, 5, 16.0)


def corners(timeline: Timeline, k: int, row: int, grow_m: float = 0.0) -> np.ndarray:
    ahead = np.array([np.cos(timeline.yaws[k, row]), np.sin(timeline.yaws[k, row])])
    left = np.array([-ahead[1], ahead[0]])
    centre = timeline.axles[k, row] + timeline.centre_ahead_m[row] * ahead
    length, width = timeline.sizes[row, :2] / 2 + grow_m
    return np.array(
        [
            centre + a * length * ahead + b * width * left
            for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
    )


def apart(first: np.ndarray, second: np.ndarray) -> bool:
    """Separating axes of two rectangles."""
    for box in (first, second):
        for edge in (box[1] - box[0], box[2] - box[1]):
            a, b = first @ edge, second @ edge
            if a.max() < b.min() or b.max() < a.min():
                return True
    return False


@pytest.mark.slow
def test_no_person_is_hit(timeline: Timeline) -> None:
    people = np.flatnonzero(np.isin(timeline.categories, PEOPLE))
    others = np.flatnonzero(~np.isin(timeline.categories, PEOPLE))
    assert len(people) > 10
    for k in range(0, len(timeline.stamps_s), 4):
        for p in people[timeline.present[k, people]]:
            for o in others[timeline.present[k, others]]:
                if np.linalg.norm(timeline.axles[k, p] - timeline.axles[k, o]) < 12:
                    assert apart(corners(timeline, k, p), corners(timeline, k, o))


@pytest.mark.slow
def test_people_move_as_people_do(timeline: Timeline) -> None:
    on_foot = timeline.categories == Category.PEDESTRIAN
    riding = timeline.categories == Category.CYCLIST
    assert on_foot.sum() > 8
    assert riding.any()
    assert timeline.speeds[:, on_foot].max() < 2.0
    assert 2.5 < timeline.speeds[:, riding].max() < 6.5
    steps = np.diff(timeline.speeds[:, on_foot], axis=0) / 0.05
    both = timeline.present[1:, on_foot] & timeline.present[:-1, on_foot]
    assert np.abs(steps[both]).max() < 5.0
    heights = timeline.sizes[on_foot, 2]
    assert 1.0 < heights.min() <= heights.max() < 2.1


@pytest.mark.slow
def test_people_cross_the_road() -> None:
    crossed = 0
    for seed in range(2):
        timeline = record("street", seed, 12.0)
        on_foot = np.flatnonzero(timeline.categories == Category.PEDESTRIAN)
        across = timeline.axles[:, on_foot, 1]
        crossed += int((np.abs(across[0] - across[-1]) > 8.0).sum())
    assert crossed >= 2


def test_corners_are_cut_and_ends_stay() -> None:
    path = rounded_path(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]))
    assert np.allclose(path[[0, -1]], [[0, 0], [4, 4]])
    turns = np.abs(np.diff(np.arctan2(*np.diff(path, axis=0).T[::-1])))
    assert turns.max() < 0.5
