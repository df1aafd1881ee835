"""The experiments of Li 2021 with the paper's figures beside ours.

Table 1 combines evidence of two sensors (section 5.2). Table 2 counts the road users that the
fusion detects; here with fog, night, crowds and failing sensors beside it.

The LiDAR's detections are made from scans. The camera's are made by the shipped network from
rendered images, and once more imitated from the truth (`noisy-camera`). The paper counts all
detections and gives no false alarms; so do the tables 'every score'. Beside them, for every method,
seed and condition the score threshold is chosen that gives half a false alarm per scan, so that
rates can be compared.

Boxes are projected as the rig is truly mounted, and moved from the scan to the image by the ego's
own motion, which the paper leaves out. How well the paper's triangular target calibrates is
measured on its own; `roadscope leaderboard fusion --calibration` shows what an error of it costs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.calibrating import calibrate_rig
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.metrics.fusion import (
    HIDDEN_BANDS,
    FusionRates,
    FusionTargets,
    MatchedTargets,
    fusion_rates,
    in_crowd,
    match_targets,
    rates_by_hidden,
    threshold_at,
)
from roadscope.benchmarks.papers.li2021_pairs import SensorPair, sense_pairs
from roadscope.benchmarks.papers.reproduction import (
    LESS_THAN_NONE,
    MORE_THAN_NONE,
    NOT_CLAIMED,
    POINTS,
    YES_OR_NO,
    ClaimRange,
    FigureKey,
    Figures,
    Measured,
    Paper,
    ReproductionRow,
    Verdict,
    differences,
    judge,
    judge_share,
    summarise,
)
from roadscope.core import Detections
from roadscope.core.fused import FusedDetections
from roadscope.detectors import Detector
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import FUSIONS
from roadscope.fusion.cluster_boxes import ClusterBoxes
from roadscope.fusion.evidence import FAMILIES, UNDECIDED, combine, decide

SCENARIOS, RIG, DURATION_S, EVERY = ("street", "town-crossing"), "li2021", 10.0, 8
"""Every eighth scan of 10 s in either scenario."""

# --------------------------------------------------------------------------------------------------
# Table 1: Dempster's rule (eq. 5 and 6).

TABLE_1 = "table 1"
COLUMNS = ("pedestrian", "car", "uncertain")
SOURCES = ("LiDAR", "camera", "fused")
PEDESTRIAN, CAR = 0, 1
"""Columns; `UNDECIDED` is the third outcome of a decision."""


class EvidenceExample(NamedTuple):
    """One target of table 1. Masses have the columns `COLUMNS`.

    decisions: by LiDAR, camera and both.
    """

    lidar: tuple[float, float, float]
    camera: tuple[float, float, float]
    fused: tuple[float, float, float]
    decisions: tuple[int, int, int]


EXAMPLES: Mapping[str, EvidenceExample] = MappingProxyType(
    {
        "pedestrian": EvidenceExample(
            (0.612, 0.302, 0.086),
            (0.865, 0.122, 0.013),
            (0.920, 0.077, 0.002),
            (UNDECIDED, PEDESTRIAN, PEDESTRIAN),
        ),
        "car": EvidenceExample(
            (0.253, 0.700, 0.047),
            (0.171, 0.812, 0.017),
            (0.082, 0.917, 0.002),
            (UNDECIDED, UNDECIDED, CAR),
        ),
    }
)
"""By what the target is. The paper prints 0.693 for the car's 0.700, and the row does not sum to
1."""


def table_1() -> list[ReproductionRow]:
    """Return the fused masses, and whether each decision is as printed."""
    rows = []
    for target, example in EXAMPLES.items():
        fused = combine(np.array(example.lidar), np.array(example.camera))
        for column, paper, ours in zip(COLUMNS, example.fused, fused, strict=True):
            key = FigureKey(TABLE_1, f"{target}, fused", column)
            rows.append(ReproductionRow(*key, "share", paper, float(ours), None, None, 1))
        masses_of = (example.lidar, example.camera, fused)
        for source, masses, printed in zip(SOURCES, masses_of, example.decisions, strict=True):
            agrees = float(int(decide(np.array(masses))) == printed)
            key = FigureKey(TABLE_1, f"{target}, {source}", "decided as printed")
            rows.append(ReproductionRow(*key, YES_OR_NO, 1.0, agrees, None, None, 1))
    return rows


# --------------------------------------------------------------------------------------------------
# Names of methods, conditions and quantities.

LIDAR, CAMERA = "LiDAR alone", "camera alone"
WITHOUT_EVIDENCE = "li2021-without-evidence"
"""Takes the camera's masses wherever it has a box: the difference is the effect of Dempster's
rule."""
BY_BELIEF, BY_BELIEF_WITHOUT = "li2021-by-belief", "li2021-by-belief-without"
"""The same two with targets ranked by the belief that they are any of the classes."""
SPECS = {
    LIDAR: "union",
    CAMERA: "union",
    BY_BELIEF: "li2021?rank=any",
    BY_BELIEF_WITHOUT: f"{WITHOUT_EVIDENCE}?rank=any",
}
"""Specs of methods that are not named by their own spec."""
FUSED = (
    "li2021",
    WITHOUT_EVIDENCE,
    BY_BELIEF,
    BY_BELIEF_WITHOUT,
    "icp-boxes",
    "weighted-boxes",
    "bayes",
    "consistent",
)
METHODS = (LIDAR, CAMERA, *FUSED)

FAULTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"clear": (), "fog": ("fog:3",), "night": ("night:3",)}
)
"""Faults of the sensors, by condition."""
WITH_BOTH = ("clear", "fog", "night", "crowds")
"""Conditions in which both sensors work."""
LIDAR_FAILS, CAMERA_FAILS = "LiDAR fails", "camera fails"
CONDITIONS = (*WITH_BOTH, LIDAR_FAILS, CAMERA_FAILS)
EQUAL_FALSE_ALARMS = 0.5
"""False alarms a scan at which all methods are compared."""
ALL_COUNT = "{}, every score"
"""Name of a condition or an experiment without thresholds, as in the paper, which gives no false
alarms."""
EVERY_SCORE = ALL_COUNT.format("clear")

VEHICLES, CYCLISTS, PEDESTRIANS = (f"{family.value}s found" for family in FAMILIES)
FALSE = "false"
DISTANCE = "distance right"
TARGETS = "targets, all seeds"
"""Stands as a method before those that have to find them."""
HIDDEN = "distance right of those more than a third hidden"
BY_HIDDEN = "{}s found by how far they are hidden, clear, every score"
CALIBRATION = "calibration with the triangular target"
REPROJECTION, HELD_OUT = "points used", "points 8 to 30 m away"
CLASS = "class right of those found"
MORE_BOTH = "found more than by the better sensor alone"
MORE_ONE = "found more than by the sensor that is left"
"""Experiments with a column for each condition; the last two are of differences on a seed."""
OF_DIFFERENCES = tuple(
    name for each in (MORE_BOTH, MORE_ONE) for name in (each, ALL_COUNT.format(each))
)
CLAIMS, MORE = "claims", "finds more than either sensor alone"
MORE_AT_EQUAL = "finds more at half a false alarm a scan"
EVIDENCE = "finds more with evidence"

IMAGES, IMITATED = "", "camera imitated"
"""The shipped network detects in rendered images, or `noisy-camera` imitates it."""
CAMERA_NOTES = {
    IMAGES: "The camera's detections are the shipped network's, in rendered images.",
    IMITATED: "The camera's detections are an imitation made from truth (noisy-camera).",
}
TABLE_2 = {
    ("li2021", VEHICLES): 94.8,
    ("li2021", PEDESTRIANS): 96.4,
    ("icp-boxes", VEHICLES): 90.3,
    ("icp-boxes", PEDESTRIANS): 85.6,
}
"""On 58 vehicles and 204 pedestrians, so that the 95 % interval of the vehicles' figure is about 86
to 98; false alarms are not given. `icp-boxes` stands for the method of the paper's reference 6."""
PAPER: Mapping[FigureKey, float] = MappingProxyType(
    {
        FigureKey(experiment, *key): rate
        for experiment in ("clear", EVERY_SCORE)
        for key, rate in TABLE_2.items()
    }
    | {FigureKey(CLAIMS, "li2021", MORE): 1.0}
)
"""With either camera."""


def with_camera(experiment: str, camera: str) -> str:
    """Return the name of an experiment with a camera."""
    return f"{experiment}, {camera}" if camera else experiment


def without_camera(experiment: str) -> tuple[str, str]:
    """Return what `with_camera` joined: an experiment and its camera."""
    plain = experiment.removesuffix(f", {IMITATED}")
    return plain, IMAGES if plain == experiment else IMITATED


def unit_of(key: FigureKey) -> str:
    """Return the unit of a figure."""
    if key.method == TARGETS:
        return "count"
    if key.experiment == CALIBRATION:
        return "px"
    if without_camera(key.experiment)[0] in OF_DIFFERENCES:
        return POINTS
    if key.quantity in (MORE, MORE_AT_EQUAL, EVIDENCE):
        return YES_OR_NO
    return "1/scan" if key.quantity == FALSE else "%"


def paper_figure(key: FigureKey) -> float | None:
    """Return what the paper prints for a quantity, None where it prints nothing."""
    return PAPER.get(key._replace(experiment=without_camera(key.experiment)[0]))


def note_of(experiment: str) -> str | None:
    """Return what must be known to read the tables of an experiment."""
    if experiment == TABLE_1:
        return "The printed LiDAR row of the car sums to 0.993; 0.693 is read as 0.700."
    plain, camera = without_camera(experiment)
    if plain == CALIBRATION:
        return (
            "The corners of a triangle in both sensors, in a number of poses, give the matrix of "
            "eq. 4. Errors in the image: of the corners used, and of points elsewhere. "
            "'corners alone' is the paper's method; 'refined' also estimates the poses of the "
            "targets. The paper prints no error. The rates below use the true mounting."
        )
    note = CAMERA_NOTES[camera]
    if "by how far" in plain:
        return (
            "Hidden: the share of a target's outline in the image that something else covers; "
            f"not hidden: at most 5 %. The paper's pictures show few hidden targets. {note}"
        )
    if plain == EVERY_SCORE:
        return (
            "All detections count, whatever their score. The LiDAR's distances are right by "
            f"construction: a box that is matched in space is within 2 m. {note}"
        )
    if plain in OF_DIFFERENCES and plain not in (MORE_BOTH, MORE_ONE):
        return f"All detections count, whatever their score. {note}"
    if plain == "clear":
        note = f"{note} By belief: ranked by the belief that a target is any of the classes."
    if plain == CLAIMS:
        return (
            "The share of seeds in which a method finds more road users than camera and LiDAR "
            "alone do, in clear air; and in which Li 2021's finds more with Dempster's rule than "
            f"with the camera's masses alone, at half a false alarm a scan. {note}"
        )
    return (
        f"{note} Every method is shown at the score threshold that gives half a false alarm "
        "per scan, in each condition. 'icp-boxes' stands for the paper's reference 6."
    )


# --------------------------------------------------------------------------------------------------
# Table 2.


def rows(measured: Measured) -> list[ReproductionRow]:
    """Return the paper's figures beside ours; numbers of targets are sums over all seeds."""
    of_seeds = []
    for key, values in measured.items():
        if key.method == TARGETS:
            n = int(np.isfinite(values).sum())
            total = float(np.nansum(values)) if n else None
            of_seeds.append(ReproductionRow(*key, unit_of(key), None, total, None, None, n))
        else:
            of_seeds.append(summarise(key, unit_of(key), values, paper_figure(key)))
    return [*table_1(), *of_seeds]


CAMERAS = (IMAGES, IMITATED)
CONDITIONS_OF_FAULTS: Mapping[str, Sequence[str]] = {
    "clear": ("clear", "crowds", LIDAR_FAILS, CAMERA_FAILS),
    "fog": ("fog",),
    "night": ("night",),
}
"""Conditions that share the frames sensed with one set of faults."""


def measure(camera: str, faults: str, seed: int) -> Figures:
    """Return the figures of all methods in the conditions that share a set of faults."""
    detector = CAMERA_DETECTORS.make("network") if camera == IMAGES else None
    pairs = sense_scenarios(seed, FAULTS[faults], detector)
    lidar = detect_clusters(pairs)
    figures: Figures = {}
    of_methods: dict[tuple[str, str], FusionRates] = {}
    for condition in CONDITIONS_OF_FAULTS[faults]:
        targets = [
            crowds_only(pair.targets) if condition == "crowds" else pair.targets for pair in pairs
        ]
        for method in METHODS:
            fused = fuse(method, pairs, lidar, condition)
            if fused is None:
                continue
            matched = match_targets(fused, targets)
            of_methods[ALL_COUNT.format(condition), method] = fusion_rates(matched)
            figures |= more_than_alone(condition, method, of_methods, ALL_COUNT)
            if condition == "clear":
                figures |= table_2_figures(EVERY_SCORE, method, of_methods)
                figures |= figures_by_hidden(method, matched)
            of_methods[condition, method] = fusion_rates(
                matched, threshold_at(matched, EQUAL_FALSE_ALARMS)
            )
            figures |= figures_by_condition(condition, method, of_methods)
            figures |= table_2_figures(condition, method, of_methods)
    if faults == "clear":
        figures |= claims(of_methods)
    return {
        key._replace(experiment=with_camera(key.experiment, camera)): value
        for key, value in figures.items()
    }


POSES = (4, 6, 20)
"""Numbers of poses of the calibration target that are compared."""


def measure_calibration(seed: int) -> Figures:
    """Return the errors of calibrations from each number of poses of the triangular target."""
    figures: Figures = {}
    for name, corners_only in (("corners alone", True), ("refined", False)):
        calibration = calibrate_rig(RIG, poses=30, seed=seed, corners_only=corners_only)
        for row in calibration.rows:
            if row.poses in POSES:
                method = f"{name}, {row.poses} poses"
                figures[FigureKey(CALIBRATION, method, REPROJECTION)] = row.reprojection_px
                figures[FigureKey(CALIBRATION, method, HELD_OUT)] = row.held_out_px
    return figures


def sense_scenarios(
    seed: int, faults: tuple[str, ...], detector: Detector | None
) -> list[SensorPair]:
    """Return the scans of all scenarios with the images nearest in time."""
    return [
        pair
        for scenario in SCENARIOS
        for pair in sense_pairs(
            Episode(scenario, seed, RIG, DURATION_S, faults=faults), every=EVERY, detector=detector
        )
    ]


def detect_clusters(pairs: Sequence[SensorPair]) -> list[Detections]:
    """Return the LiDAR's detections of all scans."""
    detector = ClusterBoxes()
    return [detector.detect(pair.scan) for pair in pairs]


def fuse(
    method: str, pairs: Sequence[SensorPair], lidar: Sequence[Detections], condition: str
) -> list[FusedDetections] | None:
    """Return the fused detections of all pairs; None where neither sensor is left.

    A sensor is left out where it fails, or where the method is the other sensor alone.
    """
    no_lidar = method == CAMERA or condition == LIDAR_FAILS
    no_camera = method == LIDAR or condition == CAMERA_FAILS
    if no_lidar and no_camera:
        return None
    fusion = FUSIONS.make(SPECS.get(method, method))
    return [
        fusion.fuse(
            None if no_lidar else clusters, None if no_camera else pair.camera, pair.projection
        )
        for pair, clusters in zip(pairs, lidar, strict=True)
    ]


def crowds_only(targets: FusionTargets) -> FusionTargets:
    """Return targets of which people in crowds alone are eligible."""
    return replace(targets, eligible=targets.eligible & in_crowd(targets))


def table_2_figures(
    condition: str, method: str, of_methods: Mapping[tuple[str, str], FusionRates]
) -> dict[FigureKey, float]:
    """Return the figures of table 2 and the distances, by family; and the numbers of targets."""
    result = of_methods[condition, method]
    quantities = named_quantities(result)
    if method == CAMERA:
        quantities[DISTANCE] = np.nan
    figures = {FigureKey(condition, method, name): value for name, value in quantities.items()}
    counts = dict.fromkeys(quantities, np.nan) | dict(
        zip((VEHICLES, CYCLISTS, PEDESTRIANS), map(float, result.target_counts), strict=True)
    )
    return {FigureKey(condition, TARGETS, name): n for name, n in counts.items()} | figures


def figures_by_hidden(method: str, matched: MatchedTargets) -> Figures:
    """Return the rates of each family by how far targets are hidden."""
    figures: Figures = {}
    for band, (rates, counts) in rates_by_hidden(matched).items():
        for family, rate, count in zip(FAMILIES, rates, counts, strict=True):
            experiment = BY_HIDDEN.format(family.value)
            figures[FigureKey(experiment, TARGETS, band)] = float(count)
            figures[FigureKey(experiment, method, band)] = 100 * rate
    return figures


def named_quantities(result: FusionRates) -> dict[str, float]:
    """Return the figures by name, per cent but for false alarms."""
    shares = dict(
        zip((VEHICLES, CYCLISTS, PEDESTRIANS), result.family_detection_rates, strict=True)
    )
    shares[DISTANCE] = result.distance_right
    percent = {name: 100 * share for name, share in shares.items()}
    return percent | {FALSE: result.false_alarms_per_scan}


def figures_by_condition(
    condition: str, method: str, of_methods: Mapping[tuple[str, str], FusionRates]
) -> dict[FigureKey, float]:
    """Return the figures of tables that have a column for each condition."""
    figures, result = {}, of_methods[condition, method]
    if condition in WITH_BOTH:
        right = np.nan if method == CAMERA else 100 * result.hidden_distance_right
        figures[FigureKey(HIDDEN, method, condition)] = right
        figures[FigureKey(CLASS, method, condition)] = 100 * result.family_right
    return figures | more_than_alone(condition, method, of_methods)


def more_than_alone(
    condition: str,
    method: str,
    of_methods: Mapping[tuple[str, str], FusionRates],
    title: str = "{}",
) -> Figures:
    """Return how much more a fusion finds than the better sensor alone, in percentage points.

    title: of the condition in `of_methods` and of the table, with a place for their names.
    """
    if method not in FUSED:
        return {}
    experiment, named = MORE_BOTH if condition in WITH_BOTH else MORE_ONE, title.format(condition)
    more = of_methods[named, method].detection_rate - better_sensor_alone(of_methods, named)
    return {FigureKey(title.format(experiment), method, condition): 100 * more}


def claims(of_methods: Mapping[tuple[str, str], FusionRates]) -> dict[FigureKey, float]:
    """Return whether each method detects more than a sensor alone (1) or not (0), in clear air."""
    holds: dict[FigureKey, bool] = {}
    for claim, condition in ((MORE, EVERY_SCORE), (MORE_AT_EQUAL, "clear")):
        alone = better_sensor_alone(of_methods, condition)
        for method in FUSED:
            more = of_methods[condition, method].detection_rate > alone
            holds[FigureKey(CLAIMS, method, claim)] = more
    for method, other in (("li2021", WITHOUT_EVIDENCE), (BY_BELIEF, BY_BELIEF_WITHOUT)):
        with_evidence, without = (
            of_methods["clear", each].detection_rate for each in (method, other)
        )
        holds[FigureKey(CLAIMS, method, EVIDENCE)] = with_evidence > without
    return {key: float(value) for key, value in holds.items()}


def better_sensor_alone(of_methods: Mapping[tuple[str, str], FusionRates], condition: str) -> float:
    """Return the share that the better sensor detects alone, of the sensors that work."""
    alone = (of_methods.get((condition, sensor)) for sensor in (LIDAR, CAMERA))
    return max(result.detection_rate for result in alone if result is not None)


# --------------------------------------------------------------------------------------------------
# Verdicts.


RIVALS = {
    "icp-boxes": "the method of reference 6",
    LIDAR: "the LiDAR alone",
    CAMERA: "the camera alone",
}
"""What the paper's fusion is compared with."""


def verdicts(measured: Measured) -> list[Verdict]:
    """Judge what the paper claims of its fusion, with the network's camera and the imitated one."""
    of_cameras = (verdict for camera in CAMERAS for verdict in _verdicts_with(camera, measured))
    return [*_verdicts_on_table_1(), *of_cameras]


MASS_TOLERANCE = 0.002
"""Greatest difference of fused masses from the printed ones, which have three decimals."""


def _verdicts_on_table_1() -> list[Verdict]:
    """Judge eq. 5 and 6 by the two targets of table 1: masses, decisions, and uncertainty."""
    fused = {
        target: combine(np.array(example.lidar), np.array(example.camera))
        for target, example in EXAMPLES.items()
    }
    off = max(np.abs(fused[target] - example.fused).max() for target, example in EXAMPLES.items())
    as_printed = [float(row.ours or 0) for row in table_1() if row.unit == YES_OR_NO]
    uncertain = max(
        fused[target][-1] - min(example.lidar[-1], example.camera[-1])
        for target, example in EXAMPLES.items()
    )
    decided, method = float(np.sum(as_printed)), "eq. 5 and 6"
    whole = ClaimRange(low=len(as_printed))
    return [
        judge(
            "table 1: fused masses as printed",
            method,
            "off",
            [off],
            ClaimRange(high=MASS_TOLERANCE),
        ),
        judge("table 1: decisions as printed", method, f"of {len(as_printed)}", [decided], whole),
        judge(
            "table 1: fused less uncertain than either sensor",
            method,
            "more",
            [uncertain],
            LESS_THAN_NONE,
        ),
    ]


def _verdicts_with(camera: str, measured: Measured) -> list[Verdict]:
    judged, method = [], f"li2021, {camera or 'network'}"
    for quantity in (VEHICLES, PEDESTRIANS):
        family, printed = quantity.removesuffix(" found"), TABLE_2["li2021", quantity]
        own = FigureKey(with_camera(EVERY_SCORE, camera), "li2021", quantity)
        by_hidden = with_camera(BY_HIDDEN.format(family[:-1]), camera)
        unhidden = FigureKey(by_hidden, "li2021", next(iter(HIDDEN_BANDS)))
        for claim, key in (("", own), (" if not hidden", unhidden)):
            text = f"{family}: {printed} % found{claim}"
            judged.append(judge(text, method, "%", measured[key], ClaimRange(low=printed)))
        for rival, name in RIVALS.items():
            gains = differences(measured, own, own._replace(method=rival))
            text = f"{family}: more found than by {name}"
            judged.append(judge(text, method, POINTS, gains, MORE_THAN_NONE))
    for title, stricter in ((ALL_COUNT, ""), ("{}", ", at half a false alarm a scan")):
        for experiment, condition, text in (
            (MORE_BOTH, "crowds", "people in a crowd: more found than by the better sensor alone"),
            (MORE_ONE, LIDAR_FAILS, "the LiDAR fails: no fewer found than by the camera"),
            (MORE_ONE, CAMERA_FAILS, "the camera fails: no fewer found than by the LiDAR"),
        ):
            key = FigureKey(with_camera(title.format(experiment), camera), "li2021", condition)
            limits = MORE_THAN_NONE if experiment == MORE_BOTH else ClaimRange(low=0.0)
            judged.append(judge(f"{text}{stricter}", method, POINTS, measured[key], limits))
    key = FigureKey(with_camera(CLAIMS, camera), "li2021", EVIDENCE)
    text = f"{NOT_CLAIMED}Dempster's rule finds more, at half a false alarm a scan"
    judged.append(judge_share(text, method, measured[key]))
    return judged


REPRODUCTION = Paper(
    parts={
        **{
            f"{camera or 'network'}, {faults}": partial(measure, camera, faults)
            for camera in CAMERAS
            for faults in FAULTS
        },
        CALIBRATION: measure_calibration,
    },
    rows=rows,
    verdicts=verdicts,
    note_of=note_of,
)
