"""A road with traffic on it, ready to be recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.recorder import TrafficRecorder
from roadscope.envs.traffic.timeline import Timeline

STEP_S = 0.05


@dataclass(frozen=True, slots=True)
class Stage:
    """What a scenario builds.

    rules: called with the road before every step: spawning, clearing, right of way.
    warm_up_s: time that passes before recording.
    """

    road: FlowRoad
    ego: Any
    warm_up_s: float = 0.0
    rules: tuple[Callable[[FlowRoad], None], ...] = ()


def play(stage: Stage, *, duration_s: float, style: str, seed: np.random.SeedSequence) -> Timeline:
    """Let the traffic run at 20 Hz and record it."""
    stage.road.refresh()
    for _ in range(round(stage.warm_up_s / STEP_S)):
        _advance(stage)
    recorder = TrafficRecorder(seed=seed, style=style, raw=False)
    recorder.follow(stage.road, stage.ego)
    for _ in range(round(duration_s / STEP_S)):
        _advance(stage)
        recorder.tick(stage.road, STEP_S)
    return recorder.timeline()


def _advance(stage: Stage) -> None:
    for rule in stage.rules:
        rule(stage.road)
    stage.road.act()
    stage.road.step(STEP_S)
