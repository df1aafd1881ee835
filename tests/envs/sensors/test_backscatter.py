"""Weather in scans against the laws it is made from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import lambertw
from scipy.stats import kstest

from roadscope.core import WEATHER, LidarScan, Pose
from roadscope.envs.raycast import Scene
from roadscope.envs.sensors import (
    APERTURE_M,
    CLEAR,
    DIVERGENCE_RAD,
    SPECS,
    WEATHERS,
    LidarSpec,
    SweepTruth,
    Weather,
    echo_rate,
    echoes,
    fog,
    overlap,
    rain,
    sweep,
)
from roadscope.envs.world import Prisms

SKY = np.radians(np.linspace(1.0, 30.0, 32))
WALL = np.array([[0.0, -1], [1, -1], [1, 1], [0, 1]])
LIMIT = SPECS["hdl32e"].detection_limit / SPECS["hdl32e"].range_max_m ** 2


def spec(**changes: object) -> LidarSpec:
    """Return an HDL-32E without noise and dropout, except as named."""
    silent = {"range_noise_m": 0.0, "range_resolution_m": 0.0, "dropout": 0.0}
    return replace(SPECS["hdl32e"], **{**silent, **changes})


def measure(
    scene: Scene, lidar: LidarSpec, weather: Weather, seed: int = 0
) -> tuple[LidarScan, SweepTruth]:
    return sweep(
        scene,
        lidar,
        [Pose.planar(0, 0, 0, 1.9)],
        0.1,
        rng=np.random.default_rng(0),
        weather=weather,
        weather_seed=seed,
    )


def walls(ranges: np.ndarray, reflectivity: float = 0.5) -> Scene:
    """One wall across the view, cut into prisms at different distances by bearing."""
    bearings = np.linspace(-3.0, 3.0, len(ranges))
    prisms = []
    for owner, (range_m, bearing) in enumerate(zip(ranges, bearings, strict=True)):
        cos, sin = np.cos(bearing), np.sin(bearing)
        turned = (WALL * [1, 0.02 * range_m] + [range_m, 0]) @ np.array([[cos, sin], [-sin, cos]])
        prisms.append(Prisms.of(turned, 0.0, 60.0, owner=-2 - owner, reflectivity=reflectivity))
    return Scene.still(Prisms.join(prisms), Prisms.empty(), np.empty((0, 3)))


def empty() -> Scene:
    return Scene.still(Prisms.empty(), Prisms.empty(), np.empty((0, 3)))


def echo_ranges(weather: Weather, sweeps: int, **changes: object) -> tuple[np.ndarray, int]:
    """Ranges of the echoes of rays into the sky, and how many rays there were."""
    lidar = spec(elevations=SKY, **changes)
    echo_list = []
    for seed in range(sweeps):
        scan, truth = measure(empty(), lidar, weather, seed)
        assert (truth.owners == WEATHER).all()
        echo_list.append(np.linalg.norm(scan.points, axis=1))
    return np.concatenate(echo_list), sweeps * lidar.beams * lidar.columns


@pytest.mark.parametrize("weather", [rain(50.0), fog(300.0), fog(100.0)])
def test_intensity_falls_by_beer_and_lambert(weather: Weather) -> None:
    scene = walls(np.linspace(8.0, 60.0, 40))
    lidar = spec(
        detection_limit=1e-5, elevations=np.radians([0.2, 0.6, 1.0]), firing_offsets_s=np.zeros(3)
    )
    clear, _ = measure(scene, lidar, CLEAR)
    scan, truth = measure(scene, lidar, weather)
    image = np.full((lidar.beams, lidar.columns), np.nan)
    image[clear.ring, clear.column] = clear.intensity
    surface = truth.owners <= -2
    surface &= truth.owners != WEATHER
    ranges = np.linalg.norm(scan.points[surface], axis=1)
    ratio = np.log(scan.intensity[surface] / image[scan.ring[surface], scan.column[surface]])
    assert np.ptp(ranges) > 20
    slope, start = np.polyfit(ranges, ratio, 1)
    assert slope == pytest.approx(-2 * weather.extinction_per_m, rel=1e-4)
    assert start == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("reflectivity", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("weather", [rain(100.0), fog(200.0), fog(120.0)])
def test_surfaces_are_visible_as_far_as_the_law_says(weather: Weather, reflectivity: float) -> None:
    alpha = weather.extinction_per_m
    # reflectivity * exp(-2 alpha r) = limit * r^2
    reach = float(lambertw(alpha * np.sqrt(reflectivity / LIMIT)).real) / alpha
    ranges = np.linspace(0.9, 1.1, 81) * reach
    lidar = spec(elevations=np.radians([0.01]), firing_offsets_s=np.zeros(1))
    _, truth = measure(walls(ranges, reflectivity), lidar, weather)
    visible = np.isin(-2 - np.arange(81), truth.owners)
    # The middle of a wall is hit at a right angle; its edges are slightly farther.
    assert visible[ranges < 0.999 * reach].all()
    assert not visible[ranges > 1.001 * reach].any()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("weather", [rain(100.0), rain(400.0), fog(150.0), fog(100.0), fog(50.0)])
def test_number_and_range_of_echoes_follow_the_integral(weather: Weather) -> None:
    ranges, rays = echo_ranges(weather, 4)
    edges = np.linspace(0.9, 30.0, 1501)
    middles, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    powers = np.geomspace(0.1, LIMIT, 3000)
    below = echo_rate(weather, powers[:, None], middles) * width
    tails = below.sum(axis=1)
    chance = 1 - np.exp(-tails[-1])
    deviation = np.sqrt(rays * chance * (1 - chance))
    assert abs(len(ranges) - rays * chance) < 4 * deviation + 2e-4 * rays * chance
    # Density of the strongest echo: echoes of a power, times the chance that none is stronger.
    survival = np.exp(-(tails[1:] + tails[:-1]) / 2)
    density = (np.diff(below, axis=0) * survival[:, None]).sum(axis=0)
    shares = np.append(0, np.cumsum(density)) / density.sum()
    result = kstest(ranges, lambda r: np.interp(r, edges, shares))
    assert result.statistic < 1.63 / np.sqrt(len(ranges)) + 0.004


def test_rain_is_the_drops_that_the_beam_meets() -> None:
    """Throw single drops of Marshall and Palmer's sizes into a beam and take the brightest."""
    weather, rng, rays, far = rain(400.0), np.random.default_rng(1), 20_000, 14.0
    slope = 4.1 * 400.0**-0.21
    least_mm = 1.0
    width = APERTURE_M + DIVERGENCE_RAD * far
    volume = np.pi / 4 * width**2 * far
    number = rng.poisson(8000 / slope * np.exp(-slope * least_mm) * volume, rays)
    ray = np.repeat(np.arange(rays), number)
    sizes = (least_mm + rng.exponential(1 / slope, len(ray))) * 1e-3
    ranges = rng.uniform(0, far, len(ray))
    inside = rng.random(len(ray)) < ((APERTURE_M + DIVERGENCE_RAD * ranges) / width) ** 2
    inside &= (ranges > 0.9) & (sizes < 8e-3)
    area = np.pi / 4 * (APERTURE_M + DIVERGENCE_RAD * ranges) ** 2
    scattered = 2 * np.pi / 4 * sizes**2 / weather.lidar_ratio_sr
    power = np.pi * scattered / area * overlap(ranges) / ranges**2
    power *= np.exp(-2 * weather.extinction_per_m * ranges)
    heard = inside & (power > LIMIT)
    order = np.lexsort((-power[heard], ray[heard]))
    winners, first = np.unique(ray[heard][order], return_index=True)
    drop_ranges_m, total = echo_ranges(weather, 1)
    chance = len(winners) / rays
    assert len(drop_ranges_m) / total == pytest.approx(chance, abs=4 * np.sqrt(chance / rays))
    assert kstest(drop_ranges_m, ranges[heard][order][first]).pvalue > 1e-3


@pytest.mark.parametrize("kind", ["rain", "fog"])
def test_severity_loses_surfaces_and_adds_echoes(kind: str) -> None:
    scene = walls(np.linspace(8.0, 90.0, 60))
    lost, false = [], []
    for n in range(1, 6):
        _, truth = measure(scene, spec(), WEATHERS[f"{kind}-{n}"])
        false.append(int((truth.owners == WEATHER).sum()))
        lost.append(-int((truth.owners != WEATHER).sum()))
    assert (np.diff(lost) >= 0).all()
    assert (np.diff(false) >= 0).all()
    assert lost[0] < lost[-1]
    assert false[0] < 100 < false[-1]


def test_the_strongest_return_wins() -> None:
    """In thick fog a bright wall nearby is detected behind echoes, and almost nothing else."""
    lidar = spec(elevations=np.radians([0.2]), firing_offsets_s=np.zeros(1))
    near, _ = echo_ranges(fog(50.0), 1)
    distances = np.array([6.0, 6.0, 30.0, 30.0])
    for reflectivity, expected in ((0.9, [True, True, False, False]), (0.0, [False] * 4)):
        _, truth = measure(walls(distances, reflectivity), lidar, fog(50.0))
        assert np.isin(-2 - np.arange(4), truth.owners).tolist() == expected
        assert np.median(near) < 6.0


def test_no_echo_comes_from_behind_a_surface() -> None:
    scene = walls(np.full(300, 3.5), 0.0)
    lidar = spec(elevations=np.radians([0.2]), firing_offsets_s=np.zeros(1))
    scan, truth = measure(scene, lidar, fog(50.0))
    bearing = np.abs(np.arctan2(scan.points[:, 1], scan.points[:, 0])) < 2.9
    echo = np.linalg.norm(scan.points[bearing & (truth.owners == WEATHER)], axis=1)
    assert len(echo) > 500
    assert echo.max() < 3.6


def test_air_without_echoes_has_empty_tables() -> None:
    assert len(echoes(fog(2000.0), 0.9, 100.0, LIMIT).tails) == 0
    assert echo_rate(CLEAR, np.array([1e-6]), np.array([5.0])).tolist() == [0.0]


def test_a_receiver_without_limit_is_served() -> None:
    scan, truth = measure(empty(), spec(detection_limit=0.0), fog(100.0))
    assert len(scan) == 32 * 2170
    assert (truth.owners == WEATHER).sum() > 20_000
