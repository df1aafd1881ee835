"""Trains the camera detector: pictures, learning, calibration, scores."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import cache_dir, usable_folder
from roadscope.benchmarks.fingerprint import fingerprint
from roadscope.benchmarks.metrics.image_detection import ImageScores, score_images
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.train import views
from roadscope.benchmarks.train.recipe import (
    CALIBRATION_SEEDS,
    RECIPES,
    TRAIN_SEEDS,
    VALIDATION_SEEDS,
    Recipe,
)
from roadscope.benchmarks.train.views import Pictures, View, drawn_views
from roadscope.core import Calibration, CameraImage, Frame, ImageDetections
from roadscope.core.names import unknown

LEAST_SCORE = 0.01
"""Of detections that are calibrated and scored."""


@dataclass(frozen=True, slots=True)
class Trained:
    """What came out. weights, record: files. seconds: of wall time in this run."""

    weights: Path
    record: Path
    scores: ImageScores
    data_hash: str
    seconds: float


def train_camera(
    out: Path | str,
    *,
    recipe: str = "full",
    seed: int = 0,
    work: Path | str | None = None,
    jobs: int = 1,
    progress: Progress = silent,
) -> Trained:
    """Train, write OUT.safetensors and OUT.toml beside it, and score on validation seeds.

    recipe: a name of `recipe.RECIPES`. work: folder for pictures and checkpoints, which a run
    that was stopped goes on from; left out, one in the cache. jobs: processes that render,
    then threads that learn.
    """
    from dataclasses import replace

    if recipe not in RECIPES:
        raise ValueError(unknown("recipe", recipe, RECIPES))
    plan = replace(RECIPES[recipe], seed=seed)
    target = Path(out).with_suffix(".safetensors")
    usable_folder(target.parent)
    folder = usable_folder(cache_dir() / "camera-training" if work is None else work)
    began = time.monotonic()
    split = _split(plan)
    digests = _rendered([v for part in split for v in part], folder, jobs, progress)
    data_hash = fingerprint(digests)
    learned, calibration, scores = ([views.read(v, folder) for v in part] for part in split)
    _learn(plan, data_hash, learned, folder, target, jobs, progress)
    _calibrate(target, calibration)
    found = evaluate(target, scores, progress)
    record = _record(target, recipe, plan, data_hash, found, time.monotonic() - began)
    return Trained(target, record, found, data_hash, time.monotonic() - began)


def _split(plan: Recipe) -> tuple[list[View], list[View], list[View]]:
    return (
        drawn_views(plan, plan.episodes, TRAIN_SEEDS),
        drawn_views(plan, plan.calibration_episodes, CALIBRATION_SEEDS),
        drawn_views(plan, plan.validation_episodes, VALIDATION_SEEDS, varied=False),
    )


def _rendered(wanted: Sequence[View], folder: Path, jobs: int, progress: Progress) -> list[str]:
    """Render what the folder lacks; return the hash of every episode's pictures."""
    from joblib import Parallel, delayed

    missing = [v for v in wanted if not (folder / f"{v.name}.npz").exists()]
    if missing:
        progress("pictures", 0, len(missing))
        work = (delayed(views.keep)(v, folder) for v in missing)
        done = Parallel(n_jobs=min(jobs, len(missing)), return_as="generator_unordered")(work)
        for i, _ in enumerate(done):
            progress("pictures", i + 1, len(missing))
    return [views.keep(v, folder) for v in wanted]


def _learn(
    plan: Recipe, data_hash: str, episodes: Sequence[Pictures], folder: Path, target: Path,
    jobs: int, progress: Progress,
) -> None:  # fmt: skip
    import torch

    from roadscope.benchmarks.train.training import Trainer, train
    from roadscope.detectors.camera.weight_file import Calibration, save

    torch.set_num_threads(jobs)
    key = fingerprint([plan, data_hash])
    network = train(
        Trainer(plan, key), episodes, folder / f"checkpoint-{key}.pt", progress=progress
    )
    save(target, network, Calibration())


def _calibrate(target: Path, episodes: Sequence[Pictures]) -> None:
    from roadscope.benchmarks.train.calibration import calibrated
    from roadscope.detectors.camera.detector import CameraDetector
    from roadscope.detectors.camera.weight_file import load, save

    detector = CameraDetector(weights=str(target), min_score=LEAST_SCORE)
    peaks = [detector.peaks(np.asarray(p)) for e in episodes for p in e.pixels]
    worth = calibrated(peaks, [label for e in episodes for label in e.labels])
    save(target, load(target)[0], worth)


def evaluate(
    weights: Path, episodes: Sequence[Pictures], progress: Progress = silent
) -> ImageScores:
    """Score weights on pictures, through the detector as it is used."""
    from roadscope.detectors.camera.detector import CameraDetector

    detector = CameraDetector(weights=str(weights), min_score=LEAST_SCORE)
    found: list[ImageDetections] = []
    total = sum(map(len, episodes))
    for episode in episodes:
        for pixels in episode.pixels:
            found.append(detector.detect(_frame(np.asarray(pixels), float(len(found)))))
            progress("scores", len(found), total)
    return score_images(found, [label for e in episodes for label in e.labels])


def _frame(pixels: np.ndarray, stamp_s: float) -> Frame:
    image = CameraImage(pixels, np.eye(3), stamp_s, "camera")
    return Frame(stamp_s, Calibration(), camera=image)


def _record(
    target: Path, name: str, plan: Recipe, data_hash: str, scores: ImageScores, seconds: float
) -> Path:
    """Write down what produced the weights and what they reach."""
    from hashlib import sha256

    from roadscope.detectors.camera.network import ARCHITECTURE

    lines = [
        f'command = "roadscope train camera --recipe {name} --seed {plan.seed}"',
        f'architecture = "{ARCHITECTURE}"',
        f"seed = {plan.seed}",
        f"steps = {plan.steps}",
        f'data = "{data_hash}"',
        f'weights = "{sha256(target.read_bytes()).hexdigest()}"',
        f"seconds = {seconds:.0f}",
        f"scenarios = [{', '.join(repr(s) for s in plan.scenarios)}]".replace("'", '"'),
        "",
        "[validation] # seeds from 10000 on, scores from 0.5 up for rates and false alarms",
    ]
    for key, score in scores.named().items():
        lines.append(f"{key} = {score.value:.4f}")
    lines.append(f"objects = {scores.ap50.n}")
    path = target.with_suffix(".toml")
    path.write_text("\n".join([*lines, ""]), "utf-8")
    return path
