"""Which figures of a board are shown, under which headings, and how they are explained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from roadscope.benchmarks.boards.rows import FIRST_METRIC
from roadscope.benchmarks.recorded.recording import (
    KITTI_BOARDS,
    MOT_BOARDS,
    OFFLINE,
    RECORDED_BOARDS,
)

FULL = 76
"""Width from which on all main figures are shown."""
NAME, NARROW_NAME = 19, 12
"""Least widths of the entry's column, at full width and below."""
PLACES, FIRST, OTHER, INTERVAL = 3, 17, 7, 12
"""About how wide columns are: places, the first figure with its interval, any other, and what an
interval adds to it."""

Columns = Mapping[str, tuple[str, int]]
"""Metric -> heading and decimals."""

KITTI_COLUMNS: Columns = {
    "hota": ("HOTA", 3),
    OFFLINE: ("pass", 0),
    "det_a": ("DetA", 3),
    "ass_a": ("AssA", 3),
    "mota": ("MOTA", 3),
    "idf1": ("IDF1", 3),
    "id_switches": ("ID\nsw.", 1),
    "wrong_associations": ("wrong\nassoc", 1),
    "fragmentations": ("frag-\nments", 1),
    "hota_3d": ("HOTA\n3-D", 3),
    "samota_3d": ("sAMOTA\n3-D", 3),
    "hota_centre": ("HOTA\ncentre", 3),
    "mota_3d": ("MOTA\n3-D", 3),
    "position_rmse_m": ("pos.\nm", 2),
    "heading_rmse_deg": ("head.\ndeg", 1),
    "nees_position": ("NEES", 2),
    "nees_in_band": ("in\nband", 2),
    "call_p50_ms": ("ms\np50", 2),
    "call_p99_ms": ("ms\np99", 2),
}
MOT_COLUMNS: Columns = {
    **{
        metric: KITTI_COLUMNS[metric]
        for metric in (
            "hota", OFFLINE, "det_a", "ass_a", "mota", "idf1", "id_switches", "fragmentations",
        )
    },
    "samota": ("sAMOTA", 3),
    "call_p50_ms": ("ms\np50", 2),
    "call_p99_ms": ("ms\np99", 2),
}  # fmt: skip

COLUMNS: Mapping[str, Columns] = {
    "detection": {
        "f1": ("F1", 2),
        "detection_rate": ("detec-\nted", 2),
        "precision": ("preci-\nsion", 2),
        "false_alarms_per_frame": ("false/\nframe", 2),
        "ap": ("AP", 2),
        "ap_iou_50": ("AP\nIoU.5", 2),
        "ap_iou_70": ("AP\nIoU.7", 2),
        "calibration_error": ("cal.\nerror", 2),
        "position_rmse_m": ("pos.\nm", 2),
        "longitudinal_rmse_m": ("long.\nm", 2),
        "lateral_rmse_m": ("lat.\nm", 2),
        "heading_rmse_deg": ("head.\ndeg", 1),
        "heading_flips": ("flip-\nped", 3),
        "size_rmse_m": ("size\nm", 2),
        "category_accuracy": ("cate-\ngory", 2),
        "delay_s": ("delay\ns", 2),
        "call_p50_ms": ("ms\np50", 2),
        "call_p99_ms": ("ms\np99", 2),
    },
    "tracking": {
        "hota": ("HOTA", 2),
        "mota": ("MOTA", 2),
        "idf1": ("IDF1", 2),
        "id_switches": ("ID\nsw.", 1),
        "wrong_associations": ("wrong\nassoc", 1),
        "kept_through_occlusion": ("kept\nhidden", 2),
        "fragmentations": ("frag-\nments", 1),
        "motp_m": ("MOTP\nm", 2),
        "velocity_rmse_m_s": ("vel.\nm/s", 2),
        "det_a": ("DetA", 2),
        "ass_a": ("AssA", 2),
        "samota": ("sAMO-\nTA", 2),
        "amota_nuscenes": ("AMOTA\nnuSc.", 2),
        "amotp_nuscenes_m": ("AMOTP\nnuSc.", 2),
        "gospa_m": ("GOSPA\nm", 2),
        "heading_rmse_deg": ("head.\ndeg", 1),
        "inside_state": ("in\n95 %", 2),
        "nees_position": ("NEES", 2),
        "nees_in_band": ("in\nband", 2),
        "call_p50_ms": ("ms\np50", 2),
        "call_p99_ms": ("ms\np99", 2),
    },
    "camera": {
        "ap50": ("AP50", 2),
        "ap": ("AP", 2),
        "detection_rate": ("detec-\nted", 2),
        "false_alarms": ("false/\nimage", 2),
        "category_accuracy": ("cate-\ngory", 2),
        "calibration_error": ("cal.\nerror", 2),
        "ap50_16px": ("AP50\n16 px", 2),
        "call_p50_ms": ("ms\np50", 1),
        "call_p99_ms": ("ms\np99", 1),
    },
    "fusion": {
        "ap": ("AP", 2),
        "f1": ("F1", 2),
        "detection_rate": ("detec-\nted", 2),
        "false_alarms": ("false/\nscan", 2),
        "precision": ("preci-\nsion", 2),
        "distance_right": ("dist.\nright", 2),
        "hidden_distance_right": ("dist.\nhidden", 2),
        "family_right": ("class\nright", 2),
        "calibration_error": ("cal.\nerror", 2),
        "call_p50_ms": ("ms\np50", 2),
        "call_p99_ms": ("ms\np99", 2),
    },
    "odometry": {
        "t_rel": ("t_rel\n%", 2),
        "failed": ("fail-\nures", 2),
        "below_1": ("t_rel\n<1 %", 2),
        "r_rel": ("r_rel\ndeg", 2),
        "ate": ("ATE\nm", 2),
        "rpe": ("RPE\nm", 3),
        "rpe_rotation": ("RPE\ndeg", 3),
        "end": ("end\nm", 2),
        "error_mean": ("mean\nm", 2),
        "error_std": ("std\nm", 2),
        "error_min": ("min\nm", 2),
        "error_max": ("max\nm", 2),
        "false_motion": ("false\nm", 2),
        "false_motion_end": ("false\nend m", 2),
        "degraded": ("degra-\nded", 2),
        "dynamic_precision": ("dyn.\nprec.", 2),
        "dynamic_recall": ("dyn.\nrecall", 2),
        "call_p50_ms": ("ms\np50", 1),
        "call_p90_ms": ("ms\np90", 1),
        "call_p99_ms": ("ms\np99", 1),
    },
    **dict.fromkeys(KITTI_BOARDS, KITTI_COLUMNS),
    **dict.fromkeys(MOT_BOARDS, MOT_COLUMNS),
}

WIDER: Mapping[str, Sequence[str]] = {
    "detection": (
        "heading_rmse_deg", "ap_iou_50", "call_p99_ms", "category_accuracy", "size_rmse_m",
        "calibration_error", "ap_iou_70", "heading_flips", "longitudinal_rmse_m",
        "lateral_rmse_m", "delay_s",
    ),
    "tracking": (
        "velocity_rmse_m_s", "motp_m", "fragmentations", "call_p99_ms", "ass_a", "det_a", "samota",
        "gospa_m", "inside_state", "heading_rmse_deg", "nees_position", "nees_in_band",
        "amota_nuscenes", "amotp_nuscenes_m",
    ),
    "camera": ("call_p99_ms", "ap50_16px"),
    "fusion": ("calibration_error", "hidden_distance_right", "precision", "call_p99_ms"),
    "odometry": (
        "below_1", "rpe", "call_p90_ms", "call_p99_ms", "dynamic_recall", "dynamic_precision",
        "degraded", "rpe_rotation", "error_max", "error_mean", "error_std", "false_motion_end",
        "error_min",
    ),
    **dict.fromkeys(MOT_BOARDS, ("ass_a", "det_a", "fragmentations", "call_p99_ms")),
    **dict.fromkeys(
        KITTI_BOARDS,
        (
            "ass_a", "det_a", "samota_3d", "nees_position", "nees_in_band", "hota_centre",
            "position_rmse_m", "fragmentations", "mota_3d", "call_p99_ms", "heading_rmse_deg",
            "wrong_associations",
        ),
    ),
}  # fmt: skip
"""What only wide terminals show, in the order in which it comes with the width; all of it and
more is in `leaderboard.json`."""

ENTRY = {
    "detection": "detector",
    "tracking": "tracker",
    "camera": "detector",
    "fusion": "fusion",
    "odometry": "odometry",
    **dict.fromkeys(RECORDED_BOARDS, "tracker"),
}

Explained = Sequence[tuple[Sequence[str], str]]

NEES_EXPLAINED = (
    ("nees_position",), "NEES: of positions, over its degrees of freedom; 1 when consistent, more "
    "when tracks are too sure.",
)  # fmt: skip

SURE_OR_NOT = "; with tentative tracks of trackers that weigh them (weighed = True)"
"""Averages over recall need the tracks that a tracker is not sure of."""
KITTI_EXPLAINED: Explained = (
    (("hota",), "HOTA, MOTA, IDF1: image boxes, all sequences as one (KITTI's rules)."),
    ((OFFLINE,), "pass: online, or offline with all frames at hand."),
    (("hota_3d", "samota_3d", "mota_3d"), "3-D: IoU in space, from 0.25."),
    (("samota_3d",), f"sAMOTA: mean of sequences{SURE_OR_NOT}."),
    (("hota_centre",), "centre: seen from above, gate 2 m."),
    (("position_rmse_m",), "pos.: RMSE of matches by centres."),
    (("heading_rmse_deg",), "head.: the same, front and rear told apart."),
    NEES_EXPLAINED,
    (("nees_in_band",), "in band: sequences whose NEES lies in its 95 % band, share."),
    (("id_switches", "wrong_associations", "fragmentations"), "Counts: per sequence."),
)

MOT_EXPLAINED: Explained = (
    (("hota",), "HOTA, MOTA, IDF1: image boxes, all sequences as one (MOTChallenge's rules)."),
    ((OFFLINE,), "pass: online, or offline with all frames at hand."),
    (("samota",), f"sAMOTA: mean of sequences{SURE_OR_NOT}."),
    (("id_switches", "fragmentations"), "Counts: per sequence."),
)

EXPLAINED: Mapping[str, Explained] = {
    "detection": (
        (("f1",), "F1, detected, precision: one to one, centres within 2 m seen from above."),
        (("ap",), "AP: mean over 0.5, 1, 2, 4 m."),
        (("ap_iou_50", "ap_iou_70"), "IoU: of boxes seen from above."),
        (("calibration_error",), "cal. error: of the scores (ECE)."),
        (("position_rmse_m",), "pos.: RMSE of matches."),
        (("longitudinal_rmse_m",), "long., lat.: its parts along and across the object."),
        (("heading_rmse_deg",), "head.: RMSE of matches."),
        (("heading_flips",), "flipped: off by more than 45 degrees."),
        (("size_rmse_m",), "size: RMSE of length and width."),
        (("category_accuracy",), "category: share right."),
        (("delay_s",), "delay: from a frame to its answer."),
    ),
    "tracking": (
        (("hota",), "HOTA, MOTA, IDF1: centres seen from above, gate 2 m."),
        (("id_switches", "wrong_associations", "fragmentations"), "Counts: per episode."),
        (("velocity_rmse_m_s",), "vel.: RMSE of matches."),
        (("kept_through_occlusion",), "kept hidden: same track after a time unseen, share."),
        (("samota",), "sAMOTA: as AB3DMOT has it."),
        (
            ("amota_nuscenes", "amotp_nuscenes_m"),
            "nuSc.: as nuScenes has them, AMOTP in metres, 2 where a recall is not reached.",
        ),
        (("gospa_m",), "GOSPA: order 1, cut-off 2 m, per frame."),
        (("inside_state",), "in 95 %: objects within their tracks' 95 % ellipses."),
        (("heading_rmse_deg",), "head.: RMSE of matches, front and rear told apart."),
        NEES_EXPLAINED,
        (("nees_in_band",), "in band: episodes whose NEES lies in its 95 % band, share."),
    ),
    "camera": (
        (("ap50",), "AP50: from an IoU of 0.5, mean of the families; episodes by their objects."),
        (("ap",), "AP: IoU 0.5 to 0.95."),
        (("detection_rate", "false_alarms"), "detected, false: from a score of 0.5."),
        (("category_accuracy",), "category: share right of those found."),
        (("calibration_error",), "cal. error: of the scores (ECE)."),
        (("ap50_16px",), "16 px: of objects that high."),
    ),
    "fusion": (
        (
            ("ap",),
            "AP: of targets of any class, in the image by IoU 0.5, else within 2 m; episodes by "
            "their objects.",
        ),
        (("f1", "detection_rate", "false_alarms"), "Others: from a score of 0.5."),
        (("distance_right",), "dist. right: of those found, within 10 % or 1 m."),
        (("hidden_distance_right",), "hidden: more than a third."),
        (("family_right",), "class right: vehicle, cyclist or pedestrian."),
        (("calibration_error",), "cal. error: of the scores (ECE)."),
    ),
    "odometry": (
        (("r_rel",), "r_rel: degrees in 100 m."),
        (
            ("failed",),
            "failures: share of episodes that end more than 1 m and 5 % of the way off.",
        ),
        (("below_1",), "t_rel < 1 %: share of episodes."),
        (("ate",), "ATE, end: of positions, first pose on first pose."),
        (("rpe", "rpe_rotation"), "RPE: from scan to scan."),
        (("error_mean",), "mean, std, min, max: of positions' errors, mean of the episodes."),
        (("false_motion",), "false: farthest that a standing ego is told to have gone."),
        (("false_motion_end",), "false end: how far at the end of its rest."),
        (("degraded",), "degraded: share of scans whose pose is said to rest on little."),
        (("dynamic_recall",), "dyn.: returns held to be of what moves."),
    ),
    **dict.fromkeys(KITTI_BOARDS, KITTI_EXPLAINED),
    **dict.fromkeys(MOT_BOARDS, MOT_EXPLAINED),
}
"""Metrics and what is said of them when one is shown."""


def in_one_line(heading: str) -> str:
    """Return the heading of a column without its breaks."""
    return heading.replace("-\n", "").replace("\n", " ")


def shown_columns(board: str, width: int) -> Columns:
    """Return the columns that a terminal has room for; the name and the first figure stay."""
    columns, wider = COLUMNS[board], WIDER[board]
    main = [metric for metric in columns if metric not in wider]
    if width >= FULL:
        room = max(0, (width - FULL) // OTHER)
        chosen = [*main, *wider[:room]]
    else:
        chosen = main[: 1 + max(0, (width - NARROW_NAME - FIRST - PLACES - 2) // OTHER)]
    return {metric: column for metric, column in columns.items() if metric in chosen}


def with_intervals(board: str, width: int) -> list[str]:
    """Return the metrics whose intervals there is room for: the first, then as they come."""
    shown = list(shown_columns(board, width))
    room = width - PLACES - NAME - FIRST - OTHER * (len(shown) - 1)
    return [FIRST_METRIC[board], *shown[1 : 1 + max(0, room // INTERVAL)]]


def footnote(board: str, width: int, jobs: int) -> str:
    """Explain the columns that are shown, and say where the others are."""
    shown = shown_columns(board, width)
    texts = [text for metrics, text in EXPLAINED[board] if any(m in shown for m in metrics)]
    if "call_p50_ms" in shown:
        what = {"camera": "image", "fusion": "scan", "odometry": "scan"}.get(board, "frame")
        clock = " in processor time" if board == "odometry" else ""
        texts.append(f"ms: per {what}, the plug-in's call{clock}.")
        if jobs > 1:
            texts.append(f"Taken with {jobs} workers at once; use --jobs 1 for timing.")
    if len(shown) < len(COLUMNS[board]):
        texts.append("More columns on a wider terminal; all in leaderboard.json (--out).")
    return " ".join(texts)
