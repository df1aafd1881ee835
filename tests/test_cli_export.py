import json

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


def test_export_submit_compare(tmp_path, answer) -> None:
    suite, folder = tmp_path / "tiny.toml", tmp_path / "exported"
    suite.write_text(SUITE)
    asked = (
        "export",
        suite,
        folder,
        "--seeds",
        1,
        "--scenario",
        "lu2018-occlusion",
        "--with-truth",
    )
    status, out, _ = answer(*asked)
    assert status == 0
    assert "at most" in out
    assert (folder / "README.md").is_file()
    assert sorted(p.stem for p in (folder / "calib").iterdir()) == ["0000"]
    assert answer(*asked)[0] == 0

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
    status, out, _ = answer("compare", written, written, "--fail-on-regression", "--all")
    assert status == 0
    assert "hota" in out


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
