"""A picture for every figure of the papers' experiments."""

import re
from functools import cache, partial
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from roadscope.benchmarks.papers import FIRST_SEED, draw_figures, figures_of
from roadscope.core import SpecError

FIGURES = {
    "lu2018": range(7, 15),
    "zhang2017": (2, 3, 7, 8, 10),
    "li2021": range(5, 9),
    "zhang2022": (3, *range(5, 12)),
}
"""Numbers of the papers' figures that show results."""
TRAJECTORIES = range(8, 12)
"""Figures of Zhang 2022 that need minutes with all scans."""


@cache
def drawn(paper: str, number: int) -> Figure:
    """Return a figure as it is drawn, trajectories of Zhang 2022 with the first few scans.

    Tests look at the same figure, as some take half a minute.
    """
    figure = Figure(layout="constrained")
    draw = figures_of(paper)[f"figure-{number:02d}"]
    if paper == "zhang2022" and number in TRAJECTORIES:
        draw = partial(draw, scans=8)
    draw(figure)
    return figure


def shows_something(picture: Path) -> bool:
    """Return whether a picture is not small and has colours."""
    pixels = imread(picture)[..., :3]
    colours = np.unique((255 * pixels).astype(np.uint8).reshape(-1, 3), axis=0)
    return min(pixels.shape[:2]) > 200 and len(colours) > 20


@pytest.mark.parametrize("paper", FIGURES)
def test_every_figure_of_a_paper_has_its_picture(paper: str) -> None:
    assert list(figures_of(paper)) == [f"figure-{number:02d}" for number in FIGURES[paper]]


def test_no_picture_of_an_unknown_paper(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="lu2018"):
        draw_figures("lu2019", tmp_path)


@pytest.mark.slow
def test_pictures_of_a_paper_are_written(tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    paths = draw_figures("lu2018", tmp_path, lambda *progress: done.append(progress))
    numbers = FIGURES["lu2018"]
    assert done == [(k, len(numbers)) for k in range(len(numbers) + 1)]
    assert [path.name for path in paths] == [f"lu2018-figure-{n:02d}.png" for n in numbers]
    assert all(map(shows_something, paths))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("paper", "number"), [(paper, number) for paper in FIGURES for number in FIGURES[paper]]
)
def test_a_figure_shows_something_says_its_seed_and_methods_and_covers_no_data_with_names(
    paper: str, number: int, tmp_path: Path
) -> None:
    figure = drawn(paper, number)
    figure.savefig(tmp_path / "figure.png")
    assert shows_something(tmp_path / "figure.png")
    assert re.match(rf"seeds? {FIRST_SEED}(, \d+)*, \w", figure.get_supxlabel())
    figure.draw_without_rendering()
    of_axes = [axes.get_window_extent() for axes in figure.axes]
    for legend in figure.legends:
        assert not any(legend.get_window_extent().overlaps(extent) for extent in of_axes)


@pytest.mark.slow
@pytest.mark.parametrize("number", FIGURES["li2021"])
def test_labels_of_boxes_do_not_overlap(number: int) -> None:
    figure = drawn("li2021", number)
    figure.draw_without_rendering()
    labels = [[text.get_window_extent() for text in axes.texts] for axes in figure.axes]
    assert sum(map(len, labels)) > 5
    for extents in labels:
        assert not any(a.overlaps(b) for a, b in combinations(extents, 2))


@pytest.mark.slow
def test_the_template_of_the_matched_filter_weighs_the_near_edge() -> None:
    templates = [axes for axes in drawn("zhang2017", 3).axes if "template" in axes.get_label()]
    assert len(templates) == 2
    for axes, near_m in zip(templates, (-2.4, 0.9), strict=True):
        places_m, scores = axes.lines[0].get_data()
        assert places_m[scores.argmax()] == pytest.approx(near_m, abs=0.1)
        plateau = scores[np.abs(places_m) < 0.5]
        assert plateau.min() > 0
        assert np.ptp(plateau) < 1e-6
        assert scores.max() > 3 * plateau.max()
        assert scores[[0, -1]] == pytest.approx(-0.5)  # alpha


@pytest.mark.slow
def test_boxes_of_the_occlusion_are_drawn_whole() -> None:
    for axes in drawn("lu2018", 11).axes:
        boxes = [line.get_data() for line in axes.lines if len(line.get_xdata()) == 5]
        assert len(boxes) == 2
        for corners in boxes:
            for values, (low, high) in zip(
                corners, (axes.get_xlim(), axes.get_ylim()), strict=True
            ):
                assert low < min(values) < max(values) < high


@pytest.mark.slow
def test_the_angle_bounds_the_clusters_that_are_drawn() -> None:
    _, after = drawn("zhang2022", 3).axes
    clusters = [each for each in after.collections if len(each.get_offsets())]
    assert len(clusters) > 360 / 5 / 2


@pytest.mark.slow
def test_people_walk_in_view_in_every_case() -> None:
    cases = drawn("zhang2022", 5).axes
    assert len(cases) == 4
    for axes in cases:
        _, people = axes.collections
        x, y = np.abs(people.get_offsets()).T
        assert ((x < axes.get_xlim()[1]) & (y < axes.get_ylim()[1])).sum() >= 100
