"""Average precision of objects: equal to KITTI's rules, written down plainly, and to hand work."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kitti_evaluation import average_precision

from roadscope.benchmarks import score_kitti_object_results
from roadscope.benchmarks.formats import TYPE_NAMES, read_kitti_object_labels
from roadscope.benchmarks.recorded import DIFFICULTIES, object_precisions
from roadscope.formats import FormatError, KittiObjects, KittiType

TYPES = {name: kind for kind, name in TYPE_NAMES.items()} | {"Person_sitting": KittiType.PERSON}
CLASSES = ("Car", "Pedestrian", "Cyclist")


def thing(kind="Car", *, x=0.0, z=20.0, top=100.0, left=100.0, height=50.0, **others):
    """A label or a detection: a box 4 m long along x, and an image box 80 px wide."""
    return {
        "type": kind,
        "truncated": 0.0,
        "occluded": 0,
        "box": (left, top, left + 80.0, top + height),
        "h": 1.5,
        "w": 1.6,
        "l": 4.0,
        "x": x,
        "y": 1.7,
        "z": z,
        "ry": 0.0,
        "score": 1.0,
        **others,
    }


def rows(things):
    """The same as a record of roadscope."""
    n = len(things)

    def column(*names):
        values = [[each[name] for name in names] for each in things]
        array = np.array(values, np.float64).reshape(n, len(names))
        return array[:, 0] if len(names) == 1 else array

    return KittiObjects(
        frames=np.zeros(n),
        ids=np.full(n, -1),
        types=np.array([TYPES[each["type"]] for each in things], np.int8),
        truncated=column("truncated"),
        occluded=column("occluded"),
        alphas=np.zeros(n),
        boxes=np.array([each["box"] for each in things], np.float64).reshape(n, 4),
        sizes=column("l", "w", "h"),
        bottoms=column("x", "y", "z"),
        rotations_y=column("ry"),
        scores=column("score"),
    )


def precisions(frames, name="Car", kind="3d"):
    labels, detections = zip(*frames, strict=True)
    return object_precisions(
        list(map(rows, labels)), list(map(rows, detections)), TYPES[name], kind
    )


def random_frames(rng, name, count):
    """Labels of all kinds close together, and detections near them, near nothing, or twice."""
    frames = []
    kinds = [name, name, name, "Van", "Person_sitting", "Pedestrian", "Car", "Tram", "DontCare"]
    for _ in range(count):
        labels, detections = [], []
        for _ in range(rng.integers(0, 6)):
            left, top = rng.uniform(0, 900), rng.uniform(100, 250)
            kind = str(rng.choice(kinds))
            place = thing(
                kind,
                x=rng.uniform(-6, 6),
                z=rng.uniform(8, 20),
                box=(left, top, left + rng.uniform(20, 120), top + rng.uniform(15, 90)),
                truncated=float(rng.choice([0, 0, 0.1, 0.2, 0.4, 0.6])),
                occluded=int(rng.choice([0, 0, 1, 2, 3])),
                ry=rng.uniform(-3, 3),
                l=rng.uniform(1, 4),
                w=rng.uniform(0.6, 2),
            )
            labels.append(place)
            for _ in range(rng.integers(0, 4)):
                shift = rng.normal(0, rng.choice([0.02, 0.2]), 8)
                other = rng.random() < 0.15
                detections.append(
                    place
                    | {
                        "type": str(rng.choice(CLASSES)) if other or kind not in CLASSES else kind,
                        "x": place["x"] + shift[0],
                        "z": place["z"] + shift[1],
                        "y": place["y"] + 0.3 * shift[2],
                        "ry": place["ry"] + 0.3 * shift[3],
                        "box": tuple(np.array(place["box"]) + 20 * np.sort(shift[4:])),
                        "score": round(rng.random(), int(rng.choice([1, 6]))),
                    }
                )
        rng.shuffle(detections)
        frames.append((labels, detections))
    return frames


@given(st.integers(0, 10**6), st.sampled_from(CLASSES), st.sampled_from(["2d", "bev", "3d"]))
@settings(max_examples=60, deadline=None)
def test_it_equals_the_plain_evaluation(seed, name, kind):
    rng = np.random.default_rng(seed)
    frames = random_frames(rng, name, int(rng.integers(1, 40)))
    ours = precisions(frames, name, kind)
    for level in DIFFICULTIES:
        expected = average_precision(frames, name, level, kind)
        assert ours[level].ap == pytest.approx(expected, abs=1e-12, nan_ok=True)


def test_perfect_detections_reach_one_only_with_enough_objects():
    frames = [([thing()], [thing(score=1 - k / 200)]) for k in range(100)]
    for level, precision in precisions(frames).items():
        assert precision.objects == 100
        assert precision.ap == 1.0, level
    assert precisions(frames[:8])["easy"].ap == pytest.approx(7 / 40)


def test_hand_work_half_of_the_objects_with_false_ones_between():
    # Eighty cars of which forty are found, with falling scores; after each but the first ten found
    # ones comes a false detection. Two objects are a step of recall: thresholds are the scores of
    # the 1st, 2nd (0.025), 4th (0.05), ..., 40th (0.5) of the found ones, 21 in all.
    frames = []
    for k in range(80):
        detections = [thing(score=1 - 2 * k / 100)] if k < 40 else []
        if 10 <= k < 40:
            detections.append(thing(x=30.0, score=1 - (2 * k + 1) / 100))
        frames.append(([thing()], detections))
    # At the n-th found one, n of n + max(n - 11, 0) are right.
    steps = [n / (n + max(n - 11, 0)) for n in range(2, 41, 2)]
    assert precisions(frames)["easy"].ap == pytest.approx(sum(steps) / 40)


@pytest.mark.parametrize(
    ("change", "levels"),
    [
        ({}, "easy moderate hard"),
        ({"occluded": 1}, "moderate hard"),
        ({"occluded": 2}, "hard"),
        ({"occluded": 3}, ""),
        ({"truncated": 0.15}, "easy moderate hard"),
        ({"truncated": 0.3}, "moderate hard"),
        ({"truncated": 0.5}, "hard"),
        ({"truncated": 0.51}, ""),
        ({"height": 40.0}, "moderate hard"),
        ({"height": 25.0}, ""),
        ({"type": "Van"}, ""),
        ({"type": "Truck"}, ""),
    ],
)
def test_labels_have_to_be_detected_at_these_difficulties(change, levels):
    label = thing(**{k: v for k, v in change.items() if k != "type"})
    label["type"] = change.get("type", "Car")
    precision_by_level = precisions([([label], [])])
    assert [
        level for level in precision_by_level if precision_by_level[level].objects
    ] == levels.split()


def with_one_more(label, detection, kind="3d", name="Car"):
    """AP of fifty found cars and one more label and detection; the score is the highest."""
    frames = [([thing(name)], [thing(name, score=0.5)]) for _ in range(50)]
    frames.append(([label] if label else [], [detection | {"score": 0.9}]))
    return precisions(frames, name, kind)["moderate"].ap


def test_what_is_false_and_what_counts_for_nothing():
    false = with_one_more(None, thing())
    assert false < 1
    assert with_one_more(thing("Van"), thing()) == 1
    assert with_one_more(thing("Truck"), thing()) == false
    assert with_one_more(thing("Person_sitting"), thing("Pedestrian"), name="Pedestrian") == 1
    assert with_one_more(thing(occluded=3), thing()) == 1
    assert with_one_more(None, thing(height=24.9)) == 1
    assert with_one_more(None, thing(height=25.0)) == false
    region = thing("DontCare", height=60.0)
    assert with_one_more(region, thing(), "2d") == 1
    # A region without labels is one of the image alone.
    assert with_one_more(region, thing(), "3d") == false


@pytest.mark.parametrize(("name", "least"), [("Car", 0.7), ("Pedestrian", 0.5), ("Cyclist", 0.5)])
@pytest.mark.parametrize("kind", ["bev", "3d"])
def test_boxes_match_from_this_overlap_on(name, least, kind):
    # Shifted by d along its 4 m, a box overlaps its copy by (4 - d) / (4 + d).
    shift = 4 * (1 - least) / (1 + least)
    for d, right in ((shift - 0.01, True), (shift + 0.01, False)):
        frames = [([thing(name)], [thing(name, x=d)]) for _ in range(50)]
        assert (precisions(frames, name, kind)["easy"].ap > 0) == right


def test_heights_count_in_space_and_not_from_above():
    frames = [([thing()], [thing(y=0.2)]) for _ in range(50)]
    assert precisions(frames, kind="bev")["easy"].ap == 1
    assert precisions(frames, kind="3d")["easy"].ap == 0


def test_without_objects_there_is_no_figure():
    assert all(math.isnan(precision.ap) for precision in precisions([([], [thing()])]).values())


def test_labels_of_objects_are_read_as_kitti_publishes_them(tmp_path):
    path = tmp_path / "000000.txt"
    path.write_text(
        "Car 0.88 3 -0.69 0.00 192.37 402.31 374.00 1.60 1.57 3.23 -2.70 1.74 3.68 -1.29\n"
        "Person_sitting 0.00 1 2.04 334.85 178.94 624.50 372.04 1.57 1.50 3.68 -1.17 1.65 7.86 2\n"
        "DontCare -1 -1 -10 800.38 163.67 825.45 184.07 -1 -1 -1 -1000 -1000 -1000 -10\n"
    )
    labels = read_kitti_object_labels(path, 7)
    assert labels.types.tolist() == [KittiType.CAR, KittiType.PERSON, KittiType.DONT_CARE]
    assert labels.truncated.tolist() == [0.88, 0.0, -1.0]
    assert labels.occluded.tolist() == [3, 1, -1]
    assert labels.frames.tolist() == [7, 7, 7]
    assert labels.sizes[0].tolist() == [3.23, 1.57, 1.60]
    assert labels.bottoms[0].tolist() == [-2.70, 1.74, 3.68]


def line_of(each, *, score):
    """An object as a line of KITTI's files of labels or of results."""
    numbers = [*each["box"], each["h"], each["w"], each["l"], each["x"], each["y"], each["z"]]
    words = [each["type"], repr(each["truncated"]), each["occluded"], -10]
    words += [repr(float(v)) for v in (*numbers, each["ry"], *([each["score"]] if score else []))]
    return " ".join(map(str, words)) + "\n"


def written(folder, frames):
    """Write frames as files; return the folders of labels and of results."""
    places = folder / "label_2", folder / "mine"
    for place, score in zip(places, (False, True), strict=True):
        place.mkdir()
        for number, frame in enumerate(frames):
            lines = (line_of(each, score=score) for each in frame[score])
            (place / f"{number:06d}.txt").write_text("".join(lines))
    return places


def test_result_files_get_the_same_figures(tmp_path):
    frames = random_frames(np.random.default_rng(5), "Car", 30)
    scores = score_kitti_object_results(*written(tmp_path, frames))
    assert len(scores) == 9
    for kind in ("2d", "bev", "3d"):
        for level in DIFFICULTIES:
            expected = average_precision(frames, "Car", level, kind)
            assert expected > 0
            assert scores[f"ap_{kind}_{level}"].value == pytest.approx(expected, abs=1e-12)


def test_result_files_are_as_many_as_those_of_labels(tmp_path):
    labels, results = written(tmp_path, [([thing()], [thing()])] * 3)
    (results / "000001.txt").unlink()
    with pytest.raises(FormatError, match="000001"):
        score_kitti_object_results(labels, results)
    with pytest.raises(FormatError, match="000000"):
        score_kitti_object_results(tmp_path, results)
