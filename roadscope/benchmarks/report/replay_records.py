"""Moments of episodes for the replay of the page: what a file holds, and how places are written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np

from roadscope.benchmarks.cache import read_kept
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.core import Category, Detections, RecordError, Tracks, Truth

AROUND_S = 2.0
"""Length of a moment before its event and after it; chosen by hand."""
MOST_BOXES = 60
"""Most objects, and most boxes of an entry, in a frame: those nearest to the ego."""
VIEW_MARGIN_M = 12.0
"""Margin of a view around what went wrong; chosen by hand."""
LANE_TOLERANCE_M = 0.15
"""Points of a lane that are nearer than this to its simplified line are left out."""
DECIMETRES, CENTIRADIANS = 10.0, 100.0
"""Decimetres of a metre and hundredths of a radian: the units of files for the page. Boxes in an
image have pixels in place of metres."""


class LaneStrip(msgspec.Struct, frozen=True, array_like=True):
    """A lane: width, decimetres, and x, y of its points, the first one, then differences."""

    width: int
    points: list[int]


class MovingBox(msgspec.Struct, frozen=True, array_like=True):
    """A box over consecutive frames of a moment; one in an image is of a single frame.

    number: id of an object or track; -1 for a detection or a parked car. first: its first frame.
    states: a letter for each frame from there on: m matched, x missed, f false alarm, s matched
        after a switch of identities, i does not count, d a detection that a driver's tracks or
        fused detections are made from, and . absent.
    length, width: decimetres.
    motion: x, y (decimetres) and yaw (0.01 rad) of the first frame, then the differences from each
        frame to the next in which it is present.
    label: category of an object, or category and score of an answer; often empty.
    """

    number: int
    first: int
    states: str
    length: int
    width: int
    motion: list[int]
    label: str = ""


class ReplayMoment(msgspec.Struct, frozen=True, kw_only=True):
    """Some seconds of an episode around an event.

    Coordinates are those of the ego at the event: x ahead, y left. In an image x is to the right
    and y up from its left top corner, in tenths of a pixel.

    kind: such as `misses`. text: what happens. event: number of its frame.
    times_s: of the frames, seconds. ego: its motion, as in `MovingBox`.
    objects, answers: true boxes, and those of the entry.
    estimate: motion of the ego as an odometry estimates it; empty on other boards.
    errors: centimetres from the true position in each frame, for odometries.
    focus: x, y, half length and half width of the first view, decimetres, from the ego; in an
        image tenths of a pixel, from its corner.
    size_px: width and height of images; zeros where none are shown.
    images: JPEG files of the frames, empty where there was no image; none where the page has no
        space for them.
    image_objects, image_answers: boxes in images beside the view from above. Where there are only
        images, all boxes are in `objects` and `answers`, and `ego` is empty.
    image_focus: as `focus`, of these images.
    """

    board: str
    entry: str
    kind: str
    text: str
    scenario: str
    seed: int
    condition: str
    inputs: str
    event: int
    times_s: list[float]
    ego: list[int]
    focus: tuple[int, int, int, int]
    objects: list[MovingBox] = []
    answers: list[MovingBox] = []
    lanes: list[LaneStrip] = []
    estimate: list[int] = []
    errors: list[int] = []
    size_px: tuple[int, int] = (0, 0)
    images: list[bytes] = []
    image_objects: list[MovingBox] = []
    image_answers: list[MovingBox] = []
    image_focus: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        if not 0 <= self.event < len(self.times_s):
            raise ValueError(f"event {self.event} of {len(self.times_s)} frames")
        if min(self.size_px) < 0:
            raise ValueError(f"size_px {self.size_px}")


def named(job: Job) -> dict[str, Any]:
    """Return the fields of a moment that say whose it is."""
    episode = job.episode
    assert isinstance(episode, Episode)
    return {
        "board": job.board.name,
        "entry": job.entry,
        "scenario": episode.scenario,
        "seed": episode.seed,
        "condition": episode.condition,
        "inputs": job.inputs,
    }


# --------------------------------------------------------------------------------------------------
# Boxes of frames.


class FrameBoxes(NamedTuple):
    """The N boxes of a frame, from above or in an image.

    numbers: (N,), ids; -1 without one, and below for objects without an id that stay the same from
        frame to frame. centres, sizes: (N, 2). yaws: (N,).
    states: (N,) letters as in `MovingBox`; they are `i` until the boxes are judged.
    labels: (N,) texts as in `MovingBox`.
    """

    numbers: np.ndarray
    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    states: np.ndarray
    labels: np.ndarray

    def select(self, rows: np.ndarray) -> FrameBoxes:
        """Return some of the boxes. rows: numbers or (N,) bool."""
        return FrameBoxes(*(values[rows] for values in self))


def joined(*parts: FrameBoxes) -> FrameBoxes:
    """Return the boxes of all parts."""
    return FrameBoxes(*map(np.concatenate, zip(*parts, strict=True)))


def boxes_of(record: Truth | Tracks | Detections, numbers: np.ndarray) -> FrameBoxes:
    """Return the boxes of a record, not yet judged; those of objects have labels."""
    states, labels = np.full(len(record), "i"), np.full(len(record), "")
    if isinstance(record, Truth):
        labels = category_names(record.categories)
    centres, sizes = record.centres[:, :2], record.sizes[:, :2]
    return FrameBoxes(numbers, centres, sizes, record.yaws, states, labels)


def category_names(categories: np.ndarray) -> np.ndarray:
    """Return (N,) names of categories, `car`."""
    return _CATEGORY_NAMES[np.asarray(categories, np.int64)]


_CATEGORY_NAMES = np.array([category.name.lower() for category in Category])


def series_of(
    frames: Sequence[FrameBoxes], origin: np.ndarray, egos: np.ndarray, reach_m: float
) -> list[MovingBox]:
    """Join the boxes of frames by their numbers; boxes out of reach of the ego are left out.

    origin: planar pose in whose frame the boxes are shown. egos: those of the ego in each frame.
    """
    series: dict[tuple[int, int], list[_BoxInFrame]] = {}
    for t, (boxes, ego) in enumerate(zip(frames, egos, strict=True)):
        poses = moved_into(np.column_stack([boxes.centres, boxes.yaws]), origin)
        away_m = np.linalg.norm(boxes.centres - ego[:2], axis=1)
        nearest = np.argsort(away_m, kind="stable")[:MOST_BOXES]
        for row in np.sort(nearest[away_m[nearest] <= reach_m]):
            number = int(boxes.numbers[row])
            # A detection has no identity: each is a box of its own.
            key = (number, -1) if number != -1 else (t, int(row))
            state, label = str(boxes.states[row]), str(boxes.labels[row])
            box = _BoxInFrame(t, number, state, poses[row], boxes.sizes[row], label)
            series.setdefault(key, []).append(box)
    return [_moving_box(each) for each in series.values()]


class _BoxInFrame(NamedTuple):
    """A box in one frame of a moment.

    number: as in `FrameBoxes`. pose: planar. size: length and width.
    """

    frame: int
    number: int
    state: str
    pose: np.ndarray
    size: np.ndarray
    label: str


def _moving_box(boxes: Sequence[_BoxInFrame]) -> MovingBox:
    """Join the boxes of one object, track or detection, in order of frames."""
    first, last = boxes[0].frame, boxes[-1].frame
    states = ["."] * (last - first + 1)
    for box in boxes:
        states[box.frame - first] = box.state
    length, width = np.rint(np.median([box.size for box in boxes], axis=0) * DECIMETRES)
    motion = motion_of(np.array([box.pose for box in boxes]))
    number, label = max(boxes[0].number, -1), boxes[0].label
    return MovingBox(number, first, "".join(states), int(length), int(width), motion, label)


# --------------------------------------------------------------------------------------------------
# Places as small whole numbers: poses, lanes, and what to look at. Planar poses are (N, 3): x, y,
# metres, and yaw, radians.


def planar(poses: np.ndarray) -> np.ndarray:
    """Return (N, 3) planar poses of (N, 4, 4) ones."""
    return np.column_stack([poses[:, :2, 3], np.arctan2(poses[:, 1, 0], poses[:, 0, 0])])


def moved_into(poses: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return planar poses in the frame of another one."""
    cos, sin = np.cos(origin[2]), np.sin(origin[2])
    x, y = (poses[:, :2] - origin[:2]).T
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, poses[:, 2] - origin[2]])


def focus_on(points: np.ndarray) -> tuple[int, int, int, int]:
    """Return the centre, half length and half width of a view of (N, 2) points."""
    low, high = points.min(axis=0) - VIEW_MARGIN_M, points.max(axis=0) + VIEW_MARGIN_M
    x, y, length, width = np.rint(np.append(low + high, high - low) / 2 * DECIMETRES).astype(int)
    return int(x), int(y), int(length), int(width)


def motion_of(poses: np.ndarray) -> list[int]:
    """Return planar poses as whole numbers: the first, then differences."""
    unwrapped = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    scaled = np.rint(unwrapped * (DECIMETRES, DECIMETRES, CENTIRADIANS)).astype(int)
    return _differences(scaled)


def _differences(rows: np.ndarray) -> list[int]:
    """Return the first row, then the differences from row to row, one after the other."""
    return [int(value) for value in np.diff(rows, axis=0, prepend=0 * rows[:1]).ravel()]


def lanes_of(episode: Episode) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the lanes of an episode's road; none if its traffic is not kept."""
    node = TrafficNode.of(episode)
    try:
        return read_kept(node.path, node.record.load).road.lanes()
    except (OSError, RecordError):
        return []


def near_lanes(
    lanes: Sequence[tuple[np.ndarray, np.ndarray]],
    origin: np.ndarray,
    egos: np.ndarray,
    reach_m: float,
) -> list[LaneStrip]:
    """Return the parts of lanes that come near the ego, with no more points than bends need."""
    shown = []
    for points, widths in lanes:
        is_near = np.zeros(len(points), bool)
        for ego in egos[:: max(1, len(egos) // 8)]:
            is_near |= np.linalg.norm(points - ego[:2], axis=1) <= 1.5 * reach_m
        rows = np.flatnonzero(is_near)
        # A lane that leaves and comes back gives several parts.
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if len(part) > 1:
                poses = np.column_stack([points[part], np.zeros(len(part))])
                line = _simplified(moved_into(poses, origin)[:, :2])
                width = round(float(np.median(widths[part])) * DECIMETRES)
                shown.append(LaneStrip(width, _differences(np.rint(line * DECIMETRES).astype(int))))
    return shown


def _simplified(line: np.ndarray) -> np.ndarray:
    """Return a line with no more points than bends need (Douglas and Peucker 1973)."""
    chord = line[-1] - line[0]
    offsets = line - line[0]
    length = float(np.hypot(*chord))
    if length > 0:
        distances = np.abs(chord[0] * offsets[:, 1] - chord[1] * offsets[:, 0]) / length
    else:
        distances = np.hypot(*offsets.T)
    farthest = int(np.argmax(distances))
    if distances[farthest] <= LANE_TOLERANCE_M:
        return line[[0, -1]]
    before, after = _simplified(line[: farthest + 1]), _simplified(line[farthest:])
    return np.vstack([before[:-1], after])
