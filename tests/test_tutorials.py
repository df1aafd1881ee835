"""The notebooks of the documentation run, with less training and fewer drives than they have."""

import os
from pathlib import Path

import jupytext
import pytest
from nbclient import NotebookClient

import roadscope

ROOT = Path(roadscope.__file__).parents[1]
NOTEBOOKS = sorted(
    path for path in (ROOT / "docs/tutorials").glob("*.md") if path.name != "index.md"
)
SMALLER = {
    "first-score": (("range(40)", "range(10)"), ('"hdl32e", 4.0', '"hdl32e", 2.0')),
    "why-it-loses": (("seeds = 4", "seeds = 2"), ("duration_s = 6.0", "duration_s = 3.0")),
    "train-an-agent": (
        ('"duration": 20', '"duration": 5'),
        ("range(1000, 1010)", "range(1000, 1002)"),
        ("range(4)", "range(2)"),
        ("agent.learn(768)", "agent.learn(128)"),
    ),
    "drive-on-perception": (
        ("range(10_010, 10_016)", "range(10_010, 10_012)"),
        ("duration_s=15.0", 'duration_s=4.0, rig="lux"'),
        ("validation_seeds=2", "validation_seeds=1"),
    ),
}
"""By notebook: what stands there, and what is run in its place."""


def test_the_index_lists_every_notebook() -> None:
    index = (ROOT / "docs/tutorials/index.md").read_text()
    for path in NOTEBOOKS:
        assert f"]({path.name})" in index
        assert f"\n{path.stem}\n" in index
    assert len(NOTEBOOKS) == 4


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    text = path.read_text("utf-8")
    for whole, part in SMALLER.get(path.stem, ()):
        assert whole in text
        text = text.replace(whole, part)
    notebook = jupytext.reads(text, fmt="md:myst")
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(cells) >= 4
    # A cell that raises ends it with the cell's traceback.
    NotebookClient(
        notebook, timeout=1200, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
    printed = [output for cell in cells for output in cell.outputs]
    assert printed
    assert not [o for o in printed if o.output_type == "stream" and o.name == "stderr"]
