"""Trains drivers: by imitation of a driver of the board, then by reinforcement learning (PPO)."""

from __future__ import annotations

import json
import multiprocessing
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from roadscope.benchmarks.cache import usable_folder
from roadscope.benchmarks.fingerprints import package_version
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.run_manifest import cpu_model
from roadscope.benchmarks.suite import SPLITS
from roadscope.benchmarks.suite_files import load_suite
from roadscope.benchmarks.train.camera import weights_path
from roadscope.core import DrivingCommand, DrivingScene
from roadscope.core.loading import NotInstalledError, Requirement
from roadscope.driving.agent import (
    ACCELERATIONS_M_S2,
    ACTIONS,
    ARCHITECTURE,
    HIDDEN,
    LEFT,
    OBSERVED,
    RIGHT,
    AgentDriver,
    Layers,
    agent_path,
    best_action,
    load_agent,
    save_agent,
)
from roadscope.driving.drive_env import DriveEnv
from roadscope.driving.drivers import DRIVERS
from roadscope.driving.perception import TRUTH

if TYPE_CHECKING:
    from stable_baselines3 import PPO

LIBRARY = Requirement("stable-baselines3", "pip install 'roadscope[rl]'")
ENVIRONMENTS = 4
"""Drives at once, each in a process of its own; another number gives other weights. All numbers of
this file are chosen by hand."""
SEEDS_PER_SCENARIO = 64
"""Training seeds of each scenario. A drive in traffic that a process has made before begins ten
times as fast."""


@dataclass(frozen=True, slots=True)
class DriverRecipe:
    """Settings of one training run.

    perceptions: stacks and `truth`; each drive has one of them at random. scenarios: likewise;
    empty: those of the suite `driving`. start: an agent that is trained further, a name or a file;
    empty: a new one. teacher: a driver of the board that a new agent imitates first, and that sees
    the truth, whatever the agent perceives; empty: none.
    lessons: drives of each of the five rounds of imitation. steps: decisions, 0.2 s each, from
    which the agent then learns by itself; rounded up to whole updates of 1,024; 0: none.
    duration_s: of a drive. rig: sensors of the stacks. validation_seeds: drives that are scored
    afterwards for each scenario and each perception; `truth` is always one of them.
    """

    perceptions: tuple[str, ...] = (TRUTH,)
    scenarios: tuple[str, ...] = ()
    start: str = ""
    teacher: str = "idm-mobil"
    lessons: int = 36
    steps: int = 0
    duration_s: float = 30.0
    rig: str = "vlp16"
    validation_seeds: int = 5
    seed: int = 0

    @property
    def updates(self) -> int:
        """Updates of the network."""
        return -(-self.steps // STEPS_PER_UPDATE)


@dataclass(frozen=True, slots=True)
class DriverTraining:
    """The files of a training run, and how well the agent drives on validation seeds.

    weights, record: files. scores: by perception, (drives, 2): the reward of the board `driving`,
    and whether the drive ended in a collision.
    """

    weights: Path
    record: Path
    scores: Mapping[str, np.ndarray]


def train_driver(
    out: Path | str, recipe: DriverRecipe | None = None, *, progress: Progress | None = None
) -> DriverTraining:
    """Train an agent, write OUT.safetensors and OUT.toml beside it, and score it.

    Child processes drive, so a script that calls this needs `if __name__ == "__main__":`.
    Raises `NotInstalledError` if there are `steps` but no Stable-Baselines3, and `ValueError` if
    `steps` is 0 and there is a `start` or no `teacher`: then nothing would be learned.
    """
    report = progress or silent
    recipe = recipe or DriverRecipe()
    if recipe.steps and LIBRARY.missing:
        raise NotInstalledError(LIBRARY.missing)
    for name in ("lessons", "validation_seeds"):
        if getattr(recipe, name) < 1:
            raise ValueError(f"{name}: expected at least 1, got {getattr(recipe, name)}")
    if not recipe.scenarios:
        recipe = replace(recipe, scenarios=load_suite("driving").scenarios)
    weights = weights_path(Path(out))
    layers = load_agent(recipe.start) if recipe.start else None
    # Wrong names are reported before anything is trained.
    _environment(recipe)
    if recipe.teacher:
        DRIVERS.resolve(recipe.teacher)
    if not recipe.steps and (recipe.start or not recipe.teacher):
        raise ValueError("steps: expected more than 0 with a start or without a teacher, got 0")
    usable_folder(weights.parent)
    if layers is None and recipe.teacher:
        layers = _imitated(recipe, report)
    if recipe.steps:
        layers = _trained(recipe, layers, report)
    assert layers is not None
    save_agent(weights, layers)
    result = DriverTraining(
        weights, weights.with_suffix(".toml"), _validated(recipe, weights, report)
    )
    _write_record(result, recipe)
    return result


def _environment(recipe: DriverRecipe) -> DriveEnv:
    return DriveEnv(
        recipe.scenarios,
        perception=recipe.perceptions,
        rig=recipe.rig,
        duration_s=recipe.duration_s,
        seeds=SPLITS["train"][:SEEDS_PER_SCENARIO],
    )


# --------------------------------------------------------------------------------------------------
# Imitation by DAgger: Ross, Gordon and Bagnell, A reduction of imitation learning and structured
# prediction to no-regret online learning, AISTATS 2011. The teacher sees the truth, whatever the
# agent perceives, as in Chen, Zhou, Koltun and Krähenbühl, Learning by cheating, CoRL 2019.

ROUNDS = 5
"""In the first the teacher drives, in the others the agent; the teacher says each time what it
would do."""
IMITATION_PASSES, IMITATION_BATCH, IMITATION_RATE = 40, 256, 1e-3
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


def _imitated(recipe: DriverRecipe, progress: Progress) -> Layers:
    """Return an agent that does what the teacher does, who gets the true scenes."""
    from joblib import Parallel, delayed

    layers, lessons = _new_layers(recipe.seed), list[Lesson]()
    run = Parallel(n_jobs=ENVIRONMENTS, return_as="generator")
    for k in range(ROUNDS):
        agent = layers if k else None
        seeds = np.random.SeedSequence([recipe.seed, k]).generate_state(recipe.lessons)
        for lesson in run(delayed(_lesson)(recipe, agent, int(seed)) for seed in seeds):
            lessons.append(lesson)
            progress("imitation", len(lessons), ROUNDS * recipe.lessons)
        layers = _fitted(layers, lessons, recipe.seed + k)
    return layers


def _lesson(recipe: DriverRecipe, agent: Layers | None, seed: int) -> Lesson:
    """Drive once; agent: who drives, the teacher if None."""
    env, driver = _environment(recipe), DRIVERS.make(recipe.teacher)
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
    optimizer = torch.optim.Adam(variables, IMITATION_RATE)
    generator = torch.Generator().manual_seed(seed)
    for _ in range(IMITATION_PASSES):
        order = torch.randperm(len(actions), generator=generator)
        for first in range(0, len(order), IMITATION_BATCH):
            rows = order[first : first + IMITATION_BATCH]
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


# --------------------------------------------------------------------------------------------------
# Reinforcement learning by PPO.

STEPS_PER_UPDATE = 256 * ENVIRONMENTS
SETTINGS: Mapping[str, Any] = {"batch_size": 256, "n_epochs": 8, "gamma": 0.98, "ent_coef": 0.005}
"""Settings of PPO: samples of a batch, passes over the samples of an update, discount of a step of
0.2 s, and weight of the entropy."""
LEARNING_RATE, RETRAINING_RATE = 5e-4, 2e-4
"""At the start; both fall to nearly 0. The second is for an agent that can drive already."""


def _trained(recipe: DriverRecipe, start: Layers | None, progress: Progress) -> Layers:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import SubprocVecEnv

    steps = recipe.updates * STEPS_PER_UPDATE
    rate = LEARNING_RATE if start is None else RETRAINING_RATE
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    # Where processes are forked from a server, it imports once what takes each of them seconds.
    multiprocessing.set_forkserver_preload(["__main__", PPO.__module__, __name__])
    environments = SubprocVecEnv([lambda: _environment(recipe)] * ENVIRONMENTS)
    try:
        model = PPO(
            "MlpPolicy",
            environments,
            n_steps=STEPS_PER_UPDATE // ENVIRONMENTS,
            # What is left is counted after the samples of an update are taken.
            learning_rate=lambda left: rate * (left + STEPS_PER_UPDATE / steps),
            policy_kwargs={"net_arch": list(HIDDEN)},
            seed=recipe.seed,
            device="cpu",
            **SETTINGS,
        )
        if start is not None:
            _put_layers(model, start)

        def report(*_: object) -> bool:
            progress("training", model.num_timesteps, steps)
            return True

        model.learn(steps, callback=report)
        return _layers_of(model)
    finally:
        environments.close()
        torch.set_num_threads(threads)


def _linear_layers(model: PPO) -> list[Any]:
    """Return the layers of the network that chooses actions."""
    hidden = list(model.policy.mlp_extractor.policy_net)[::2]
    return [*hidden, model.policy.action_net]


def _layers_of(model: PPO) -> Layers:
    return [
        (layer.weight.detach().numpy(), layer.bias.detach().numpy())
        for layer in _linear_layers(model)
    ]


def _put_layers(model: PPO, layers: Layers) -> None:
    import torch

    with torch.no_grad():
        for layer, (weights, biases) in zip(_linear_layers(model), layers, strict=True):
            layer.weight.copy_(torch.from_numpy(weights))
            layer.bias.copy_(torch.from_numpy(biases))


# --------------------------------------------------------------------------------------------------
# Scores on validation seeds, and the record.


def _validated(recipe: DriverRecipe, weights: Path, progress: Progress) -> Mapping[str, np.ndarray]:
    from joblib import Parallel, delayed

    perceptions = dict.fromkeys((TRUTH, *recipe.perceptions))
    seeds = SPLITS["validation"][: recipe.validation_seeds]
    drives = [
        {"perception": text, "scenario": scenario, "seed": seed}
        for text in perceptions
        for scenario in recipe.scenarios
        for seed in seeds
    ]
    calls = (delayed(_scored)(recipe, str(weights), drive) for drive in drives)
    scores: dict[str, list[tuple[float, bool]]] = {text: [] for text in perceptions}
    done = Parallel(n_jobs=ENVIRONMENTS, return_as="generator")(calls)
    for k, (drive, score) in enumerate(zip(drives, done, strict=True)):
        scores[str(drive["perception"])].append(score)
        progress("validation", k + 1, len(drives))
    return {text: np.array(values, float) for text, values in scores.items()}


def _scored(recipe: DriverRecipe, weights: str, drive: dict[str, Any]) -> tuple[float, bool]:
    """Return the reward of a drive, and whether it ended in a collision."""
    env, agent = _environment(recipe), AgentDriver(weights=weights)
    observation, _ = env.reset(options=drive)
    total, collided, truncated = 0.0, False, False
    while not (collided or truncated):
        observation, reward, collided, truncated, info = env.step(agent.choose(observation))
        total += reward
    planned_s = recipe.duration_s if collided else info["time_s"]
    return total / planned_s, collided


def _write_record(result: DriverTraining, recipe: DriverRecipe) -> None:
    """Write the record: what the weights were made from, and their scores."""
    versions = {name: package_version(name) for name in ("torch", LIBRARY.distribution)}
    settings: dict[str, Any] = {**asdict(recipe), "steps": recipe.updates * STEPS_PER_UPDATE}
    if recipe.start:
        settings |= {"teacher": "", "lessons": 0}
        settings["start_weights"] = _digest(agent_path(recipe.start))
    settings |= {
        "architecture": ARCHITECTURE,
        "environments": ENVIRONMENTS,
        "seeds_per_scenario": SEEDS_PER_SCENARIO,
    }
    settings |= {**(SETTINGS if recipe.steps else {}), "weights": _digest(result.weights)}
    lines = [
        f"# Trained on {cpu_model()}, Python {sys.version.split()[0]}, "
        + ", ".join(f"{name} {version}" for name, version in versions.items()),
        *(f"{name} = {json.dumps(value)}" for name, value in settings.items()),
        "# Scores are on validation seeds.",
    ]
    for perception, scores in result.scores.items():
        reward, collided = scores.mean(axis=0)
        lines += ["", f"[scores.{json.dumps(perception)}]", f"drives = {len(scores)}"]
        lines += [f"reward = {reward:.3f}", f"collided = {collided:.3f}"]
    result.record.write_text("\n".join([*lines, ""]), "utf-8")


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()
