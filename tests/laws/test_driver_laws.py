"""Every registered driver: the contract of all drivers, and what all of them have to do."""

from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import Tracks
from roadscope.driving import DRIVERS, ClosedLoop
from roadscope.testing import contract_items


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", DRIVERS.installed())
def test_contract(name) -> None:
    for item in contract_items(name):
        item.verify()


@pytest.mark.parametrize("name", DRIVERS.installed())
def test_it_brakes_for_what_stands_ahead_and_for_a_line(name) -> None:
    loop = ClosedLoop("two-way", 0, perception="blind", rig="vlp16", duration_s=5.0)
    driver = DRIVERS.make(name)
    scene = loop.scene(loop.tracks())
    free = driver.drive(scene).acceleration_m_s2
    # The model of the simulation, which the IDM drivers follow, brakes for these as for a car.
    model = replace(scene.model, acceleration_m_s2=-6.0)
    following = replace(scene.following, acceleration_m_s2=-6.0)
    both = {"model": model, "following": following}
    near = replace(scene, gap_m=8.0, leader_speed_m_s=0.0, **both)
    line = replace(scene, line_m=8.0, **both)
    assert free > -0.5
    for other in (near, line):
        driver.reset()  # A driver may decide at every second call only.
        assert driver.drive(other).acceleration_m_s2 < free - 3.0


@pytest.mark.parametrize("name", DRIVERS.installed())
def test_it_brakes_for_a_track_and_not_without(name) -> None:
    loop = ClosedLoop("two-way", 0, perception="truth", rig="vlp16", duration_s=5.0)
    truth = loop.tracks()
    ahead = loop.traffic.world_from_ego.apply(np.array([[18.0, 0.0, 0.8]]))
    standing = replace(
        truth,
        centres=np.repeat(ahead, len(truth), axis=0),
        velocities=np.zeros((len(truth), 2)),
        yaws=truth.yaws + np.pi,
    )
    driver = DRIVERS.make(name)
    free = driver.drive(loop.scene(Tracks.empty(0.0, "world"))).acceleration_m_s2
    driver.reset()
    assert driver.drive(loop.scene(standing)).acceleration_m_s2 < free - 3.0


@pytest.mark.parametrize("name", DRIVERS.installed())
def test_it_drives_on_a_free_road(name) -> None:
    loop = ClosedLoop("motorway", 0, perception="blind", rig="vlp16", duration_s=3.0)
    driver = DRIVERS.make(name)
    while not loop.over:
        loop.step(driver.drive(loop.scene(loop.tracks())))
    assert loop.traffic.speed_m_s > 0.7 * loop.traffic.desired_speed_m_s
    assert np.isfinite(loop.traffic.speed_m_s)
