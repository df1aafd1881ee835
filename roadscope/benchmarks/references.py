"""Entries that are no plug-ins: made from the truth, or composed of other entries.

They belong to the benchmark and never run in the process of a plug-in:

- `oracle`: the true boxes; `oracle?odometry=A`: the odometry A, whose scans lack the returns of
  moving objects.
- noise models, `noisy?miss=0.2`, `noisy-camera`, `noisy-odometry`: truth with errors of known size.
- `fused?lidar=A&camera=B&fusion=C`: the fused detections of a LiDAR and a camera detector.

On boards some of them are marks: shown beside the entries, without a rank.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from roadscope.benchmarks.kinds import (
    CAMERA_DETECTOR,
    DETECTOR,
    FUSION,
    ODOMETRY,
    Kind,
    check_plugin_spec,
    make_once,
    traits_of,
)
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.noisy_odometry import ODOMETRY_NOISES
from roadscope.core import Spec, SpecError
from roadscope.core.spec import FUSED, FUSED_PARTS, NO_POSES, ORACLE, TRUE_POSES
from roadscope.fusion.calibration import read_calibration

UPPER_MARK, LOWER_MARK = "upper mark", "lower mark"
IMITATION = "imitation"
"""The mark of noise models."""
ONE_SENSOR = "alone"
"""The mark of the detections of one sensor without the other."""
LIDAR_ALONE, CAMERA_ALONE = "LiDAR alone", "camera alone"
CALIBRATION = "calibration"
"""Argument of `fused`: a file of `roadscope calibrate`, whose calibration the fusion gets."""

ONE_CLUSTER = "one-cluster"
"""The lower mark of the detection board: all returns above ground are one cluster and one box."""
LOWER_ODOMETRIES = ("still", "dead-reckoning")
"""The lower marks of the odometry board: odometries that use no scan."""
FUSED_DEFAULTS: Mapping[str, str] = {
    "lidar": "cluster-boxes",
    "camera": "network",
    "fusion": "consistent",
}
_NOISE_KINDS = (NOISES.kind, CAMERA_NOISES.kind, ODOMETRY_NOISES.kind)


def made_from_truth(spec: Spec) -> bool:
    """Return whether a resolved spec is an oracle or a noise model."""
    return spec.kind == ORACLE or spec.kind in _NOISE_KINDS


def is_noise(spec: Spec) -> bool:
    """Return whether a resolved spec is a noise model."""
    return spec.kind in _NOISE_KINDS


def detection_source(text: str | Spec) -> Spec:
    """Return the resolved spec of a source of detections in space, not only a plug-in."""
    spec = Spec.parse(text) if isinstance(text, str) else text
    if spec.name == ORACLE and not spec.parts:
        return replace(spec, kind=ORACLE)
    _refuse_parts_of_oracle(spec)
    if spec.name == FUSED:
        return _fused(spec)
    if spec.name in NOISES:
        return NOISES.resolve(spec)
    return DETECTOR.registry.resolve(spec, also_possible=(ORACLE, FUSED, *NOISES))


def image_source(text: str | Spec) -> Spec:
    """Return the resolved spec of a source of detections in images, not only a plug-in."""
    spec = Spec.parse(text) if isinstance(text, str) else text
    if spec.name == ORACLE and not spec.parts:
        return replace(spec, kind=ORACLE)
    _refuse_parts_of_oracle(spec)
    if spec.name in CAMERA_NOISES:
        return CAMERA_NOISES.resolve(spec)
    return CAMERA_DETECTOR.registry.resolve(spec, also_possible=(ORACLE, *CAMERA_NOISES))


def pose_source(text: str | Spec) -> Spec:
    """Return the resolved spec of a source of poses, not only a plug-in.

    That of an oracle has the class of its odometry, and kind `oracle`.
    """
    spec = Spec.parse(text) if isinstance(text, str) else text
    if spec.name == ORACLE and ODOMETRY.name in spec.parts:
        odometry = spec.parts[ODOMETRY.name]
        if odometry.name in ODOMETRY_NOISES:
            raise SpecError(f"'{spec}': a noise model uses no scan that could lack returns")
        inner = ODOMETRY.registry.resolve(odometry)
        return replace(spec, parts={ODOMETRY.name: inner}, kind=ORACLE, target=inner.target)
    if spec.name == ORACLE:
        raise SpecError(f"'{spec}': name its odometry too: {ORACLE}?{ODOMETRY.name}=NAME")
    if spec.name in ODOMETRY_NOISES:
        return ODOMETRY_NOISES.resolve(spec)
    return ODOMETRY.registry.resolve(spec, also_possible=ODOMETRY_NOISES)


def missing_for_poses(source: Spec) -> str:
    """Return what a `pose_source` needs and is not installed; empty if nothing."""
    return "" if is_noise(source) else traits_of(source.parts.get(ODOMETRY.name, source)).requires


def _refuse_parts_of_oracle(spec: Spec) -> None:
    """Raise `SpecError` for an oracle with parts: only that of poses has one."""
    if spec.name == ORACLE and spec.parts:
        raise SpecError(f"'{spec}': {ORACLE} has no parts here")


def check_detection_source(text: str | Spec) -> Spec:
    """Return `detection_source`; raise `SpecError` if it cannot be made."""
    spec = detection_source(text)
    if spec.kind == FUSED:
        if spec.parts["lidar"].kind == FUSED:
            raise SpecError(f"lidar={spec.parts['lidar']}: name a LiDAR detector, not a fusion")
        check_detection_source(spec.parts["lidar"])
        check_image_source(spec.parts["camera"])
        check_plugin_spec(spec.parts["fusion"], FUSION)
        if path := spec.arguments.get(CALIBRATION):
            read_calibration(str(path))
        return spec
    return _checked(spec, DETECTOR)


def check_image_source(text: str | Spec) -> Spec:
    """Return `image_source`; raise `SpecError` if it cannot be made."""
    return _checked(image_source(text), CAMERA_DETECTOR)


def check_pose_source(text: str | Spec) -> Spec:
    """Return `pose_source`; raise `SpecError` if it cannot be made."""
    spec = pose_source(text)
    if spec.kind == ORACLE:
        check_plugin_spec(spec.parts[ODOMETRY.name], ODOMETRY)
        return spec
    return _checked(spec, ODOMETRY)


def check_ego(text: str | Spec) -> None:
    """Raise `SpecError` unless `ego=` names a source of poses, `truth` or `none`."""
    if str(text) in (TRUE_POSES, NO_POSES):
        return
    try:
        check_pose_source(text)
    except SpecError as error:
        raise SpecError(f"ego={text}: {error}; or '{TRUE_POSES}', '{NO_POSES}'") from error


def _checked(spec: Spec, kind: Kind) -> Spec:
    if spec.kind == ORACLE:
        return spec
    if is_noise(spec):
        make_once(spec)
        return spec
    return check_plugin_spec(spec, kind)


def _fused(spec: Spec) -> Spec:
    """Resolve the parts of `fused?lidar=A&camera=B&fusion=C`."""
    for key in spec.arguments:
        if key != CALIBRATION:
            possible = ", ".join((*FUSED_PARTS, CALIBRATION))
            raise SpecError(f"'{spec}': no argument '{key}'; known: {possible}")
    named = {key: spec.parts.get(key) or Spec.parse(FUSED_DEFAULTS[key]) for key in FUSED_PARTS}
    parts = {
        "lidar": detection_source(named["lidar"]),
        "camera": image_source(named["camera"]),
        "fusion": FUSION.registry.resolve(named["fusion"]),
    }
    return replace(spec, parts=parts, kind=FUSED)
