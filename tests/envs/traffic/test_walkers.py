import numpy as np
import pytest
from bodies import gaps_m

from roadscope.core import Category
from roadscope.envs.traffic import Timeline, record, rounded_path

PEOPLE = (Category.PEDESTRIAN, Category.CYCLIST)


@pytest.fixture(scope="module", params=["street", "town-crossing"])
def timeline(request: pytest.FixtureRequest) -> Timeline:
    return record(request.param, 5, 16.0)


@pytest.mark.slow
def test_no_person_is_hit(timeline: Timeline) -> None:
    of_people = np.isin(timeline.categories, PEOPLE)
    assert of_people.sum() > 10
    for k in range(0, len(timeline.stamps_s), 4):
        people = of_people[timeline.present[k]]
        assert gaps_m(timeline, k)[people][:, ~people].min(initial=np.inf) > 0


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
