"""Which hostile acts there are, of which kinds, and what the reason of the failure says."""

from collections.abc import Iterable
from dataclasses import dataclass

CLASSES = {
    "detection": "Detector",
    "camera": "CameraDetector",
    "tracking": "Tracker",
    "fusion": "Fusion",
    "odometry": "Odometry",
}
"""By board the class in `hostile.py`."""
ALL = tuple(CLASSES)
SCORED = ("detection", "camera", "tracking", "fusion")
IN_SPACE = ("detection", "tracking", "fusion")


@dataclass(frozen=True)
class Act:
    """A hostile act.

    name: of the function in `hostile.py`. says: what the reason contains, in small letters; empty
    for an act that must change nothing. boards: those whose plug-ins can do it. quick: boards on
    which it belongs to the quick set.
    """

    name: str
    says: str
    boards: tuple[str, ...] = ALL
    quick: tuple[str, ...] = ()


ENDS = (
    Act("segfault", "sigsegv", quick=ALL),
    Act("exit_0", "status 0", quick=ALL),
    Act("exit_3", "status 3", quick=("tracking",)),
    Act("kill_itself", "sigkill", quick=("fusion", "odometry")),
    Act("base_exception", "baseexception", quick=("detection", "tracking")),
    Act("generator_exit", "generatorexit", quick=("camera", "odometry")),
    Act("system_exit", "systemexit", quick=("detection",)),
    Act("keyboard_interrupt", "keyboardinterrupt", quick=("fusion",)),
    Act("unspeakable", "unspeakableerror", quick=("tracking",)),
    Act("long_text", "valueerror", quick=("camera",)),
    Act("children_and_death", "status 4", quick=("tracking",)),
)
HANGS = (
    Act("hang_when_made", "1.5 s", quick=("detection",)),
    Act("hang_in_reset", "1.5 s", quick=("odometry",)),
    Act("hang_in_call", "1.5 s", quick=("fusion",)),
    Act("stop_itself", "1.5 s"),
    Act("stop_both", "1.5 s"),
)
RESOURCES = (
    Act("flood", "output", quick=("tracking",)),
    Act("hog", "memory", quick=("tracking",)),
    Act("million_boxes", "", SCORED, quick=("camera",)),
    Act("thousands_of_boxes", "50000", SCORED, quick=("detection",)),
)
FORGERIES = (
    Act("forged_answer", "forged", quick=("odometry",)),
    Act("forged_bytes", "", quick=("detection",)),
    Act("forged_pickle", "", quick=("fusion",)),
    Act("forged_length", "mb", quick=("camera",)),
    Act("forged_times", "forged"),
    Act("truncated", "status 0", quick=("tracking",)),
    Act("second_answer", "answer", quick=("detection", "fusion")),
)
WRONG = (
    Act("nan_scores", "scores", SCORED, quick=("tracking", "camera")),
    Act("float_ids", "ids", ("tracking",), quick=("tracking",)),
    Act("object_arrays", "object", quick=("odometry", "fusion")),
    Act("category_99", "categor", SCORED, quick=("detection", "fusion")),
    Act("skewed_pose", "rotation", ("odometry",), quick=("odometry",)),
    Act("nan_pose", "finite", ("odometry",)),
    Act("far_pose", "1e+200", ("odometry",), quick=("odometry",)),
    Act("short_mask", "returns", ("odometry",)),
    Act("negative_covariance", "covariance", ("odometry",)),
    Act("none_mask", "none", quick=ALL),
    Act("missing_field", "missing"),
    Act("wrong_type", "tuple", quick=("tracking",)),
    Act("other_record", "pose", quick=("camera",)),
    Act("nothing", "none", quick=("odometry",)),
    Act("itself", "cannot be sent", quick=("fusion",)),
    Act("wrong_stamp", "stamp", quick=("camera", "odometry")),
    Act("nan_stamp", "stamp"),
    Act("wrong_frame", "moon", ("detection", "tracking"), quick=("tracking",)),
    Act("repeated_ids", "unique", ("tracking",), quick=("tracking",)),
    Act("negative_sizes", "sizes", IN_SPACE, quick=("fusion",)),
    Act("inverted_boxes", "boxes", ("camera",), quick=("camera",)),
    Act("wrong_shape", "shape"),
    Act("enormous_values", "1e+300", quick=("detection", "odometry")),
    Act("enormous_velocities", "1e+200", ("tracking",), quick=("tracking",)),
    Act("varying_masses", "masses", ("detection", "camera", "fusion"), quick=("fusion",)),
)
WATCHERS = (
    Act("kill_guard", "watches over it", quick=("tracking",)),
    Act("kill_both", "watches over it", quick=("detection",)),
)
HARMLESS = (
    Act("honest", "", quick=ALL),
    Act("written_later", "", quick=("tracking", "fusion")),
    Act("children", "", quick=("odometry",)),
    Act("patch", "", quick=("tracking", "detection")),
    Act("seek_truth", "", quick=("tracking",)),
    Act("seek_paths", "", quick=("camera",)),
)
TOLERATED = (
    Act("singular_covariances", "", ("tracking",), quick=("tracking",)),
    Act("indefinite_covariances", "", ("tracking",), quick=("tracking",)),
    Act("tiny_sizes", "", IN_SPACE, quick=("detection",)),
)
"""Odd answers that the contract allows: they are scored, badly."""
FAILING = (*ENDS, *HANGS, *RESOURCES, *FORGERIES, *WRONG, *WATCHERS)


def pairs(acts: Iterable[Act], *, quick: bool) -> list[tuple[str, Act]]:
    """Return boards with their acts, those of the quick set or all."""
    return [(b, act) for act in acts for b in (act.quick if quick else act.boards)]
