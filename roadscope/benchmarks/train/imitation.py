"""Lets a new agent imitate a driver of the board.

By DAgger: Ross, Gordon and Bagnell, A reduction of imitation learning and structured prediction to
no-regret online learning, AISTATS 2011. The teacher sees the truth, whatever the agent perceives,
as in Chen, Zhou, Koltun and Krähenbühl, Learning by cheating, CoRL 2019.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from roadscope.benchmarks.progress import Progress
from roadscope.core import DrivingCommand, DrivingScene
from roadscope.driving.agent import (
    ACCELERATIONS_M_S2,
    ACTIONS,
    HIDDEN,
    LEFT,
    OBSERVED,
    RIGHT,
    Layers,
    best_action,
)
from roadscope.driving.drive_env import DriveEnv
from roadscope.driving.drivers import DRIVERS

ROUNDS = 5
"""In the first the teacher drives, in the others the agent; the teacher says each time what it
would do. All numbers here are chosen by hand."""
PASSES, BATCH, RATE = 40, 256, 1e-3
"""After each round: passes over the samples of all rounds so far, samples of a batch, and learning
rate of Adam."""

Lesson = tuple[np.ndarray, np.ndarray]
"""Observations (S, 71) float32 of a drive, and the teacher's actions (S,) int64."""


def action_of(command: DrivingCommand, scene: DrivingScene) -> int:
    """Return the action for a driver's command.

    That is its lane change if one can begin now, without its acceleration; else the nearest
    acceleration.
    """
    if scene.lane == scene.target_lane and command.target_lane != scene.target_lane:
        return LEFT if command.target_lane < scene.target_lane else RIGHT
    away = np.abs(np.subtract(ACCELERATIONS_M_S2, command.acceleration_m_s2))
    return int(np.argmin(away))


def imitate(
    teacher: str,
    environment: Callable[[], DriveEnv],
    *,
    drives: int,
    jobs: int,
    seed: int,
    progress: Progress,
) -> Layers:
    """Return an agent that does what the teacher does.

    teacher: a driver of the board; it gets the true scenes. environment: makes the
    environment of one process. drives: of each round; their seeds follow from `seed`.
    """
    from joblib import Parallel, delayed

    layers, lessons = _new_layers(seed), list[Lesson]()
    run = Parallel(n_jobs=jobs, return_as="generator")
    for k in range(ROUNDS):
        agent = layers if k else None
        seeds = np.random.SeedSequence([seed, k]).generate_state(drives)
        calls = (delayed(_lesson)(teacher, environment, agent, int(each)) for each in seeds)
        for lesson in run(calls):
            lessons.append(lesson)
            progress("imitation", len(lessons), ROUNDS * drives)
        layers = _fitted(layers, lessons, seed + k)
    return layers


def _lesson(
    teacher: str, environment: Callable[[], DriveEnv], agent: Layers | None, seed: int
) -> Lesson:
    """Drive once; agent: who drives, the teacher if None."""
    env, driver = environment(), DRIVERS.make(teacher)
    driver.reset()
    observation, _ = env.reset(seed=seed)
    observations, actions, over = [], [], False
    while not over:
        scene = env.true_scene
        action = action_of(driver.drive(scene), scene)
        observations.append(observation)
        actions.append(action)
        executed = action if agent is None else best_action(agent, observation)
        observation, _, terminated, truncated, _ = env.step(executed)
        over = terminated or truncated
    return np.array(observations), np.array(actions)


def _new_layers(seed: int) -> Layers:
    rng = np.random.default_rng(seed)
    return [
        (
            rng.normal(0, inputs**-0.5, (outputs, inputs)).astype(np.float32),
            np.zeros(outputs, np.float32),
        )
        for inputs, outputs in pairwise((OBSERVED, *HIDDEN, ACTIONS))
    ]


def _fitted(layers: Layers, lessons: Sequence[Lesson], seed: int) -> Layers:
    """Return the layers, trained on all lessons by cross entropy."""
    import torch

    observations, actions = (
        torch.from_numpy(np.concatenate(part)) for part in zip(*lessons, strict=True)
    )
    variables = [torch.tensor(each, requires_grad=True) for layer in layers for each in layer]
    optimizer = torch.optim.Adam(variables, RATE)
    generator = torch.Generator().manual_seed(seed)
    for _ in range(PASSES):
        order = torch.randperm(len(actions), generator=generator)
        for first in range(0, len(order), BATCH):
            rows = order[first : first + BATCH]
            values = observations[rows]
            for k in range(0, len(variables), 2):
                values = torch.nn.functional.linear(values, variables[k], variables[k + 1])
                values = torch.tanh(values) if k + 2 < len(variables) else values
            loss = torch.nn.functional.cross_entropy(values, actions[rows])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
    arrays = [each.detach().numpy() for each in variables]
    return list(zip(arrays[::2], arrays[1::2], strict=True))
