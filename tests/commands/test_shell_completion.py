import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import roadscope

ROOT = Path(roadscope.__file__).parents[1]


JOB = {"board": "tracking", "scenario": "street", "seed": 1, "scores": {}}


def roadscope_does(*arguments: str, **variables: str) -> str:
    """Return what the command prints, without complaint."""
    paths = filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])
    done = subprocess.run(
        [sys.executable, "-m", "roadscope", *arguments],
        capture_output=True,
        text=True,
        env={
            **os.environ,
            # The shell is the one that is named, whatever process runs the tests.
            "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1",
            "PYTHONPATH": os.pathsep.join(paths),
            **variables,
        },
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def completed(words: str) -> list[str]:
    """Return what bash is offered for the last word."""
    last = str(len(words.split(" ")) - 1)
    return roadscope_does(
        _ROADSCOPE_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=last
    ).split()


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("roadscope lea", {"leaderboard"}),
        ("roadscope run dense", {"dense-motorway"}),
        ("roadscope run street --rig wi", {"wide"}),
        ("roadscope run street --tracker bytet", {"bytetrack"}),
        ("roadscope run street --detector distance-l-", {"distance-l-shape"}),
        ("roadscope run street --camera-detector colour", {"colour-blobs"}),
        ("roadscope run street --light d", {"day", "dusk"}),
        ("roadscope leaderboard --suite camera", {"camera", "camera-unseen"}),
        ("roadscope leaderboard dete", {"detection"}),
        ("roadscope leaderboard --entry image-f", {"image-first"}),
        ("roadscope run-odometry scans --odometry lego", {"lego-loam", "lego-loam-loop"}),
        ("roadscope new cam", {"camera-detector"}),
        ("roadscope cache clear --kind pos", {"poses"}),
        ("roadscope list we", {"weathers"}),
        ("roadscope submit results --inputs distance-l-", {"distance-l-shape"}),
        ("roadscope check here.py:Mine --kind camera", {"camera", "detector"}),
        ("roadscope check voxel-", {"voxel-map"}),
        ("roadscope leaderboard --by scen", {"scenario"}),
        ("roadscope run street --rig nothing", set()),
    ],
)
def test_names_are_completed(words: str, expected: set[str]) -> None:
    assert set(completed(words)) == expected


@pytest.mark.parametrize("before", ["compare {run} --entry", "compare {run} --entry gnn --entry"])
def test_entries_of_a_run_are_completed(before: str, tmp_path: Path) -> None:
    scores = [{**JOB, "entry": name} for name in ("gnn", "gnn on oracle", "imm")]
    (tmp_path / "leaderboard.json").write_text(json.dumps({"scores": scores}))
    words = f"roadscope {before.format(run=tmp_path)} im"
    assert completed(words) == ["imm"]


def test_the_script_for_a_shell_is_shown() -> None:
    script = roadscope_does("--show-completion", "bash")
    assert "_ROADSCOPE_COMPLETE=complete_bash" in script
