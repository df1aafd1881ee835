import numpy as np

from roadscope.benchmarks import Episode, parked_centres, parked_owners, sensed

EPISODE = Episode("intersection", 20000, "hdl32e", 1.0)


def test_returns_of_parked_cars_surround_their_centres() -> None:
    low, high = {}, {}
    for frame, truth in sensed(EPISODE):
        assert frame.lidar is not None
        world = (truth.world_from_ego @ frame.calibration.pose("lidar")).apply(frame.lidar.points)
        for owner in parked_owners(truth):
            own = world[truth.sources == owner, :2]
            low[owner] = np.minimum(low.get(owner, np.inf), own.min(axis=0))
            high[owner] = np.maximum(high.get(owner, -np.inf), own.max(axis=0))
    assert low
    centres = parked_centres(EPISODE, low)
    for owner, centre in zip(sorted(low), centres, strict=True):
        # A car is at most 5.3 m long; the sweep's own motion shears it by about a metre.
        assert (centre > high[owner] - 4.0).all()
        assert (centre < low[owner] + 4.0).all()


def test_no_parked_cars_have_no_centres() -> None:
    assert parked_centres(EPISODE, []).shape == (0, 2)
