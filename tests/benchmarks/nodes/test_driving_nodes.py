"""Drives: what is written down, and what a stranger's plug-in can do to it."""

import io

import numpy as np
import pytest

from roadscope import Episode, Spec
from roadscope.benchmarks import Eligibility, Job, RunOptions
from roadscope.benchmarks.boards import BOARDS
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.nodes import DriveNode, EpisodeDrive, Stack
from roadscope.driving import DRIVERS, ClosedLoop

EPISODE = Episode("two-way", 0, "vlp16", 2.0)
PLUGINS = """
import os
import numpy as np
from roadscope import Detections, DrivingCommand, Tracks

class Stops:
    kind = "driver"
    def reset(self): ...
    def drive(self, scene):
        return DrivingCommand(-3.0, scene.lane)

class Leaves(Stops):
    def drive(self, scene):
        os._exit(0)

class Flies(Stops):
    def drive(self, scene):
        return DrivingCommand(0.0, 7)

class Changes(Stops):
    def drive(self, scene):
        scene.tracks.centres[:] = 0.0
        scene.path[:] = 0.0
        return scene.model

class Nothing:
    kind = "detector"
    def reset(self): ...
    def detect(self, frame):
        return Detections.empty(frame.stamp_s)

class Dies(Nothing):
    def detect(self, frame):
        os.abort()

class Late(Nothing):
    def detect(self, frame):
        return Detections.empty(frame.stamp_s + 1.0)
"""


@pytest.fixture(scope="module")
def plugins(tmp_path_factory):
    file = tmp_path_factory.mktemp("plugins") / "mine.py"
    file.write_text(PLUGINS)
    return file


def node(driver, stack, episode=EPISODE):
    return DriveNode(DRIVERS.resolve(Spec.parse(str(driver))), Stack(stack), episode)


def drive(driver, stack, episode=EPISODE):
    return node(driver, stack, episode).compute(RunOptions())


def scores_of(stack, answers):
    job = Job(BOARDS["driving"], "idm", EPISODE, node("idm", stack), settings=Eligibility())
    return job.board.score(job, answers, RunOptions())


def test_a_drive_is_stored_whole_and_repeats() -> None:
    first = drive("idm", "distance + gnn")
    again = drive("idm", "distance + gnn")
    for name in ("stamps_s", "speeds", "accelerations", "poses", "reference_accelerations"):
        assert np.array_equal(getattr(first, name), getattr(again, name), equal_nan=True), name
    assert first.believed == again.believed
    assert first.detected == again.detected
    assert len(first.stamps_s) == 20
    assert len(first.sensed) == len(first.detected) == len(first.believed)
    assert len(first.believed) == len(first.perception_times.wall_ms) >= 18
    assert sum(map(len, first.believed)) > 0
    file = io.BytesIO()
    first.save(file)
    file.seek(0)
    assert EpisodeDrive.load(file).tracks == first.tracks


def test_a_driver_with_the_same_commands_has_the_same_drive(monkeypatch) -> None:
    """On a two-way road nobody changes lanes, so MOBIL changes nothing."""
    stack, episode = "distance + gnn", Episode("two-way", 1, "vlp16", 2.0)
    first, steps = drive("idm-mobil", stack, episode), []
    step = ClosedLoop.step
    monkeypatch.setattr(ClosedLoop, "step", lambda *args: (steps.append(1), step(*args)))
    repeated = drive("idm", stack, episode)
    assert not steps
    assert len(repeated.driver_times.wall_ms) == len(first.driver_times.wall_ms)
    again = drive("idm", stack, episode)
    assert len(steps) == len(again.stamps_s)
    for name in ("speeds", "accelerations", "poses", "reference_accelerations"):
        assert np.array_equal(getattr(repeated, name), getattr(again, name), equal_nan=True), name
    assert repeated.tracks == again.tracks
    assert repeated.believed == again.believed
    braking = drive("emergency-brake", stack, episode)
    assert not np.array_equal(braking.speeds, again.speeds)
    alone = drive("emergency-brake", stack, episode)
    assert np.array_equal(alone.poses, braking.poses, equal_nan=True)


def test_truth_and_blind_need_no_sensors() -> None:
    truth, blind = drive("idm", "truth"), drive("idm", "blind")
    assert truth.sensed == blind.sensed == ()
    assert not any(map(len, blind.tracks))
    present = np.isfinite(truth.poses[0, 1:, 0]).sum()
    assert len(truth.tracks[0]) == present


def test_a_strangers_driver_sees_no_drive_before_its_own(plugins, monkeypatch) -> None:
    model, steps = drive("idm-mobil", "truth"), []
    step = ClosedLoop.step
    monkeypatch.setattr(ClosedLoop, "step", lambda *args: (steps.append(1), step(*args)))
    changed = drive(f"{plugins}:Changes", "truth")
    assert len(steps) == len(changed.stamps_s)
    assert np.array_equal(changed.poses, model.poses, equal_nan=True)


def test_a_strangers_driver_acts_on_the_world(plugins) -> None:
    stopped = drive(f"{plugins}:Stops", "blind")
    assert stopped.speeds[-1] == pytest.approx(max(stopped.speeds[0] - 3.0 * 1.9, 0.0), abs=0.4)
    changed, model = drive(f"{plugins}:Changes", "truth"), drive("idm-mobil", "truth")
    assert np.array_equal(changed.poses, model.poses, equal_nan=True)
    assert changed.tracks == model.tracks


@pytest.mark.parametrize(
    ("driver", "stack", "reason"),
    [
        ("{}:Leaves", "blind", "exit"),
        ("{}:Flies", "blind", "target_lane 7"),
        ("idm", "{}:Dies + gnn", "Dies"),
        ("idm", "{}:Late + gnn", "stamped"),
    ],
)
def test_what_a_stranger_does_wrong_fails_its_own_drive(plugins, driver, stack, reason) -> None:
    with pytest.raises(PluginError, match=reason):
        drive(driver.format(plugins), stack.format(plugins))


def test_a_drive_that_is_over_at_once_says_so(monkeypatch) -> None:
    monkeypatch.setattr(ClosedLoop, "over", True)
    with pytest.raises(ValueError, match="before the drive begins"):
        drive("idm", "blind")


def test_detections_within_the_stack_are_scored(plugins) -> None:
    scores = scores_of("distance + gnn", drive("idm", "distance + gnn"))
    assert 0.3 < scores["detection_rate"].value <= 1.0
    assert scores["false_alarms_per_frame"].value > 0
    stack = f"{plugins}:Nothing + gnn"
    scores = scores_of(stack, drive("idm", stack))
    assert scores["detection_rate"].value == scores["false_alarms_per_frame"].value == 0.0
    assert "detection_rate" not in scores_of("truth", drive("idm", "truth"))


@pytest.mark.parametrize(
    ("stack", "rig"),
    [
        ("distance + gnn", "vlp16"),
        ("distance + gnn?ego=dead-reckoning", "vlp16-imu"),
        ("fused?lidar=distance&camera=colour-blobs&fusion=union + gnn", "wide"),
    ],
)
def test_a_delay_changes_what_the_driver_knows_and_no_score(plugins, stack, rig) -> None:
    """The driver looks at no tracks, so both drives are the same."""
    episode, delayed = Episode("two-way", 0, rig, 2.0), f"{stack} + 400 ms"
    prompt, late = (drive(f"{plugins}:Stops", each, episode) for each in (stack, delayed))
    assert np.array_equal(prompt.poses, late.poses, equal_nan=True)
    assert prompt.detected == late.detected
    assert prompt.believed == late.believed
    for now_s, known in zip(late.stamps_s, late.tracks, strict=True):
        done = [each for each in late.believed if each.stamp_s + 0.4 <= now_s + 1e-9]
        assert np.array_equal(known.ids, done[-1].ids if done else [])
    assert len(late.tracks[-1]) > 0
    scores = [scores_of(s, d) for s, d in ((stack, prompt), (delayed, late))]
    for name in ("detection_rate", "recall", "hota", "reward"):
        assert scores[0][name] == scores[1][name], name


def test_a_strangers_detector_is_called_and_timed(plugins) -> None:
    nothing = drive("idm", f"{plugins}:Nothing + gnn")
    assert not any(map(len, nothing.believed))
    assert (nothing.perception_times.wall_ms > 0).all()
