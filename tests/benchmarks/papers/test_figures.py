"""A picture for every figure of the papers' experiments."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from roadscope.benchmarks.papers import draw_figures, figures_of
from roadscope.core import SpecError

FIGURES = {
    "lu2018": range(7, 15),
    "zhang2017": (2, 3, 7, 8, 10),
    "li2021": range(5, 9),
    "zhang2022": (3, *range(5, 12)),
}
"""Numbers of the papers' figures that show results."""


@pytest.mark.parametrize("paper", FIGURES)
def test_every_figure_of_a_paper_has_its_picture(paper: str) -> None:
    assert list(figures_of(paper)) == [f"figure-{number:02d}" for number in FIGURES[paper]]


def test_no_picture_of_an_unknown_paper(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="lu2018"):
        draw_figures("lu2019", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("paper", ["lu2018", "zhang2017", "li2021"])
def test_pictures_show_something(paper: str, tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    paths = draw_figures(paper, tmp_path, lambda *progress: done.append(progress))
    count = len(FIGURES[paper])
    assert done == [(k, count) for k in range(count + 1)]
    assert [path.name for path in paths] == [f"{paper}-figure-{n:02d}.png" for n in FIGURES[paper]]
    for path in paths:
        pixels = imread(path)[..., :3]
        assert min(pixels.shape[:2]) > 200
        assert len(np.unique((255 * pixels).astype(np.uint8).reshape(-1, 3), axis=0)) > 20
