"""Help that fits a terminal, and examples in it that run."""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import roadscope
from roadscope.__main__ import COMMANDS

ROOT = Path(roadscope.__file__).parents[1]
MOST_LINES = 39
GROUPS = "cache", "train"
"""Commands that have commands of their own."""
QUICK = "list", "new", "doctor", "cache show"
"""Commands whose examples take less than two seconds."""
NEEDS = {
    "report results": ["leaderboard tracking --seeds 1 --out results"],
    "compare results": ["leaderboard tracking --seeds 1 --out results"],
    "check my_tracker.py": ["new tracker"],
    "--entry my_tracker.py": ["new tracker"],
    "exported/velodyne": ["export"],
    "submit": ["export", "detect"],
}
"""Words of an example -> beginnings of the examples that have to run before it."""
SMALL = "small.toml"
"""The suite `quick`, with a third of its traffic and half its length."""
SMALLER = {
    "run roundabout": ("--seconds", "2"),
    "run merge": ("--seconds", "2"),
    "leaderboard": ("--suite", SMALL),
    "train driver": shlex.split("--seconds 2 --perception truth --perception blind --rig lux"),
}
"""Beginnings of examples that would take minutes -> options that they get as well."""
SAYS = {
    "train driver": ("on truth: reward", "on blind: reward", "learned?weights=my_agent.safetensors")
}
"""Beginnings of examples -> what they print."""


def examples_of(text: str) -> list[str]:
    """Return the examples of a help text."""
    lines = text.partition("Examples:\n")[2].splitlines()
    return [line.strip() for line in lines if line.strip()]


EXAMPLES = [line for entry in COMMANDS.values() for line in entry.examples]


@pytest.mark.parametrize("width", [80, 100])
@pytest.mark.parametrize("name", ["", *COMMANDS, "cache clear", "train camera", "train driver"])
def test_help_fits_a_screen_and_shows_every_option(answer, monkeypatch, name, width) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    status, text, errors = answer(*name.split(), "--help")
    assert (status, errors) == (0, "")
    assert len(text.splitlines()) <= MOST_LINES
    shown = text.partition("Examples:")[0]
    assert max(map(len, shown.splitlines())) <= width
    if name in COMMANDS:
        assert examples_of(text) == list(COMMANDS[name].examples)
        assert all(line.startswith(f"roadscope {name}") for line in examples_of(text))
    if name in GROUPS:
        return
    command = name.split()
    for example in [line for entry in COMMANDS.values() for line in entry.examples]:
        words = shlex.split(example)[1:]
        if command and words[: len(command)] == command:
            assert {word for word in words if word.startswith("--")} <= {*shown.split(), "--help"}


def test_the_whole_help_names_every_command(answer) -> None:
    text = answer("--help")[1]
    for name, entry in COMMANDS.items():
        assert f"  {name} " in text
        assert entry.summary in text
    assert roadscope.__version__ in answer("--version")[1]


def test_the_help_of_all_commands_imports_nothing_heavy() -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "roadscope", "--help"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60,
    )
    assert done.returncode == 0
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "roadscope.commands.help" in imported
    assert not imported & {"gymnasium", "numpy", "rich", "roadscope.commands.leaderboard"}


@pytest.fixture(scope="module")
def run_example(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Run an example once, in one folder for all, after those that it needs."""
    folder = tmp_path_factory.mktemp("examples")
    quick = (ROOT / "roadscope/benchmarks/suites/quick.toml").read_text()
    traffic = '"motorway", "dense-motorway", "merge", "roundabout", "intersection", "two-way"'
    for whole, part in (
        (traffic, '"motorway", "roundabout"'),
        ("duration_s = 4", "duration_s = 2"),
    ):
        assert whole in quick
        quick = quick.replace(whole, part)
    (folder / SMALL).write_text(quick)
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "BROWSER": "true",  # a program that does nothing stands for the browser
    }
    outputs: dict[str, str] = {}

    def run(example: str) -> str:
        if example in outputs:
            return outputs[example]
        for words, beginnings in NEEDS.items():
            for beginning in beginnings if words in example else ():
                run(next(e for e in EXAMPLES if e.startswith(f"roadscope {beginning}")))
        if example.startswith("roadscope view"):
            pytest.importorskip("rerun", reason="needs the extra view")
        if example.startswith("roadscope submit"):
            # Answers of another program: here they are ours.
            shutil.copytree(folder / "detections/labels", folder / "answers/detection/0000")
        smaller = example.replace("export quick", f"export {SMALL}")
        command = [sys.executable, "-m", *shlex.split(smaller)]
        for beginning, options in SMALLER.items():
            if example.startswith(f"roadscope {beginning}"):
                command += options
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment, cwd=folder, timeout=1200
        )
        assert done.returncode == 0, done.stderr
        assert "rror" not in done.stderr
        outputs[example] = done.stdout
        return done.stdout

    return run


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(
            example,
            marks=()
            if example.startswith(tuple(f"roadscope {q}" for q in QUICK))
            else pytest.mark.slow,
        )
        for example in EXAMPLES
    ],
)
def test_an_example_of_the_help_runs(run_example, example) -> None:
    printed = run_example(example)
    assert printed.strip()
    for beginning, texts in SAYS.items():
        if example.startswith(f"roadscope {beginning}"):
            for text in texts:
                assert text in printed
