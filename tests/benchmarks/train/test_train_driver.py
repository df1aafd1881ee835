"""Training of drivers: the files it writes, what it starts from, and what it refuses."""

import tomllib
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from roadscope import SpecError
from roadscope.benchmarks.train import DriverRecipe, action_of, train_driver
from roadscope.core import DrivingCommand, NotInstalledError
from roadscope.driving import DRIVERS, AgentDriver, DriveEnv, load_agent
from roadscope.envs.traffic import ScenarioError

UPDATE = 1024
"""Decisions of an update of the network."""
SHORT = DriverRecipe(
    scenarios=("merge",), teacher="", steps=UPDATE, duration_s=6.0, validation_seeds=2, seed=1
)


def test_wrong_input_is_refused_before_anything_is_trained(tmp_path) -> None:
    out = tmp_path / "agent.safetensors"
    with pytest.raises(ScenarioError, match="mergge"):
        train_driver(out, replace(SHORT, scenarios=("mergge",)))
    with pytest.raises(SpecError, match="no perception stack"):
        train_driver(out, replace(SHORT, perceptions=("truth", "lidar")))
    with pytest.raises(ValueError, match="no agent 'nobody'"):
        train_driver(out, replace(SHORT, start="nobody"))
    with pytest.raises(SpecError, match="nobody"):
        train_driver(out, replace(SHORT, teacher="nobody"))
    with pytest.raises(ValueError, match="steps: expected more than 0"):
        train_driver(out, replace(SHORT, steps=0))
    for name in ("lessons", "validation_seeds"):
        with pytest.raises(ValueError, match=f"{name}: expected at least 1, got 0"):
            train_driver(out, replace(SHORT, **{name: 0}))
    with pytest.raises(ValueError, match=r"as .safetensors, not as .zip"):
        train_driver(tmp_path / "agent.zip", SHORT)
    assert not list(tmp_path.iterdir())


def test_without_the_library_it_says_what_to_install(tmp_path, uninstall) -> None:
    uninstall("stable-baselines3")
    with pytest.raises(NotInstalledError, match=r"pip install 'roadscope\[rl\]'"):
        train_driver(tmp_path / "agent", SHORT)


@pytest.mark.slow
def test_a_trained_agent_is_written_with_its_record_and_trained_further(tmp_path) -> None:
    """Steps are rounded up to whole updates, and each of these learns."""
    pytest.importorskip("stable_baselines3")
    stages = []
    first = train_driver(
        tmp_path / "first",
        replace(SHORT, steps=1),
        progress=lambda stage, done, total: stages.append((stage, done, total)),
    )
    assert first.weights == tmp_path / "first.safetensors"
    assert ("training", UPDATE, UPDATE) in stages
    assert stages[-1] == ("validation", 2, 2)
    record = tomllib.loads(first.record.read_text())
    assert (record["steps"], record["scenarios"], record["seed"]) == (UPDATE, ["merge"], 1)
    assert record["scores"]["truth"]["drives"] == 2
    assert record["scores"]["truth"]["reward"] == pytest.approx(
        first.scores["truth"][:, 0].mean(), abs=1e-3
    )
    again = train_driver(tmp_path / "again", SHORT)
    assert again.weights.read_bytes() == first.weights.read_bytes()
    longer = train_driver(tmp_path / "longer", replace(SHORT, steps=UPDATE + 1, validation_seeds=1))
    assert tomllib.loads(longer.record.read_text())["steps"] == 2 * UPDATE
    assert longer.weights.read_bytes() != first.weights.read_bytes()
    further = replace(SHORT, seed=2, start=str(first.weights), perceptions=("truth", "blind"))
    second = train_driver(tmp_path / "second", further)
    assert set(second.scores) == {"truth", "blind"}
    record = tomllib.loads(second.record.read_text())
    assert record["start_weights"] == sha256(first.weights.read_bytes()).hexdigest()
    before, after = load_agent(first.weights), load_agent(second.weights)
    # It goes on from the other agent, so its weights are near those; new ones are near 0.
    moved = np.abs(after[0][0] - before[0][0]).mean()
    assert 0 < moved < 0.5 * np.abs(before[0][0]).mean()


class Hesitant:
    """Brakes where there is one lane and accelerates where there are more."""

    def reset(self) -> None: ...

    def drive(self, scene):
        return DrivingCommand(1.5 if scene.lanes > 1 else -4.0, scene.target_lane)


def test_an_agent_does_what_its_teacher_does(tmp_path) -> None:
    hesitant = f"{Path(__file__)}:Hesitant"
    imitation = replace(
        SHORT,
        scenarios=("motorway", "merge"),
        teacher=hesitant,
        steps=0,
        lessons=2,
        duration_s=12.0,
    )
    stages = []
    trained = train_driver(tmp_path / "new", imitation, progress=lambda *each: stages.append(each))
    assert stages[9] == ("imitation", 10, 10)
    assert tomllib.loads(trained.record.read_text())["teacher"] == hesitant
    agent, teacher = AgentDriver(weights=str(trained.weights)), DRIVERS.make(hesitant)
    env = DriveEnv(["motorway", "merge"], duration_s=12.0)
    same, taught = [], []
    for scenario in ("motorway", "merge"):
        observation, _ = env.reset(options={"seed": 10_000, "scenario": scenario})
        over = False
        while not over:
            taught.append(action_of(teacher.drive(env.scene), env.scene))
            same.append(agent.choose(observation) == taught[-1])
            observation, _, collided, late, _ = env.step(taught[-1])
            over = collided or late
    assert np.bincount(taught).max() < 0.8 * len(taught)
    assert np.mean(same) > 0.95


class Cautious:
    """Brakes where there is any road user, and accelerates where there is none."""

    def reset(self) -> None: ...

    def drive(self, scene):
        return DrivingCommand(-4.0 if len(scene.tracks) else 1.5, scene.target_lane)


def test_a_teacher_sees_the_truth_where_the_agent_is_blind(tmp_path) -> None:
    recipe = replace(
        SHORT, perceptions=("blind",), teacher=f"{Path(__file__)}:Cautious", steps=0, lessons=1
    )
    trained = train_driver(tmp_path / "new", recipe)
    agent, env = AgentDriver(weights=str(trained.weights)), DriveEnv("merge", perception="blind")
    observation, _ = env.reset(options={"seed": 10_000})
    assert not len(env.scene.tracks)
    assert agent.choose(observation) == 1
    assert action_of(Cautious().drive(env.scene), env.scene) == 4


@pytest.mark.parametrize(
    ("acceleration", "lane", "action"),
    [(-9.0, 1, 0), (-2.9, 1, 2), (-0.9, 1, 3), (0.8, 1, 4), (0.8, 0, 5), (-8.0, 2, 6)],
)
def test_the_action_is_the_one_nearest_to_a_command(acceleration, lane, action) -> None:
    env = DriveEnv("motorway", duration_s=1.0)
    env.reset(options={"seed": 10_000})
    scene = replace(env.scene, lanes=3, lane=1, target_lane=1)
    assert action_of(DrivingCommand(acceleration, lane), scene) == action
    changing = replace(scene, lane=0)
    expected = min(action, 0 if acceleration < -6 else 4)
    assert action_of(DrivingCommand(acceleration, lane), changing) == expected
