import numpy as np

from roadscope.envs.traffic import RoadMap
from roadscope.envs.world import CACHED_ROADS, cached_per_road
from tests.envs.worlds import straight


def test_equal_roads_are_computed_once():
    computed_roads = []

    @cached_per_road
    def count(road: RoadMap) -> int:
        computed_roads.append(road)
        return len(road.points)

    assert count(straight(2)) == count(straight(2)) == len(straight(2).points)
    assert len(computed_roads) == 1
    assert count(straight(3)) == len(straight(3).points)
    wider = straight(2, width_m=3.0)
    assert not np.array_equal(wider.widths, straight(2).widths)
    count(wider)
    assert len(computed_roads) == 3


def test_the_cache_of_roads_is_bounded():
    computed_roads = []

    @cached_per_road
    def note(road: RoadMap) -> None:
        computed_roads.append(road)

    roads = [straight(1, length_m=10.0 + 2 * i) for i in range(CACHED_ROADS + 1)]
    for road in [*roads, roads[0]]:
        note(road)
    assert len(computed_roads) == CACHED_ROADS + 2
