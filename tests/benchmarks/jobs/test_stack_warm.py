"""Our detectors are compiled before a call is timed, and nothing else changes."""

import pytest

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.jobs import stack
from roadscope.benchmarks.jobs.stack import WARM_FRAMES, perceive
from roadscope.detectors.long_range import LongRangeDetector

EPISODE = Episode("two-way", 7, "lux", 1.0)


@pytest.fixture
def seen(monkeypatch):
    """Stamps that each instance was shown, instance by instance; none is warm yet."""
    monkeypatch.setattr(stack, "_WARM", set())
    shown: dict[int, list[float]] = {}
    kept, detect = [], LongRangeDetector.detect

    def told(self, frame):
        kept.append(self)
        shown.setdefault(id(self), []).append(frame.stamp_s)
        return detect(self, frame)

    monkeypatch.setattr(LongRangeDetector, "detect", told)
    return shown


def test_another_instance_sees_the_first_frames_and_what_is_detected_stays(seen):
    stamps = [frame.stamp_s for frame, _ in sensed(EPISODE)]
    cold = perceive("zhang2017", EPISODE, Eligibility())
    assert list(seen.values()) == [stamps[:WARM_FRAMES], stamps]
    assert len(cold.calls_ms) == len(stamps)
    assert sum(map(len, cold.detections)) > 0
    warm = perceive("zhang2017", EPISODE, Eligibility())
    assert list(seen.values())[2:] == [stamps]
    assert warm.detections == cold.detections


def test_what_is_not_ours_is_called_once_a_frame(monkeypatch, tmp_path):
    monkeypatch.setattr(stack, "_WARM", set())
    path, told = tmp_path / "mine.py", tmp_path / "calls.txt"
    path.write_text(
        "from roadscope.core import Detections\n"
        "class Mine:\n"
        "    def reset(self): pass\n"
        "    def detect(self, frame):\n"
        f"        with open({str(told)!r}, 'a') as calls:\n"
        "            print(frame.stamp_s, file=calls)\n"
        "        return Detections.empty(frame.stamp_s)\n"
    )
    perceived = perceive(f"{path}:Mine", EPISODE, Eligibility())
    stamps = [float(line) for line in told.read_text().split()]
    assert stamps == [truth.stamp_s for truth in perceived.truths]
