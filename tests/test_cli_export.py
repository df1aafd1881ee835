import json

import pytest
from toy_kitti import write_kitti

SUITE = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-three-vehicles", "lu2018-occlusion"]
seeds = 2
duration_s = 0.5
[tracking]
entries = ["nearest"]
detectors = ["distance-l-shape"]
"""


@pytest.mark.filterwarnings("default:results has no results")
def test_export_submit_compare(tmp_path, answer) -> None:
    suite, folder = tmp_path / "tiny.toml", tmp_path / "exported"
    suite.write_text(SUITE)
    compare_command = (
        "export",
        suite,
        folder,
        "--seeds",
        1,
        "--scenario",
        "lu2018-occlusion",
        "--with-truth",
    )
    status, out, _ = answer(*compare_command)
    assert status == 0
    assert "at most" in out
    assert (folder / "README.md").is_file()
    assert sorted(p.stem for p in (folder / "calib").iterdir()) == ["0000"]
    record = json.loads(answer(*compare_command, "--json")[1])
    assert record["folder"] == str(folder)
    (sequence,) = record["sequences"]
    assert (sequence["name"], sequence["scenario"]) == ("0000", "lu2018-occlusion")

    results = tmp_path / "results" / "tracking"
    results.mkdir(parents=True)
    labels = (folder / "label_02" / "0000.txt").read_text().splitlines()
    (results / "0000.txt").write_text("".join(f"{line} 0.9\n" for line in labels))
    written = tmp_path / "mine.json"
    status, out, _ = answer(
        "submit",
        results.parent,
        "--suite",
        folder,
        "--name",
        "mine",
        "--inputs",
        "distance-l-shape",
        "--out",
        written,
    )
    assert status == 0
    assert "mine" in out
    assert "hota" in out
    (item,) = json.loads(written.read_text())["scores"]
    assert (item["entry"], item["inputs"]) == ("mine", "distance-l-shape")
    assert json.loads(answer("submit", results.parent, "--suite", folder, "--json")[1])["scores"]

    board = tmp_path / "board"
    run = "leaderboard", "--suite", suite, "--seeds", 1, "--jobs", 1, "--out", board, "--quiet"
    assert answer(*run) == (0, "", "")
    beside = "--beside", board, "--inputs", "distance-l-shape", "--width", 60
    status, out, errors = answer("submit", results.parent, "--suite", folder, *beside)
    assert status == 0
    assert "no results of 1 episodes" in errors
    places = [line.split()[1] for line in out.splitlines() if line[:2] in ("1 ", "2 ")]
    assert places == ["results", "nearest"]
    assert max(map(len, out.splitlines())) <= 60

    status, out, _ = answer("compare", written, written, "--fail-on-regression", "--all")
    assert status == 0
    assert "hota" in out


def test_the_name_of_a_suite_is_plain_text(tmp_path, answer) -> None:
    suite, folder = tmp_path / "tiny.toml", tmp_path / "exported"
    suite.write_text(SUITE.replace('"tiny"', '"t<b>\\u001biny"'))
    few = "--seeds", 1, "--scenario", "lu2018-occlusion", "--detections", "none"
    status, out, _ = answer("export", suite, folder, *few)
    assert status == 0
    assert out.startswith("t<b>?iny v1: 1 sequence ")
    assert (folder / "README.md").read_text().startswith("# Suite t&lt;b&gt;?iny v1,")


def test_results_on_kitti_stand_beside_those_of_a_run(tmp_path, answer) -> None:
    kitti, results = write_kitti(tmp_path / "kitti"), tmp_path / "mine"
    results.mkdir()
    for labels in (kitti / "label_02").iterdir():
        lines = [line for line in labels.read_text().splitlines() if "DontCare" not in line]
        (results / labels.name).write_text("".join(f"{line} 0.9\n" for line in lines))
    board = tmp_path / "board"
    run = "leaderboard", "tracking", "--entry", "nearest", "--only", "--jobs", 1, "--quiet"
    assert answer(*run, "--kitti", kitti, "--out", board) == (0, "", "")
    status, out, errors = answer("submit", results, "--kitti", kitti, "--beside", board)
    assert (status, errors) == (0, "")
    for kind in ("car", "pedestrian"):
        table = out.partition(f"kitti {kind} board")[2].splitlines()
        assert [line.split()[1] for line in table if line[:2] in ("1 ", "2 ")][:2] == [
            "mine",
            "nearest",
        ]


def test_figures_of_several_sequences_are_those_of_the_board(tmp_path, answer) -> None:
    """Without objects in a sequence its false alarms count all the same."""
    kitti, results = write_kitti(tmp_path / "kitti"), tmp_path / "mine"
    results.mkdir()
    for labels in (kitti / "label_02").iterdir():
        lines = [line for line in labels.read_text().splitlines() if " Car " in line]
        (results / labels.name).write_text("".join(f"{line} 0.9\n" for line in lines))
    (kitti / "label_02" / "0001.txt").write_text("")
    submission = "submit", results, "--kitti", kitti
    jobs = json.loads(answer(*submission, "--json")[1])["scores"]
    of_cars = [job["scores"] for job in jobs if job["board"] == "kitti car"]
    objects = sum(scores["mota"]["n"] for scores in of_cars)
    false_alarms = of_cars[1]["false_alarms"]["value"]
    assert false_alarms > 0
    status, out, _ = answer(*submission)
    assert status == 0
    table = out.partition("mine on kitti car")[2].partition("mine on kitti pedestrian")[0]
    rows = (line.split() for line in table.splitlines())
    printed = {row[0]: row[1] for row in rows if len(row) > 2}
    assert printed["mota"] == f"{1 - false_alarms / objects:.3f}"
    assert float(printed["hota"]) < 1


def test_missing_results_end_with_status_1(tmp_path, answer) -> None:
    suite, folder = tmp_path / "tiny.toml", tmp_path / "exported"
    suite.write_text(SUITE)
    scenario = "--scenario", "lu2018-occlusion"
    assert answer("export", suite, folder, *scenario, "--detections", "none")[0] == 0
    assert not list(folder.glob("det_*"))
    (folder / "tracking").mkdir()
    (folder / "tracking" / "0000.txt").write_text("")
    status, out, errors = answer("submit", folder)
    assert status == 1
    assert "0001.txt" in errors
    assert "1 of 2" in out


def test_bad_input_is_answered_in_one_line(tmp_path, answer) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    for arguments in (
        ["export", "quik", tmp_path / "new"],
        ["export", "quick", tmp_path],
        ["export", "quick", tmp_path / "new", "--seeds", 1000],
        ["export", "quick", tmp_path / "new", "--scenario", "motorwy"],
        ["submit", tmp_path / "none"],
        ["submit", tmp_path],
        ["submit", tmp_path, "--kitti", tmp_path],
        ["submit", tmp_path, "--kitti", tmp_path, "--mot", tmp_path],
    ):
        status, out, errors = answer(*arguments)
        assert (status, out) == (1, "")
        assert errors.startswith("error: ")
        assert errors.count("\n") == 1
