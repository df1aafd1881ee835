"""The board of recorded sequences, from the folder to the table."""

import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console
from toy_kitti import write_kitti
from toy_kitti_scans import write_tracking
from typer.testing import CliRunner

from roadscope import TRACKERS as REGISTRY
from roadscope import Spec, leaderboard, load_suite
from roadscope.__main__ import app
from roadscope.benchmarks import Outcome, RunOptions, agreements, kitti_suite, plan, run_jobs
from roadscope.benchmarks.boards import OFFLINE, JobOptions, board_named
from roadscope.benchmarks.metrics import Score
from roadscope.benchmarks.recorded import recordings_of
from roadscope.benchmarks.report import (
    agreement_lines,
    board_table,
    breakdown_tables,
    explanation,
    note,
)
from roadscope.benchmarks.results import gather, spearman
from roadscope.benchmarks.speed import own_trackers
from roadscope.core import SpecError
from roadscope.formats import FormatError, read_kitti_sequence
from roadscope.trackers import NearestTracker

TRACKERS = ["nearest", "nearest-q", "nearest-q-confirmed"]


def plan_of(suite, entries=(), **options):
    return plan(suite, entries, boards=["tracking"], **options)


def scored(jobs):
    """Outcomes of jobs by key."""
    outcomes = {}
    run_jobs(jobs, lambda job, outcome: outcomes.update({job.key: outcome}))
    return outcomes


def simulated_jobs(entries):
    """The jobs of trackers on the tracking board of the quick suite."""
    board = board_named("tracking")
    specs = [REGISTRY.resolve(entry) for entry in entries]
    return board.jobs(load_suite("quick"), specs, JobOptions(marks=False))


@pytest.fixture
def folder(tmp_path):
    return write_kitti(tmp_path / "kitti")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = write_kitti(tmp_path_factory.mktemp("kitti"))
    out = tmp_path_factory.mktemp("out")
    board_results = leaderboard(
        "quick", TRACKERS, boards=["tracking"], only=True, kitti=folder, out_dir=out
    )
    return board_results, out, folder


@pytest.mark.slow
def test_each_class_that_is_labelled_has_a_board(results):
    board_results, out, _ = results
    assert board_results.boards() == ["kitti car", "kitti pedestrian"]
    assert not board_results.failures
    for board in board_results.boards():
        assert set(board_results.entries(board)) == set(TRACKERS)
        for entry in TRACKERS:
            row = board_results.row(board, entry, "hota")
            assert row.n == 2
            assert 0.5 < row.value < 1
            assert row.low < row.value < row.high
            assert board_results.row(board, entry, OFFLINE).value == 0
    assert {r.band for r in board_results.breakdown("sequence", "kitti car")} == {"0000", "0001"}
    assert len({r.band for r in board_results.breakdown("alpha", "kitti car")}) == 19
    content = json.loads((out / "leaderboard.json").read_text())
    assert content["agreements"] == []
    assert "## kitti car" in (out / "leaderboard.md").read_text()


@pytest.mark.slow
def test_nees_of_each_sequence_and_of_all_stands_beside_its_band(results):
    board_results, out, _ = results
    board, entry = "kitti car", TRACKERS[0]
    parts = {
        (r.metric, r.band): r.value
        for r in board_results.breakdown("sequence", board)
        if r.entry == entry
    }
    for sequence in ("0000", "0001"):
        low, high = parts["nees_low", sequence], parts["nees_high", sequence]
        assert 0 < low < 1 < high
        # One band for two objects and one for all that both sequences have.
        assert board_results.row(board, entry, "nees_low").value > low
        assert board_results.row(board, entry, "nees_high").value < high
    nees = board_results.row(board, entry, "nees_position").value
    tables = {
        table.title: table for table in breakdown_tables(board_results, board, "sequence", 120)
    }
    shown = tables["NEES (its 95 % band) by sequence"]
    assert [column.header for column in shown.columns] == ["tracker", "0000", "0001", "all"]
    cells = [list(column.cells) for column in shown.columns]
    row = [str(name) for name in cells[0]].index(entry)
    low, high = (board_results.row(board, entry, f"nees_{end}").value for end in ("low", "high"))
    assert cells[3][row] == f"{nees:.2f} ({low:.2f}-{high:.2f})"
    assert "95 %" in note(board, "sequence")
    assert "### NEES (its 95 % band) by sequence" in (out / "leaderboard.md").read_text()


@pytest.mark.slow
def test_a_sequence_without_objects_is_shown_and_moves_no_mean(folder):
    board, entry, board_options = "kitti car", "nearest", {"boards": ["tracking"], "only": True}
    whole = leaderboard("quick", [entry], kitti=folder, **board_options)
    (folder / "label_02" / "0001.txt").write_text("")
    board_results = leaderboard("quick", [entry], kitti=folder, **board_options)
    tables = {t.title: t for t in breakdown_tables(board_results, board, "sequence", 120)}
    shown = {
        name: {c.header: [str(cell) for cell in c.cells] for c in tables[name].columns}
        for name in ("HOTA by sequence", "MOTA by sequence", "false alarms by sequence")
    }
    hota = shown["HOTA by sequence"]
    assert hota["tracker"] == [entry, "object frames"]
    assert hota["0001"] == ["-", "0"]
    assert float(hota["0000"][0]) > 0.5
    assert int(hota["0000"][1]) > 0
    assert shown["MOTA by sequence"]["0001"] == ["-"]
    (alarms,) = shown["false alarms by sequence"]["0001"]
    false_alarms = {
        r.band: r for r in board_results.breakdown("sequence", board) if r.metric == "false_alarms"
    }
    assert int(alarms) == false_alarms["0001"].value > 10
    parts = {(r.metric, r.band): r.value for r in board_results.breakdown("sequence", board)}
    before = {(r.metric, r.band): r.value for r in whole.breakdown("sequence", board)}
    assert ("hota", "0001") not in parts
    assert parts["hota", "0000"] == before["hota", "0000"]
    sure = board_results.row(board, entry, "samota_3d")
    assert (sure.n, whole.row(board, entry, "samota_3d").n) == (1, 2)
    assert "false alarms" in note(board, "sequence")


@pytest.mark.slow
def test_the_table_says_that_figures_are_online(results):
    console = Console(width=160, record=True)
    console.print(board_table(results[0], "kitti car", 160))
    text = console.export_text()
    assert text.count("online") == 3
    assert "HOTA" in text


@pytest.mark.slow
def test_what_was_done_is_not_done_again(results):
    _, out, folder = results
    stages = []
    again = leaderboard(
        "quick",
        TRACKERS,
        boards=["tracking"],
        only=True,
        kitti=folder,
        out_dir=out,
        progress=lambda stage, done, of: stages.append(stage),
    )
    assert set(stages) <= {"worst moments"}, "these come from kept answers"
    assert again.rows == results[0].rows


def test_files_decide_the_key_and_their_place_does_not(folder, tmp_path):
    def keys(where):
        return [job.key for job in plan_of(kitti_suite(where)).jobs]

    before = keys(folder)
    moved = folder.rename(tmp_path / "elsewhere")
    assert keys(moved) == before
    path = moved / "label_02" / "0001.txt"
    path.write_text(path.read_text().replace("Van", "Car"))
    changed = keys(moved)
    same = [a == b for a, b in zip(before, changed, strict=True)]
    assert any(same)
    assert not all(same)


@pytest.mark.slow
def test_an_offline_tracker_is_called_so(folder, tmp_path):
    plugin = tmp_path / "late.py"
    plugin.write_text(
        "from roadscope.trackers import NearestTracker\n"
        "class Late(NearestTracker):\n    offline = True\n"
        "    def rescored(self, history):\n        return history\n"
    )
    entries = ["nearest", f"{plugin}:Late", "existence-offline"]
    jobs = plan_of(kitti_suite(folder), entries, only=True).jobs
    of_one = [job for job in jobs if job.episode == jobs[0].episode]
    board_results = gather(of_one, scored(of_one), {})
    assert not board_results.failures
    assert [board_results.row("kitti car", entry, OFFLINE).value for entry in entries] == [0, 1, 1]
    console = Console(width=160, record=True)
    console.print(board_table(board_results, "kitti car", 160))
    assert console.export_text().count("(offline)") == 1


def test_on_simulated_traffic_too_an_offline_tracker_is_marked():
    """The table has no column for it there."""
    suite = replace(
        load_suite("quick"),
        scenarios=("lu2018-occlusion",),
        seeds=(10_000,),
        duration_s=0.8,
        rig="lux",
    ).with_settings("tracking", detectors=("oracle",))
    board_results = leaderboard(
        suite, ["nearest", "existence-offline"], boards=["tracking"], only=True
    )
    assert board_results.row("tracking", "nearest", OFFLINE) is None
    assert board_results.row("tracking", "existence-offline", OFFLINE).value == 1


def test_the_suite_has_the_offline_tracker_beside_the_online_one(folder):
    suite = kitti_suite(folder)
    entries = suite.boards["kitti car"].entries
    assert set(own_trackers()) <= {Spec.parse(entry).name for entry in entries}
    made = plan_of(suite)
    names = [board.name for board in made.boards]
    assert "learned on KITTI's training sequences" in explanation(suite, names)
    assert {job.entry for job in made.jobs} == set(entries)


def test_trackers_get_the_detections_of_the_file_bit_for_bit(folder, monkeypatch):
    received, update = [], NearestTracker.update

    def watched(self, detections, ego_pose=None):
        received.append(detections)
        return update(self, detections, ego_pose)

    monkeypatch.setattr(NearestTracker, "update", watched)
    job = plan_of(kitti_suite(folder), ["nearest"], only=True).jobs[0]
    job.answers.compute(RunOptions())
    assert tuple(received) == read_kitti_sequence(folder, "0000").detections


def test_two_detectors_are_distinguished(folder):
    for name in ("Car", "Pedestrian"):
        (folder / "det_a" / name).mkdir(parents=True)
    (folder / "det_a" / "Car" / "0001.txt").write_text("")
    suite = kitti_suite(folder)
    made = plan_of(suite, ["nearest"], only=True)
    assert {job.entry for job in made.jobs} == {"nearest", "nearest on toy"}
    assert "2 of 2 labelled sequences" in explanation(suite, [b.name for b in made.boards])


def test_poses_of_an_odometry_are_refused_and_no_poses_are_accepted(folder):
    suite = kitti_suite(folder)
    with pytest.raises(SpecError, match="without scans"):
        plan_of(suite, ["nearest?ego=still"])
    made = plan_of(suite, ["nearest?ego=none"], only=True)
    assert {job.answers.posed for job in made.jobs} == {False}


def test_wrong_folders_and_boards_are_refused(folder, tmp_path):
    with pytest.raises(FormatError, match="no such folder"):
        leaderboard(kitti=tmp_path / "nowhere")
    with pytest.raises(SpecError, match="it is for trackers only"):
        plan(kitti_suite(folder), (), boards=["detection"])
    with pytest.raises(SpecError, match="'pag' is a detector; the boards of this run are for a t"):
        plan_of(kitti_suite(folder), ["pag"])
    for path in folder.glob("det_toy/*/*.txt"):
        path.unlink()
    with pytest.raises(FormatError, match=r"expected det_NAME/Car/SEQ.txt.* for a sequence"):
        kitti_suite(folder)
    (folder / "det_toy").rename(folder / "found")
    with pytest.raises(FormatError, match="got no det_NAME"):
        kitti_suite(folder)


def test_labels_are_found_however_they_are_spaced_and_spelt(folder, tmp_path):
    where = Path(shutil.copytree(folder, tmp_path / "tabs"))
    for path in (where / "label_02").glob("*.txt"):
        path.write_text(path.read_text().replace(" ", "\t").lower())
    assert recordings_of(kitti_suite(where)) == tuple(
        replace(r, folder=str(where)) for r in recordings_of(kitti_suite(folder))
    )


NOBODY = "label_02: expected labels of Car, Pedestrian, Cyclist"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", NOBODY),
        (b"\n\n", NOBODY),
        (b"0 1 Tram 0 0 -1.8 9 9 60 60 3 2 9 1 2 30 1.6", NOBODY),
        (b"\x00\xff\xfe" * 30, "0000.txt, line 1: expected text, got binary data"),
        (b"0 1 Tram", r"0000.txt, line 1: expected 17 columns .*, got '3 columns'"),
        (b"0,1,Car,0,0", r"0000.txt, line 1: expected 17 col.* got '1 column .* at white space'"),
    ],
)
def test_labels_without_a_tracked_class_are_refused(content, message, folder, tmp_path):
    where = Path(shutil.copytree(folder, tmp_path / "nobody"))
    for path in (where / "label_02").glob("*.txt"):
        path.write_bytes(content)
    with pytest.raises(FormatError, match=message):
        kitti_suite(where)


def test_detections_of_classes_without_labels_are_reported(folder, tmp_path):
    """The message names the classes that labels have, or the file of labels that is malformed."""
    where = Path(shutil.copytree(folder, tmp_path / "cars"))
    for kind in ("Pedestrian", "Cyclist"):
        shutil.rmtree(where / "det_toy" / kind)
    for path in (where / "label_02").glob("*.txt"):
        lines = path.read_text().splitlines()
        path.write_text("".join(f"{line}\n" for line in lines if "Pedestrian" in line))
    expected = r"expected det_NAME/Pedestrian/SEQ.txt, .*, got det_toy/Car/0000.txt"
    with pytest.raises(FormatError, match=expected):
        kitti_suite(where)
    labels = where / "label_02" / "0000.txt"
    labels.write_text((folder / "label_02" / "0000.txt").read_text(), encoding="utf-16")
    with pytest.raises(FormatError, match=r"0000.txt, line 1: expected text, got binary data"):
        kitti_suite(where)


def test_detections_in_another_place_or_between_spaces_are_reported(folder):
    path = folder / "det_toy" / "Car" / "0000.txt"
    commas = path.read_text()
    path.write_text(commas.replace(",", " "))
    with pytest.raises(FormatError, match=r"line 1: expected 15 col.* got '1 column .* at commas"):
        read_kitti_sequence(folder, "0000")
    path.write_text(commas.replace(",", ";", 3))
    with pytest.raises(FormatError, match=r"line 1: expected 15 col.* got '12 columns'"):
        read_kitti_sequence(folder, "0000")
    (folder / "det_toy").rename(folder / "found")
    (folder / "det_toy" / "car").mkdir(parents=True)
    (folder / "det_toy" / "car" / "0000.txt").write_text(commas)
    with pytest.raises(FormatError, match=r"expected det_NAME/Car.*, got det_toy/car/0000.txt"):
        kitti_suite(folder)


def test_malformed_files_are_refused_before_anything_runs(folder, tmp_path):
    path = folder / "label_02" / "0001.txt"
    path.write_text(path.read_text() + "29 9 Lorry 0 0\n")
    with pytest.raises(FormatError, match=r"0001.txt, line \d+: expected 17 columns"):
        leaderboard("quick", ["nearest"], only=True, kitti=folder, out_dir=tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--suite", "kitti"], "name its folder with --kitti DIR"),
        (["--suite", "standard", "--kitti", "."], "leave --suite standard out"),
        (["--kitti", "nowhere"], "no such folder"),
        (["--kitti", "."], r"expected label_02/SEQ.txt"),
    ],
)
def test_the_command_line_says_what_is_wrong(options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    caught = CliRunner().invoke(app, ["leaderboard", "tracking", *options]).exception
    assert isinstance(caught, ValueError)
    assert message in str(caught)


@pytest.mark.slow
def test_ranks_are_compared_with_suites_that_were_run(results):
    """Outcomes of simulated traffic as if a run had left them in the store."""
    board_results, _, folder = results
    recorded = plan_of(kitti_suite(folder), TRACKERS, only=True)
    figures = dict(zip(TRACKERS, (0.1, 0.2, 0.3), strict=True))
    simulated = {job.key: job.entry for job in simulated_jobs(TRACKERS)}

    def outcomes(keys):
        return {
            k: Outcome({"hota": Score(figures[simulated[k]], "1", "higher", 9)})
            for k in keys
            if simulated.get(k) in figures
        }

    matches = agreements(board_results, recorded, outcomes)
    title = load_suite("quick").title
    assert [(m.board, m.suite) for m in matches] == [
        ("kitti car", title),
        ("kitti pedestrian", title),
    ]
    assert set(matches[0].entries) == set(TRACKERS)
    ours = [board_results.row("kitti car", entry, "hota").value for entry in TRACKERS]
    assert matches[0].rho == pytest.approx(spearman(list(figures.values()), ours))
    (line,) = agreement_lines(replace(board_results, agreements=matches), "kitti car")
    assert title in line
    assert f"{matches[0].rho:.2f}" in line


@pytest.mark.slow
def test_a_results_file_that_a_tracker_ruined_costs_no_board(folder, tmp_path):
    out, path = tmp_path / "out", tmp_path / "mine.py"
    path.write_text(
        "from pathlib import Path\nfrom roadscope.trackers import NearestTracker\n\n\n"
        "class Mine(NearestTracker):\n    def update(self, detections, ego_pose):\n"
        f"        for path in Path({str(out)!r}).glob('results.sqlite*'):\n"
        "            path.write_bytes(b'')\n"
        "        return super().update(detections, ego_pose)\n"
    )
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        board_results = leaderboard(
            "quick",
            [*TRACKERS, f"{path}:Mine"],
            boards=["tracking"],
            only=True,
            kitti=folder,
            out_dir=out,
        )
    assert board_results.boards() == ["kitti car", "kitti pedestrian"]
    assert not board_results.failures
    assert any("are not compared" in str(each.message) for each in raised)


@pytest.mark.slow
def test_without_anything_to_compare_the_board_says_what_to_run(results, folder, tmp_path):
    (line,) = agreement_lines(results[0], "kitti car")
    assert "roadscope leaderboard tracking --suite tracking" in line
    assert agreement_lines(results[0], "tracking") == []
    two = leaderboard("quick", TRACKERS[:2], only=True, kitti=folder, out_dir=tmp_path)
    assert agreement_lines(two, "kitti car") == []


@pytest.mark.slow
def test_only_trackers_that_came_through_a_suite_are_compared(results):
    board_results, _, folder = results
    recorded = plan_of(kitti_suite(folder), TRACKERS, only=True)
    jobs = simulated_jobs(TRACKERS)
    failed = next(job.key for job in jobs if job.entry == TRACKERS[2])

    def outcomes(keys):
        whole = Outcome({"hota": Score(0.5, "1", "higher", 9)})
        return {key: Outcome({}, "it failed") if key == failed else whole for key in keys}

    # Two that came through are too few to compare.
    assert agreements(board_results, recorded, outcomes) == ()
    assert agreements(board_results, recorded, lambda keys: {}) == ()


def _no_scans(folder):
    (folder / "velodyne").mkdir()


def _no_poses_of_the_vehicle(folder):
    write_tracking(folder)
    (folder / "ego_pose" / "0001.txt").unlink()


def _no_images(folder):
    write_tracking(folder)
    (folder / "image_02").mkdir()


@pytest.mark.parametrize(
    ("change", "kinds", "left_out"),
    [
        (_no_scans, {"tracker"}, {"detection": "velodyne"}),
        (_no_poses_of_the_vehicle, {"detector"}, {"tracking": "no poses of sequence 0001"}),
        (
            _no_images,
            {"tracker", "detector"},
            {"camera": "image_02", "fusion": "expected files 0000/000000.bin"},
        ),
    ],
)
def test_boards_without_complete_data_are_left_out_with_the_reason(change, kinds, left_out, folder):
    change(folder)
    notices = []
    suite = kitti_suite(folder, notice=notices.append)
    assert {board_named(name).kind.name for name in suite.boards} == kinds
    assert len(notices) == len(left_out)
    for notice, (board, reason) in zip(notices, left_out.items(), strict=True):
        assert board in notice
        assert reason in notice
    with pytest.raises(FormatError):
        kitti_suite(folder, list(left_out))
