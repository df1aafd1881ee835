import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import roadscope
from roadscope.benchmarks import FolderError, check_names, load_suite, plan
from roadscope.benchmarks.boards import BOARDS
from roadscope.benchmarks.templates import TEMPLATES, template_text, write_template
from roadscope.core import SpecError

ROOT = Path(roadscope.__file__).parents[1]
PLUGINS = [kind for kind in TEMPLATES if kind != "suite"]


def roadscope_does(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    paths = filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "80"}
    return subprocess.run(
        [sys.executable, "-m", "roadscope", *map(str, arguments)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=cwd,
        timeout=300,
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", PLUGINS)
def test_the_printed_steps_check_the_template(
    kind: str,
    tmp_path: Path,
    answer: Callable[..., tuple[int, str, str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, output, _ = answer("new", kind)
    assert status == 0
    assert (tmp_path / TEMPLATES[kind].default_path).read_text() == template_text(kind)
    steps = [line.split() for line in output.splitlines() if "roadscope" in line]
    (check,) = [step[1:] for step in steps if step[1] == "check"]
    status, output, _ = answer(*check)
    assert status == 0, output
    assert any(step[1] == "leaderboard" and check[1] in step for step in steps)


@pytest.mark.parametrize("kind", PLUGINS)
def test_plugins_say_their_kind(kind: str, tmp_path: Path) -> None:
    written = write_template(kind, tmp_path)
    content: dict[str, object] = {"__name__": "template"}
    sys.modules["template"] = type(sys)("template")
    try:
        exec(compile(written.path.read_text(), str(written.path), "exec"), content)
    finally:
        del sys.modules["template"]
    (plugin,) = [value for name, value in content.items() if name.startswith("My")]
    assert plugin.kind == kind.replace("-", " ")  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", PLUGINS)
def test_plugins_need_public_names_alone(kind: str) -> None:
    modules = re.findall(r"^from (roadscope\S*) import", template_text(kind), re.MULTILINE)
    assert set(modules) == {"roadscope"}


def test_a_suite_is_checked_with_all_that_it_names(
    tmp_path: Path, answer: Callable[..., tuple[int, str, str]]
) -> None:
    suite = write_template("suite", tmp_path).path
    status, output, _ = answer("check", suite)
    assert status == 0
    assert "all right" in output
    suite.write_text(suite.read_text().replace('"gnn"', '"gun"'))
    status, output, errors = answer("check", suite)
    assert (status, output) == (1, "")
    assert "gun" in errors


def test_the_suite_can_be_read_and_run(tmp_path: Path) -> None:
    written = write_template("suite", tmp_path)
    suite = load_suite(written.path)
    check_names(suite)
    assert suite.boards["detection"].entries
    assert suite.boards["tracking"].entries
    assert all(str(written.path) in step for step in written.next_steps)


def test_the_suite_shows_a_table_of_every_board(tmp_path: Path) -> None:
    path = write_template("suite", tmp_path).path
    head, comments = path.read_text().split("# A rig with a camera")
    tables = "\n".join(re.findall(r"^# (\[\w+\]|\w+ = .*)$", comments, re.MULTILINE))
    for rig, boards in (("wide", BOARDS.keys() - {"odometry"}), ("vlp16-imu", {"odometry"})):
        path.write_text(f"{head}\n{tables}".replace('"lux"', f'"{rig}"'))
        jobs = plan(load_suite(path), [], boards=sorted(boards)).jobs
        assert {job.board.name for job in jobs} == boards


@pytest.mark.slow
def test_the_suite_runs(tmp_path: Path) -> None:
    write_template("suite", tmp_path)
    options = ("--suite", "my_suite.toml", "--seeds", 1, "--jobs", 1)
    done = roadscope_does("leaderboard", *options, cwd=tmp_path)
    assert done.returncode == 0
    assert "gnn" in done.stdout


def test_what_is_there_is_written_over_by_force_alone(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("x = 1\n")
    with pytest.raises(FolderError, match="--force"):
        write_template("tracker", path)
    assert path.read_text() == "x = 1\n"
    assert write_template("tracker", path, force=True).path == path
    assert path.read_text() == template_text("tracker")


def test_the_command_can_be_quiet(tmp_path: Path, answer) -> None:
    assert answer("new", "tracker", tmp_path / "mine.py", "--quiet") == (0, "", "")
    assert (tmp_path / "mine.py").is_file()


def test_paths_with_blanks_can_be_pasted(tmp_path: Path) -> None:
    written = write_template("fusion", tmp_path / "my code" / "f.py")
    assert written.path.is_file()
    assert all(f"'{written.path}'" in step for step in written.next_steps)


def test_unknown_templates_and_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"no template 'trakcer' \(did you mean 'tracker'"):
        write_template("trakcer", tmp_path)
    with pytest.raises(FolderError, match=r"ends in \.toml"):
        write_template("suite", tmp_path / "suite.yaml")
    assert not list(tmp_path.iterdir())
