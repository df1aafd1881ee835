"""Trains the camera detector: pictures, learning, calibration, scores."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.cache import cache_dir, usable_folder
from roadscope.benchmarks.fingerprint import fingerprint
from roadscope.benchmarks.metrics.image_detection import ImageScores, score_images
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.train import views
from roadscope.benchmarks.train.recipe import (
    CALIBRATION_SEEDS,
    FAULTS,
    HELD_OUT_FAULTS,
    HELD_OUT_SCENARIOS,
    HELD_OUT_WEATHERS,
    LOOKS,
    RECIPES,
    TEST_SEEDS,
    TRAIN_SEEDS,
    VALIDATION_SEEDS,
    WEATHERS,
    WORST,
    Recipe,
)
from roadscope.benchmarks.train.views import Pictures, View, drawn_views
from roadscope.core import Calibration, CameraImage, Frame, ImageDetections
from roadscope.core.names import unknown

if TYPE_CHECKING:
    from roadscope.benchmarks.train.training import Trainer
    from roadscope.detectors.camera.network import CentreNetwork

LEAST_SCORE = 0.01
"""Of detections that are scored."""


@dataclass(frozen=True, slots=True)
class Trained:
    """What came out.

    weights, record: files. seconds: that learning took, pictures not counted.
    scores: on validation seeds. held_out: by section of the record, in scenarios and weathers
        never trained on, and on test seeds.
    """

    weights: Path
    record: Path
    scores: ImageScores
    held_out: Mapping[str, ImageScores]
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
    then threads that learn: sums are rounded otherwise with another number of them, so the same
    weights, byte by byte, need the same jobs and processor.
    """
    from roadscope.benchmarks.train.training import Trainer

    if recipe not in RECIPES:
        raise ValueError(unknown("recipe", recipe, RECIPES))
    plan = replace(RECIPES[recipe], seed=seed)
    target = _target(Path(out))
    usable_folder(target.parent)
    folder = usable_folder(cache_dir() / "camera-training" if work is None else work)
    split, apart = _split(plan), held_out(plan)
    _rendered([v for part in apart.values() for v in part], folder, jobs, progress)
    digests = _rendered([v for part in split for v in part], folder, jobs, progress)
    data_hash = fingerprint(digests)
    learned, calibration, scores = ([views.read(v, folder) for v in part] for part in split)
    trainer = Trainer(plan, fingerprint([plan, data_hash]))
    network = _learn(trainer, learned, folder, jobs=jobs, progress=progress)
    _calibrate(network, target, calibration)
    found = evaluate(target, scores, progress, threads=jobs)
    others = {
        name: evaluate(target, [views.read(v, folder) for v in part], progress, threads=jobs)
        for name, part in apart.items()
    }
    record = target.with_suffix(".toml")
    done = Trained(target, record, found, others, data_hash, trainer.seconds)
    _record(done, recipe, plan, jobs)
    return done


def _target(out: Path) -> Path:
    """Return the file of the weights; an ending that says something else is refused."""
    if out.suffix not in ("", ".safetensors"):
        raise ValueError(f"weights are written as .safetensors, not as {out.suffix}: {out}")
    return out.with_suffix(".safetensors")


def _split(plan: Recipe) -> tuple[list[View], list[View], list[View]]:
    """Draw episodes to learn from, to calibrate and to score on; bodies held out are refused."""
    if kept := set(plan.scenarios) & set(LOOKS):
        raise ValueError(f"scenarios {', '.join(sorted(kept))} are held out: nothing learns there")
    return (
        drawn_views(plan, plan.episodes, TRAIN_SEEDS),
        drawn_views(plan, plan.calibration_episodes, CALIBRATION_SEEDS),
        drawn_views(plan, plan.validation_episodes, VALIDATION_SEEDS, varied=False),
    )


def held_out(plan: Recipe) -> dict[str, list[View]]:
    """Draw episodes in clear air by day, then such as nothing was learned from, by section.

    Other places and bodies, heavier weather and faults. The last two are on test seeds: what was
    learned from, drawn as validation is, and clear days.
    """
    count = max(1, plan.validation_episodes // 3)
    plain = replace(plan, weathers=WEATHERS, faulty=0.0, lights=("day",))
    unlike = {
        "clear_days": replace(plain, weathers=("clear",)),
        "held_out_scenarios": replace(plain, scenarios=HELD_OUT_SCENARIOS),
        "held_out_looks": replace(plain, scenarios=LOOKS),
        "held_out_weathers": replace(plain, weathers=HELD_OUT_WEATHERS),
        "held_out_faults": replace(plain, weathers=("clear",), conditions=HELD_OUT_FAULTS),
    }
    drawn = {
        name: drawn_views(other, count, VALIDATION_SEEDS, varied=False)
        for name, other in unlike.items()
    }
    return drawn | {
        "test": drawn_views(plan, plan.validation_episodes, TEST_SEEDS, varied=False),
        "test_clear_days": drawn_views(unlike["clear_days"], count, TEST_SEEDS, varied=False),
    }


def _rendered(wanted: Sequence[View], folder: Path, jobs: int, progress: Progress) -> list[str]:
    """Render what the folder lacks; return the hash of every episode's pictures."""
    from joblib import Parallel, delayed

    missing = [v for v in wanted if views.kept(v, folder) is None]
    if missing:
        progress("pictures", 0, len(missing))
        work = (delayed(views.keep)(v, folder) for v in missing)
        done = Parallel(n_jobs=min(jobs, len(missing)), return_as="generator_unordered")(work)
        for i, _ in enumerate(done):
            progress("pictures", i + 1, len(missing))
    return [views.keep(v, folder) for v in wanted]


def _learn(
    trainer: Trainer, episodes: Sequence[Pictures], folder: Path, *, jobs: int, progress: Progress
) -> CentreNetwork:
    import torch

    from roadscope.benchmarks.train.training import train

    torch.set_num_threads(jobs)
    checkpoint = folder / f"checkpoint-{trainer.key}.pt"
    return train(trainer, episodes, checkpoint, progress=progress)


def _calibrate(network: CentreNetwork, target: Path, episodes: Sequence[Pictures]) -> None:
    """Write the network with what its scores are worth on these pictures."""
    from roadscope.benchmarks.train.calibration import calibrated
    from roadscope.detectors.camera.calibration import BoxCalibration
    from roadscope.detectors.camera.detector import CameraDetector
    from roadscope.detectors.camera.weight_file import save

    save(target, network, BoxCalibration())
    # In one precision everywhere: what is written must not depend on what is fast here.
    detector = CameraDetector(weights=str(target), precision="float32")
    peaks = [detector.peaks(np.asarray(p)) for e in episodes for p in e.pixels]
    worth = calibrated(peaks, [label for e in episodes for label in e.labels])
    save(target, network, worth)


def evaluate(
    weights: Path, episodes: Sequence[Pictures], progress: Progress = silent, *, threads: int = 1
) -> ImageScores:
    """Score weights on pictures, through the detector as it is used."""
    from roadscope.detectors.camera.detector import CameraDetector

    detector = CameraDetector(weights=str(weights), min_score=LEAST_SCORE, threads=threads)
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


def _record(done: Trained, name: str, plan: Recipe, jobs: int) -> None:
    """Write down what produced the weights and what they reach."""
    from hashlib import sha256

    from roadscope.benchmarks.manifest import cpu_model
    from roadscope.detectors.camera.detector import CameraDetector
    from roadscope.detectors.camera.network import ARCHITECTURE

    lines = [
        f'command = "roadscope train camera --recipe {name} --seed {plan.seed} --jobs {jobs}"',
        f'processor = "{cpu_model()}" # on another kind sums are rounded otherwise',
        f'architecture = "{ARCHITECTURE}"',
        f"seed = {plan.seed}",
        f"steps = {plan.steps}",
        f'data = "{done.data_hash}"',
        f'weights = "{sha256(done.weights.read_bytes()).hexdigest()}"',
        f"seconds = {done.seconds:.0f} # of learning",
        f"scenarios = {json.dumps(plan.scenarios)}",
        f"weathers = {json.dumps(sorted(set(plan.weathers)))}",
        f"lights = {json.dumps(sorted(set(plan.lights)))}",
        f"faulty = {plan.faulty} # share of the episodes with {', '.join(FAULTS)}, 1 to {WORST}",
        "# Scores are on validation seeds, but for those of `test` and `test_clear_days`, on test",
        "# seeds; rates and false alarms from a score of 0.5 up.",
        f'precision = "{CameraDetector().precision}" # of the network when it was scored',
    ]
    for section, scores in {"validation": done.scores, **done.held_out}.items():
        lines += ["", f"[{section}]", f"objects = {scores.ap50.n}"]
        lines += [f"{key} = {score.value:.4f}" for key, score in scores.named().items()]
    done.record.write_text("\n".join([*lines, ""]), "utf-8")
