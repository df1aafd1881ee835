from __future__ import annotations

import numpy as np
import pytest

from roadscope.envs.sensors import SPECS

ROUND_US = {"vlp16": 55.296, "hdl32e": 46.08}


@pytest.mark.parametrize(
    ("name", "beams", "rays", "lowest", "highest"),
    [
        ("lux", 4, 1_760, -1.2, 1.2),
        ("vlp16", 16, 28_928, -15.0, 15.0),
        ("hdl32e", 32, 69_440, -30.67, 10.67),
        ("hdl64e", 64, 133_312, -24.33, 2.0),
    ],
)
def test_beams_and_rays(name: str, beams: int, rays: int, lowest: float, highest: float) -> None:
    spec = SPECS[name]
    assert spec.name == name
    assert spec.beams == beams
    assert spec.beams * spec.columns == rays
    assert np.degrees(spec.elevations[[0, -1]]) == pytest.approx([lowest, highest], abs=0.01)


@pytest.mark.parametrize("name", ["vlp16", "hdl32e", "hdl64e"])
def test_spinning_lidars_begin_at_the_rear_and_turn_clockwise(name: str) -> None:
    azimuths = SPECS[name].azimuths()
    assert azimuths[0] == pytest.approx(np.pi)
    assert (np.diff(azimuths) < 0).all()
    ahead = np.abs(azimuths).argmin()
    assert abs(SPECS[name].column_offsets_s()[ahead]) < 1e-4


@pytest.mark.parametrize("name", list(ROUND_US))
def test_rounds_fill_a_turn(name: str) -> None:
    spec = SPECS[name]
    assert spec.sweep_s / spec.columns == pytest.approx(ROUND_US[name] * 1e-6, rel=1e-3)
    assert spec.firing_offsets_s.min() == 0
    assert spec.firing_offsets_s.max() < spec.sweep_s / spec.columns


def test_firing_order_of_the_manuals() -> None:
    degrees = np.degrees(SPECS["vlp16"].elevations)[np.argsort(SPECS["vlp16"].firing_offsets_s)]
    assert degrees[:6] == pytest.approx([-15, 1, -13, 3, -11, 5])
    degrees = np.degrees(SPECS["hdl32e"].elevations)[np.argsort(SPECS["hdl32e"].firing_offsets_s)]
    assert degrees[:4] == pytest.approx([-30.67, -9.33, -29.33, -8.0])
    assert degrees[15] == pytest.approx(0.0)
    assert degrees[-1] == pytest.approx(10.67)


def test_two_blocks_of_the_hdl64e_fire_together() -> None:
    spec = SPECS["hdl64e"]
    assert sorted(spec.firing_offsets_s)[::2] == sorted(spec.firing_offsets_s)[1::2]
    steps = np.degrees(np.diff(spec.elevations))
    assert steps[:31] == pytest.approx(0.5)
    assert steps[32:] == pytest.approx(1 / 3)


def test_lux_samples_the_view_ahead_evenly() -> None:
    spec = SPECS["lux"]
    assert np.degrees(spec.azimuths()[[0, 220]]) == pytest.approx([55.0, 0.0])
    assert spec.period_s == pytest.approx(0.08)
    assert np.degrees(np.diff(spec.azimuths())) == pytest.approx(-0.25)
