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
WITH_MASSES = ("detection", "camera", "fusion")
FLOATS = {
    "centres": IN_SPACE,
    "sizes": IN_SPACE,
    "yaws": IN_SPACE,
    "scores": SCORED,
    "masses": WITH_MASSES,
    "boxes": ("camera",),
    "velocities": ("tracking",),
    "covariances": ("tracking",),
    "distances_m": ("fusion",),
    "image_boxes": ("fusion",),
    "covariance": ("odometry",),
}
"""The arrays of floats in answers, with the boards that have them."""


@dataclass(frozen=True)
class Act:
    """A hostile act.

    name: as plug-ins of `hostile.py` take it.
    says: what the reason contains, in small letters; empty for an act that must change nothing.
    boards: those whose plug-ins can do it.
    jobs: the numbers of workers with which it can be done.
    """

    name: str
    says: str
    boards: tuple[str, ...] = ALL
    jobs: tuple[int, ...] = (1, 2)


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
    Act("segfault_later", "sigsegv"),
    Act("made.exit_255", "status 255"),
    Act("reset.base_exception", "baseexception"),
    Act("load.segfault", "sigsegv"),
    Act("load.exit_0", "status 0"),
    Act("load.base_exception", "baseexception"),
    Act("load.generator_exit", "generatorexit"),
    Act("load.system_exit", "systemexit"),
    Act("load.keyboard_interrupt", "keyboardinterrupt"),
    Act("load.unspeakable", "unspeakableerror"),
)
HANGS = (
    Act("hang", "0.3 s"),
    Act("load.hang", "0.3 s"),
    Act("made.hang", "0.3 s"),
    Act("reset.hang", "0.3 s"),
    Act("half_an_answer", "0.3 s"),
    Act("stop_itself", "0.3 s"),
    Act("stop_both", "0.3 s"),
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
    Act("shortened", "truncated"),
    Act("second_answer", "answer"),
)
WRONG = (
    *(Act(f"nan.{name}", f"{name}: must be finite", boards) for name, boards in FLOATS.items()),
    Act("float_ids", "ids", ("tracking",)),
    Act("half_categories", "whole", SCORED),
    Act("number_mask", "true or false", ("fusion", "odometry")),
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
    Act("varying_masses", "masses", WITH_MASSES),
)
WATCHERS = (
    Act("kill_guard", "watches over it"),
    Act("kill_both", "watches over it"),
    # With one worker it is the run that is killed. In `reset` a new one has little to load again.
    Act("reset.kill_worker", "worker process died", jobs=(2,)),
)
HARMLESS = (
    Act("honest", ""),
    Act("kill_supervisor", ""),
    Act("written_later", ""),
    Act("patch", ""),
    Act("seek_all", ""),
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


def pairs(acts: Iterable[Act], jobs: int) -> list[tuple[str, Act]]:
    """Return each act that can be done with so many workers, with each of its boards."""
    return [(board, act) for act in acts if jobs in act.jobs for board in act.boards]
