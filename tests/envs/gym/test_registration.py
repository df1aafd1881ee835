import subprocess
import sys

import gymnasium as gym
import pytest

from roadscope.envs.gym.registration import IDS, env_ids, register, register_on_import
from roadscope.envs.traffic.scenarios import SCENARIOS


def run(code: str) -> str:
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


COUNT = "print(sum(name.startswith('roadscope/') for name in gymnasium.registry))"


@pytest.mark.parametrize(
    "imports",
    [
        "import roadscope, gymnasium",
        "import gymnasium, roadscope",
        "import roadscope, roadscope.envs.gym.highway, gymnasium",
        "import roadscope, gymnasium.envs.registration",
        "import roadscope; from gymnasium import spaces; import gymnasium",
    ],
)
def test_ids_are_known_whatever_is_imported_first(imports: str) -> None:
    assert run(f"{imports}\n{COUNT}") == str(len(IDS))


def test_make_imports_the_package_that_an_id_names() -> None:
    code = (
        "import gymnasium\n"
        "env = gymnasium.make('roadscope:roadscope/ParkingLot-v0')\n"
        "print(env.spec.id)"
    )
    assert run(code) == "roadscope/ParkingLot-v0"


def test_importing_the_package_loads_no_gymnasium() -> None:
    assert run("import sys, roadscope\nprint('gymnasium' in sys.modules)") == "False"


def test_gymnasium_keeps_its_own_loader_and_no_finder_stays() -> None:
    code = (
        "import sys, roadscope, gymnasium\n"
        "print(type(gymnasium.__spec__.loader).__name__, type(gymnasium.__loader__).__name__,\n"
        "      any('Gymnasium' in type(finder).__name__ for finder in sys.meta_path))"
    )
    assert run(code) == "SourceFileLoader SourceFileLoader False"


def test_looking_for_gymnasium_without_loading_it_is_harmless() -> None:
    code = (
        "import importlib.util, roadscope\n"
        "spec = importlib.util.find_spec('gymnasium')\n"
        "assert spec.origin.endswith('__init__.py') and spec.submodule_search_locations\n"
        f"import gymnasium\n{COUNT}"
    )
    assert run(code) == str(len(IDS))


def test_a_missing_gymnasium_is_reported_as_missing() -> None:
    code = (
        "import sys, roadscope\n"
        "sys.meta_path = [f for f in sys.meta_path if 'Gymnasium' in type(f).__name__]\n"
        "try:\n    import gymnasium\nexcept ModuleNotFoundError as error:\n    print(error.name)"
    )
    assert run(code) == "gymnasium"


def test_registering_again_changes_nothing() -> None:
    register()
    before = dict(gym.registry)
    finders = list(sys.meta_path)
    register()
    register_on_import()
    assert dict(gym.registry) == before
    assert sys.meta_path == finders


def test_an_id_that_somebody_else_has_registered_is_left_alone() -> None:
    code = (
        "import gymnasium\n"
        "gymnasium.register('roadscope/Highway-v0', entry_point='mine:Env')\n"
        "import roadscope\n"
        "print(gymnasium.spec('roadscope/Highway-v0').entry_point)"
    )
    assert run(code) == "mine:Env"


def test_every_id_plays_a_known_scenario() -> None:
    assert env_ids() == tuple(f"roadscope/{name}" for name in IDS)
    assert {arguments["scenario"] for arguments in IDS.values()} <= set(SCENARIOS)
