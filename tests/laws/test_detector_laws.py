"""Every registered detector: the contract of all detectors, and laws of ours."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from law_scenes import AROUND, carried, differences, mirror_boxes, mirrored, turned_sensor
from law_scenes import film as drive
from toy_lidar import CALIBRATION, scan, scan_of

from roadscope.core import Detections, Frame, LidarScan, Pose
from roadscope.detectors import DETECTORS, Detector
from roadscope.testing import contract_items

SCENE = [
    (22, 0, 4.6, 1.85, 1.5, 0),
    (34, 4, 4.6, 1.85, 1.5, 0),
    (20, -7, 4.6, 1.85, 1.5, 1.57),
    (30, 12, 0.4, 0.4, 2, 0),
    (25, -14, 30, 0.3, 1, 0),
]


STAGED = {name for name in DETECTORS.names() if "ClusterDetector" in DETECTORS.target(name)}
"""Pipelines of stages. `test_stage_laws.py` asks much of any two stages."""
FEW = {"cluster", "pag-residual", "distance-body", "range-angle-filter"}
WHOLLY = [name for name in DETECTORS.names() if name in FEW or name not in STAGED]
"""Those of which everything is asked: a few pipelines, and all other detectors."""
AS_SEEN = {"cluster-boxes"}
"""Boxes of the returns as they lie, for fusions: where a face or two are seen, the box ends there.
Headings are whole multiples of 5 degrees, so of two faces that fit alike the first one counts."""
COMPLETED = [name for name in WHOLLY if name not in AS_SEEN]
"""Those whose boxes are whole road users, so that they move with them."""


@pytest.fixture(params=WHOLLY)
def detector(request):
    return DETECTORS.make(request.param)


@pytest.fixture(params=DETECTORS.names())
def any_detector(request):
    return DETECTORS.make(request.param)


def shuffled(sweep: LidarScan, seed: int) -> LidarScan:
    return sweep.select(np.random.default_rng(seed).permutation(len(sweep)))


def film(scene=(), *, shuffled_by=None, count=6, **options) -> list[Frame]:
    """Return frames 0.1 s apart of a car that comes nearer by 1 m a frame, to (22, 0).

    A detector of what moves needs to have seen what stands.
    """
    frames = []
    for k in range(count):
        boxes = [(22 + count - 1 - k, 0, 4.6, 1.85, 1.5, 0), *scene]
        sweep = replace(scan(boxes, seed=k, **options), stamp_s=1.0 + 0.1 * k)
        sweep = sweep if shuffled_by is None else shuffled(sweep, shuffled_by)
        frames.append(Frame(sweep.stamp_s, CALIBRATION, sweep))
    return frames


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "item",
    [
        item
        for name in DETECTORS.installed()
        for item in contract_items(name)[0 if name in WHOLLY else -1 :]
    ],
    ids=str,
)
def test_contract(item):
    item.verify()


@pytest.mark.sampled(3)
def test_finds_one_vehicle_among_ground(any_detector):
    frames = film([SCENE[3]], noise_m=0.03)
    boxes = [any_detector.detect(f) for f in frames][-1]
    x = 22 + (frames[-1].stamp_s - boxes.stamp_s) / 0.1
    off = np.hypot(*(boxes.centres[:, :2] - [x, 0]).T)
    assert off.min() < 0.25
    assert abs(np.sin(boxes.yaws[off.argmin()])) < np.sin(np.radians(2))
    # Its length is not seen, and usual cars differ by as much.
    assert boxes.sizes[off.argmin()] == pytest.approx([4.6, 1.85, 1.5], abs=0.4)


@pytest.mark.sampled(4)
def test_order_of_points_is_irrelevant(detector):
    first = [detector.detect(f) for f in film(SCENE[1:], noise_m=0.03)]
    assert len(first[-1]) > 0
    for seed in range(3):
        detector.reset()
        frames = film(SCENE[1:], noise_m=0.03, shuffled_by=seed)
        assert [detector.detect(f) for f in frames] == first


@pytest.mark.parametrize("name", COMPLETED)
def test_a_full_turn_of_a_scanner_on_the_roof(name):
    """The car behind lies across the column in which the turn begins; it is one car, or none to
    those who tell what moves alone."""
    behind = (-12, 0.3, 4.6, 1.85, 1.5, 0)
    frames = film([*SCENE[1:], behind], azimuths=AROUND, elevations=np.linspace(-15, 5, 16))
    detector = DETECTORS.make(name)
    boxes = [detector.detect(f) for f in frames][-1]
    x = 22 + (frames[-1].stamp_s - boxes.stamp_s) / 0.1
    off_m = [np.hypot(*(boxes.centres[:, :2] - p).T) for p in ((x, 0), behind[:2], SCENE[2][:2])]
    moving, seam, standing = (d[d < 4] for d in off_m)
    assert len(moving) == 1
    assert moving[0] < 0.5
    assert len(seam) == (len(standing) > 0)
    assert (seam < 0.5).all()


@pytest.mark.parametrize("name", DETECTORS.names())
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60), grid=st.booleans())
def test_any_cloud_gives_proper_boxes(name, seed, count, grid):
    """Duplicates, collinear points, arbitrary rings and columns: a record comes out."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-30, 30, (count, 3)) * [1, 1, 0.03]
    points = np.round(points) if grid else points
    sweep = scan_of(points, rng.integers(0, 4, count), rng.integers(0, 9, count))
    boxes = DETECTORS.make(name).detect(Frame(1.0, CALIBRATION, sweep))
    assert (boxes.frame, boxes.stamp_s) == ("ego", 1.0)
    assert (np.abs(boxes.centres[:, :2]) < 42).all()
    assert DETECTORS.make(name).detect(Frame(1.0, CALIBRATION, shuffled(sweep, 0))) == boxes


def run(detector, frames):
    detector.reset()
    return [detector.detect(each_frame) for each_frame in frames]


def by_cells_of_the_bounding_box(name: str) -> bool:
    """Whether its clustering is PAG, the default: its cells do not turn with the scene."""
    target = DETECTORS.target(name)
    other = "clustering=" in target and "clustering=pag" not in target
    return "ClusterDetector" in target and not other


def every_box(name: str) -> Detector:
    """Make it so that no box is left out for its score, which counts returns."""
    return DETECTORS.make(DETECTORS.target(name).replace("min_score=0.5", "min_score=0.0"))


def runs_like_the_ego(name: str) -> bool:
    """Whether its shape, the default, takes a body of one face to be headed like the ego."""
    target = DETECTORS.target(name)
    return "ClusterDetector" in target and ("shape=" not in target or "shape=iepf" in target)


TURNING = [name for name in COMPLETED if not by_cells_of_the_bounding_box(name)]


@cache
def driven(speed_m_s: float) -> tuple[Frame, ...]:
    """Make the film of the laws that many examples share, once; no example writes into it."""
    return tuple(drive(speed_m_s=speed_m_s))


@cache
def boxes_of(name: str, speed_m_s: float) -> tuple[Detections, ...]:
    """Return the boxes of that film as it is."""
    return tuple(run(every_box(name), driven(speed_m_s)))


def off_after(name: str, speed_m_s: float, motion: Pose) -> np.ndarray:
    """Return how far the boxes are from where they were when the scene is moved."""
    there = run(every_box(name), [carried(each_frame, motion) for each_frame in driven(speed_m_s)])
    before = [each_boxes.moved(motion, "ego") for each_boxes in boxes_of(name, speed_m_s)]
    return np.max([differences(a, b) for a, b in zip(there, before, strict=True)], axis=0)


def worst(detector, frames, others, back) -> np.ndarray:
    """Return how far the answers to frames, brought elsewhere, are from those to others."""
    pairs = zip(run(detector, frames), run(detector, others), strict=True)
    return np.max([differences(there, back(here)) for here, there in pairs], axis=0)


EXACT = (1e-6, 1e-6, 1e-6, 1e-5)
"""Metres of place and of size, radians, score."""
ROUNDED = (1e-3, 1e-3, 1e-3, 1e-2)
"""A scan's numbers are rounded anew, to a few micrometres."""
CLOSE = (0.15, 0.1, 0.035, 0.1)
"""Cells of height and sectors, which do not turn with the scene, decide on single returns; one at
the end of a flank makes a body so much longer or wider."""
DESCENDED = (0.2, 0.35, 0.04, 0.2)
"""Where a descent ends a little before the bottom, or at another bottom of a few returns."""
SAMPLED = (0.3, 0.6, 0.03, 0.1)
"""Where a pose is the mean of drawn samples. Over 80 turned scenes 95 % of headings lay within
0.015 rad, the worst at 0.022 rad."""
LATTICE = (1e-6, 1e-6, 1e-6, 0.05)
"""Where a box slides in strides from a corner of the scene, which a turn makes another one: the
score counts what it holds."""


def allowed(name: str, **by_part: tuple[float, ...]) -> tuple[float, ...]:
    """Return the tolerance of the part of a detector that has one, else all of them `other`."""
    target, other = DETECTORS.target(name), by_part.pop("other", EXACT)
    return next((t for part, t in by_part.items() if PARTS[part] in target), other)


PARTS = {
    "filtered": "shape=matched-filter",
    "fitted": "shape=body",
    "sampled": "fit=body",
    "slid": "LongRangeDetector",
}
"""What names a part in a detector's string."""


films = pytest.mark.parametrize("speed_m_s", [0.0, 8.0], ids=["standing", "driving"])
completed = pytest.mark.parametrize("name", COMPLETED)
many = settings(max_examples=8, phases=[Phase.explicit, Phase.generate])


@pytest.mark.sampled(2)
@completed
@films
@many
@given(k=st.integers(1, 3), x=st.integers(-30, 30), y=st.integers(-30, 30))
def test_right_angles_and_whole_cells_move_the_boxes(name, speed_m_s, k, x, y):
    """What every method owes. Half turns only where traffic is taken to run like the ego."""
    k = 2 if runs_like_the_ego(name) else k
    off = off_after(name, speed_m_s, Pose.planar(x / 2, y / 2, k * np.pi / 2))
    assert (off <= allowed(name, sampled=SAMPLED, slid=LATTICE)).all()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", TURNING)
@films
@many
@given(turn=st.floats(-3.1, 3.1), x=st.floats(-30, 30), y=st.floats(-30, 30))
@example(turn=2.934060755101393, x=1.456, y=0.0035)
def test_rigid_motion_moves_the_boxes(name, speed_m_s, turn, x, y):
    """By as much as leaves bodies of one face headed rather like the ego than across its way."""
    turn = 0.03 * turn if runs_like_the_ego(name) else turn
    off = off_after(name, speed_m_s, Pose.planar(x, y, turn))
    tolerances = {"fitted": DESCENDED, "sampled": SAMPLED, "other": CLOSE}
    assert (off <= allowed(name, **tolerances)).all()


@completed
@films
def test_left_and_right_are_alike(name, speed_m_s):
    frames = drive(speed_m_s=speed_m_s)
    there = [mirrored(each_frame) for each_frame in frames]
    off = worst(every_box(name), frames, there, mirror_boxes)
    assert (off <= allowed(name, fitted=DESCENDED, sampled=SAMPLED)).all()


@films
def test_the_clock_has_no_zero(detector, speed_m_s):
    frames, later = (drive(speed_m_s=speed_m_s, start_s=s) for s in (1.0, 65.0))
    assert (worst(detector, frames, later, lambda boxes: boxes) <= 1e-6).all()


def test_a_sensor_that_stands_may_say_so(detector):
    frames = drive()
    with_motion = [
        replace(f, previous_from_ego=Pose.identity() if k else None) for k, f in enumerate(frames)
    ]
    assert (worst(detector, frames, with_motion, lambda boxes: boxes) <= 1e-6).all()


def test_the_mounting_of_the_sensor_changes_nothing(detector):
    """The returns stay where they are in the ego frame, to the rounding of the scan's numbers."""
    frames = [replace(f, lidar=behind_too(f.lidar)) for f in drive()]
    there = [turned_sensor(each_frame, Pose.planar(0.0, 0.0, 1.0)) for each_frame in frames]
    assert (worst(detector, frames, there, lambda boxes: boxes) <= ROUNDED).all()


def behind_too(sweep: LidarScan) -> LidarScan:
    """Add a return behind the sensor: what looks ahead only knows where its view ends."""
    last = sweep.select(np.array([0]))
    last = replace(last, points=[[-30.0, 0.0, 0.5]], column=last.column + 900)
    fields = ("points", "intensity", "ring", "column", "time_offset_s")
    both = {n: np.concatenate([getattr(sweep, n), getattr(last, n)]) for n in fields}
    return replace(sweep, **both)


def test_copies_of_returns_give_proper_boxes(detector):
    """Those that count returns, such as PAG and DBSCAN, may say something else, but not nothing."""
    frames = drive()
    copied = [
        replace(f, lidar=f.lidar.select(np.repeat(np.arange(len(f.lidar)), 2))) for f in frames
    ]
    boxes_per_frame = run(detector, copied)
    assert any(len(f) for f in boxes_per_frame) == any(len(f) for f in run(detector, frames))


@pytest.mark.parametrize("name", TURNING)
def test_copies_of_returns_move_no_box(name):
    frames = drive()
    copied = [
        replace(f, lidar=f.lidar.select(np.repeat(np.arange(len(f.lidar)), 2))) for f in frames
    ]
    off = worst(every_box(name), frames, copied, lambda boxes: boxes)
    # The sum over copies rounds otherwise, and with it where bins begin.
    assert (off[:3] <= allowed(name, filtered=(0.01, 1e-6, 5e-3))[:3]).all()


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize(
    "place", [(12.0, 0.0, 0.3), (0.0, 0.0, 0.0)], ids=["ahead", "at the sensor"]
)
def test_one_and_two_returns_give_no_boxes(detector, count, place):
    """Seen again and again, and moving."""
    for k in range(5):
        points = np.tile(place, (count, 1)) + np.array([0.5 * k * (place[0] > 0), 0, 0])
        sweep = scan_of(points, stamp_s=1.0 + 0.1 * k)
        assert len(detector.detect(Frame(sweep.stamp_s, CALIBRATION, sweep))) == 0


def test_returns_on_a_line_give_proper_boxes(detector):
    for direction in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 0.1)):
        for k in range(4):
            points = [12.0 - k, 0.0, 0.4] + np.linspace(-2, 2, 30)[:, None] * direction
            sweep = scan_of(points, np.arange(30) % 4, stamp_s=1.0 + 0.1 * k)
            boxes = detector.detect(Frame(sweep.stamp_s, CALIBRATION, sweep))
            assert (np.abs(boxes.centres[:, :2]) < 25).all()
        detector.reset()


def test_scans_that_are_missing_or_empty_now_and_then(detector):
    frames = drive(count=9)
    frames[3] = replace(frames[3], lidar=None)
    frames[5] = replace(frames[5], lidar=frames[5].lidar.select(np.arange(0)))
    stamps = {each_frame.stamp_s for each_frame in frames}
    boxes_per_frame = run(detector, frames)
    assert all(f.stamp_s in stamps for f in boxes_per_frame)
    assert len(boxes_per_frame[-1]) > 0
    assert run(detector, frames) == boxes_per_frame
