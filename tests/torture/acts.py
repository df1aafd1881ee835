"""Which hostile acts there are, of which kinds, and what the reason of the failure says."""

from collections.abc import Iterable
from dataclasses import dataclass

CLASSES = {
    "detection": "Detector",
    "camera": "CameraDetector",
    "tracking": "Tracker",
    "fusion": "Fusion",
    "odometry": "Odometry",
    "driving": "Driver",
}
"""By board the class in `hostile.py`."""
ALL = tuple(CLASSES)
STAMPED = ("detection", "camera", "tracking", "fusion", "odometry")
SCORED = ("detection", "camera", "tracking", "fusion")
IN_SPACE = ("detection", "tracking", "fusion")


@dataclass(frozen=True)
class Act:
    """A hostile act.

    name: of the function in `hostile.py`. says: what the reason contains, in small letters; empty
    for an act that must change nothing. boards: those whose plug-ins can do it.
    """

    name: str
    says: str
    boards: tuple[str, ...] = ALL


ENDS = (
    Act("segfault", "sigsegv"),
    Act("exit_0", "status 0"),
    Act("exit_3", "status 3"),
    Act("kill_itself", "sigkill"),
    Act("base_exception", "baseexception"),
    Act("generator_exit", "generatorexit"),
    Act("system_exit", "systemexit"),
    Act("keyboard_interrupt", "keyboardinterrupt"),
    Act("unspeakable", "unspeakableerror"),
    Act("long_text", "valueerror"),
    Act("children_and_death", "status 4"),
)
HANGS = (
    Act("hang_when_made", "0.8 s"),
    Act("hang_in_reset", "0.8 s"),
    Act("hang_in_call", "0.8 s"),
    Act("stop_itself", "0.8 s"),
    Act("stop_both", "0.8 s"),
)
RESOURCES = (
    Act("flood", "output"),
    Act("hog", "memory"),
    Act("million_boxes", ""),
    Act("thousands_of_boxes", "50000", SCORED),
)
FORGERIES = (
    Act("forged_answer", "forged"),
    Act("forged_bytes", ""),
    Act("forged_pickle", ""),
    Act("forged_length", "mb"),
    Act("forged_number", "forged"),
    Act("forged_times", "forged"),
    Act("forged_processor_time", "forged"),
    Act("truncated", "status 0"),
    Act("second_answer", "answer"),
)
WRONG = (
    Act("nan_scores", "scores", SCORED),
    Act("float_ids", "ids", ("tracking",)),
    Act("object_arrays", "object"),
    Act("category_99", "categor", SCORED),
    Act("skewed_pose", "rotation", ("odometry",)),
    Act("nan_pose", "finite", ("odometry",)),
    Act("far_pose", "1e+200", ("odometry",)),
    Act("short_mask", "returns", ("odometry",)),
    Act("negative_covariance", "covariance", ("odometry",)),
    Act("nan_acceleration", "finite", ("driving",)),
    Act("infinite_acceleration", "finite", ("driving",)),
    Act("array_acceleration", "ndarray", ("driving",)),
    Act("lane_99", "target_lane 99", ("driving",)),
    Act("negative_lane", "target_lane -1", ("driving",)),
    Act("half_lane", "target_lane", ("driving",)),
    Act("huge_lane", "64 bits", ("driving",)),
    Act("none_mask", "none"),
    Act("missing_field", "missing"),
    Act("wrong_type", "tuple"),
    Act("other_record", "pose"),
    Act("nothing", "none"),
    Act("itself", "cannot be sent"),
    Act("wrong_stamp", "stamp", STAMPED),
    Act("nan_stamp", "stamp", STAMPED),
    Act("wrong_frame", "moon", ("detection", "tracking")),
    Act("repeated_ids", "unique", ("tracking",)),
    Act("negative_sizes", "sizes", IN_SPACE),
    Act("inverted_boxes", "boxes", ("camera",)),
    Act("wrong_shape", "shape", STAMPED),
    Act("enormous_values", "1e+300"),
    Act("enormous_velocities", "1e+200", ("tracking",)),
    Act("varying_masses", "masses", ("detection", "camera", "fusion")),
)
WATCHERS = (Act("kill_guard", "watches over it"), Act("kill_both", "watches over it"))
HARMLESS = (
    Act("honest", ""),
    Act("kill_supervisor", ""),
    Act("written_later", ""),
    Act("children", ""),
    Act("patch", ""),
    Act("seek_truth", ""),
    Act("seek_paths", ""),
)
TOLERATED = (
    Act("singular_covariances", "", ("tracking",)),
    Act("indefinite_covariances", "", ("tracking",)),
    Act("tiny_sizes", "", IN_SPACE),
    Act("wild_commands", "", ("driving",)),
)
"""Odd answers that the contract allows: they are scored, badly."""
FAILING = (*ENDS, *HANGS, *RESOURCES, *FORGERIES, *WRONG, *WATCHERS)
ACTS = (*FAILING, *HARMLESS, *TOLERATED)


def pairs(acts: Iterable[Act]) -> list[tuple[str, Act]]:
    """Return each act with each of its boards."""
    return [(board, act) for act in acts for board in act.boards]
