import numpy as np
import pytest

from roadscope.core import WEATHER, LidarScan, RecordError
from roadscope.envs import find_rig
from roadscope.envs.sensors import CLEAR, WEATHERS, Sensing, Weather, fog, rain, sense, weather
from roadscope.envs.traffic import Timeline, record
from roadscope.envs.world import kinds_of


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    return record("merge", 3, 1.0)


def test_presets_are_known_by_name() -> None:
    assert [*WEATHERS] == ["clear", *(f"{k}-{n}" for k in ("rain", "fog") for n in range(1, 6))]
    assert all(weather(name).name == name for name in WEATHERS)
    assert weather("fog") is weather("fog-3")
    assert weather("rain") is weather("rain-3")
    assert weather(CLEAR) is CLEAR


def test_unknown_weather_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"no weather 'fogg' \(did you mean 'fog'"):
        weather("fogg")
    with pytest.raises(TypeError, match="a name or a Weather, got 3"):
        weather(3)  # type: ignore[arg-type]
    with pytest.raises(RecordError, match=r"Weather\.extinction_per_m: expected above 0"):
        Weather("fog", 2)
    with pytest.raises(RecordError, match=r"Weather\.kind: expected clear or rain or fog"):
        Weather("snow", 2, 0.1)


@pytest.mark.parametrize("kind", ["rain", "fog"])
def test_extinction_grows_with_severity(kind: str) -> None:
    extinctions = [WEATHERS[f"{kind}-{n}"].extinction_per_m for n in range(1, 6)]
    assert extinctions[0] > 0
    assert (np.diff(extinctions) > 0).all()


def test_rain_takes_out_twice_the_outline_of_its_drops() -> None:
    diameters = np.linspace(0, 30e-3, 200_001)
    for rate in (2.0, 25.0, 100.0):
        number = 8000e3 * np.exp(-4.1 * rate**-0.21 * diameters * 1e3)
        extinction = np.trapezoid(number * np.pi / 2 * diameters**2, diameters)
        assert rain(rate).extinction_per_m == pytest.approx(extinction, rel=0.005)


def test_fog_leaves_two_per_cent_of_contrast() -> None:
    assert np.exp(-fog(150.0).extinction_per_m * 150) == pytest.approx(0.02, rel=1e-3)


def test_clear_air_changes_no_byte(timeline: Timeline) -> None:
    assert list(sense(timeline, find_rig("lux"), 2, weather="clear")) == list(
        sense(timeline, find_rig("lux"), 2)
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rain-5", "fog-3"])
def test_weather_comes_from_the_seed_and_leaves_the_rest_alone(
    timeline: Timeline, name: str
) -> None:
    clear = list(sense(timeline, find_rig("vlp16"), 2))
    first = list(sense(timeline, find_rig("vlp16"), 2, weather=name))
    assert first == list(sense(timeline, find_rig("vlp16"), 2, weather=name))
    for (frame, truth), (dry, bare) in zip(first, clear, strict=True):
        assert frame != dry
        assert frame.previous_from_ego == dry.previous_from_ego
        assert truth.world_from_ego == bare.world_from_ego
        for field in ("ids", "centres", "occluded_fraction"):
            assert np.array_equal(getattr(truth, field), getattr(bare, field))
        assert (truth.lidar_returns <= bare.lidar_returns).all()
        wet = truth.sources == WEATHER
        assert wet.any()
        assert not (bare.sources == WEATHER).any()
        counted = [(truth.sources == i).sum() for i in truth.ids]
        np.testing.assert_array_equal(truth.lidar_returns, counted)
        _same_where_not_weather(frame.lidar, ~wet, dry.lidar)
        assert (kinds_of(truth.sources[wet]) == -1).all()


def _same_where_not_weather(scan: LidarScan, of_surfaces: np.ndarray, clear: LidarScan) -> None:
    """Check that returns of surfaces lie where they lie in clear air."""
    places = {(r, c): p for r, c, p in zip(clear.ring, clear.column, clear.points, strict=True)}
    for r, c, p in zip(
        scan.ring[of_surfaces], scan.column[of_surfaces], scan.points[of_surfaces], strict=True
    ):
        assert np.array_equal(places[r, c], p)


def test_a_sweep_of_its_own_has_the_same_weather(timeline: Timeline) -> None:
    whole = list(sense(timeline, find_rig("lux"), 7, weather="fog-4"))
    assert Sensing(find_rig("lux"), 7, weather="fog-4").sense(timeline, 3) == whole[3]
