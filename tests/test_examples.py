import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from toy_boxes import detections

from roadscope.core import Detections, Pose
from roadscope.trackers import TRACKERS

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name: str, *arguments: str | Path) -> str:
    result = subprocess.run(
        [sys.executable, EXAMPLES / name, *arguments], capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.slow
def test_a_random_agent_sees_the_motorway() -> None:
    printed = run("random_agent.py")
    assert "'lidar_range': (16, " in printed
    assert "step 0: reward" in printed
    assert "10 scans" in printed


@pytest.mark.slow
def test_a_wrapped_environment_feeds_a_detector() -> None:
    lines = run("wrap_highway_env.py").splitlines()
    assert lines[0].startswith("step 0: 12 scans") or lines[0].startswith("step 0: 13 scans")


@pytest.mark.slow
def test_an_odometry_follows_the_ego() -> None:
    lines = run("odometry_on_board.py").splitlines()
    assert len(lines) == 10
    away_m, off_m = (float(part) for part in lines[-1].split()[2::3][:2])
    assert away_m > 200.0
    assert off_m < 0.01 * away_m


@pytest.mark.slow
def test_ppo_trains_on_the_observation() -> None:
    pytest.importorskip("stable_baselines3")
    assert "trained for 64 steps" in run("train_ppo.py")


@pytest.mark.slow
def test_an_agent_drives_on_what_is_perceived() -> None:
    pytest.importorskip("stable_baselines3")
    # It begins to learn after 32 steps.
    lines = run("drive_on_perception.py", "36").splitlines()
    assert [line.partition(":")[0] for line in lines[-3:]] == [
        "truth",
        "distance-l-shape + existence",
        "blind",
    ]
    assert all("crashes in 1 episodes" in line for line in lines[-3:])


def test_the_tracker_of_ones_own_keeps_identities() -> None:
    tracker = TRACKERS.make(f"{EXAMPLES / 'my_tracker.py'}:LastSeen?gate_m=2.5")
    centres = np.array([[10.0, 0.0, 0.5], [20.0, 3.0, 0.5]])
    ids = []
    for k in range(4):
        moved = detections(centres + np.array([k, 0, 0]), frame="ego", stamp_s=0.1 * k)
        ids.append(tracker.update(moved, Pose.identity()).ids.tolist())
    assert ids == [[0, 1]] * 4
    assert len(tracker.update(Detections.empty(1.0), Pose.identity())) == 0


@pytest.mark.slow
def test_pictures_of_the_documentation_are_what_the_cameras_draw_now(tmp_path: Path) -> None:
    written = {Path(line).name for line in run("camera_pictures.py", tmp_path).splitlines()}
    shown = Path(__file__).parents[1] / "docs" / "images"
    assert written == {path.name for path in shown.glob("*.png")}
    page = (shown.parent / "sensors.md").read_text("utf-8")
    for name in written:
        assert f"images/{name}" in page
        now, before = (imread(folder / name) for folder in (tmp_path, shown))
        assert np.abs(now - before).mean() < 0.005
