"""Boards of camera detectors and of fusions, on a suite of seconds."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file
from toy_sensors import TINY
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.boards.breakdown_tables import breakdown_tables
from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.boards.tables import board_table
from roadscope.benchmarks.jobs.camera_job import CameraJob, seen_of
from roadscope.benchmarks.jobs.fused import FusedSpec, fuse, perceive_fused
from roadscope.benchmarks.jobs.plan import boards_of, episodes, plan
from roadscope.benchmarks.runner import run
from roadscope.benchmarks.seen import Seen
from roadscope.benchmarks.suite import SUITES, load_suite, parse_suite
from roadscope.core import SpecError
from roadscope.core.projection import Projection
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.detectors.camera.network import ARCHITECTURE
from roadscope.detectors.camera.weight_file import SHIPPED
from roadscope.fusion import FUSIONS
from roadscope.fusion.calibration import CalibrationResult
from roadscope.fusion.calibration_file import write_calibration

SENSORS = Path(__file__).parent / "check" / "bad_sensors.py"


@pytest.fixture(scope="module")
def suite():
    return parse_suite(TINY, "tiny")


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="module")
def results(suite, out) -> Results:
    return run(suite, boards=("camera", "fusion"), out_dir=out)


def test_every_registered_detector_and_fusion_has_a_place(results) -> None:
    ranked = {(s.board, s.entry): s.mark for s in results.standings}
    for name in CAMERA_DETECTORS.names():
        assert ranked["camera", name] is None
    for name in FUSIONS.names():
        assert ranked["fusion", name] is None
    assert ranked["camera", "oracle"] == "upper mark"
    assert ranked["camera", "noisy-camera"] == "imitation"
    assert ranked["fusion", "LiDAR alone"] == ranked["fusion", "camera alone"] == "alone"


def test_the_oracle_is_perfect_where_there_are_images(results) -> None:
    for metric, value in (("ap50", 1.0), ("false_alarms", 0.0), ("category_accuracy", 1.0)):
        rows = [r for r in results.breakdown("condition", "camera") if r.entry == "oracle"]
        clear = [r for r in rows if (r.metric, r.band) == (metric, "clear")]
        assert all(r.value == value for r in clear)
    assert results.row("camera", "network", "ap50").value < 1.0


def test_parts_add_up_to_the_whole(results) -> None:
    for board, entry in (("camera", "noisy-camera"), ("fusion", "consistent")):
        for metric, by in (("detection_rate", "family"), ("detection_rate", "condition")):
            rows = [
                r for r in results.breakdown(by, board) if (r.entry, r.metric) == (entry, metric)
            ]
            whole = results.row(board, entry, metric)
            assert sum(r.samples for r in rows) == whole.samples
            found = sum(r.value * r.samples for r in rows)
            assert found == pytest.approx(whole.value * whole.samples)


def test_false_alarms_stand_beside_every_rate_of_a_family(results) -> None:
    for board in ("camera", "fusion"):
        rows = results.breakdown("family", board)
        rates = {(r.entry, r.band) for r in rows if r.metric == "detection_rate"}
        alarms = {(r.entry, r.band) for r in rows if r.metric == "false_alarms"}
        assert rates
        assert rates <= alarms
        (table,) = breakdown_tables(results, board, "family", 80, ("detection_rate",))
        assert "false alarms per" in str(table.title)
        assert "(" in str(next(iter(table.columns[1].cells)))


def test_tables_fit_a_terminal(results) -> None:
    from rich.console import Console

    console = Console(width=80)
    for board in ("camera", "fusion"):
        assert console.measure(board_table(results, board, 80)).minimum <= 80


def test_a_strangers_fusion_runs_apart_and_costs_only_its_own_row(suite, out, capfd) -> None:
    small = replace(suite, seeds=suite.seeds[1:], fused_lidar=("cluster-boxes",))
    good, bad = f"{SENSORS}:Mine", f"{SENSORS}:NeedsBoth"
    found = run(small, [good, bad, "union"], boards=("fusion",), only=True, out_dir=out)
    assert found.row("fusion", good, "ap").value == found.row("fusion", "union", "ap").value
    assert found.row("fusion", bad, "failed_episodes").value > 0
    reasons = [reason for name, _, reason in found.reasons() if name == bad]
    assert reasons
    assert all("AttributeError" in reason for reason in reasons)
    conditions = {failure.condition for failure in found.failures}
    assert conditions
    assert conditions <= {episode.condition for episode in episodes(small)}
    assert "Warning" not in capfd.readouterr().err


def test_a_second_run_does_nothing_again(suite, out, results, monkeypatch) -> None:
    for name in ("execute_camera", "execute_fusions", "seen_of", "detections_of", "apart"):
        monkeypatch.setattr(f"roadscope.benchmarks.runner.{name}", None)
    monkeypatch.setattr("roadscope.benchmarks.jobs.public.PublicDetections.read", None)
    again = run(suite, boards=("camera", "fusion"), out_dir=out)
    assert again.row("fusion", "union", "ap") == results.row("fusion", "union", "ap")
    assert again.row("camera", "network", "ap50") == results.row("camera", "network", "ap50")
    written = json.loads((out / "leaderboard.json").read_text())
    assert {row["board"] for row in written["rows"]} == {"camera", "fusion"}
    assert "### detected (false alarms per image) by family" in (out / "leaderboard.md").read_text()


def test_strangers_that_raise_hang_or_end_the_program_become_rows(suite, out) -> None:
    small = replace(suite, seeds=suite.seeds[:1], faults=((),), camera_detectors=())
    told = {}
    for names, deadline_s in ((("Fine", "Raises", "EndsAll"), 300.0), (("Hangs",), 1.0)):
        specs = [f"{SENSORS}:{name}" for name in names]
        found = run(small, specs, boards=("camera",), only=True, out_dir=out, deadline_s=deadline_s)
        told |= {name.rpartition(":")[2]: reason for name, _, reason in found.reasons()}
    assert "Fine" not in told
    assert "KeyError" in told["Raises"]
    assert "no answer within 1 s: it hangs" in told["Hangs"]
    assert "ended its whole process, exit code 3" in told["EndsAll"]


def test_detections_are_kept_as_they_were(suite, tmp_path) -> None:
    episode = episodes(suite)[3]
    seen = seen_of(CameraJob("noisy-camera", "noisy-camera", episode, 0.2))
    assert any(d is None for d in seen.detections)
    seen.save(tmp_path / "seen.npz")
    back = Seen.load(tmp_path / "seen.npz")
    assert back.detections == seen.detections
    assert back.truths == seen.truths
    assert np.array_equal(back.rows, seen.rows)
    assert all(
        np.array_equal(x, y)
        for one, other in zip(back.parked, seen.parked, strict=True)
        for x, y in zip(one, other, strict=True)
    )


def test_fused_detections_are_a_detector_for_trackers(suite, out) -> None:
    found = run(suite, boards=("tracking",), out_dir=out)
    assert found.row("tracking", "nearest", "hota").value > 0
    spec, episode = suite.public_detectors[0], episodes(suite)[0]
    perceived = perceive_fused(spec, episode, suite.eligibility)
    moments = fuse(FusedSpec.parse(spec), episode, suite.eligibility)
    assert len(perceived.detections) == len(moments.fused) == len(perceived.truths)
    for seen, fused, truth in zip(
        perceived.detections, moments.fused, perceived.truths, strict=True
    ):
        assert seen.stamp_s == fused.stamp_s == truth.stamp_s
        assert len(seen) == int(fused.has_box.sum())
    kinds = np.concatenate([d.categories for d in perceived.detections])
    assert len(np.unique(kinds)) > 1


def test_another_calibration_gives_other_results_under_another_key(suite, tmp_path) -> None:
    path = tmp_path / "rig.json"
    matrix = np.array([[320.0, -420, 0, -640], [240, 0, -420, 108], [1, 0, 0, -2.0]])
    whole = np.ones(6, bool)
    write_calibration(path, CalibrationResult(Projection(matrix, 640, 480), whole, 0.5), "here")
    episode = episodes(suite)[0]
    true = FusedSpec(camera="noisy-camera")
    other = replace(true, calibration=str(path))
    assert true.made_by(episode, suite.eligibility, 0.4) != other.made_by(
        episode, suite.eligibility, 0.4
    )
    assert len(fuse(other, episode, suite.eligibility, 0.4).fused)
    write_calibration(path, CalibrationResult(Projection(matrix, 1280, 960), whole, 0.5), "here")
    with pytest.raises(RuntimeError, match="1280 x 960 pixels, the rig's have 640 x 480"):
        plan(suite, (), ("fusion",), calibration=str(path))


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("fused?lidar=nobody", "no detector 'nobody'"),
        ("fused?camera=nobody", "no camera detector 'nobody'"),
        ("fused?fusion=nobody", "no fusion 'nobody'"),
        ("fused?lidr=cluster-boxes", "no argument 'lidr'; known: lidar, camera, fusion"),
        ("fused?lidar=fused", "not another fusion"),
        ("fused?calibration=nowhere.json", r"cannot read nowhere\.json"),
    ],
)
def test_what_cannot_be_fused_is_named_before_anything_runs(suite, spec, words) -> None:
    with pytest.raises(ValueError, match=words):
        plan(replace(suite, public_detectors=(spec,)), (), ("tracking",))


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
            plan(suite, [f"network?weights={path}"], ("camera",))


def test_other_weights_are_another_key(suite, tmp_path) -> None:
    mine = tmp_path / "mine.safetensors"
    mine.write_bytes(SHIPPED.read_bytes())
    (job, *_) = (
        j
        for j in plan(suite, [f"network?weights={mine}"], ("camera",)).camera
        if "weights" in j.entry
    )
    before = job.key
    mine.write_bytes(SHIPPED.read_bytes() + b"\0")
    assert replace(job).key != before


def test_kinds_belong_on_their_boards(suite) -> None:
    with pytest.raises(SpecError, match="is a camera detector; it belongs on the camera board"):
        plan(suite, ["network"], ("fusion",))
    with pytest.raises(SpecError, match="is a fusion; it belongs on the fusion board"):
        plan(suite, ["union"], ("camera",))
    with pytest.raises(SpecError, match="no camera detector 'netwrk'"):
        plan(suite, ["netwrk"], ("camera",))
    unsaid = f"{SENSORS}:Unsaid"
    both = plan(replace(suite, detectors=("distance",)), [unsaid], ("detection", "camera"))
    assert unsaid in {job.entry for job in both.camera}
    assert unsaid not in {job.entry for job in both.detection}
    with pytest.raises(SpecError, match="is a camera detector; it belongs on the camera board"):
        plan(suite, [unsaid], ("detection",))
    blind = replace(suite, rig="lux")
    for board in ("camera", "fusion"):
        with pytest.raises(ValueError, match="rig 'lux' has no camera; li2021 and wide"):
            plan(blind, (), (board,))


@pytest.mark.parametrize("name", SUITES)
def test_suites_of_the_package_have_jobs_on_all_their_boards(name: str) -> None:
    loaded = load_suite(name)
    assert plan(loaded, (), boards_of(loaded)).jobs


def test_the_command_line_shows_both_boards(tmp_path, suite, results) -> None:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    for board, words in (
        ("camera", ("AP50", "false alarms per image) by family", "AP50 by size")),
        ("fusion", ("dist.", "false alarms per scan) by family", "AP by inputs")),
    ):
        by = {"camera": "size", "fusion": "inputs"}[board]
        arguments = ["leaderboard", board, "--suite", str(path), "--by", by, "--jobs", "1"]
        said = CliRunner().invoke(app, arguments, env={"COLUMNS": "80"})
        assert said.exit_code == 0, said.output
        for each in words:
            assert each in said.output
        lines = [line for line in said.stdout.splitlines() if not line.startswith("written")]
        assert max(map(len, lines)) <= 80


def test_detections_on_the_command_line_replace_the_suites(tmp_path) -> None:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    arguments = ["leaderboard", "tracking", "--suite", str(path), "--jobs", "1", "--detections"]
    said = CliRunner().invoke(app, [*arguments, "cluster-boxes"])
    assert said.exit_code == 0, said.output
    assert "detections of cluster-boxes" in " ".join(said.output.split())
    said = CliRunner().invoke(app, [*arguments, "fused?fusion=nobody"])
    assert "no fusion 'nobody'" in str(said.exception)


@pytest.mark.parametrize(
    ("board", "option", "words"),
    [
        ("camera", "--detections", "--detections is for the board tracking, not camera"),
        ("detection", "--calibration", "--calibration is for the board fusion, not detection"),
    ],
)
def test_options_that_a_board_does_not_heed_are_refused(board, option, words) -> None:
    said = CliRunner().invoke(app, ["leaderboard", board, option, "cluster-boxes"])
    assert words in str(said.exception)
