"""Several environments as one: equal to one after the other, faster, and without orphans."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import psutil
import pytest

from roadscope.envs.gym import PooledVectorEnv, pooled

SHORT = {"duration_s": 2.0, "rig": "lux", "records": False}


class OddError(ValueError):
    """An error that cannot be made again from its text."""

    def __init__(self, *, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


class Counting(gym.Env):
    """Counts its steps; actions of 7 and 9 are refused, and one of 8 ends the process."""

    def __init__(self, start: int = 0) -> None:
        self.observation_space = gym.spaces.Box(0, 1000, (2,), np.int64)
        self.action_space = gym.spaces.Discrete(10)
        self._start = start

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._count = self._start + int((options or {}).get("more", 0))
        return np.array([self._count, seed or 0]), {}

    def step(self, action):
        if action == 7:
            raise OddError(code=7, text="seven is refused")
        if action == 9:
            raise ValueError("nine is refused")
        if action == 8:
            os._exit(3)
        self._count += 1
        return np.array([self._count, 0]), float(action), False, False, {"count": self._count}


def batches(name: str, mode: str, steps: int, **settings):
    """Yield what reset and each step return."""
    envs = gym.make_vec(name, num_envs=3, vectorization_mode=mode, **settings)
    yield envs.reset(seed=4)
    for number in range(steps):
        yield envs.step(np.full(3, number % envs.single_action_space.n))
    envs.close()


def assert_same(a, b) -> None:
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    else:
        np.testing.assert_array_equal(a, b)
        assert np.asarray(a).dtype == np.asarray(b).dtype


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("roadscope/Highway-v0", SHORT),
        ("roadscope/Highway-v0", {"perception": "pag + nearest", "rig": "lux", "duration_s": 2.0}),
        ("roadscope/Street-v0", {**SHORT, "duration_s": 0.2}),
        ("roadscope/Drive-v0", {"rig": "lux", "duration_s": 0.4}),
        ("roadscope/Highway-v0", {**SHORT, "duration_s": 9.0, "max_episode_steps": 2}),
    ],
    ids=["sensors", "perception", "played", "drive", "limit"],
)
def test_it_equals_one_environment_after_the_other_also_in_the_next_episode(
    name: str, settings: dict
) -> None:
    ours, theirs = (
        list(batches(name, mode, 5, **settings)) for mode in ("vector_entry_point", "sync")
    )
    assert any(step[2].any() or step[3].any() for step in ours[1:])
    for one, other in zip(ours, theirs, strict=True):
        assert_same(one, other)


def test_gymnasium_makes_it_unless_the_call_says_otherwise() -> None:
    envs = gym.make_vec("roadscope/Highway-v0", num_envs=2, **SHORT)
    assert isinstance(envs, PooledVectorEnv)
    observations, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(observations)
    envs.close()
    with pytest.raises(gym.error.ClosedEnvironmentError):
        envs.step(np.zeros(2, np.int64))


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_rows_stay_in_order_and_observations_are_copies(workers: int) -> None:
    envs = pooled(Counting, 3, workers=workers, start=5)
    first, _ = envs.reset(seed=[7, None, 9], options={"more": 1})
    assert first.tolist() == [[6, 7], [6, 0], [6, 9]]
    second, rewards, *_, infos = envs.step(np.array([1, 2, 3]))
    assert rewards.tolist() == [1.0, 2.0, 3.0]
    assert infos["count"].tolist() == [7, 7, 7]
    assert first[0, 0] == 6
    assert second[0, 0] == 7
    envs.close()


def test_a_mask_chooses_whose_episode_begins_anew() -> None:
    results = []
    for envs in (
        pooled(Counting, 3, workers=2, start=4),
        gym.vector.SyncVectorEnv([lambda: Counting(4)] * 3),
    ):
        envs.reset(seed=1)
        envs.step(np.zeros(3, np.int64))
        mask = np.array([True, False, True])
        results.append((envs.reset(seed=5, options={"reset_mask": mask})[0], *envs.step([1, 1, 1])))
        envs.close()
    assert_same(*results)


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_processes_need_not_be_forked(method: str, tmp_path: Path) -> None:
    script = tmp_path / "agents.py"
    script.write_text(
        "import multiprocessing, gymnasium as gym, roadscope\n"
        "if __name__ == '__main__':\n"
        f"    multiprocessing.set_start_method({method!r})\n"
        "    envs = gym.make_vec('roadscope/Highway-v0', num_envs=2, rig='lux', records=False)\n"
        "    print(envs.reset(seed=0)[0]['ego'].shape)\n"
        "    envs.close()\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.stdout == "(2, 4)\n", done.stderr


def test_without_copies_a_step_writes_over_the_observations() -> None:
    envs = pooled(Counting, 2, copy=False)
    first, _ = envs.reset()
    envs.step(np.zeros(2, np.int64))
    assert first[:, 0].tolist() == [1, 1]
    envs.close()


def test_an_error_of_an_environment_is_raised_and_the_others_go_on() -> None:
    envs = pooled(Counting, 4, workers=2)
    envs.reset()
    with pytest.raises(ValueError, match="nine is refused"):
        envs.step(np.array([0, 9, 0, 0]))
    with pytest.raises(RuntimeError, match="seven is refused"):
        envs.step(np.array([0, 7, 0, 0]))
    for actions in (np.zeros(3, np.int64), np.zeros(6, np.int64)):
        with pytest.raises(ValueError, match="expected 4"):
            envs.step(actions)
    *_, infos = envs.step(np.zeros(4, np.int64))
    assert infos["count"].tolist() == [3, 1, 3, 3]
    envs.close()


def test_what_cannot_be_is_refused() -> None:
    for settings in ({"num_envs": 0}, {"num_envs": 2, "workers": 0}):
        with pytest.raises(ValueError, match="from 1 up"):
            pooled(Counting, **settings)
    envs = pooled(Counting, 2)
    with pytest.raises(ValueError, match="expected 2 seeds, got 1"):
        envs.reset(seed=[1])
    envs.close()


def test_a_process_that_dies_is_named_and_the_rest_is_closed() -> None:
    envs = pooled(Counting, 4, workers=2)
    envs.reset()
    with pytest.raises(RuntimeError, match="environments 1, 3 ended with status 3"):
        envs.step(np.array([0, 8, 0, 0]))
    assert envs.closed


def running(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_processes_end_with_one_that_is_killed() -> None:
    code = (
        "import roadscope, gymnasium as gym, psutil, time\n"
        "envs = gym.make_vec('roadscope/Highway-v0', num_envs=2, rig='lux', workers=2)\n"
        "print(*(child.pid for child in psutil.Process().children()), flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        children = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(children) == 2
        os.kill(parent.pid, signal.SIGKILL)
    end_s = time.monotonic() + 20
    while any(map(running, children)) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert not any(map(running, children))


@pytest.mark.slow
def test_two_processes_share_the_work_of_one() -> None:
    """By processor time, which other work changes less: a process that did all would have 1.

    Measured ratios are 0.50 to 0.62, as two processes slow each other down.
    """

    def used_s(workers: int) -> list[float]:
        others = {child.pid for child in psutil.Process().children()}
        envs = gym.make_vec(
            "roadscope/Highway-v0", num_envs=8, workers=workers, rig="wide", records=False
        )
        envs.reset(seed=0)
        envs.step(np.ones(8, np.int64))  # Kernels are loaded.
        children = [child for child in psutil.Process().children() if child.pid not in others]
        before = [sum(child.cpu_times()[:2]) for child in children]
        for _ in range(2):
            envs.step(np.ones(8, np.int64))
        after = [sum(child.cpu_times()[:2]) for child in children]
        envs.close()
        return [now - then for now, then in zip(after, before, strict=True)]

    (one,), two = used_s(1), used_s(2)
    assert max(two) < 0.75 * one
