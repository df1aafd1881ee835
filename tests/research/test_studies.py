"""Every study explains itself, and readers find it."""

import tomllib
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
STUDIES = sorted(
    path.stem
    for path in (ROOT / "research").glob("*.py")
    if 'if __name__ == "__main__":' in path.read_text("utf-8")
)


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        import_module(f"research.{name}").main(["--help"])
    assert not ended.value.code
    text = capsys.readouterr().out
    assert f"python -m research.{name}" in text
    assert "--help" in text


def test_readers_find_all_studies_and_no_others() -> None:
    text = (ROOT / "research" / "README.md").read_text("utf-8")
    named = {word.split("`")[0].split(" ")[0] for word in text.split("python -m research.")[1:]}
    assert named == set(STUDIES)


def test_studies_are_not_in_the_wheel() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == ["roadscope"]
