"""Every registered driver: the contract of all drivers, and what all of them have to do."""

from dataclasses import replace

import numpy as np
import pytest

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
    near = replace(scene, gap_m=8.0, leader_speed_m_s=0.0)
    line = replace(scene, line_m=8.0)
    assert free > -0.5
    for wanted in (near, line):
        if name.startswith("idm"):
            continue  # Its answer is that of the simulation's model, which is part of the scene.
        assert driver.drive(wanted).acceleration_m_s2 < free - 3.0


@pytest.mark.parametrize("name", DRIVERS.installed())
def test_it_drives_on_a_free_road(name) -> None:
    loop = ClosedLoop("motorway", 0, perception="blind", rig="vlp16", duration_s=3.0)
    driver = DRIVERS.make(name)
    while not loop.over:
        loop.step(driver.drive(loop.scene(loop.tracks())))
    assert loop.traffic.speed_m_s > 0.7 * loop.traffic.desired_speed_m_s
    assert np.isfinite(loop.traffic.speed_m_s)
