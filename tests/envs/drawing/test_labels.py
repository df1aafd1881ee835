import numpy as np
import pytest
from toy_boxes import tracks

from roadscope.core import LABEL_COLOUR, Pose, Tracks, TrackState, track_colour
from roadscope.envs.drawing import (
    BirdsEyeView,
    Canvas,
    LabelPlacer,
    LegendRow,
    draw_legend,
    legend_of,
    write_distances,
    write_ids,
)

SIZE = 400
VIEW = BirdsEyeView(Pose.planar(0.0, 0.0, 0.0), SIZE, SIZE, 0.2)
WHITE = (255, 255, 255)


class NotedCanvas(Canvas):
    """Remembers where each text was written."""

    def __init__(self, *size):
        super().__init__(*size)
        self.places = {}

    def text(self, text, corner, *options, **named):
        self.places[text] = corner
        super().text(text, corner, *options, **named)


def _labels(value: int = 0) -> LabelPlacer:
    return LabelPlacer(Canvas(SIZE, SIZE, (value, value, value)))


def _tracks(centres, states=TrackState.CONFIRMED) -> Tracks:
    ids = np.arange(len(centres))
    return tracks(centres, ids, state=states, sizes=[4.0, 2.0, 1.5], stamp_s=5.0)


def _written(tracks: Tracks) -> list[int]:
    """Ids that a canvas was asked to write."""
    labels, ids = _labels(), []
    write = labels.canvas.text
    labels.canvas.text = lambda text, *rest, **more: (
        ids.append(int(text)),
        write(text, *rest, **more),
    )
    write_ids(labels, VIEW, tracks)
    assert (labels.canvas.image() == track_colour(ids[0])).all(axis=2).any()
    return sorted(ids)


def test_no_word_covers_another():
    labels, place = _labels(), np.array([[50.0, 50.0]])
    assert labels.write("12", place, WHITE)
    before = labels.canvas.image()
    assert not labels.write("34", place + 3, WHITE)
    assert np.array_equal(labels.canvas.image(), before)
    assert labels.write("34", np.concatenate([place + 3, place + 30]), WHITE)


@pytest.mark.parametrize("place", [(-1.0, 50.0), (50.0, -1.0), (395.0, 50.0), (50.0, 395.0)])
def test_words_are_written_whole_or_not_at_all(place):
    assert not _labels().write("12", np.array([place]), WHITE)


def test_ids_that_do_not_overlap_are_all_written():
    assert _written(_tracks([(10.0, 0.0), (20.0, 0.0), (10.0, 10.0)])) == [0, 1, 2]


def test_labels_never_cover_each_other():
    rng, labels = np.random.default_rng(0), _labels()
    write_distances(labels, VIEW)
    write_ids(labels, VIEW, _tracks(rng.uniform(-25, 25, (120, 2))))
    boxes = np.array(labels.reserved)
    assert len(boxes) > 30
    for k, box in enumerate(boxes):
        others = np.delete(boxes, k, axis=0)
        disjoint = (box[:2] >= others[:, 2:]) | (box[2:] <= others[:, :2])
        assert disjoint.any(axis=1).all()


def test_the_nearest_of_overlapping_ids_is_written():
    pile = [(12.0 + 0.01 * step, 0.0) for step in range(20)]
    labelled_tracks = _written(_tracks(pile))
    assert 0 < len(labelled_tracks) < 20
    assert labelled_tracks[0] == 0
    assert _written(_tracks(pile[::-1]))[-1] == 19


def test_ids_of_coasting_tracks_are_written_last():
    states = [TrackState.COASTING] * 4 + [TrackState.CONFIRMED] * 4
    canvas = NotedCanvas(SIZE, SIZE)
    write_ids(LabelPlacer(canvas), VIEW, _tracks([(12.0 + k, 0.0) for k in range(8)], states))
    assert [int(text) > 3 for text in canvas.places] == sorted(
        (int(text) > 3 for text in canvas.places), reverse=True
    )
    assert "4" in canvas.places


def test_distances_are_bright_on_any_ground_and_lie_on_their_rings():
    for ground in (0, 90):
        labels = _labels(ground)
        write_distances(labels, VIEW)
        boxes = np.array(labels.reserved)
        middles = (boxes[:, :2] + boxes[:, 2:]) / 2
        radii = np.linalg.norm(middles - VIEW.home, axis=1) * VIEW.metres_per_px
        assert radii == pytest.approx([20.0 * ring for ring in range(1, len(boxes) + 1)], abs=0.2)
        assert len(boxes) > 0
        x, y = middles[0].astype(int)
        around = labels.canvas.image()[y - 7 : y + 7, x - 18 : x + 18]
        assert (around == LABEL_COLOUR).all(axis=2).any()
        assert np.median(around) < 0.3 * np.mean(LABEL_COLOUR)


def _dot(canvas, low, high):
    canvas.circle((low + high) / 2, 4.0, WHITE)


@pytest.mark.parametrize("width", [100, 250, 400])
def test_a_legend_names_every_row_without_overlap(width):
    rows = [LegendRow(f"row {k}", _dot) for k in range(7)]
    height = len(legend_of(rows, width))
    canvas, places = Canvas(width, height), {}
    write = canvas.text
    canvas.text = lambda text, corner, *rest: (
        places.update({text: corner}),
        write(text, corner, *rest),
    )
    draw_legend(canvas, rows, np.zeros(2), width)
    assert set(places) == {row.text for row in rows}
    assert len({tuple(corner) for corner in places.values()}) == len(rows)
    image = canvas.image()
    assert np.array_equal(image, legend_of(rows, width))
    assert (image == WHITE).all(axis=2).sum() > len(rows) * 20
