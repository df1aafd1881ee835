"""Trains the camera detector: pictures, training, calibration, scores."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadscope.benchmarks.cache import cache_dir, usable_folder
from roadscope.benchmarks.fingerprints import fingerprint
from roadscope.benchmarks.metrics.image_detection import (
    ImageScores,
    images_of_family,
    match_image,
    score_images,
)
from roadscope.benchmarks.metrics.image_labels import FAMILIES, Labels
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.train import pictures
from roadscope.benchmarks.train.pictures import PictureEpisode, Pictures, read_pictures
from roadscope.benchmarks.train.recipe import (
    FAULTS,
    GREATEST_SEVERITY,
    RECIPES,
    Recipe,
    held_out_episodes,
    split_episodes,
)
from roadscope.core import Calibration, CameraImage, Frame, ImageDetections
from roadscope.core.names import unknown
from roadscope.detectors.camera.calibration import TERM_COUNT, BoxCalibration
from roadscope.detectors.camera.decoding import TRAITS, Peaks

if TYPE_CHECKING:
    from roadscope.detectors.camera.network import CentreNetwork

LEAST_SCORE = 0.01
"""Detections with lower scores are not scored."""


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """The files of a training run, and how well the network detects.

    weights, record: files. data_hash: of all pictures that were trained, calibrated and scored on.
    scores: on validation seeds. held_out: by section of the record, in scenarios, bodies, weather
        and faults never trained on, and on test seeds.
    seconds: spent on training, without rendering.
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
) -> TrainingResult:
    """Train, write OUT.safetensors and OUT.toml beside it, and score on validation seeds.

    recipe: a name of `recipe.RECIPES`. work: folder for pictures and checkpoints, from which a
    stopped run goes on; left out, one in the cache. jobs: processes that render, then threads that
    train. Another number of threads adds up in another order, so the same weights, byte by byte,
    need the same jobs and processor.
    """
    import torch

    from roadscope.benchmarks.train.training import Trainer, train

    if recipe not in RECIPES:
        raise ValueError(unknown("recipe", recipe, RECIPES))
    settings = replace(RECIPES[recipe], seed=seed)
    weights = weights_path(Path(out))
    usable_folder(weights.parent)
    folder = usable_folder(cache_dir() / "camera-training" if work is None else work)
    split, held_out = split_episodes(settings), held_out_episodes(settings)
    _render_missing([e for part in held_out.values() for e in part], folder, jobs, progress)
    hashes = _render_missing([e for part in split for e in part], folder, jobs, progress)
    data_hash = fingerprint(hashes)
    training, calibration, validation = (
        [read_pictures(episode, folder) for episode in part] for part in split
    )
    trainer = Trainer(settings, fingerprint([settings, data_hash]))
    torch.set_num_threads(jobs)
    checkpoint = folder / f"checkpoint-{trainer.key}.pt"
    network = train(trainer, training, checkpoint, progress=progress)
    _calibrate(network, weights, calibration)
    scores = evaluate(weights, validation, progress, threads=jobs)
    held_out_scores = {
        name: evaluate(weights, [read_pictures(e, folder) for e in part], progress, threads=jobs)
        for name, part in held_out.items()
    }
    record = weights.with_suffix(".toml")
    result = TrainingResult(
        weights, record, scores, held_out_scores, data_hash, seconds=trainer.seconds
    )
    _write_record(result, recipe, settings, jobs)
    return result


def weights_path(out: Path) -> Path:
    """Return the file of the weights; another ending than its own raises `ValueError`."""
    if out.suffix not in ("", ".safetensors"):
        raise ValueError(f"weights are written as .safetensors, not as {out.suffix}: {out}")
    return out.with_suffix(".safetensors")


def _render_missing(
    episodes: Sequence[PictureEpisode], folder: Path, jobs: int, progress: Progress
) -> list[str]:
    """Render what the folder lacks; return the hash of every episode's pictures."""
    from joblib import Parallel, delayed

    missing = [e for e in episodes if pictures.stored_hash(e, folder) is None]
    if missing:
        progress("pictures", 0, len(missing))
        calls = (delayed(pictures.store_pictures)(episode, folder) for episode in missing)
        done = Parallel(n_jobs=min(jobs, len(missing)), return_as="generator_unordered")(calls)
        for i, _ in enumerate(done):
            progress("pictures", i + 1, len(missing))
    return [pictures.store_pictures(episode, folder) for episode in episodes]


def _calibrate(network: CentreNetwork, weights: Path, episodes: Sequence[Pictures]) -> None:
    """Write the network with a calibration of its scores that is fitted on these pictures."""
    from roadscope.detectors.camera.detector import CameraDetector
    from roadscope.detectors.camera.weight_file import save

    save(weights, network, BoxCalibration())
    # Float32 on every computer: the file must not depend on which precision is fast on this one.
    detector = CameraDetector(weights=str(weights), precision="float32")
    peaks = [detector.peaks(np.asarray(p)) for e in episodes for p in e.pixels]
    calibration = fitted_calibration(peaks, [label for e in episodes for label in e.labels])
    save(weights, network, calibration)


def evaluate(
    weights: Path, episodes: Sequence[Pictures], progress: Progress = silent, *, threads: int = 1
) -> ImageScores:
    """Score weights on pictures, through the detector as users run it."""
    from roadscope.detectors.camera.detector import CameraDetector

    detector = CameraDetector(weights=str(weights), min_score=LEAST_SCORE, threads=threads)
    detections: list[ImageDetections] = []
    total = sum(map(len, episodes))
    for episode in episodes:
        for pixels in episode.pixels:
            stamp_s = float(len(detections))
            image = CameraImage(np.asarray(pixels), np.eye(3), stamp_s, "camera")
            detections.append(detector.detect(Frame(stamp_s, Calibration(), camera=image)))
            progress("scores", len(detections), total)
    return score_images(detections, [label for e in episodes for label in e.labels])


def _write_record(result: TrainingResult, name: str, recipe: Recipe, jobs: int) -> None:
    """Write the record: what the weights were made from, and their scores."""
    from hashlib import sha256

    from roadscope.benchmarks.run_manifest import cpu_model
    from roadscope.detectors.camera.detector import CameraDetector
    from roadscope.detectors.camera.network import ARCHITECTURE

    fault_kinds = ", ".join(FAULTS)
    lines = [
        f'command = "roadscope train camera --recipe {name} --seed {recipe.seed} --jobs {jobs}"',
        f'processor = "{cpu_model()}" # on another kind sums are rounded otherwise',
        f'architecture = "{ARCHITECTURE}"',
        f"seed = {recipe.seed}",
        f"steps = {recipe.steps}",
        f'data = "{result.data_hash}"',
        f'weights = "{sha256(result.weights.read_bytes()).hexdigest()}"',
        f"seconds = {result.seconds:.0f} # of learning",
        f"scenarios = {json.dumps(recipe.scenarios)}",
        f"weathers = {json.dumps(sorted(set(recipe.weathers)))}",
        f"lights = {json.dumps(sorted(set(recipe.lights)))}",
        f"faulty = {recipe.faulty} # share of the episodes with {fault_kinds}, "
        f"1 to {GREATEST_SEVERITY}",
        "# Scores are on validation seeds, but for those of `test` and `test_clear_days`, on test",
        "# seeds; rates and false alarms from a score of 0.5 up.",
        f'precision = "{CameraDetector().precision}" # of the network when it was scored',
    ]
    for section, scores in {"validation": result.scores, **result.held_out}.items():
        lines += ["", f"[{section}]", f"objects = {scores.ap50.n}"]
        lines += [f"{key} = {score.value:.4f}" for key, score in scores.named().items()]
    result.record.write_text("\n".join([*lines, ""]), "utf-8")


# --------------------------------------------------------------------------------------------------
# Scores as probabilities that boxes are right, fitted on pictures that were not trained on.

NEWTON_STEPS = 100
LONGEST_STEP = 0.5
"""Greatest change of a weight in a Newton step, chosen by hand."""
PRIOR = 30.0
"""Strength of the prior, which draws the weights to scores that are the heat itself: about as
strong as this many boxes for each term. Chosen by hand."""
LEAST_SPREAD = 0.01
"""Least standard deviation of a trait, so that none is divided by 0."""
DIGITS = 4
"""Decimals that fitted values are rounded to."""


def fitted_calibration(peaks: Sequence[Peaks], labels: Sequence[Labels]) -> BoxCalibration:
    """Fit one logistic curve of traits and their products for each family.

    peaks, labels: of the same pictures. A box is right if it matches an object when boxes are
    matched by falling heat.
    """
    detections = [
        ImageDetections(
            p.boxes, p.categories.astype(np.int8), 1 / (1 + np.exp(-p.log_odds)), float(i)
        )
        for i, p in enumerate(peaks)
    ]
    traits = np.concatenate([np.empty((0, len(TRAITS))), *(p.traits for p in peaks)])
    standardised = _standardised(traits)
    # The prior's weights: scores that are the heat, which is the first trait.
    prior = np.zeros(TERM_COUNT)
    prior[0], prior[1] = standardised.middles[0], standardised.spreads[0]
    weights = []
    for family in range(len(FAMILIES)):
        boxes = _judged_boxes(peaks, detections, labels, family)
        weights.append(logistic(standardised.terms(boxes.traits), boxes.right, prior))
    return replace(standardised, weights=np.round(weights, DIGITS))


class _JudgedBoxes(NamedTuple):
    """Boxes that are right or wrong. traits: (N, 9). right: (N,) bool."""

    traits: np.ndarray
    right: np.ndarray


def _judged_boxes(
    peaks: Sequence[Peaks],
    detections: Sequence[ImageDetections],
    labels: Sequence[Labels],
    family: int,
) -> _JudgedBoxes:
    """Return the boxes of a family without those that are neither right nor wrong."""
    traits, right = [np.empty((0, len(TRAITS)))], [np.empty(0, bool)]
    for p, image in zip(peaks, images_of_family(detections, labels, family), strict=True):
        rows, hits = match_image(image)
        traits.append(p.traits[np.flatnonzero(p.families == family)[rows]])
        right.append(hits)
    return _JudgedBoxes(np.concatenate(traits), np.concatenate(right))


def _standardised(traits: np.ndarray) -> BoxCalibration:
    """Return a calibration with the means and standard deviations of (N, 9) traits."""
    if not len(traits):
        return BoxCalibration()
    spreads = np.maximum(traits.std(axis=0), LEAST_SPREAD)
    return BoxCalibration(traits.mean(axis=0).round(DIGITS), spreads.round(DIGITS))


def logistic(terms: np.ndarray, right: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return (T,) weights of (N, T) terms in the log odds of being right, by Newton's method.

    right: (N,) bool. prior: (T,) mean of a normal prior of the weights.
    """
    weights = prior.copy()
    for _ in range(NEWTON_STEPS):
        chance = 1 / (1 + np.exp(-np.clip(terms @ weights, -40, 40)))
        gradient = terms.T @ (right - chance) - PRIOR * (weights - prior)
        hessian = (terms * (chance * (1 - chance))[:, None]).T @ terms + PRIOR * np.eye(len(prior))
        step = np.linalg.solve(hessian, gradient)
        weights += step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
    return weights
