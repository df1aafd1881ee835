"""Made-up scenes, and trackers that run on them."""

import numpy as np
from toy_boxes import detections

from roadscope.core import Category, Detections, construct
from roadscope.trackers import TRACKERS

T = 0.1
CAR, PERSON = (4.6, 1.85, 1.5), (0.6, 0.6, 1.75)


def boxes(places, tick, scores=0.9, category=Category.CAR, yaws=0.0):
    """Return boxes of one kind, standing on the ground at (N, 2) places, ego frame."""
    size = np.array(PERSON if category is Category.PEDESTRIAN else CAR)
    places = np.reshape(places, (-1, 2))
    centres = np.column_stack([places, np.full(len(places), size[2] / 2)])
    return detections(
        centres,
        sizes=size,
        yaws=yaws,
        categories=category,
        scores=scores,
        frame="ego",
        stamp_s=tick * T,
    )


def both(one, other):
    """Join two frames of detections."""
    names = ("centres", "sizes", "yaws", "categories", "scores")
    joined = [np.concatenate([getattr(one, name), getattr(other, name)]) for name in names]
    return Detections(*joined, one.frame, one.stamp_s)


def make(name, **settings):
    """Return a tracker by name."""
    return construct(TRACKERS.resolve(name).factory, settings)


def run(tracker, episode, poses=None):
    """Return what a tracker says of an episode, without poses or with one for each frame."""
    poses = [None] * len(episode) if poses is None else poses
    return [tracker.update(d, pose) for d, pose in zip(episode, poses, strict=True)]


def identities(tracks, state=None):
    """Return all ids of an episode, or those of tracks that were ever in a state."""
    rows = [each.ids if state is None else each.ids[each.states == state] for each in tracks]
    return set(np.concatenate(rows).tolist())
