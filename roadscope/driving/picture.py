"""A picture of a drive: what is true, what was sensed, and what the driver believes."""

from __future__ import annotations

from collections import deque

import numpy as np

from roadscope.core import DrivingScene, Tracks, Truth
from roadscope.core.palette import TRUTH_COLOUR
from roadscope.driving.closed_loop import ClosedLoop
from roadscope.envs.drawing.birds_eye import (
    OBJECT,
    PATH_PX,
    BirdsEyeView,
    draw_ego,
    draw_returns,
    draw_rings,
    draw_road,
    draw_tracks,
    draw_truth,
    return_rows,
    track_rows,
    user_rows,
    write_distances,
    write_ids,
)
from roadscope.envs.drawing.canvas import Canvas
from roadscope.envs.drawing.composed import MARGIN, METRES_PER_PX, SIDE_PX, VIEW_PX, framed
from roadscope.envs.drawing.labels import LabelPlacer, legend_of
from roadscope.envs.drawing.panels import RunningScore, score_panel

FIGURES = {"speed (m/s)": 1, "believed gap ahead (m)": 1, "reward so far": 2, "tracks": 0}
"""What is shown over time, with decimals."""
SCORES_PX = 270
MEMORY_S = 1.0
"""Length of the traffic before now that is read. An older scan is not drawn: faults lose some."""
OLDER_S = 0.2
"""How much older than its stamp the returns of a scan may be."""
TAIL = 10
"""Decisions over which the past of a track is shown."""


class DrivePictures:
    """Draws a drive, decision by decision.

    title: above the figures.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._past: deque[Tracks] = deque(maxlen=TAIL)
        self._places: list[np.ndarray] = []
        self._figures: list[tuple[float, ...]] = []

    def add(self, loop: ClosedLoop, scene: DrivingScene, reward: float) -> None:
        """Note the state after a decision. scene: what the driver has. reward: so far."""
        self._past.append(scene.tracks)
        self._places.append(loop.traffic.world_from_ego.translation[:2])
        gap_m = scene.gap_m if np.isfinite(scene.gap_m) else np.nan
        self._figures.append((scene.speed_m_s, gap_m, reward, float(len(scene.tracks))))

    def draw(self, loop: ClosedLoop) -> np.ndarray:
        """Return the picture of the latest state, (720, 1280, 3) uint8."""
        *past, tracks = self._past
        timeline = loop.traffic.timeline(MEMORY_S)
        pose = loop.traffic.world_from_ego
        view = BirdsEyeView(pose, VIEW_PX, VIEW_PX, METRES_PER_PX)
        canvas = Canvas(VIEW_PX, VIEW_PX)
        draw_road(canvas, view, timeline)
        draw_rings(canvas, view)
        scan = loop.scan
        if scan is not None and loop.traffic.now_s - scan[0].stamp_s < MEMORY_S - OLDER_S:
            draw_returns(canvas, view, *scan, timeline, colour_by=OBJECT)
        canvas.line(view.pixels(np.array(self._places)), TRUTH_COLOUR, PATH_PX)
        draw_truth(canvas, view, _truth_now(loop))
        draw_ego(canvas, view, timeline)
        draw_tracks(canvas, view, tracks, past)
        labels = LabelPlacer(canvas)
        write_ids(labels, view, tracks)
        write_distances(labels, view)
        scores = [
            RunningScore(name, values, decimals=decimals)
            for (name, decimals), values in zip(
                FIGURES.items(), np.array(self._figures).T, strict=True
            )
        ]
        panels = [
            (score_panel(SIDE_PX, SCORES_PX, pair), MARGIN) for pair in (scores[:2], scores[2:])
        ]
        rows = [*user_rows(), *track_rows(), *(return_rows() if scan is not None else ())]
        legend = legend_of(rows, SIDE_PX)
        return framed(canvas.image(), self._title, loop.traffic.now_s, panels, legend)


def _truth_now(loop: ClosedLoop) -> Truth:
    """Return the road users as they are, all of them as if they were seen."""
    users = loop.traffic.true_tracks()
    count = len(users)
    return Truth(
        users.ids,
        users.categories,
        users.centres,
        users.sizes,
        users.yaws,
        users.velocities,
        np.ones(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(count),
        loop.traffic.world_from_ego,
        users.stamp_s,
        np.empty(0, np.int64),
    )
