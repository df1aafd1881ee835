"""The README and the site: short, without broken links, true to the code."""

import doctest
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_public_face import OFFERING

import roadscope
from roadscope.benchmarks import load_suite, names_of
from roadscope.benchmarks.boards import BOARDS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text("utf-8")
OUTSIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "RELEASE.md", "research/README.md")


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) < 150


def test_the_readme_says_of_which_version_its_board_is() -> None:
    """A newer version asks for a new board, at a release at the latest (RELEASE.md)."""
    (version,) = re.findall(r"suite quick v(\d+)", README)
    assert 1 <= int(version) <= load_suite("quick").version


@pytest.mark.parametrize("name", OUTSIDE)
def test_links_lead_somewhere(name: str) -> None:
    page = ROOT / name
    links = re.findall(r'\]\(([^)\s]+)\)|src="([^"]+)"', page.read_text("utf-8"))
    inner = [a or b for a, b in links if "://" not in (a or b)]
    missing = [link for link in inner if not (page.parent / link.partition("#")[0]).exists()]
    assert missing == []


def test_every_scenario_has_a_picture_and_all_are_small() -> None:
    pictures = {path.stem: path.stat().st_size for path in (DOCS / "images/scenarios").iterdir()}
    assert sorted(pictures) == sorted(name for name, _ in names_of("scenarios"))
    assert sum(pictures.values()) < 3e6


def documented_columns() -> dict[str, list[tuple[str, str]]]:
    """Return heading and name of each metric on the page, by board."""
    text = (DOCS / "metrics.md").read_text("utf-8")
    return {
        section.partition("\n")[0].lower(): re.findall(r"^\| ([^|]+?) \| `(\w+)` \|", section, re.M)
        for section in text.split("\n## ")
    }


@pytest.mark.parametrize("board", BOARDS)
def test_the_page_of_metrics_has_every_column(board: str) -> None:
    columns = [(column.heading, column.metric) for column in BOARDS[board].columns]
    assert documented_columns()[board] == columns


def test_directions_and_units_are_those_of_the_scores() -> None:
    episode = roadscope.Episode("motorway", 1, "lux", 1.0)
    scored = roadscope.run_episode(episode)
    text = (DOCS / "metrics.md").read_text("utf-8")
    for board, scores in (("Detection", scored.detection), ("Tracking", scored.tracking)):
        (section,) = (each for each in text.split("\n## ") if each.startswith(f"{board}\n"))
        for row in re.findall(r"^\|(.*`\w+`.*)\|$", section, re.M):
            _, name, _, better, unit, _ = (cell.strip(" `") for cell in row.split("|"))
            assert better == scores[name].better, name
            assert (unit or "1") == scores[name].unit, name


@pytest.mark.parametrize("module", OFFERING)
def test_examples_of_public_names_run(module: str) -> None:
    """Those of `score_kitti_results` and `score_mot_results` need files that another test makes."""
    loaded = importlib.import_module(module)
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner()
    for name in loaded.__all__:
        value = getattr(loaded, name)
        if not name.startswith("score_") and (inspect.isclass(value) or inspect.isroutine(value)):
            for case in finder.find(value, name, globs={}):
                assert runner.run(case).failed == 0


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("myst_nb", reason="needs the extra docs")
    pytest.importorskip("furo", reason="needs the extra docs")
    options = ["--quiet", "--fail-on-warning", "--keep-going", "-d", str(tmp_path / "trees")]
    command = [sys.executable, "-m", "sphinx", *options, str(DOCS), str(tmp_path / "site")]
    built = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert built.returncode == 0, built.stderr
    for page in ("index", "api/roadscope", "trackers"):
        assert (tmp_path / "site" / f"{page}.html").is_file()
