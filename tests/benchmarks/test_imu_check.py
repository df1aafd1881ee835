"""An IMU whose motion contradicts that of the scans is reported, a right one never."""

from pathlib import Path

import numpy as np
import pytest
from toy_drive import ScansInMemory, driven

from roadscope.benchmarks import (
    Episode,
    Motion,
    MotionWindow,
    RecordedImu,
    RecordedWheels,
    doubt_of_accelerations,
    doubt_of_imu,
    doubt_of_turns,
    doubt_of_wheels,
    drive,
    imu_mounting,
)
from roadscope.core import ImuSamples, Pose, WheelSamples

STILL = np.zeros(3)


def turned(by_imu_deg, by_scans_deg) -> MotionWindow:
    turns = (np.deg2rad([0.0, 0.0, value]) for value in (by_imu_deg, by_scans_deg))
    return MotionWindow(*(Motion(turn, STILL) for turn in turns))


@pytest.mark.parametrize(
    ("by_imu_deg", "by_scans_deg", "message"),
    [
        (10.0, 10.4, ""),
        (-30.0, -29.0, ""),
        (1.0, -1.0, ""),
        (573.0, 10.0, "in degrees per second?"),
        (10.0, -10.0, "about an axis 180 degrees away: is --mounting right?"),
        (10.0, 25.0, "are its rates in rad/s"),
        (25.0, 10.0, "are its rates in rad/s"),
    ],
)
def test_turns_are_compared(by_imu_deg, by_scans_deg, message) -> None:
    doubt = doubt_of_turns([turned(by_imu_deg, by_scans_deg)] * 2)
    assert (message in doubt) if message else not doubt
    assert doubt_of_turns([]) == ""


@pytest.mark.parametrize(
    ("by_imu", "by_scans", "degrees"),
    [
        ((2.0, 0.0), (1.5, 0.1), None),
        ((2.0, 0.0), (-1.5, 0.1), 176),
        ((0.0, 2.0), (1.5, 0.0), 90),
        ((0.3, 0.0), (-1.5, 0.0), None),
    ],
)
def test_accelerations_are_compared(by_imu, by_scans, degrees) -> None:
    window = MotionWindow(*(Motion(STILL, np.array([*each, 0.0])) for each in (by_imu, by_scans)))
    doubt = doubt_of_accelerations([window])
    assert (f"accelerates {degrees} degrees away" in doubt) if degrees else not doubt


def test_wrong_mountings_and_units_are_reported_for_drives() -> None:
    episode = Episode("racetrack-loop", 10000, "vlp16-imu", 10.0)
    steps = list(drive(episode))
    blocks = [step.imu for step in steps if step.imu is not None]
    names = "stamps_s", "angular_velocity", "specific_force"
    stamps_s, rates, forces = (
        np.concatenate([getattr(block, name) for block in blocks]) for name in names
    )
    mounted = imu_mounting(episode)
    assert mounted is not None

    def doubt(wrong: Pose, unit: float = 1.0) -> str:
        samples = ImuSamples(stamps_s, unit * rates, forces)
        imu = RecordedImu(samples, Path("imu.csv"), lidar_from_imu=mounted @ wrong)
        return doubt_of_imu(ScansInMemory([step.scan for step in steps]), imu)  # type: ignore[arg-type]

    assert doubt(Pose.identity()) == ""
    assert "is --mounting right?" in doubt(Pose.from_euler(0, 0, 0, yaw=np.pi))
    assert "by its gravity, up is 1" in doubt(Pose.from_euler(0, 0, 0, roll=np.pi))
    assert "degrees per second" in doubt(Pose.identity(), unit=180 / np.pi)


@pytest.mark.parametrize(("factor", "message"), [(1.0, ""), (3.6, "not in km/h"), (0.3, "in m/s")])
def test_speeds_of_wheels_in_other_units_are_reported(factor, message) -> None:
    scans = [scan for scan, _ in driven(24)[1]]
    stamps_s = np.arange(0, 2.4, 0.02)
    wheels = RecordedWheels(
        WheelSamples(stamps_s, np.full(len(stamps_s), factor * 8.0)), Path("wheels.csv")
    )
    doubt = doubt_of_wheels(ScansInMemory(scans), wheels)  # type: ignore[arg-type]
    assert (message in doubt) if message else not doubt
