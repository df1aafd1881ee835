import numpy as np
import pytest
from toy_kitti import tracks_at

from roadscope.benchmarks.formats import FormatError
from roadscope.benchmarks.formats.motchallenge import (
    mot_rows,
    read_mot,
    read_mot_sequence,
    save_mot,
)
from roadscope.core import Category

DET = "1,-1,100,50,40,80,0.9,-1,-1,-1"
TRUE = "1,3,100,50,40,80,1,1,0.75"
CENTRES = np.array([[20.0, 0, -1], [30, 2, -1.2]])
BOXES = np.array([[10.0, 20, 60, 90], [100.5, 20.25, 160, 91]])


def write_sequence(folder, det=(DET,), true=(TRUE,), info=True):
    for name in ("det", "gt"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "det" / "det.txt").write_text("\n".join(det))
    (folder / "gt" / "gt.txt").write_text("\n".join(true))
    if info:
        text = "[Sequence]\nname=A\nframeRate=25\nseqLength=4\nimWidth=640\nimHeight=480\n"
        (folder / "seqinfo.ini").write_text(text)
    return folder


def test_a_sequence_in_our_records(tmp_path):
    third = DET.replace("1,-1", "3,-1", 1).replace("0.9", "0.2")
    cart = TRUE.replace("1,3", "2,3", 1).replace(",1,0.75", ",3,1")
    mot = read_mot_sequence(write_sequence(tmp_path / "A", (DET, third), (TRUE, cart)))
    assert (mot.name, mot.rate_hz, mot.image_size) == ("A", 25, (640, 480))
    assert [len(d) for d in mot.detections] == [1, 0, 1, 0]
    np.testing.assert_allclose(mot.detections[0].boxes, [[100, 50, 140, 130]])
    assert mot.detections[2].scores.tolist() == [0.2]
    assert mot.detections[2].stamp_s == pytest.approx(2 / 25)
    assert mot.detections[0].categories.tolist() == [Category.PEDESTRIAN]
    assert mot.truth[0].visibilities.tolist() == [0.75]
    assert mot.truth[1].classes.tolist() == [3]


def test_without_seqinfo_the_files_say_how_long_it_is(tmp_path):
    mot = read_mot_sequence(write_sequence(tmp_path, (DET.replace("0.9", "3.5"),), info=False))
    assert len(mot.detections) == 1
    assert mot.detected[0].confidences.tolist() == [3.5]
    assert mot.detections[0].scores[0] == pytest.approx(1 / (1 + np.exp(-3.5)))


@pytest.mark.parametrize("world", [True, False])
def test_results_come_back_within_printed_digits(tmp_path, world):
    frames = [mot_rows(tracks_at(CENTRES, frame="world"), t, BOXES + t) for t in (1, 2)]
    save_mot(tmp_path / "a.txt", frames, world=world)
    back = read_mot(tmp_path / "a.txt")
    assert back.frames.tolist() == [1, 1, 2, 2]
    assert back.ids.tolist() == [7, 8, 7, 8]
    np.testing.assert_allclose(back.boxes, np.concatenate([f.boxes for f in frames]), atol=2e-6)
    np.testing.assert_allclose(back.confidences, [0, 1, 0, 1])
    # the bottom of a box 1.5 m high
    feet = np.tile(CENTRES - [0, 0, 0.75], (2, 1)) if world else np.full((4, 3), -1)
    np.testing.assert_allclose(back.points, feet, atol=1e-6)


def test_tracks_that_no_camera_saw_have_no_image_box(tmp_path):
    save_mot(tmp_path / "a.txt", [mot_rows(tracks_at(CENTRES), 1)])
    back = read_mot(tmp_path / "a.txt")
    assert (back.boxes == -1).all()
    np.testing.assert_allclose(back.points[:, 0], CENTRES[:, 0])
    empty = np.array([[0.0, 0, 0, 0], [1, 1, 2, 2]])
    assert mot_rows(tracks_at(CENTRES), 1, empty).ids.tolist() == [8]


def test_trackeval_reads_our_results(tmp_path):
    trackeval = pytest.importorskip("trackeval")
    gt = tmp_path / "gt" / "MOT17-train"
    write_sequence(gt / "A")
    (tmp_path / "gt" / "seqmaps").mkdir()
    (tmp_path / "gt" / "seqmaps" / "MOT17-train.txt").write_text("name\nA\n")
    out = tmp_path / "trackers" / "MOT17-train" / "mine" / "data"
    out.mkdir(parents=True)
    save_mot(out / "A.txt", [mot_rows(tracks_at(CENTRES), t, BOXES) for t in (1, 2)])
    config = {
        "GT_FOLDER": str(tmp_path / "gt"), "TRACKERS_FOLDER": str(tmp_path / "trackers"),
        "PRINT_CONFIG": False,
    }  # fmt: skip
    dataset = trackeval.datasets.MotChallenge2DBox(config)
    raw = dataset.get_raw_seq_data("mine", "A")
    assert raw["tracker_ids"][1].tolist() == [7, 8]
    sizes = BOXES[:, 2:] - BOXES[:, :2]
    np.testing.assert_allclose(raw["tracker_dets"][0], np.hstack([BOXES[:, :2], sizes]), atol=2e-6)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1,2,3", r"expected 7 columns \(frame id .*, got '3 columns'"),
        (DET.replace("1,-1", "0,-1", 1), "an integer frame of 1 or more, got '0'"),
        (DET.replace("40,80", "40,-80"), "a width and height above 0, got '40 -80'"),
        (TRUE.replace(",1,0.75", ",14,0.75"), "a class from 1 to 13, got '14'"),
        (TRUE.replace("0.75", "1.75"), "a visibility in 0 to 1"),
        (TRUE.replace("100", "x"), "a number as left, got 'x'"),
        (TRUE + "\n" + TRUE, "each id once in frame 1"),
    ],
)
def test_malformed_files_are_refused_with_their_line(tmp_path, line, said):
    path = tmp_path / "a.txt"
    path.write_text(line + "\n")
    with pytest.raises(FormatError, match=said) as caught:
        read_mot(path)
    assert f"{path}, line {1 + line.count(chr(10))}: " in str(caught.value)


def test_malformed_sequences_are_refused(tmp_path):
    with pytest.raises(FormatError, match=r"det.txt: missing"):
        read_mot_sequence(tmp_path)
    folder = write_sequence(tmp_path / "A", (DET.replace("1,-1", "9,-1", 1),))
    with pytest.raises(FormatError, match="seqLength is 4, but frame 9"):
        read_mot_sequence(folder)
    back = write_sequence(tmp_path / "B", (DET.replace("1,-1", "2,-1", 1), DET))
    with pytest.raises(FormatError, match="line 2: expected frames that do not decrease"):
        read_mot_sequence(back)
    (folder / "seqinfo.ini").write_text("frameRate=10")
    with pytest.raises(FormatError, match=r"expected \[Sequence\]"):
        read_mot_sequence(folder)


def test_an_empty_file_is_allowed(tmp_path):
    (tmp_path / "a.txt").write_text("")
    assert len(read_mot(tmp_path / "a.txt")) == 0
