"""The loop that runs plug-ins: what is called, what is timed, what is checked."""

import numpy as np
import pytest
from toy_boxes import detections

from roadscope import DETECTORS, TRACKERS, Detections, Pose, Tracks
from roadscope.benchmarks import (
    DETECTOR,
    TRACKER,
    CallInput,
    Eligibility,
    Episode,
    RunOptions,
    run_plugin,
    sensed,
)
from roadscope.benchmarks.boards import call_cost
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.nodes import DetectionNode
from roadscope.core import AnswerError, check_tracks
from roadscope.detectors import LongRangeDetector

EPISODE = Episode("two-way", 7, "lux", 1.0)
TICKS = 12
SLEEP_S = 0.05

PLUGIN = """
import time
import numpy as np
from roadscope import Tracks


class Quick:
    def reset(self):
        self.calls = 0

    def update(self, detections, ego_pose):
        self.calls += 1
        self.work()
        return Tracks.empty(detections.stamp_s, detections.frame)

    def work(self): ...


class Sleeps(Quick):
    def work(self):
        time.sleep(0.05)


class Works(Quick):
    def work(self):
        end = time.process_time() + 0.05
        while time.process_time() < end:
            pass


class SlowFirst(Quick):
    def work(self):
        time.sleep(0.4 if self.calls == 1 else 0)


class Fifth(Quick):
    def work(self):
        if self.calls == 5:
            raise KeyError("fifth")


class Warns(Quick):
    def work(self):
        import warnings
        warnings.warn("a black image")
"""


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    path = tmp_path_factory.mktemp("mine") / "mine.py"
    path.write_text(PLUGIN)
    return path


def ticks(count: int = TICKS, called=lambda k: True):
    return [
        CallInput((detections([[10.0, 0.0]], stamp_s=0.1 * k), Pose.identity()), k, called(k))
        for k in range(count)
    ]


def check(answer, tick) -> Tracks:
    return check_tracks(answer, stamp_s=0.1 * tick.context, posed=True)


def run(spec: str, **options):
    made = options.pop("ticks", None) or ticks()
    return run_plugin(TRACKERS.resolve(spec), TRACKER, made, check, **options)


@pytest.mark.parametrize("trust", [False, True])
def test_a_plug_in_that_sleeps_costs_wall_time_and_no_processor_time(mine, trust) -> None:
    times = run(f"{mine}:Sleeps", options=RunOptions(trust=trust)).times
    assert times.wall_ms.shape == times.processor_ms.shape == (TICKS,)
    assert times.wall_ms.min() >= 1000 * SLEEP_S
    assert np.median(times.wall_ms) < 4000 * SLEEP_S
    assert np.median(times.processor_ms) < 100 * SLEEP_S


def test_a_plug_in_that_works_costs_both(mine) -> None:
    times = run(f"{mine}:Works").times
    assert times.processor_ms.min() >= 990 * SLEEP_S
    assert (times.wall_ms >= 0.95 * times.processor_ms).all()


def test_a_board_leaves_the_first_call_out(mine) -> None:
    times = run(f"{mine}:SlowFirst").times
    assert times.wall_ms[0] >= 400
    costs = call_cost(times)
    assert costs["wall_p50_ms"].value < 200
    assert costs["call_p99_ms"].value < 200
    assert costs["call_p50_ms"].n == TICKS - 1


def test_moments_without_anything_to_answer_cost_no_call(mine) -> None:
    replies = run(f"{mine}:Sleeps", ticks=ticks(4, lambda k: k % 2 == 0))
    assert [answer is not None for answer in replies.answers] == [True, False, True, False]
    assert replies.contexts == (0, 1, 2, 3)
    assert (replies.times.wall_ms[1::2] == 0).all()
    assert (replies.times.wall_ms[::2] > 0).all()


@pytest.mark.parametrize("trust", [False, True])
def test_what_a_plug_in_raises_is_its_own_failure_and_ends_the_loop(mine, trust) -> None:
    with pytest.raises(PluginError, match=rf"^{mine}:Fifth: .*KeyError.*mine\.py:\d+"):
        run(f"{mine}:Fifth", options=RunOptions(trust=trust))


def test_a_wrong_answer_is_the_plug_ins_failure(mine) -> None:
    def refuse(answer, tick):
        raise AnswerError("too good")

    spec = TRACKERS.resolve(f"{mine}:Quick")
    with pytest.raises(PluginError, match=rf"^{mine}:Quick: too good$"):
        run_plugin(spec, TRACKER, ticks(), refuse)


@pytest.mark.parametrize("trust", [False, True])
def test_what_a_plug_in_warns_of_stops_nothing(mine, trust) -> None:
    assert len(run(f"{mine}:Warns", options=RunOptions(trust=trust)).answers) == TICKS


def test_every_call_has_its_share_of_what_comes_after_the_last() -> None:
    def finish(plugin):
        timed = plugin.call("update", *ticks(TICKS + 1)[-1].arguments)
        return type(timed)(timed.answer, 120.0, 240.0)

    replies = run("nearest", finish=finish)
    assert isinstance(replies.last, Tracks)
    assert replies.times.processor_ms.min() >= 120.0 / TICKS
    assert replies.times.wall_ms.min() >= 240.0 / TICKS


@pytest.fixture
def stamps_of(monkeypatch):
    """Stamps that each instance was shown, instance by instance."""
    shown: dict[int, list[float]] = {}
    instances, detect = [], LongRangeDetector.detect

    def noted(self, frame):
        instances.append(self)
        shown.setdefault(id(self), []).append(frame.stamp_s)
        return detect(self, frame)

    monkeypatch.setattr(LongRangeDetector, "detect", noted)
    return shown


def test_ours_are_compiled_before_a_call_is_timed_and_answers_stay(stamps_of) -> None:
    stamps = [frame.stamp_s for frame, _ in sensed(EPISODE)]
    # A spec that no other test warms up in this process.
    source = DETECTORS.resolve("zhang2017?")
    node = DetectionNode(source, EPISODE, Eligibility())
    cold = node.compute(RunOptions())
    assert list(stamps_of.values()) == [stamps[: DETECTOR.warm_calls], stamps]
    assert len(cold.times.wall_ms) == len(stamps)
    assert sum(map(len, cold.detections)) > 0
    warm = node.compute(RunOptions())
    assert list(stamps_of.values())[2:] == [stamps]
    assert warm.detections == cold.detections


def test_what_is_not_ours_is_called_once_a_frame(tmp_path) -> None:
    path, calls = tmp_path / "mine.py", tmp_path / "calls.txt"
    path.write_text(
        "from roadscope import Detections\n"
        "class Mine:\n"
        "    def reset(self): pass\n"
        "    def detect(self, frame):\n"
        f"        with open({str(calls)!r}, 'a') as file:\n"
        "            print(frame.stamp_s, file=file)\n"
        "        return Detections.empty(frame.stamp_s)\n"
    )
    source = DETECTORS.resolve(f"{path}:Mine")
    answers = DetectionNode(source, EPISODE, Eligibility()).compute(RunOptions())
    stamps = [float(line) for line in calls.read_text().split()]
    assert stamps == [truth.stamp_s for truth in answers.truths]
    assert answers.detections == tuple(Detections.empty(s, "world") for s in stamps)
