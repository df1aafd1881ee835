"""What entries are, and what is wrong with them, before anything runs."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from roadscope.benchmarks.ego import (
    NO_POSES,
    TRUE_POSES,
    odometry_among,
    odometry_told,
    tracker_of,
)
from roadscope.benchmarks.jobs.fused import FusedSpec
from roadscope.benchmarks.jobs.look import drawn_from_truth
from roadscope.benchmarks.jobs.sensor_plan import check_camera_of
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.noisy_odometry import ODOMETRY_NOISES, imitated
from roadscope.benchmarks.oracle import (
    FUSED,
    ORACLE,
    SUITES_ONLY,
    full_name,
    is_fused,
    made_from_truth,
)
from roadscope.benchmarks.oracle_odometry import method_of, spared
from roadscope.benchmarks.suite import Suite, SuiteError
from roadscope.core import Registry, SpecError
from roadscope.core.names import unknown
from roadscope.core.registry import Plugin, split_spec
from roadscope.detectors import DETECTORS
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import FUSIONS
from roadscope.fusion.calibration_file import read_calibration
from roadscope.odometry import ODOMETRIES
from roadscope.trackers import TRACKERS

BOARDS = ("detection", "tracking")
"""Boards of what LiDAR sees, which every suite may have."""
SENSOR_BOARDS = ("camera", "fusion")
"""Boards that need a rig with a camera."""
ODOMETRY = "odometry"
ALL_BOARDS = (*BOARDS, *SENSOR_BOARDS, ODOMETRY)
BOARD_OF: Mapping[str, str] = {
    "detector": "detection",
    "tracker": "tracking",
    "camera detector": "camera",
    "fusion": "fusion",
    "odometry": ODOMETRY,
}
"""By kind of entry."""
METHOD_OF: Mapping[str, str] = {
    "detector": "detect",
    "tracker": "update",
    "camera detector": "detect",
    "fusion": "fuse",
    "odometry": "update",
}
REGISTRIES: Mapping[str, Registry[Any]] = {
    "detector": DETECTORS,
    "tracker": TRACKERS,
    "camera detector": CAMERA_DETECTORS,
    "fusion": FUSIONS,
    "odometry": ODOMETRIES,
}


def kind_of(spec: str, boards: Sequence[str] = BOARDS) -> str:
    """Say which kind of plug-in a spec names.

    boards: a class of one's own with detect() is of the camera where they have no detection
        board, or as `in_images` says; one with update() is an odometry where they have no
        tracking board, or as `by_scans` says.
    """
    if spared(spec) is not None or imitated(spec):
        return "odometry"
    name, _ = split_spec(spec)
    if ":" not in name:
        for kind, registry in REGISTRIES.items():
            if name in registry:
                return kind
        if made_from_truth(spec) or name in (FUSED, *SUITES_ONLY, *CAMERA_NOISES):
            raise SpecError(
                f"'{spec}' is no entry; a suite gives it to trackers: tracking.detectors"
            )
        asked = [kind for kind, board in BOARD_OF.items() if board in boards]
        raise SpecError(
            unknown(" or ".join(asked), name, [n for kind in asked for n in REGISTRIES[kind]])
            + "; or name your own: package.module:Class, path/to/file.py:Class"
        )
    factory: Any = DETECTORS.resolve(spec).factory
    if hasattr(factory, "detect"):
        by_camera = in_images(factory) or ("camera" in boards and "detection" not in boards)
        return "camera detector" if by_camera else "detector"
    if hasattr(factory, "update"):
        alone = ODOMETRY in boards and "tracking" not in boards
        return "odometry" if alone or by_scans(factory) else "tracker"
    if hasattr(factory, "fuse"):
        return "fusion"
    raise SpecError(
        f"'{spec}' has neither detect() as a detector nor update() as a tracker or an odometry, "
        "nor fuse() as a fusion"
    )


def in_images(factory: Any) -> bool:
    """Say whether detect() looks at images.

    Its answer is declared `-> ImageDetections`, or it reads a frame's camera and no LiDAR.
    """
    said = getattr(factory.detect, "__annotations__", {}).get("return", "")
    name = said if isinstance(said, str) else getattr(said, "__name__", "")
    read = getattr(getattr(factory.detect, "__code__", None), "co_names", ())
    return "ImageDetections" in name or ("camera" in read and "lidar" not in read)


def by_scans(factory: Any) -> bool:
    """Say whether update() is an odometry's.

    Its answer is declared `-> OdometryEstimate`, or it takes a scan or inertial samples.
    """
    said = getattr(factory.update, "__annotations__", {}).get("return", "")
    name = said if isinstance(said, str) else getattr(said, "__name__", "")
    code = getattr(factory.update, "__code__", None)
    taken = code.co_varnames[: code.co_argcount] if code is not None else ()
    return "OdometryEstimate" in name or bool({"scan", "imu"} & set(taken))


def check(registry: Registry[Any], spec: str) -> None:
    """Refuse a plug-in that cannot be found, is of another kind or refuses its arguments.

    Ours are made once for it, so that values are refused too; what strangers' do when they are
    made is for the job to find out, where it costs them only their own row, and so is what is not
    installed.
    """
    plugin = registry.resolve(spec)
    needed = METHOD_OF[registry.kind]
    if not hasattr(plugin.factory, needed):
        others = [kind for kind, name in METHOD_OF.items() if hasattr(plugin.factory, name)]
        wrong = f"is a {others[0]}, not" if others else f"has no {needed}(), not"
        raise SpecError(f"'{spec}' {wrong} a {registry.kind}")
    if not hasattr(plugin.factory, "reset"):
        raise SpecError(f"'{spec}' has no reset()")
    try:
        inspect.signature(plugin.factory).bind(**plugin.arguments)
    except TypeError:
        plugin.make()
    if plugin.ours and not plugin.missing:
        _make(plugin)


def check_tracker(spec: str) -> None:
    """Refuse a tracker that cannot be made, or that is to be told the poses of no odometry."""
    check(TRACKERS, tracker_of(spec))
    if (odometry := odometry_told(spec)) is not None:
        check_told(odometry)


def check_told(odometry: str) -> None:
    """Refuse what tells no poses of the ego."""
    try:
        check_odometry(odometry)
    except SpecError as error:
        raise SpecError(f"ego={odometry}: {error}; or '{TRUE_POSES}', '{NO_POSES}'") from error


def check_entry(kind: str, spec: str) -> None:
    """Refuse an entry of a kind that cannot be found or refuses its arguments."""
    if kind == "tracker":
        check_tracker(spec)
    elif kind == "odometry":
        check_odometry(spec)
    else:
        check(REGISTRIES[kind], spec)


def check_odometry(spec: str) -> None:
    """Refuse what tells no poses; oracles of odometries and noise models do, beside these."""
    if imitated(spec):
        _make(ODOMETRY_NOISES.resolve(spec))
    elif imitated(method_of(spec)):
        raise SpecError(f"'{spec}': an imitation looks at no scan that could be spared anything")
    else:
        check(ODOMETRIES, method_of(spec))


def check_detector(spec: str) -> None:
    """Refuse what makes no detections; the oracle and noise models do, beside detectors."""
    if is_fused(spec):
        _check_fused(FusedSpec.parse(spec))
    elif not made_from_truth(spec):
        check(DETECTORS, full_name(spec))
    elif spec != ORACLE:
        _make(NOISES.resolve(spec))


def check_camera(spec: str) -> None:
    """Refuse what finds nothing in images; the oracle and imitations do, beside detectors."""
    if not drawn_from_truth(spec):
        check(CAMERA_DETECTORS, spec)
    elif spec != ORACLE:
        _make(CAMERA_NOISES.resolve(spec))


def _check_fused(spec: FusedSpec) -> None:
    if is_fused(spec.lidar):
        raise SpecError(f"lidar={spec.lidar}: name a LiDAR detector, not another fusion")
    check_detector(spec.lidar)
    check_camera(spec.camera)
    check(FUSIONS, spec.fusion)
    if spec.calibration:
        read_calibration(spec.calibration)


def _make(plugin: Plugin[Any]) -> None:
    """Make a plug-in of ours once, and read the weights that are named."""
    try:
        made = plugin.make()
        if "weights" in plugin.arguments and hasattr(made, "prepare"):
            made.prepare()
    except (TypeError, ValueError) as error:
        raise SpecError(f"'{plugin.spec}': {error}") from error


def check_suite(suite: Suite) -> None:
    """Check the entries of the suite with the key that names them."""
    for key, registry, specs in (
        ("detection.entries", DETECTORS, suite.detectors),
        ("fusion.entries", FUSIONS, suite.fusions),
    ):
        for spec in specs:
            of_suite(suite, key, check, registry, spec)
    for spec in suite.trackers:
        of_suite(suite, "tracking.entries", check_tracker, spec)
    for spec in suite.odometries:
        of_suite(suite, "odometry.entries", check_odometry, spec)
    for odometry in filter(None, map(odometry_among, suite.egos)):
        of_suite(suite, "tracking.ego", check_told, odometry)
    for key, specs in (
        ("tracking.detectors", suite.public_detectors),
        ("fusion.lidar", suite.fused_lidar),
    ):
        for spec in specs:
            of_suite(suite, key, check_detector, spec)
            if is_fused(spec):
                of_suite(suite, key, check_camera_of, suite)
    for key, specs in (
        ("camera.entries", suite.camera_detectors),
        ("fusion.camera", suite.fused_camera),
    ):
        for spec in specs:
            of_suite(suite, key, check_camera, spec)


def of_suite(suite: Suite, key: str | None, work: Callable[..., object], *arguments: Any) -> None:
    """Name the suite, and the key in it, in what is wrong with it."""
    try:
        work(*arguments)
    except ValueError as error:
        place = f"suite {suite.title}" + (f", {key}" if key else "")
        raise SuiteError(f"{place}: {error}") from error


def refuse_unused(entries: Sequence[str], kinds: Sequence[str], boards: Sequence[str]) -> None:
    """Refuse entries whose board is not asked for."""
    for spec, kind in zip(entries, kinds, strict=True):
        board = BOARD_OF[kind]
        if board not in boards:
            raise SpecError(f"'{spec}' is a {kind}; it belongs on the {board} board")
