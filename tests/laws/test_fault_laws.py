"""What holds for every fault, of every rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from roadscope.core import Frame, Truth
from roadscope.envs import find_rig
from roadscope.envs.imaging import Ground, Pinhole
from roadscope.envs.sensors import (
    FAULTS,
    SEVERITIES,
    Fault,
    Rig,
    Sensing,
    condition_name,
    faults_of,
    summary_of,
)
from roadscope.envs.traffic import Timeline, record
from roadscope.envs.world import surface_of

SEED, END_S = 43, 0.43
Pairs = tuple[tuple[Frame, Truth], ...]
KINDS = pytest.mark.parametrize("kind", FAULTS)


@cache
def timeline() -> Timeline:
    return record("motorway", 10_003, 1.0)


def small(quiet: bool = False) -> Rig:
    """Four beams and a camera of 160 x 120 pixels."""
    wide, lux = find_rig("wide").camera, find_rig("lux")
    spec = replace(wide.spec, pinhole=Pinhole.centred(160, 120, 105.0))
    if quiet:
        spec = replace(spec, full_well=1e12, read_noise=0.0)
    return replace(lux, camera=replace(wide, spec=spec))


@cache
def sensed(condition: str, seed: int = SEED, quiet: bool = False) -> Pairs:
    return fresh(END_S, small(quiet), seed, faults=condition)


@cache
def ground() -> Ground:
    return Ground(surface_of(timeline().road), "bare")


def fresh(end_s: float, carrier: Rig, seed: int = SEED, **sensing_options: Any) -> Pairs:
    """Sense anew, but on ground that is painted already: that takes longest."""
    sensing = Sensing(carrier, seed, "bare", **sensing_options)
    sensing._ground = ground()
    return tuple(sensing.advance(timeline(), end_s))


def images(pairs: Pairs) -> list[np.ndarray]:
    return [frame.camera.pixels for frame, _ in pairs if frame.camera is not None]


def brightness(pairs: Pairs) -> float:
    return float(np.mean(images(pairs)))


def white(pairs: Pairs) -> float:
    """Share of the pixels in which nothing is to be seen for light."""
    return float((np.array(images(pairs)).min(axis=-1) >= 250).mean())


def grain(pairs: Pairs) -> float:
    """Difference of pixels above one another against their brightness."""
    pixels = np.array(images(pairs), np.float64)
    return float(np.abs(np.diff(pixels, axis=1)).mean() / pixels.mean())


def hit(pairs: Pairs) -> int:
    return sum(int(truth.lidar_returns.sum()) for _, truth in pairs)


def mean_image_difference(pairs: Pairs) -> float:
    """Return the mean difference to images without fault."""
    clean = np.array(images(sensed("clear")), np.float64)
    return float(np.abs(np.array(images(pairs)) - clean).mean())


def arrived(sensor: str) -> Callable[[Pairs], int]:
    def count(pairs: Pairs) -> int:
        return sum(
            (image := getattr(frame, sensor)) is not None
            and (sensor == "lidar" or bool(image.pixels.any()))
            for frame, _ in pairs
        )

    return count


def lateness(pairs: Pairs) -> float:
    return max(frame.stamp_s - truth.stamp_s for frame, truth in pairs)


def misplaced(pairs: Pairs) -> float:
    """Return the error of the assumed place of a point 50 m away, of the worse sensor."""
    believed, true = pairs[0][0].calibration, small().calibration()
    points = 50 * np.eye(3)
    return max(
        float(np.linalg.norm(believed.pose(n).apply(points) - p.apply(points), axis=1).max())
        for n, p in true.ego_from_sensor
    )


MEASURES: Mapping[str, tuple[tuple[Callable[[Pairs], float], int], ...]] = {
    "fog": ((hit, -1), (mean_image_difference, 1)),
    "rain": ((hit, -1), (mean_image_difference, 1)),
    "night": ((brightness, -1), (grain, 1)),
    "glare": ((white, 1),),
    "dropped-scans": ((arrived("lidar"), -1),),
    "blackout": ((arrived("camera"), -1),),
    "clock-offset": ((lateness, 1),),
    "extrinsic-error": ((misplaced, 1),),
}
"""What each fault does, and which way is worse."""


@pytest.mark.sampled(1)
@KINDS
def test_each_severity_hurts_at_least_as_much_as_the_last(kind: str) -> None:
    conditions = ["clear", *(f"{kind}:{n}" for n in SEVERITIES)]
    for measure, sign in MEASURES[kind]:
        ladder = [sensed(condition, quiet=measure is brightness) for condition in conditions]
        harm = [sign * measure(pairs) for pairs in ladder]
        assert harm == sorted(harm), measure.__name__
        assert harm[-1] > harm[0], measure.__name__


@pytest.mark.slow
@KINDS
@pytest.mark.parametrize("severity", [1, 5])
def test_truth_stays_what_it_was(kind: str, severity: int) -> None:
    clean, faulty = sensed("clear"), sensed(f"{kind}:{severity}")
    assert len(clean) == len(faulty)
    # Returns count where a beam got to, which air decides, and sources are one a return.
    measured = ("lidar_returns", "sources") if kind in ("fog", "rain") else ("sources",)
    for (_, before), (frame, truth) in zip(clean, faulty, strict=True):
        for name in (f.name for f in fields(truth) if f.name not in measured):
            np.testing.assert_equal(getattr(truth, name), getattr(before, name), err_msg=name)
        assert len(truth.sources) == (0 if frame.lidar is None else len(frame.lidar))


@KINDS
def test_same_seed_same_bytes_and_only_the_sensors_concerned_change(kind: str) -> None:
    first = sensed(f"{kind}:3")
    assert first == fresh(END_S, small(), faults=[Fault(kind, 3)])
    for sensor in {"lidar", "camera"} - set(FAULTS[kind].sensors):
        assert [getattr(f, sensor) for f, _ in first] == [
            getattr(f, sensor) for f, _ in sensed("clear")
        ]


@pytest.mark.parametrize("nothing", ["clear", (), [], ("clear",)])
def test_without_faults_the_bytes_are_the_clean_ones(nothing: object) -> None:
    clean = fresh(0.22, small())
    assert fresh(0.22, small(), faults=nothing) == clean


@KINDS
def test_every_rig_takes_every_fault_and_says_which_it_does_not_feel(kind: str) -> None:
    for name in ("lux", "wide", "li2021"):
        carrier = find_rig(name)
        sensing = Sensing(carrier, SEED, "bare", faults=f"{kind}:5")
        felt = not sensing.idle_faults
        assert felt == (carrier.camera is not None or "lidar" in FAULTS[kind].sensors)
        end_s = carrier.lidar.stamp_s(0) + carrier.lidar.spec.sweep_s / 2
        end_s = max(end_s, 0.03)
        out = fresh(end_s, carrier, faults=f"{kind}:5")
        assert out
        if not felt:
            assert out == fresh(end_s, carrier)
        for frame, truth in out:
            assert np.isfinite(frame.stamp_s)
            assert np.isfinite(truth.occluded_fraction).all()
            for _, pose in frame.calibration.ego_from_sensor:
                assert np.isfinite(pose.matrix).all()
            if frame.lidar is not None:
                assert np.isfinite(frame.lidar.points).all()


def test_names_are_read_as_they_are_written() -> None:
    everything = [Fault(kind, n) for kind in FAULTS for n in SEVERITIES]
    assert [Fault.parse(str(fault)) for fault in everything] == everything
    for fault in everything:
        assert faults_of(condition_name([fault])) == (fault,)
    mixed = faults_of(" night:2+fog:3 ")
    assert condition_name(mixed) == "fog:3 + night:2"
    assert mixed == faults_of(("night:2", Fault("fog", 3)))
    assert condition_name(()) == "clear"
    assert "120, 80, 50 m" in summary_of("fog")


@pytest.mark.parametrize("severity", [1, 5])
def test_what_is_said_to_be_lost_is_lost(severity: int) -> None:
    for kind, sensor in (("dropped-scans", "lidar"), ("blackout", "camera")):
        sensing = Sensing(small(), SEED, "bare", faults=f"{kind}:{severity}")
        frames = [
            frame
            for frame, truth in sensed(f"{kind}:{severity}")
            if (truth.image_boxes is None) == (sensor == "lidar")
        ]
        for index, frame in enumerate(frames):
            came = getattr(frame, sensor)
            if sensor == "lidar":
                assert sensing.scan_lost(index) == (came is None)
            else:
                black = came is not None and not came.pixels.any()
                reason = "missing" if came is None else "black" if black else None
                assert sensing.image_lost(index) == reason


@pytest.mark.parametrize("condition", [f"{kind}:5" for kind in FAULTS] + ["night:5 + fog:5"])
def test_none_but_a_blackout_leaves_a_blank_image(condition: str) -> None:
    camera_images = [frame.camera for frame, _ in sensed(condition) if frame.camera is not None]
    blank = [image.blank for image in camera_images]
    assert blank == [not image.pixels.any() for image in camera_images]
    assert any(blank) == (condition == "blackout:5")


@KINDS
def test_figures_only_get_worse(kind: str) -> None:
    figures = FAULTS[kind].figures
    assert len(set(figures)) == 5
    assert list(figures) in (sorted(figures), sorted(figures, reverse=True))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fgo:3", r"no fault 'fgo' \(did you mean 'fog'\?\); known: fog, rain, night, glare"),
        ("fog", r"fault 'fog': expected a severity 1 to 5, fog:1 to fog:5, got ''"),
        ("fog:0", "expected a severity 1 to 5"),
        ("fog:6", r"fault 'fog:6': expected a severity 1 to 5, fog:1 to fog:5, got '6'"),
        ("fog:2.5", "expected a severity 1 to 5"),
        ("fog:-1", "expected a severity 1 to 5"),
        ("", "no fault ''"),
        ("fog-3", "no fault 'fog-3'"),
        ("clear + fog:3", "no fault 'clear'"),
        (("night:1", "night:2"), "fault 'night' is given 2 times"),
        ("rain:1 + fog:1", "faults fog and rain exclude each other"),
    ],
)
def test_what_is_no_fault_is_refused_with_what_is(text: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Sensing(find_rig("lux"), 0, faults=text)


@pytest.mark.parametrize("value", [[3], [None], [("fog", 3)]])
def test_what_is_no_text_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match="expected text such as fog:3"):
        Sensing(find_rig("lux"), 0, faults=value)
    with pytest.raises(TypeError, match=r"faults: expected 'fog:3', .* got 3"):
        faults_of(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(("kind", "severity"), [("fog", 0), ("fog", 6), ("fog", True), ("hail", 1)])
def test_faults_made_by_hand_are_checked_too(kind: str, severity: int) -> None:
    with pytest.raises(ValueError, match=r"1 to 5|no fault 'hail'"):
        Fault(kind, severity)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"weather": "rain"}, "fog:3"),
        ({"weather": "fog-3"}, "fog:3"),
        ({"light": "day"}, "night:1"),
    ],
)
def test_two_words_on_one_thing_are_refused(options: dict[str, str], fault: str) -> None:
    with pytest.raises(ValueError, match=f"and fault '{fault}' both say what"):
        Sensing(find_rig("wide"), 0, faults=fault, **options)


@pytest.mark.parametrize("kind", ["fog", "rain"])
def test_weather_and_the_fault_of_that_name_are_one(kind: str) -> None:
    by_weather = fresh(0.22, small(), weather=f"{kind}-4")
    by_fault = fresh(0.22, small(), faults=f"{kind}:4")
    assert by_weather == by_fault


def test_one_more_fault_leaves_the_others_draws_as_they_are() -> None:
    alone, among = sensed("extrinsic-error:3"), sensed("dropped-scans:5 + extrinsic-error:3")
    assert alone[0][0].calibration == among[0][0].calibration
    dropped = [f.lidar is None for f, _ in sensed("dropped-scans:5")]
    assert dropped == [f.lidar is None for f, _ in among]


def test_seeds_decide_where_a_sensor_slips_to() -> None:
    views = {
        str(Sensing(small(), seed, faults="extrinsic-error:2").calibration) for seed in range(4)
    }
    assert len(views) == 4


def test_a_sensor_slips_equally_with_and_without_camera() -> None:
    alone = replace(find_rig("wide"), camera=None)
    both = Sensing(find_rig("wide"), 9, faults="extrinsic-error:4").calibration
    assert both.pose("lidar") == Sensing(alone, 9, faults="extrinsic-error:4").calibration.pose(
        "lidar"
    )
