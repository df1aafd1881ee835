"""Boards of camera detectors and of fusions, on a suite of seconds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from node_answers import fused_detections_of, fusion_node, fusions_of, images_of
from rich.console import Console
from safetensors.numpy import save_file
from toy_sensors import TINY
from typer.testing import CliRunner

from roadscope import CAMERA_DETECTORS, FUSIONS, Projection, Results, leaderboard, load_suite
from roadscope.__main__ import app
from roadscope.benchmarks import SUITES, EpisodeImageDetections, image_source, parse_suite, plan
from roadscope.benchmarks.boards import episodes
from roadscope.benchmarks.nodes import ImageNode
from roadscope.benchmarks.report import board_table, breakdown_tables
from roadscope.core import SpecError
from roadscope.detectors.camera import ARCHITECTURE, SHIPPED
from roadscope.fusion import CalibrationResult, write_calibration

SENSORS = Path(__file__).parent / "sensor_plugins.py"


@pytest.fixture(scope="module")
def suite():
    return parse_suite(TINY, "tiny")


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="module")
def results(suite, out) -> Results:
    return leaderboard(suite, boards=["camera", "fusion"], out_dir=out)


@pytest.mark.slow
def test_every_registered_detector_and_fusion_has_a_place(results) -> None:
    ranked = {(s.board, s.entry): s.mark for s in results.standings}
    for name in CAMERA_DETECTORS.names():
        assert ranked["camera", name] is None
    for name in FUSIONS.names():
        assert ranked["fusion", name] is None
    assert ranked["camera", "oracle"] == "upper mark"
    assert ranked["camera", "noisy-camera"] == "imitation"
    assert ranked["fusion", "LiDAR alone"] == ranked["fusion", "camera alone"] == "alone"


@pytest.mark.slow
def test_the_oracle_is_perfect_where_there_are_images(results) -> None:
    for metric, value in (("ap50", 1.0), ("false_alarms", 0.0), ("category_accuracy", 1.0)):
        rows = [r for r in results.breakdown("condition", "camera") if r.entry == "oracle"]
        clear = [r for r in rows if (r.metric, r.band) == (metric, "clear")]
        assert all(r.value == value for r in clear)
    assert results.row("camera", "network", "ap50").value < 1.0


@pytest.mark.slow
def test_parts_add_up_to_the_whole(results) -> None:
    for board, entry in (("camera", "noisy-camera"), ("fusion", "consistent")):
        for metric, by in (("detection_rate", "family"), ("detection_rate", "condition")):
            rows = [
                r for r in results.breakdown(by, board) if (r.entry, r.metric) == (entry, metric)
            ]
            whole = results.row(board, entry, metric)
            assert sum(r.samples for r in rows) == whole.samples
            total = sum(r.value * r.samples for r in rows)
            assert total == pytest.approx(whole.value * whole.samples)


@pytest.mark.slow
def test_false_alarms_stand_beside_every_rate_of_a_family(results) -> None:
    for board in ("camera", "fusion"):
        rows = results.breakdown("family", board)
        rates = {(r.entry, r.band) for r in rows if r.metric == "detection_rate"}
        alarms = {(r.entry, r.band) for r in rows if r.metric == "false_alarms"}
        assert rates
        assert rates <= alarms
        (table,) = breakdown_tables(results, board, "family", 80, metrics=("detection_rate",))
        assert "false alarms per" in str(table.title)
        assert "(" in str(next(iter(table.columns[1].cells)))


@pytest.mark.slow
def test_tables_fit_a_terminal(results) -> None:
    console = Console(width=80)
    for board in ("camera", "fusion"):
        assert console.measure(board_table(results, board, 80)).minimum <= 80


def test_a_strangers_fusion_costs_only_its_own_row(suite, out, capfd) -> None:
    small = replace(suite, seeds=suite.seeds[1:])
    small = small.with_settings("fusion", lidar=("cluster-boxes",))
    good, bad = f"{SENSORS}:MyUnion", f"{SENSORS}:NeedsBoth"
    board_results = leaderboard(
        small, [good, bad, "union"], boards=["fusion"], only=True, out_dir=out
    )
    assert (
        board_results.row("fusion", good, "ap").value
        == board_results.row("fusion", "union", "ap").value
    )
    assert board_results.row("fusion", bad, "failed_episodes").value > 0
    assert board_results.failures
    assert {failure.entry for failure in board_results.failures} == {bad}
    assert all("AttributeError" in failure.reason for failure in board_results.failures)
    assert {f.condition for f in board_results.failures} <= {e.condition for e in episodes(small)}
    assert "Warning" not in capfd.readouterr().err


def test_detections_are_stored_unchanged(suite, tmp_path) -> None:
    answers = images_of("noisy-camera", episodes(suite)[3], 0.2)
    assert any(d is None for d in answers.detections)
    with (tmp_path / "kept.npz").open("wb") as file:
        answers.save(file)
    with (tmp_path / "kept.npz").open("rb") as file:
        back = EpisodeImageDetections.load(file)
    assert back == answers


def test_fused_detections_are_a_detector_for_trackers(suite, out) -> None:
    board_results = leaderboard(suite, boards=["tracking"], out_dir=out)
    assert board_results.row("tracking", "nearest", "hota").value > 0
    spec, episode = suite.boards["tracking"].detectors[0], episodes(suite)[0]
    detections = fused_detections_of(spec, episode, suite.eligibility)
    fusions = fusions_of(spec, episode, suite.eligibility)
    assert len(detections.detections) == len(fusions.fused) == len(detections.truths)
    for of_tracker, fused, truth in zip(
        detections.detections, fusions.fused, detections.truths, strict=True
    ):
        assert of_tracker.stamp_s == fused.stamp_s == truth.stamp_s
        assert len(of_tracker) == int(fused.has_box.sum())
    kinds = np.concatenate([d.categories for d in detections.detections])
    assert len(np.unique(kinds)) > 1


def test_another_calibration_gives_other_results_under_another_key(suite, tmp_path) -> None:
    path = tmp_path / "rig.json"
    matrix = np.array([[320.0, -420, 0, -640], [240, 0, -420, 108], [1, 0, 0, -2.0]])
    whole = np.ones(6, bool)
    write_calibration(path, CalibrationResult(Projection(matrix, 640, 480), whole, 0.5), "here")
    own, other = (
        fusion_node(spec, episodes(suite)[0], suite.eligibility, every_s=0.4)
        for spec in ("fused?camera=noisy-camera", f"fused?camera=noisy-camera&calibration={path}")
    )
    assert own.key != other.key
    assert len(other.read().fused)
    assert other.read() != own.read()
    write_calibration(path, CalibrationResult(Projection(matrix, 1280, 960), whole, 0.5), "here")
    with pytest.raises(ValueError, match="1280 x 960 pixels, the rig's have 640 x 480"):
        plan(suite, (), boards=["fusion"], calibration=str(path))


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("fused?lidar=nobody", "no detector 'nobody'"),
        ("fused?camera=nobody", "no camera detector 'nobody'"),
        ("fused?fusion=nobody", "no fusion 'nobody'"),
        ("fused?lidr=cluster-boxes", "no argument 'lidr'; known: lidar, camera, fusion"),
        ("fused?lidar=fused", "not a fusion"),
        ("fused?calibration=nowhere.json", r"cannot read nowhere\.json"),
    ],
)
def test_what_cannot_be_fused_is_named_before_anything_runs(suite, spec, words) -> None:
    with pytest.raises(ValueError, match=words):
        plan(suite.with_settings("tracking", detectors=(spec,)), (), boards=["tracking"])


def test_weights_that_do_not_fit_are_named_before_anything_runs(suite, tmp_path) -> None:
    wrong, other = tmp_path / "text.safetensors", tmp_path / "other.safetensors"
    wrong.write_text("these are no weights")
    save_file({"a": np.zeros(3, np.float32)}, other, {"roadscope": '{"architecture": "yolo"}'})
    for path, words in (
        (wrong, "is not a safetensors file"),
        (other, f"expected architecture '{ARCHITECTURE}', got 'yolo'"),
        (tmp_path / "none.safetensors", "cannot read weights"),
    ):
        with pytest.raises(SpecError, match=words):
            plan(suite, [f"network?weights={path}"], boards=["camera"])


def test_other_weights_are_another_key(suite, tmp_path) -> None:
    mine = tmp_path / "mine.safetensors"
    keys = []
    for ending in (b"", b"\0"):
        mine.write_bytes(SHIPPED.read_bytes() + ending)
        node = ImageNode(image_source(f"network?weights={mine}"), episodes(suite)[0], 0.4)
        keys.append(node.key)
    assert keys[0] != keys[1]


def test_kinds_belong_on_their_boards(suite) -> None:
    with pytest.raises(SpecError, match=r"'network' is a camera detector; the boards .* a fusion"):
        plan(suite, ["network"], boards=["fusion"])
    with pytest.raises(SpecError, match=r"'union' is a fusion; the boards .* a camera detector"):
        plan(suite, ["union"], boards=["camera"])
    with pytest.raises(SpecError, match="no camera detector 'netwrk'"):
        plan(suite, ["netwrk"], boards=["camera"])
    blind = replace(suite, rig="lux")
    for board in ("camera", "fusion"):
        with pytest.raises(ValueError, match="rig 'lux' has no camera; li2021 and wide"):
            plan(blind, (), boards=[board])


def test_a_class_with_detect_says_its_kind_or_the_board_does(suite) -> None:
    with_both = suite.with_settings("detection", entries=("distance",))
    unsaid, spatial, imaging = (
        f"{SENSORS}:{name}" for name in ("OneBox", "SpatialBox", "RaisingCamera")
    )
    with pytest.raises(SpecError, match='kind = "detector"'):
        plan(with_both, [unsaid], boards=["detection", "camera"])
    for entry, board in (
        (unsaid, "detection"),
        (unsaid, "camera"),
        (spatial, "detection"),
        (imaging, "camera"),
    ):
        named = plan(with_both, [entry], boards=[board], only=True)
        assert {(job.board.name, job.entry) for job in named.jobs} == {(board, entry)}
    both = plan(with_both, [spatial, imaging], boards=["detection", "camera"], only=True)
    placed = {(job.board.name, job.entry) for job in both.jobs}
    assert placed == {("detection", spatial), ("camera", imaging)}
    with pytest.raises(SpecError, match="is a camera detector; the boards of this run are for a d"):
        plan(with_both, [imaging], boards=["detection"])


@pytest.mark.parametrize("name", SUITES)
def test_suites_of_the_package_have_jobs_on_all_their_boards(name: str) -> None:
    made = plan(load_suite(name), ())
    assert {job.board.name for job in made.jobs} == {board.name for board in made.boards}


def test_detections_on_the_command_line_replace_the_suites(tmp_path) -> None:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    arguments = ["leaderboard", "tracking", "--suite", str(path), "--jobs", "1", "--detections"]
    result = CliRunner().invoke(app, [*arguments, "cluster-boxes"])
    assert result.exit_code == 0, result.output
    assert "detections of cluster-boxes" in " ".join(result.output.split())
    result = CliRunner().invoke(app, [*arguments, "fused?fusion=nobody"])
    assert "no fusion 'nobody'" in str(result.exception)


@pytest.mark.parametrize(
    ("board", "option", "words"),
    [
        (
            "camera",
            "--detections",
            "--detections is for the boards tracking and driving, not camera",
        ),
        ("detection", "--calibration", "--calibration is for the board fusion, not detection"),
    ],
)
def test_options_that_a_board_does_not_heed_are_refused(board, option, words) -> None:
    result = CliRunner().invoke(app, ["leaderboard", board, option, "cluster-boxes"])
    assert words in str(result.exception)
