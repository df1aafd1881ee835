from __future__ import annotations

import pytest

from roadscope.benchmarks.speed import (
    FRAMES,
    LEAD,
    SCENES,
    detector_steps,
    driven_frames,
    measure_detectors,
    timed_frames,
)
from roadscope.core import Detections, Frame
from roadscope.detectors import DETECTORS


class Counting:
    """Detects nothing, and counts its drives."""

    drives = 0

    def reset(self) -> None:
        Counting.drives += 1

    def detect(self, frame: Frame) -> Detections:
        return Detections.empty(frame.stamp_s)


@pytest.mark.slow
def test_every_registered_detector_is_measured() -> None:
    rows = measure_detectors("lux", 1, scenes=SCENES[:1])
    expected = [f"detector {name}, lux" for name in DETECTORS.names()]
    assert [row.name for row in rows[::2]] == expected
    assert [row.name for row in rows[1::2]] == [f"{name}, slowest frame" for name in expected]
    assert all(0 < median.value <= slowest.value for median, slowest in pairs(rows))


def pairs(rows):  # type: ignore[no-untyped-def]
    return list(zip(rows[::2], rows[1::2], strict=True))


def test_specs_are_measured() -> None:
    median, slowest = measure_detectors("lux", 1, ["distance?distance_m=2"], SCENES[:1])
    assert median.name == "detector distance?distance_m=2, lux"
    assert 0 < median.value <= slowest.value


@pytest.mark.slow
def test_frames_before_the_lead_are_not_timed() -> None:
    frames = driven_frames("lux")
    assert len(frames) == FRAMES
    assert timed_frames("long-range", [frames, frames], 2).shape == (2, FRAMES - LEAD)


def test_detectors_run_three_times_on_a_small_lidar() -> None:
    name, timed = f"{__name__}:Counting", dict[str, int]()
    for step in detector_steps([name], SCENES[:1]):
        Counting.drives = 0
        rows = step.measure()
        timed[rows[0].name] = Counting.drives - 1
    assert timed == {
        f"detector {name}, {rig}": runs for rig, runs in (("hdl64e", 1), ("hdl32e", 1), ("lux", 3))
    }
