import numpy as np
import pytest
from toy_kitti import tracks_at

from roadscope.core import Category
from roadscope.formats import FormatError, mot_rows, read_mot, read_mot_sequence, write_mot

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
    assert mot.truth_rows[0].visibilities.tolist() == [0.75]
    assert mot.truth_rows[1].classes.tolist() == [3]


def test_without_seqinfo_the_files_say_how_long_it_is(tmp_path):
    mot = read_mot_sequence(write_sequence(tmp_path, (DET.replace("0.9", "3.5"),), info=False))
    assert len(mot.detections) == 1
    assert mot.detection_rows[0].confidences.tolist() == [3.5]
    assert mot.detections[0].scores[0] == pytest.approx(1 / (1 + np.exp(-3.5)))


@pytest.mark.parametrize("world", [True, False])
def test_results_come_back_within_printed_digits(tmp_path, world):
    frames = [mot_rows(tracks_at(CENTRES, frame="world"), t, BOXES + t) for t in (1, 2)]
    write_mot(tmp_path / "a.txt", frames, world=world)
    back = read_mot(tmp_path / "a.txt")
    assert back.frames.tolist() == [1, 1, 2, 2]
    assert back.ids.tolist() == [7, 8, 7, 8]
    np.testing.assert_allclose(back.boxes, np.concatenate([f.boxes for f in frames]), atol=2e-6)
    np.testing.assert_allclose(back.confidences, [0, 1, 0, 1])
    # the bottom of a box 1.5 m high
    feet = np.tile(CENTRES - [0, 0, 0.75], (2, 1)) if world else np.full((4, 3), -1)
    np.testing.assert_allclose(back.points, feet, atol=1e-6)


def test_tracks_that_no_camera_saw_have_no_image_box(tmp_path):
    write_mot(tmp_path / "a.txt", [mot_rows(tracks_at(CENTRES), 1)])
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
    write_mot(out / "A.txt", [mot_rows(tracks_at(CENTRES), t, BOXES) for t in (1, 2)])
    config = {
        "GT_FOLDER": str(tmp_path / "gt"),
        "TRACKERS_FOLDER": str(tmp_path / "trackers"),
        "PRINT_CONFIG": False,
    }
    dataset = trackeval.datasets.MotChallenge2DBox(config)
    raw = dataset.get_raw_seq_data("mine", "A")
    assert raw["tracker_ids"][1].tolist() == [7, 8]
    sizes = BOXES[:, 2:] - BOXES[:, :2]
    np.testing.assert_allclose(raw["tracker_dets"][0], np.hstack([BOXES[:, :2], sizes]), atol=2e-6)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1,2,3", r"expected 7 columns \(frame id .*, got '3 columns'"),
        (DET.replace("1,-1", "0,-1", 1), "frame as an integer from 1 to 500000, got '0'"),
        (DET.replace("40,80", "40,-80"), "a width and height above 0, got '40 -80'"),
        (TRUE.replace(",1,0.75", ",14,0.75"), "a class from 1 to 13, got '14'"),
        (TRUE.replace("0.75", "1.75"), "a visibility from 0 to 1"),
        (TRUE.replace("100", "x"), "left as a number, got 'x'"),
        (TRUE.replace("100", "1_00"), "left as a number, got '1_00'"),
        (TRUE + "\n" + TRUE, "each id once in frame 1"),
        (TRUE.replace("1,3", "1,1e300", 1), f"id as an integer .* to {2**53 - 1}, got '1e300'"),
        (TRUE.replace("1,3", "1,99999999999999999999", 1), "id as an integer from -1 to"),
        (DET.replace("1,-1", "1000000000000,-1", 1), "frame as an integer from 1 to 500000, got"),
        (DET.replace("100", "1e200"), r"left top width height from -1e\+09 to 1e\+09 pixels"),
        (DET.replace("-1,-1,-1", "-1,-1,1e200"), r"x y z from -1e\+09 to 1e\+09 m"),
    ],
)
def test_malformed_files_are_refused_with_their_line(tmp_path, line, message):
    path = tmp_path / "a.txt"
    path.write_text(line + "\n")
    with pytest.raises(FormatError, match=message) as caught:
        read_mot(path)
    assert f"{path}, line {1 + line.count(chr(10))}: " in str(caught.value)


def test_malformed_sequences_are_refused(tmp_path):
    with pytest.raises(FormatError, match=r"det.txt: missing"):
        read_mot_sequence(tmp_path)
    folder = write_sequence(tmp_path / "A", (DET.replace("1,-1", "9,-1", 1),))
    message = (
        r"det.txt, line 1: expected a frame of at most 4, the seqLength of seqinfo.ini, got '9'"
    )
    with pytest.raises(FormatError, match=message):
        read_mot_sequence(folder)
    late = write_sequence(tmp_path / "C", true=(TRUE, TRUE.replace("1,3", "5,3", 1)))
    with pytest.raises(FormatError, match=r"gt.txt, line 2: expected a frame of at most 4, .*'5'"):
        read_mot_sequence(late)
    negative_id = write_sequence(tmp_path / "D", true=(TRUE, TRUE.replace("1,3", "1,-1", 1)))
    with pytest.raises(FormatError, match=r"gt.txt, line 2: expected id as an integer from 0"):
        read_mot_sequence(negative_id)
    back = write_sequence(tmp_path / "B", (DET.replace("1,-1", "2,-1", 1), DET))
    with pytest.raises(
        FormatError, match="line 2: expected a frame not below the frame of the line before"
    ):
        read_mot_sequence(back)
    (folder / "seqinfo.ini").write_text("frameRate=10")
    with pytest.raises(FormatError, match=r"expected \[Sequence\]"):
        read_mot_sequence(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[Sequence]\nseqLength=-3", "line 2: expected seqLength .* from 1 to 500000, got '-3'"),
        ("[Sequence]\nseqLength=0", ", line 2: expected seqLength as a whole"),
        ("[Sequence]\n\nseqLength=1000000000000", ", line 3: expected seqLength as a whole"),
        ("[Sequence]\nseqLength=many", ", line 2: expected seqLength .*, got 'many'"),
        ("[Sequence]\nimWidth=0\nimHeight=4", ", line 2: expected imWidth as a whole number from "),
        ("[Sequence]\nimWidth=4\nimHeight=-4", ", line 3: expected imHeight as .*, got '-4'"),
        ("[Sequence]\nframeRate=0", ", line 2: expected frameRate as a number from 1e-06 to 1e"),
        ("[Sequence]\nframeRate=nan", ", line 2: expected frameRate as .*, got 'nan'"),
        ("[Sequence]\nframeRate=quick", ", line 2: expected frameRate as .*, got 'quick'"),
        ("[Sequence]\nname=A\nNAME=A", ", line 3: expected the key NAME once, got 'NAME=A'"),
        ("[Sequence]\ngarbage", ", line 2: expected KEY=VALUE, got 'garbage'"),
        ("garbage\nmore", r", line 1: expected \[Sequence\] with seqLength .*, got 'garbage'"),
        ("[Other]\na=1", r": expected \[Sequence\] with seqLength and frameRate, got \[Other\]$"),
        ("", r": expected \[Sequence\] with seqLength and frameRate, got nothing$"),
    ],
)
def test_a_malformed_seqinfo_is_refused_in_one_line(tmp_path, text, message):
    path = write_sequence(tmp_path, (DET,)) / "seqinfo.ini"
    path.write_text(text)
    with pytest.raises(FormatError, match=message) as caught:
        read_mot_sequence(tmp_path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_frames_without_rows_are_one_record(tmp_path):
    path = write_sequence(tmp_path, (DET.replace("1,-1", "3,-1", 1),)) / "seqinfo.ini"
    path.write_text("[Sequence]\nseqLength=500000\n")
    mot = read_mot_sequence(tmp_path)
    assert len(mot.detection_rows) == len(mot.truth_rows) == 500_000
    assert len({id(rows) for rows in mot.detection_rows}) == 2
    assert [t for t, frame_detections in enumerate(mot.detections) if len(frame_detections)] == [2]
    assert mot.detections[-1].stamp_s == pytest.approx(499_999 / 30)


def test_what_else_seqinfo_says_is_passed_over(tmp_path):
    path = write_sequence(tmp_path) / "seqinfo.ini"
    path.write_text("; from us\n[more]\nwhatever\n[SEQUENCE]\nname=100%\nimWidth = 640\n")
    mot = read_mot_sequence(tmp_path)
    assert (len(mot.detections), mot.rate_hz, mot.image_size) == (1, 30, None)


def test_an_empty_file_is_allowed(tmp_path):
    (tmp_path / "a.txt").write_text("")
    assert len(read_mot(tmp_path / "a.txt")) == 0
