"""Draws the figures of a paper in one style: colours that colour-blind readers tell apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.cache import write_atomically
from roadscope.benchmarks.papers.reproduction import FIRST_SEED
from roadscope.core.palette import FIGURE_STYLE, PAPER_COLOURS, PAPER_FAINT, PAPER_TRUTH

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CAPTION_COLOUR = "#606060"
"""Dark enough to be read, fainter than titles."""

Draw = Callable[["Figure"], None]
"""Draws one figure into an empty one, and sets its size."""


def draw_all(
    paper: str,
    figures: Mapping[str, Draw],
    folder: Path,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Draw figures by name into `folder/PAPER-NAME.png`; return the files.

    progress: called with figures drawn and figures in all.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    paths: list[Path] = []
    for name, draw in figures.items():
        if progress is not None:
            progress(len(paths), len(figures))
        with mpl.rc_context(dict(FIGURE_STYLE)):
            figure = Figure((9.0, 4.0), layout="constrained")
            draw(figure)
            paths.append(folder / f"{paper}-{name}.png")
            # The same figures give the same bytes.
            save = partial(figure.savefig, format="png", metadata={"Software": None})
            write_atomically(paths[-1], save)
    if progress is not None:
        progress(len(paths), len(figures))
    return paths


def caption(figure: Figure, shown: str, seeds: Sequence[int] = (FIRST_SEED,)) -> None:
    """Say in small letters below a figure which seeds and which methods it shows."""
    numbers = ", ".join(map(str, seeds))
    text = f"seed{'s' * (len(seeds) > 1)} {numbers}, {shown}"
    figure.supxlabel(text, x=0.01, ha="left", fontsize=7, color=CAPTION_COLOUR)


def legend_above(figure: Figure, places: Iterable[Axes], *, marker_scale: float = 1.0) -> None:
    """Draw one legend of some axes, each name once, above all axes, where no data lie."""
    handles: dict[str, Artist] = {}
    for axes in places:
        of_axes, names = axes.get_legend_handles_labels()
        handles |= dict(zip(names, of_axes, strict=True))
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside upper center",
        ncols=len(handles),
        markerscale=marker_scale,
    )


def seen_from_above(axes: Axes, title: str = "") -> None:
    """Prepare axes for x ahead and y left, metres, with equal scales."""
    axes.set(title=title, xlabel="x ahead (m)", ylabel="y left (m)")
    axes.set_aspect("equal", adjustable="box")


def draw_points(axes: Axes, points: np.ndarray, colour: str = PAPER_FAINT, label: str = "") -> None:
    """Draw (N, 2) points or more columns, metres, as dots."""
    axes.scatter(points[:, 0], points[:, 1], s=3, color=colour, label=label or None, linewidths=0)


def draw_clusters(axes: Axes, points: np.ndarray, labels: np.ndarray) -> None:
    """Draw (N, 2) points by cluster, colours in turn; outliers (negative labels) are faint."""
    draw_points(axes, points[labels < 0])
    for label in np.unique(labels[labels >= 0]):
        draw_points(axes, points[labels == label], PAPER_COLOURS[int(label) % len(PAPER_COLOURS)])


def draw_box(
    axes: Axes, pose: np.ndarray, size: np.ndarray, colour: str = PAPER_TRUTH, label: str = ""
) -> None:
    """Draw a rectangle from above; pose: x, y, yaw of its centre; size: length and width."""
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) * np.asarray(size)[:2] / 2
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = (corners @ np.array([[c, s], [-s, c]]) + np.asarray(pose)[:2]).T
    axes.plot(x, y, color=colour, linewidth=1, label=label or None)
