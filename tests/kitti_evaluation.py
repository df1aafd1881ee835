"""KITTI's evaluation of objects, written down plainly from its published rules, for tests.

Geiger et al. 2012 and the text of the development kit: difficulties, ignored labels and
detections, regions without labels, the scores at which recall is sampled, 40 recalls. Nothing is
taken from roadscope. An object is a dictionary with the fields of a line of a file.
"""

import itertools
import math

MIN_HEIGHT = {"easy": 40, "moderate": 25, "hard": 25}
MAX_OCCLUDED = {"easy": 0, "moderate": 1, "hard": 2}
MAX_TRUNCATED = {"easy": 0.15, "moderate": 0.3, "hard": 0.5}
MIN_OVERLAP = {"Car": 0.7, "Pedestrian": 0.5, "Cyclist": 0.5}
NEIGHBOUR = {"Car": "Van", "Pedestrian": "Person_sitting", "Cyclist": None}


def area(corners):
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in pairs) / 2


def clipped(corners, start, end):
    """The part of a polygon that is left of the line from start to end."""

    def side(p):
        return (end[0] - start[0]) * (p[1] - start[1]) - (end[1] - start[1]) * (p[0] - start[0])

    polygon = []
    for p, q in zip(corners, corners[1:] + corners[:1], strict=True):
        if side(p) >= 0:
            polygon.append(p)
        if side(p) * side(q) < 0:
            share = side(p) / (side(p) - side(q))
            polygon.append((p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])))
    return polygon


def ground_corners(box):
    """The corners of a box on the ground, x to the right and z ahead, counter-clockwise."""
    along = (math.cos(box["ry"]), -math.sin(box["ry"]))
    across = (math.sin(box["ry"]), math.cos(box["ry"]))
    corners = []
    for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        u, v = a * box["l"] / 2, b * box["w"] / 2
        corners.append(
            (box["x"] + u * along[0] + v * across[0], box["z"] + u * along[1] + v * across[1])
        )
    return corners if area(corners) > 0 else corners[::-1]


def common_ground(one, other):
    corners, fence = ground_corners(one), ground_corners(other)
    for start, end in zip(fence, fence[1:] + fence[:1], strict=True):
        if corners:
            corners = clipped(corners, start, end)
    return area(corners) if len(corners) > 2 else 0.0


def iou_bev(one, other):
    common = common_ground(one, other)
    return common / (one["l"] * one["w"] + other["l"] * other["w"] - common)


def iou_3d(one, other):
    top = max(one["y"] - one["h"], other["y"] - other["h"])
    common = common_ground(one, other) * max(0.0, min(one["y"], other["y"]) - top)
    volumes = [box["l"] * box["w"] * box["h"] for box in (one, other)]
    return common / (sum(volumes) - common)


def common_2d(one, other):
    (a, b, c, d), (e, f, g, h) = one["box"], other["box"]
    return max(0.0, min(c, g) - max(a, e)) * max(0.0, min(d, h) - max(b, f))


def area_2d(one):
    return (one["box"][2] - one["box"][0]) * (one["box"][3] - one["box"][1])


def iou_2d(one, other):
    common = common_2d(one, other)
    return common / (area_2d(one) + area_2d(other) - common)


OVERLAP = {"2d": iou_2d, "bev": iou_bev, "3d": iou_3d}


def height(one):
    return one["box"][3] - one["box"][1]


def label_state(label, name, level):
    """0: has to be found, 1: ignored, -1: of another class."""
    if label["type"] not in (name, NEIGHBOUR[name]):
        return -1
    hard = label["occluded"] > MAX_OCCLUDED[level] or label["truncated"] > MAX_TRUNCATED[level]
    return int(label["type"] != name or hard or height(label) <= MIN_HEIGHT[level])


def detection_state(detection, name, level):
    if height(detection) < MIN_HEIGHT[level]:
        return 1
    return 0 if detection["type"] == name else -1


def frame_counts(labels, detections, name, level, kind, threshold):
    """Right detections' scores, and the numbers of right and false ones above a threshold.

    threshold: None for the first pass, in which each label takes the highest score.
    """
    states = [detection_state(d, name, level) for d in detections]
    below = [threshold is not None and d["score"] < threshold for d in detections]
    assigned, scores = set(), []
    for label in labels:
        state = label_state(label, name, level)
        if state == -1:
            continue
        best = None
        for j, detection in enumerate(detections):
            if states[j] == -1 or below[j] or j in assigned:
                continue
            overlap = OVERLAP[kind](detection, label)
            if overlap <= MIN_OVERLAP[name]:
                continue
            if threshold is None:
                if best is None or detection["score"] > detections[best]["score"]:
                    best = j
            elif states[j] == 0:
                taken = best is not None and states[best] == 0
                if not taken or overlap > OVERLAP[kind](detections[best], label):
                    best = j
            elif best is None:
                best = j
        if best is None:
            continue
        assigned.add(best)
        if state == 0 and states[best] == 0:
            scores.append(detections[best]["score"])
    left = [
        j for j in range(len(detections)) if states[j] == 0 and not below[j] and j not in assigned
    ]
    false = len(left)
    if kind == "2d":
        regions = [label for label in labels if label["type"] == "DontCare"]
        for j in left:
            shares = [common_2d(detections[j], r) / area_2d(detections[j]) for r in regions]
            false -= any(share > MIN_OVERLAP[name] for share in shares)
    return scores, len(scores), false


def thresholds_of(scores, objects):
    recall, chosen = 0.0, []
    ranked = sorted(scores, reverse=True)
    for i, score in enumerate(ranked):
        last = i == len(ranked) - 1
        left, right = (i + 1) / objects, (i + 1 if last else i + 2) / objects
        if right - recall < recall - left and not last:
            continue
        chosen.append(score)
        recall += 1 / 40
    return chosen


def average_precision(frames, name, level, kind):
    """AP at 40 recalls. frames: pairs of labels and detections."""
    objects = sum(label_state(x, name, level) == 0 for labels, _ in frames for x in labels)
    if not objects:
        return math.nan
    scores = []
    for labels, detections in frames:
        scores += frame_counts(labels, detections, name, level, kind, None)[0]
    precision = [0.0] * 41
    for i, threshold in enumerate(thresholds_of(scores, objects)):
        counts = [frame_counts(*frame, name, level, kind, threshold) for frame in frames]
        right, false = sum(c[1] for c in counts), sum(c[2] for c in counts)
        precision[i] = right / (right + false) if right + false else 0.0
    best = [max(precision[i:]) for i in range(41)]
    return sum(best[1:]) / 40


def inverse(pose):
    """The inverse of a rigid motion, 4 x 4 as nested lists."""
    turned = [[pose[j][i] for j in range(3)] for i in range(3)]
    moved = [-sum(turned[i][k] * pose[k][3] for k in range(3)) for i in range(3)]
    return [[*turned[i], moved[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]


def product(one, other):
    return [[sum(one[i][k] * other[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def odometry_errors(truth, estimate):
    """Errors per metre of each stretch: its length, of translation, of rotation in radians.

    truth, estimate: poses of the camera, 4 x 4. A stretch begins at every tenth frame and ends with
    the first frame that is farther along the true way.
    """
    along = [0.0]
    for before, after in itertools.pairwise(truth):
        along.append(along[-1] + math.dist([r[3] for r in before[:3]], [r[3] for r in after[:3]]))
    errors = []
    for first in range(0, len(truth), 10):
        for length in (100, 200, 300, 400, 500, 600, 700, 800):
            far = [k for k in range(first, len(truth)) if along[k] > along[first] + length]
            if not far:
                continue
            last = far[0]
            true = product(inverse(truth[first]), truth[last])
            estimated_motion = product(inverse(estimate[first]), estimate[last])
            error = product(inverse(estimated_motion), true)
            trace = sum(error[i][i] for i in range(3))
            angle = math.acos(max(min(0.5 * (trace - 1), 1.0), -1.0))
            errors.append((length, math.hypot(*(r[3] for r in error[:3])) / length, angle / length))
    return errors
