"""Result files of others: the same sequences as TrackEval's pipeline, examples as printed."""

import doctest
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
from toy_kitti import write_kitti

from roadscope.benchmarks import score_kitti_results, score_mot_results
from roadscope.benchmarks.recorded import apply_mot_rules
from roadscope.core import Category
from roadscope.formats import FormatError, read_mot

A, B, C = "100,50,40,80", "300,50,40,80", "500,50,40,80"


def mot_lines(*rows, tail=""):
    return "".join(f"{row}{tail}\n" for row in rows)


def example(folder: Path, results: str) -> tuple[Path, Path]:
    """Two people over two frames, of whom one is followed."""
    truth, results_file = folder / "MOT17-02" / "gt" / "gt.txt", folder / "mine" / "MOT17-02.txt"
    for path in (truth, results_file):
        path.parent.mkdir(parents=True, exist_ok=True)
    people = [f"{t},{k},{box}" for t in (1, 2) for k, box in ((1, A), (2, B))]
    truth.write_text(mot_lines(*people, tail=",1,1,1.0"))
    (truth.parents[1] / "det").mkdir(exist_ok=True)
    (truth.parents[1] / "det" / "det.txt").write_text("")
    results_file.write_text(results)
    return truth, results_file


ONE = mot_lines(f"1,7,{A}", f"2,7,{A}", tail=",0.9,-1,-1,-1")


@pytest.mark.parametrize("function", [score_mot_results, score_kitti_results])
def test_examples_work_as_printed(function, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example(tmp_path, ONE)
    write_kitti(tmp_path)
    labels = (tmp_path / "label_02" / "0000.txt").read_text().splitlines()
    (tmp_path / "mine" / "0000.txt").write_text(
        mot_lines(*(line for line in labels if "DontCare" not in line))
    )
    (case,) = doctest.DocTestFinder(recurse=False).find(function, function.__name__)
    assert doctest.DocTestRunner().run(case).failed == 0
    assert len(case.examples) == 3


@pytest.mark.parametrize("kind", [2, 7, 8, 12, 3, 11])
def test_a_track_on_a_distractor_is_neither_right_nor_wrong(kind, tmp_path):
    result_lines = ONE + mot_lines(f"1,8,{C}", tail=",0.9,-1,-1,-1")
    truth, results = example(tmp_path, result_lines)
    truth.write_text(truth.read_text() + f"1,3,{C},0,{kind},1.0\n")
    scores = score_mot_results(truth.parents[1], results)
    excused = kind in (2, 7, 8, 12)
    assert scores["precision"].value == pytest.approx(1.0 if excused else 2 / 3)
    assert scores["recall"].value == 0.5


def test_objects_marked_as_not_counting_do_not_count(tmp_path):
    truth, results = example(tmp_path, ONE)
    truth.write_text(truth.read_text().replace(f"1,2,{B},1", f"1,2,{B},0"))
    assert score_mot_results(truth.parents[1], results)["recall"].n == 3


def test_of_kitti_the_class_asked_for_counts(tmp_path):
    folder = write_kitti(tmp_path)
    labels = folder / "label_02" / "0000.txt"
    cars = [line for line in labels.read_text().splitlines() if " Car " in line]
    (folder / "cars.txt").write_text(mot_lines(*cars))
    assert score_kitti_results(labels, folder / "cars.txt")["hota"].value == 1
    people = score_kitti_results(labels, folder / "cars.txt", Category.PEDESTRIAN)
    assert people["recall"].value == 0


def test_malformed_files_are_refused_with_their_line(tmp_path):
    truth, results = example(tmp_path, ONE + "2,8,x,1,1,1,1,-1,-1,-1\n")
    with pytest.raises(FormatError, match=r"MOT17-02.txt, line 3: expected left as a number"):
        score_mot_results(truth.parents[1], results)
    results.write_text(mot_lines(f"9,7,{A}", tail=",0.9,-1,-1,-1"))
    message = r"mine/MOT17-02.txt, line 1: expected a frame of at most 2, the last of .*02, got '9'"
    with pytest.raises(FormatError, match=message):
        score_mot_results(truth.parents[1], results)
    with pytest.raises(FormatError, match=r"gt.txt, line 1: expected 17 columns"):
        score_kitti_results(truth, results)


@pytest.mark.parametrize(("name", "precision"), [("MOT20-01", 1.0), ("MOT17-02", 2 / 3)])
def test_mot20_ignores_tracks_on_other_vehicles(name, precision, tmp_path):
    """As on the board: the name of the folder decides, wherever it is called from."""
    truth, results = example(tmp_path, ONE + mot_lines(f"1,8,{C}", tail=",0.9,-1,-1,-1"))
    truth.write_text(truth.read_text() + f"1,3,{C},0,6,1.0\n")
    folder = truth.parents[1].rename(tmp_path / name)
    assert score_mot_results(folder, results)["precision"].value == pytest.approx(precision)
    with chdir(folder):
        again = score_mot_results(".", results)
    assert again["precision"].value == pytest.approx(precision)


@pytest.mark.parametrize("number", [0, 2**53 - 1])
def test_ids_may_be_as_large_as_a_float_distinguishes(number, tmp_path):
    truth, results = example(tmp_path, ONE.replace(",7,", f",{number},"))
    assert score_mot_results(truth.parents[1], results)["recall"].value == 0.5


def test_without_ground_truth_there_is_nothing_to_score_by(tmp_path):
    truth, results = example(tmp_path, ONE)
    truth.unlink()
    with pytest.raises(FormatError, match=r"gt.txt: missing; scores need ground truth"):
        score_mot_results(truth.parents[1], results)


@pytest.mark.parametrize("seed", range(5))
def test_the_same_sequence_as_trackevals(seed, tmp_path):
    trackeval = pytest.importorskip("trackeval")
    rng = np.random.default_rng(seed)
    gt = tmp_path / "gt" / "MOT17-train" / "A"
    out = tmp_path / "trackers" / "MOT17-train" / "mine" / "data"
    for folder in (gt / "gt", out, tmp_path / "gt" / "seqmaps"):
        folder.mkdir(parents=True)
    (tmp_path / "gt" / "seqmaps" / "MOT17-train.txt").write_text("name\nA\n")
    (gt / "det").mkdir()
    (gt / "det" / "det.txt").write_text("")
    (gt / "seqinfo.ini").write_text("[Sequence]\nname=A\nframeRate=25\nseqLength=12\n")
    true, result_lines = [], []
    for frame in range(1, 13):
        for k in range(14):
            x, y = 40 * k + rng.normal(0, 6), 100 + rng.normal(0, 6)
            kind = (1, 1, 1, 2, 7, 8, 12, 3, 11, 1, 1, 1, 9, 1)[k]
            shown = int(rng.random() < 0.8)
            true.append(f"{frame},{k + 1},{x:.2f},{y:.2f},50,80,{shown},{kind},1.0")
            if rng.random() < 0.8:
                x, y = x + rng.normal(0, 6), y + rng.normal(0, 6)
                result_lines.append(
                    f"{frame},{k + 20},{x:.2f},{y:.2f},50,80,{rng.random():.3f},-1,-1,-1"
                )
    (gt / "gt" / "gt.txt").write_text(mot_lines(*true))
    (out / "A.txt").write_text(mot_lines(*result_lines))
    dataset = trackeval.datasets.MotChallenge2DBox(
        {
            "GT_FOLDER": str(tmp_path / "gt"),
            "TRACKERS_FOLDER": str(tmp_path / "trackers"),
            "PRINT_CONFIG": False,
        }
    )
    wanted = dataset.get_preprocessed_seq_data(dataset.get_raw_seq_data("mine", "A"), "pedestrian")
    rows = (read_mot(path).by_frame(12) for path in (gt / "gt" / "gt.txt", out / "A.txt"))
    ours = apply_mot_rules(*rows)
    assert len(ours.truths) == wanted["num_gt_dets"] < 12 * 8
    assert len(ours.tracks) == wanted["num_tracker_dets"] < len(result_lines)
    for alike, theirs in zip(
        ours.matrices(ours.similarities), wanted["similarity_scores"], strict=True
    ):
        np.testing.assert_allclose(alike, theirs, atol=1e-9)
    expected = trackeval.metrics.HOTA().eval_sequence(wanted)["HOTA"].mean()
    scores = score_mot_results(gt, out / "A.txt")
    assert scores["hota"].value == pytest.approx(expected, abs=1e-9)
