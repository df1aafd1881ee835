import os
import subprocess
import sys
from pathlib import Path

import pytest

import roadscope

ROOT = Path(roadscope.__file__).parents[1]


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
        ("roadscope run street --rig nothing", set()),
    ],
)
def test_names_are_completed(words: str, expected: set[str]) -> None:
    assert set(completed(words)) == expected


def test_the_script_for_a_shell_is_shown() -> None:
    script = roadscope_does("--show-completion", "bash")
    assert "_ROADSCOPE_COMPLETE=complete_bash" in script
