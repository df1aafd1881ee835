import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import pytest

import roadscope
from roadscope.envs import env_ids, register

IDS = env_ids()
SCRIPT = """
import sys
from roadscope.__main__ import main
if __name__ == "__main__":
    sys.exit(main())
"""
"""What pip writes as the command `roadscope`."""


def run(*arguments: str, **variables: str) -> str:
    result = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, **variables},
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


COUNT = "print(sum(name.startswith('roadscope/') for name in gymnasium.registry))"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "imports",
    [
        "import roadscope, gymnasium",
        "import gymnasium, roadscope",
        "import roadscope.trackers, gymnasium",
        "from roadscope import Pose; import gymnasium",
    ],
)
def test_ids_are_known_whatever_is_imported_first(imports: str) -> None:
    assert run("-c", f"{imports}\n{COUNT}") == str(len(IDS) + 1)  # And Drive-v0.


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium\nenv = gymnasium.make('roadscope:roadscope/Highway-v0')",
        "import gymnasium, roadscope\nenv = gymnasium.make('roadscope/Highway-v0')",
        "import roadscope, gymnasium\nenv = gymnasium.make('roadscope/Highway-v0')",
        "import roadscope\nenv = roadscope.make('roadscope/Highway-v0')",
    ],
)
def test_environments_are_made_in_a_fresh_process(code: str) -> None:
    assert run("-c", f"{code}\nprint(env.spec.id)") == "roadscope/Highway-v0"


def test_importing_leaves_the_import_system_as_it_was() -> None:
    code = "import sys, gymnasium\nbefore = list(sys.meta_path)\nimport roadscope\n"
    assert run("-c", f"{code}print(sys.meta_path == before)") == "True"


def test_registering_again_changes_nothing() -> None:
    before = dict(gym.registry)
    register()
    assert dict(gym.registry) == before
    assert set(IDS) <= set(before)


def test_an_id_that_somebody_else_has_registered_is_left_alone() -> None:
    code = (
        "import gymnasium\n"
        "gymnasium.register('roadscope/Highway-v0', entry_point='mine:Env')\n"
        "import roadscope\n"
        "print(gymnasium.spec('roadscope/Highway-v0').entry_point)"
    )
    assert run("-c", code) == "mine:Env"


@pytest.mark.slow
@pytest.mark.parametrize("started", ["module", "script"])
def test_a_command_registers_before_a_plug_in_is_loaded(tmp_path: Path, started: str) -> None:
    (tmp_path / "tiny.py").write_text(
        "import gymnasium, pathlib\n"
        "with pathlib.Path(__file__).with_suffix('.log').open('a') as log:\n"
        "    print('roadscope/Highway-v0' in gymnasium.registry, file=log)\n"
        "class Tracker:\n    pass\n"
    )
    script = tmp_path / "roadscope"
    script.write_text(SCRIPT)
    start = ["-m", "roadscope"] if started == "module" else [str(script)]
    plugin = f"{tmp_path / 'tiny.py'}:Tracker"
    subprocess.run([sys.executable, *start, "check", plugin], capture_output=True, timeout=120)
    assert set((tmp_path / "tiny.log").read_text().split()) == {"True"}


@pytest.mark.slow
def test_the_ids_wait_for_a_command(tmp_path: Path) -> None:
    (tmp_path / "roadscope").write_text(
        "import sys\n"
        "from roadscope.__main__ import main\n"
        "before = 'gymnasium' in sys.modules\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "import gymnasium\n"
        "print(before, 'roadscope/Highway-v0' in gymnasium.registry)\n"
    )
    for arguments, known in ((["--help"], "False"), (["list", "rigs"], "True")):
        printed = run(str(tmp_path / "roadscope"), *arguments).splitlines()
        assert printed[-1].split() == ["False", known]


def test_children_of_the_command_line_know_the_ids_too(tmp_path: Path) -> None:
    (tmp_path / "roadscope").write_text(
        "import multiprocessing, sys\n"
        "import roadscope\n"
        "if __name__ == '__main__':\n"
        "    print('gymnasium' in sys.modules)\n"
        "    with multiprocessing.get_context('spawn').Pool(1) as pool:\n"
        "        import gymnasium\n"
        "        print(pool.apply(gymnasium.spec, ('roadscope/Highway-v0',)).id)\n"
    )
    assert run(str(tmp_path / "roadscope")).split() == ["False", "roadscope/Highway-v0"]


@pytest.mark.parametrize("name", ["roundabout", "roadscope/Roundabout-v0"])
def test_environments_go_by_id_or_scenario(name: str) -> None:
    env = roadscope.make(name, rig="hdl32e")
    assert env.spec is not None
    assert env.spec.id == "roadscope/Roundabout-v0"
    observation, _ = env.reset(seed=0)
    assert observation["lidar_range"].shape[0] == 32
    env.close()


def test_scenarios_without_an_id_are_played() -> None:
    env = roadscope.make("tunnel", max_episode_steps=3)
    assert env.spec is not None
    assert env.spec.kwargs["scenario"] == "tunnel"
    assert env.spec.max_episode_steps == 3
    env.close()


def test_an_error_for_a_mistyped_scenario_lists_known_names() -> None:
    with pytest.raises(ValueError, match=r"'tunel'.*tunnel"):
        roadscope.make("tunel")


@pytest.mark.parametrize("name", IDS)
def test_every_id_plays_a_known_scenario(name: str) -> None:
    env = roadscope.make(name)
    env.close()
