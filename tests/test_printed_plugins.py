"""The plug-ins that the page `bring-your-own` prints, as they are printed there."""

import re
from pathlib import Path
from typing import Any

import pytest
from toy_drive import driven, offset

from roadscope import ODOMETRIES
from roadscope.driving import DRIVERS, DriveEnv, command_of

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "bring-your-own.md"
PRINTED = re.compile(r"<!-- an? (\w+)(?: of eleven lines)? -->\n```python\n(.*?)```", re.DOTALL)
NAMES = {
    "tracker": "Mine",
    "detector": "MyDetector",
    "odometry": "MyOdometry",
    "fusion": "MyFusion",
    "driver": "MyDriver",
}
"""Kinds of plug-ins, each with the class that is printed for it."""


def printed(kind: str) -> str:
    (matching_text,) = (text for name, text in PRINTED.findall(PAGE.read_text()) if name == kind)
    return str(matching_text)


def saved(folder: Path, kind: str) -> str:
    """Return the spec of a printed plug-in in a file of a reader."""
    path = folder / f"my_{kind}.py"
    path.write_text(printed(kind))
    return f"{path}:{(NAMES | {'policy': 'PpoDriver'})[kind]}"


def test_the_readme_prints_the_same_tracker() -> None:
    assert PRINTED.findall((ROOT / "README.md").read_text()) == [("tracker", printed("tracker"))]


@pytest.mark.parametrize("kind", ["tracker", "odometry"])
def test_it_has_eleven_lines(kind: str) -> None:
    text = printed(kind)
    lines = text[text.index(f"class {NAMES[kind]}") :].splitlines()
    assert len([line for line in lines if line.strip()]) == 11


@pytest.mark.parametrize("kind", NAMES)
def test_it_keeps_every_promise(kind: str, tmp_path: Path) -> None:
    from roadscope import check

    report = check(saved(tmp_path, kind), kind=kind, deadline_s=300.0)
    assert report.kind == kind
    assert report.items
    assert report.ok, str(report)


@pytest.fixture
def policy(tmp_path: Path) -> tuple[str, Any]:
    """Return the spec of the printed driver with a policy that mostly keeps its speed, and that."""
    ppo = pytest.importorskip("stable_baselines3").PPO
    model = ppo("MlpPolicy", DriveEnv("motorway"), seed=0, device="cpu")
    model.policy.action_net.bias.data[3] = 9.0
    model.save(tmp_path / "ppo.zip")
    return f"{saved(tmp_path, 'policy')}?weights={tmp_path / 'ppo.zip'}", model


def test_a_policy_of_stable_baselines3_drives_as_in_its_environment(
    policy: tuple[str, Any],
) -> None:
    spec, model = policy
    env, driver = DriveEnv("motorway", duration_s=1.0), DRIVERS.make(spec)
    observation, _ = env.reset(options={"seed": 3})
    driver.reset()
    over = False
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        assert driver.drive(env.scene) == command_of(int(action), env.scene)
        observation, _, terminated, truncated, _ = env.step(action)
        driver.drive(env.scene)  # The second call of the same 0.2 s.
        over = terminated or truncated


@pytest.mark.slow
def test_a_policy_of_stable_baselines3_keeps_every_promise(policy: tuple[str, Any]) -> None:
    from roadscope import check

    report = check(policy[0], kind="driver", deadline_s=300.0)
    assert report.ok, str(report)


@pytest.mark.slow
def test_the_odometry_follows(tmp_path: Path) -> None:
    odometry = ODOMETRIES.make(saved(tmp_path, "odometry"))
    odometry.reset(None)
    drive, inputs = driven(25)
    estimates = [odometry.update(scan, imu) for scan, imu in inputs]
    distance_m, _ = offset(estimates[-1], drive.pose(inputs[-1][0].stamp_s))
    assert distance_m < 0.5
