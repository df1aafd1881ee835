"""The experiments of Li 2021 with the paper's figures beside ours.

The LiDAR's detections are made from scans, the camera's by the shipped network from rendered
images, and once more imitated from truth (`noisy-camera`): what a camera's detector of that quality
would bring.
Every method is shown from the score on at which it gives half a false alarm a scan, seed by seed
and condition by condition, so that rates can be compared.

Boxes are projected as the rig is truly mounted, carried from the scan to the image by the ego's own
motion, which the paper leaves out; what a calibration by the board costs is what `roadscope
leaderboard fusion --calibration` shows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.metrics.fusion import (
    FusionRates,
    FusionTargets,
    fusion_rates,
    in_crowd,
    match_targets,
    threshold_at,
)
from roadscope.benchmarks.papers.li2021_scene import Moment, film
from roadscope.benchmarks.papers.li2021_table import table_1
from roadscope.benchmarks.papers.reproduction import (
    POINTS,
    YES_OR_NO,
    Key,
    ReproductionRow,
    over_seeds,
    summarise,
)
from roadscope.core import Detections
from roadscope.core.fused import FusedDetections
from roadscope.detectors import Detector
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import FUSIONS
from roadscope.fusion.cluster_boxes import ClusterBoxes
from roadscope.fusion.evidence import FAMILIES

FIRST_SEED = 20000
SCENARIOS, RIG, DURATION_S, EVERY = ("street", "town-crossing"), "li2021", 10.0, 8
LIDAR, CAMERA = "LiDAR alone", "camera alone"
WITHOUT = "li2021-without-evidence"
"""Whose masses are the camera's wherever that has a box: what evidence theory adds to it."""
BELIEF, BELIEF_WITHOUT = "li2021-by-belief", "li2021-by-belief-without"
"""The same two with targets ranked by the belief that they are any of the classes."""
SPECS = {
    LIDAR: "union", CAMERA: "union",
    BELIEF: "li2021?rank=any", BELIEF_WITHOUT: f"{WITHOUT}?rank=any",
}  # fmt: skip
"""Of methods that are no names of fusions."""
FUSED = (
    "li2021", WITHOUT, BELIEF, BELIEF_WITHOUT, "icp-boxes", "weighted-boxes", "bayes", "consistent",
)  # fmt: skip
METHODS = (LIDAR, CAMERA, *FUSED)
EQUAL_FALSE = 0.5
"""False alarms a scan at which all methods are compared, condition by condition."""
VEHICLES, CYCLISTS, PEDESTRIANS = (f"{family.value}s found" for family in FAMILIES)
FALSE = "false"
DISTANCE = "distance right"
HIDDEN = "distance right of those more than a third hidden"
CLASS = "class right of those found"
MORE_BOTH = "found more than by the better sensor alone"
MORE_ONE = "found more than by the sensor that is left"
"""Tables of their own, by condition; the last two of differences on the same seed."""
CLAIMS, MORE = "claims", "finds more than either sensor alone"
MORE_AT_EQUAL = "finds more at half a false alarm a scan"
EVIDENCE = "finds more with evidence"
EVERY_SCORE = "clear, every score"
"""Without thresholds, as the paper counts, which gives no false alarms."""
IMAGES, IMITATED = "", "camera imitated"
"""The shipped network looks at rendered images, or `noisy-camera` makes detections from truth."""
CAMERA_NOTES = {
    IMAGES: "The camera's detections are the shipped network's, in rendered images.",
    IMITATED: "The camera's detections are an imitation made from truth (noisy-camera).",
}
SENSED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"clear": (), "fog": ("fog:3",), "night": ("night:3",)}
)
"""What is in the way of the sensors, by condition."""
WITH_BOTH = ("clear", "fog", "night", "crowds")
CONDITIONS = (*WITH_BOTH, "LiDAR fails", "camera fails")
TABLE_2 = {
    ("li2021", VEHICLES): 94.8,
    ("li2021", PEDESTRIANS): 96.4,
    ("icp-boxes", VEHICLES): 90.3,
    ("icp-boxes", PEDESTRIANS): 85.6,
}
PAPER: Mapping[Key, float] = MappingProxyType(
    {
        **{("clear", *key): rate for key, rate in TABLE_2.items()},
        **{(EVERY_SCORE, *key): rate for key, rate in TABLE_2.items()},
        (CLAIMS, "li2021", MORE): 1.0,
    }
)
"""With either camera. Table 2, on 58 vehicles and 204 pedestrians, false alarms not given: the
95 % interval of the vehicles' figure is about 86 to 98. `icp-boxes` stands for the method of the
paper's reference 6."""


def reproduce(
    seeds: int = 30, progress: Callable[[int, int], None] | None = None, *, jobs: int = 1
) -> list[ReproductionRow]:
    """Run all experiments and return the paper's figures beside ours."""
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    measured = over_seeds(measure, numbers, progress, jobs=jobs)
    rows = [
        summarise((experiment, method), quantity, unit_of(quantity, experiment), values,
                  PAPER.get((split(experiment)[0], method, quantity)))
        for (experiment, method, quantity), values in measured.items()
    ]  # fmt: skip
    return [*table_1(), *rows]


def note_of(experiment: str) -> str | None:
    """Return what must be known to read the tables of an experiment."""
    if experiment == "table 1":
        return "The printed LiDAR row of the car sums to 0.993; 0.693 is read as 0.700."
    plain, camera = split(experiment)
    told = CAMERA_NOTES[camera]
    if plain == EVERY_SCORE:
        return f"All that is found counts, however unsure. {told}"
    if plain == "clear":
        told = f"{told} By belief: ranked by the belief that a target is any of the classes."
    if plain == CLAIMS:
        return (
            "The share of seeds in which a method finds more road users than camera and LiDAR "
            "alone do, in clear air; and in which Li 2021's finds more with Dempster's rule than "
            f"with the camera's masses alone, at half a false alarm a scan. {told}"
        )
    return (
        f"{told} Every method is shown from the score on at which it has half a false "
        "alarm a scan, in each condition. 'icp-boxes' stands for the paper's reference 6."
    )


def unit_of(quantity: str, experiment: str) -> str:
    """Return the unit in which a quantity of an experiment is given."""
    if split(experiment)[0] in (MORE_BOTH, MORE_ONE):
        return POINTS
    if quantity in (MORE, MORE_AT_EQUAL, EVIDENCE):
        return YES_OR_NO
    return "1/scan" if quantity == FALSE else "%"


def measure(seed: int) -> dict[Key, float]:
    """Measure every quantity of every condition and method with one seed, with both cameras."""
    found: dict[Key, float] = {}
    for name, detector in ((IMAGES, CAMERA_DETECTORS.make("network")), (IMITATED, None)):
        told = measure_with(detector, seed)
        found |= {(titled(key[0], name), key[1], key[2]): value for key, value in told.items()}
    return found


def titled(experiment: str, camera: str) -> str:
    """Name an experiment with a camera."""
    return f"{experiment}, {camera}" if camera else experiment


def split(experiment: str) -> tuple[str, str]:
    """Return what `titled` joined: an experiment and its camera."""
    plain = experiment.removesuffix(f", {IMITATED}")
    return plain, IMAGES if plain == experiment else IMITATED


def measure_with(detector: Detector | None, seed: int) -> dict[Key, float]:
    """Measure with a detector that looks at images, or with the imitation of one."""
    moments = {
        name: [
            moment
            for scenario in SCENARIOS
            for moment in film(
                Episode(scenario, seed, RIG, DURATION_S, faults=faults), every=EVERY,
                detector=detector,
            )
        ]
        for name, faults in SENSED.items()
    }  # fmt: skip
    found: dict[Key, float] = {}
    shares: dict[tuple[str, str], FusionRates] = {}
    for condition in CONDITIONS:
        taken = moments.get(condition, moments["clear"])
        targets = [crowded(m.targets) if condition == "crowds" else m.targets for m in taken]
        lidar = detected(taken)
        for method in METHODS:
            fused = outcomes(method, taken, lidar, condition)
            if fused is None:
                continue
            matched = match_targets(fused, targets)
            result = fusion_rates(matched, threshold_at(matched, EQUAL_FALSE))
            if condition == "clear":
                free = fusion_rates(matched)
                shares[EVERY_SCORE, method] = free
                found |= {(EVERY_SCORE, method, name): v for name, v in quantities(free).items()}
            shares[condition, method] = result
            if condition in WITH_BOTH:
                found[HIDDEN, method, condition] = 100 * result.hidden_distance_right
                found[CLASS, method, condition] = 100 * result.family_right
            if method in FUSED:
                more = result.detection_rate - better_alone(shares, condition)
                place = MORE_BOTH if condition in WITH_BOTH else MORE_ONE
                found[place, method, condition] = 100 * more
            found |= {(condition, method, name): v for name, v in quantities(result).items()}
    for claim, shown in ((MORE, EVERY_SCORE), (MORE_AT_EQUAL, "clear")):
        alone = better_alone(shares, shown)
        for method in FUSED:
            found[CLAIMS, method, claim] = float(shares[shown, method].detection_rate > alone)
    for method, other in (("li2021", WITHOUT), (BELIEF, BELIEF_WITHOUT)):
        with_it, without = (shares["clear", each].detection_rate for each in (method, other))
        found[CLAIMS, method, EVIDENCE] = float(with_it > without)
    return found


def better_alone(shares: Mapping[tuple[str, str], FusionRates], condition: str) -> float:
    """Return what the better sensor finds alone, of those that work."""
    alone = (shares.get((condition, one)) for one in (LIDAR, CAMERA))
    return max(found.detection_rate for found in alone if found is not None)


def detected(moments: Sequence[Moment]) -> list[Detections]:
    """Detect clusters in all scans."""
    detector = ClusterBoxes()
    return [detector.detect(moment.scan) for moment in moments]


def outcomes(
    method: str, moments: Sequence[Moment], lidar: Sequence[Detections], condition: str
) -> list[FusedDetections] | None:
    """Fuse, with a sensor failing or for a sensor alone; None where that leaves nothing to do."""
    no_lidar = method == CAMERA or condition == "LiDAR fails"
    no_camera = method == LIDAR or condition == "camera fails"
    if no_lidar and no_camera:
        return None
    fusion = FUSIONS.make(SPECS.get(method, method))
    return [
        fusion.fuse(
            None if no_lidar else points, None if no_camera else moment.camera, moment.projection
        )
        for moment, points in zip(moments, lidar, strict=True)
    ]


def crowded(targets: FusionTargets) -> FusionTargets:
    """Ask for people in crowds only."""
    return replace(targets, eligible=targets.eligible & in_crowd(targets))


def quantities(result: FusionRates) -> dict[str, float]:
    """Name the figures; per cent but for false alarms."""
    shares = dict(
        zip((VEHICLES, CYCLISTS, PEDESTRIANS), result.family_detection_rates, strict=True)
    )
    shares[DISTANCE] = result.distance_right
    return {name: 100 * share for name, share in shares.items()} | {
        FALSE: result.false_alarms_per_scan
    }  # fmt: skip
