import numpy as np
import pytest

from roadscope.core import Pose, Tracks, TrackState
from roadscope.envs.gym import (
    LABEL,
    BirdsEyeView,
    Canvas,
    LabelPlacer,
    draw_legend,
    track_colour,
    write_distances,
    write_ids,
)

SIZE = 400
VIEW = BirdsEyeView(Pose.planar(0.0, 0.0, 0.0), SIZE, 0.2)
WHITE = (255, 255, 255)


def _labels(value: int = 0) -> LabelPlacer:
    return LabelPlacer(Canvas(np.full((SIZE, SIZE, 3), value, np.uint8)))


def _tracks(centres, states=None) -> Tracks:
    count = len(centres)
    states = [TrackState.CONFIRMED] * count if states is None else states
    return Tracks(
        np.arange(count),
        np.array([(x, y, 0.8) for x, y in centres]),
        np.tile([4.0, 2.0, 1.5], (count, 1)),
        np.zeros(count),
        np.zeros((count, 2)),
        np.tile(np.eye(4), (count, 1, 1)),
        np.zeros(count, np.int8),
        np.ones(count),
        np.array(states, np.int8),
        "world",
        5.0,
    )


def _written(tracks: Tracks) -> list[int]:
    """Ids whose colour is in the picture; up to eight ids have colours of their own."""
    labels = _labels()
    write_ids(labels, VIEW, tracks)
    image = labels.canvas.image()
    return [i for i in tracks.ids.tolist() if (image == track_colour(i)).all(axis=2).any()]


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


def test_ids_that_lie_apart_are_all_written():
    assert _written(_tracks([(10.0, 0.0), (20.0, 0.0), (10.0, 10.0)])) == [0, 1, 2]


def test_overlapping_ids_give_way_to_the_nearest_one():
    pile = [(12.0 + 0.1 * step, 0.0) for step in range(8)]
    found = _written(_tracks(pile))
    assert 0 < len(found) < 8
    assert found[0] == 0
    assert _written(_tracks(pile[::-1]))[-1] == 7


def test_ids_of_coasting_tracks_are_written_last():
    states = [TrackState.COASTING] * 4 + [TrackState.CONFIRMED] * 4
    found = _written(_tracks([(12.0, 0.0)] * 8, states))
    assert 4 in found
    assert 0 not in found


def test_distances_are_bright_on_any_ground_and_lie_on_their_rings():
    for ground in (0, 90):
        labels = _labels(ground)
        write_distances(labels, VIEW)
        boxes = np.array(labels.reserved)
        middles = (boxes[:, :2] + boxes[:, 2:]) / 2
        radii = np.linalg.norm(middles - VIEW.home, axis=1) * VIEW.metres_per_px
        assert radii == pytest.approx([20.0 * ring for ring in range(1, len(boxes) + 1)], abs=0.2)
        assert len(boxes) == 2
        x, y = middles[0].astype(int)
        around = labels.canvas.image()[y - 5 : y + 5, x - 20 : x + 20]
        letters = (around == LABEL).all(axis=2)
        assert letters.any()
        assert around[~letters].mean() < 0.3 * np.mean(LABEL)


def test_no_id_is_written_over_the_legend():
    labels = _labels()
    draw_legend(labels, detections=True, tracks=True)
    drawn = labels.canvas.image()
    centre = VIEW.world_from_ego.apply(np.array([[-25.0, 30.0, 0.0]]))[0, :2]
    write_ids(labels, VIEW, _tracks([tuple(centre)]))
    assert np.array_equal(labels.canvas.image(), drawn)
