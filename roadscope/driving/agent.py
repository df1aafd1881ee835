"""Learned drivers: what an agent observes of a scene, what it may do, and agents with weights."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from roadscope.core import Category, DrivingCommand, DrivingScene

# --------------------------------------------------------------------------------------------------
# Observations and actions.

DECISION_STEPS = 2
"""An agent decides at every second call of a driver: every 0.2 s."""
ACCELERATIONS_M_S2 = (-8.0, -4.0, -2.0, 0.0, 1.5)
"""Accelerations of the first actions, which keep the lane: from full braking to that of a car in
traffic. These and the numbers below are chosen by hand."""
LEFT, RIGHT = len(ACCELERATIONS_M_S2), len(ACCELERATIONS_M_S2) + 1
"""Actions that change to the next lane on that side, at constant speed."""
ACTIONS = RIGHT + 1
"""Number of actions."""
ROAD_USERS = 10
"""Most road users in an observation: the nearest ones."""
BEHIND_M, AHEAD_M, BESIDE_M = 40.0, 90.0, 30.0
"""Road users farther away, along the way ahead and beside it, are not observed."""
SPEED_M_S, CLOSING_M_S, GAP_M, LANE_M = 30.0, 10.0, 50.0, 4.0
"""Speeds, relative speeds, distances along and across the way are divided by these, so that most
values are from -2 to 2."""
LONGEST_GAP_M = 100.0
"""Longer gaps are observed as this."""
LARGEST = 4.0
"""Values beyond this are limited to it."""
EGO_VALUES, USER_VALUES = 11, 6
"""Numbers of values of the ego and the road, and of each road user."""
OBSERVED = EGO_VALUES + ROAD_USERS * USER_VALUES
"""Number of values of an observation."""
_PEOPLE = (Category.PEDESTRIAN, Category.CYCLIST)
SAME_M2 = 1e-6
"""Squared distances that differ by less count as equal: a point outside a corner of the path is as
far from one segment as from the next."""


def observed(scene: DrivingScene) -> np.ndarray:
    """Return what an agent observes of a scene: (71,) float32, from -4 to 4.

    Eleven values are of the ego and the road: speed, allowed and desired speed; gap to the road
    user, obstacle or line ahead, its speed relative to the ego, and whether there is one; distance
    of the line where the ego must give way; whether there is a lane on the left and on the right;
    whether the target lane is another one; how far the ego is left of the centre of the target
    lane.

    Six are of each of the ten nearest tracks: 1; its place along the way ahead and to the left of
    it, relative to the ego; its velocity along the way, relative to the ego, and to the left of the
    way; whether it is a pedestrian or a cyclist. They are 0 where there are fewer. Tracks more than
    90 m ahead, 40 m behind or 30 m beside are left out.
    """
    ego_place, _ = _along_path(_centre(scene)[None], scene)
    ahead_m, ahead_m_s = scene.gap_m, scene.leader_speed_m_s
    if scene.line_m < ahead_m:  # The ego stops there as behind something that stands.
        ahead_m, ahead_m_s = scene.line_m, 0.0
    is_there = np.isfinite(ahead_m)
    values = np.zeros(OBSERVED)
    values[:EGO_VALUES] = (
        scene.speed_m_s / SPEED_M_S,
        scene.allowed_speed_m_s / SPEED_M_S,
        scene.desired_speed_m_s / SPEED_M_S,
        min(ahead_m, LONGEST_GAP_M) / GAP_M,
        (ahead_m_s - scene.speed_m_s) / CLOSING_M_S if is_there else 0.0,
        is_there,
        min(scene.line_m, LONGEST_GAP_M) / GAP_M,
        scene.target_lane > 0,
        scene.target_lane < scene.lanes - 1,
        scene.lane != scene.target_lane,
        ego_place[0, 1] / LANE_M,
    )
    users = _users(scene, ego_place)
    values[EGO_VALUES : EGO_VALUES + users.size] = users.ravel()
    return np.clip(values, -LARGEST, LARGEST).astype(np.float32)


def _centre(scene: DrivingScene) -> np.ndarray:
    """Return (2,) the centre of the ego's box, frame `world`; the path begins beside it."""
    centre: np.ndarray = scene.world_from_ego.apply(np.array([[scene.size[0] / 2, 0.0, 0.0]]))
    return centre[0, :2]


def _users(scene: DrivingScene, ego_place: np.ndarray) -> np.ndarray:
    """Return (N, 6), the values of the nearest tracks, nearest first.

    ego_place: (1, 2), along and to the left of the path.
    """
    tracks = scene.tracks
    places, directions = _along_path(tracks.centres[:, :2], scene)
    places = places - ego_place
    along, left = places.T
    near = (along > -BEHIND_M) & (along < AHEAD_M) & (abs(left) < BESIDE_M)
    rows = np.flatnonzero(near)
    rows = rows[np.argsort(np.hypot(along[rows], left[rows]), kind="stable")][:ROAD_USERS]
    moving, ahead = tracks.velocities[rows], directions[rows]
    return np.column_stack(
        [
            np.ones(len(rows)),
            along[rows] / GAP_M,
            left[rows] / LANE_M,
            (np.sum(moving * ahead, axis=1) - scene.speed_m_s) / CLOSING_M_S,
            (moving[:, 1] * ahead[:, 0] - moving[:, 0] * ahead[:, 1]) / CLOSING_M_S,
            np.isin(tracks.categories[rows], _PEOPLE),
        ]
    )


def _along_path(points: np.ndarray, scene: DrivingScene) -> tuple[np.ndarray, np.ndarray]:
    """Return places along and to the left of the path ahead, and its directions there.

    points: (N, 2). Both results are (N, 2), metres and unit vectors.
    Places are relative to the nearest segment of the path, continued straight beyond its ends.
    """
    path = scene.path
    steps = np.diff(path, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    distinct = lengths > 0  # Points that coincide give no direction.
    starts, steps, lengths = path[:-1][distinct], steps[distinct], lengths[distinct]
    if not len(starts):
        yaw = scene.world_from_ego.yaw
        starts, lengths = path[:1], np.ones(1)
        steps = np.array([[np.cos(yaw), np.sin(yaw)]])
    units = steps / lengths[:, None]
    away = points[:, None] - starts
    along = np.sum(away * units, axis=2)
    feet = np.clip(along, 0.0, lengths)[..., None] * units
    squares = np.sum((away - feet) ** 2, axis=2)
    nearest = np.argmax(squares <= squares.min(axis=1, keepdims=True) + SAME_M2, axis=1)
    rows = np.arange(len(points))
    ahead, offset = units[nearest], away[rows, nearest]
    left = offset[:, 1] * ahead[:, 0] - offset[:, 0] * ahead[:, 1]
    before = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    return np.column_stack([before[nearest] + along[rows, nearest], left]), ahead


def command_of(action: int, scene: DrivingScene) -> DrivingCommand:
    """Return the command of an action.

    0 to 4 keep the lane and accelerate by `ACCELERATIONS_M_S2`; 5 and 6 change to the next lane on
    the left and on the right, at constant speed. A lane that does not exist is not changed to, and
    no lane change begins during another one.
    """
    if action < LEFT:
        return DrivingCommand(ACCELERATIONS_M_S2[action], scene.target_lane)
    lane = scene.target_lane + (1 if action == RIGHT else -1)
    possible = 0 <= lane < scene.lanes and scene.lane == scene.target_lane
    return DrivingCommand(0.0, lane if possible else scene.target_lane)


# --------------------------------------------------------------------------------------------------
# Agents with weights.

Layers = Sequence[tuple[np.ndarray, np.ndarray]]
"""Weights (outputs, inputs) and biases (outputs,) of each layer of a network. Hidden layers are
followed by tanh."""
HIDDEN = (64, 64)
"""Widths of the hidden layers."""
FOLDER = Path(__file__).parent / "agents"
ENDING = ".safetensors"
ABOUT = "roadscope"
"""Key of the file's metadata under which the architecture is named."""
ARCHITECTURE = "driver-1"
"""Name of these observations, actions and layers; files with another name are refused."""


class AgentDriver:
    """A trained agent: a network with two hidden layers chooses the action with the best value.

    weights: a shipped agent or a file of `roadscope train driver`. Both shipped ones learned from
        `idm-mobil`: `truth` on true tracks, `perceived` on those of `distance-l-shape + existence`.
    """

    def __init__(self, *, weights: str = "truth") -> None:
        self._layers = load_agent(weights)
        self.reset()

    def reset(self) -> None:
        """Forget the last drive."""
        self._calls, self._action = 0, 0

    def drive(self, scene: DrivingScene) -> DrivingCommand:
        """Return the command of the action; at every second call the agent chooses a new one."""
        if self._calls % DECISION_STEPS == 0:
            self._action = self.choose(observed(scene))
        self._calls += 1
        return command_of(self._action, scene)

    def choose(self, observation: np.ndarray) -> int:
        """Return the best action, 0 to 6. observation: (71,), of `observed` or of `DriveEnv`."""
        return best_action(self._layers, observation)


def best_action(layers: Layers, observation: np.ndarray) -> int:
    """Return the action, 0 to 6, whose output is the largest. observation: (71,)."""
    values = observation
    for weights, biases in layers[:-1]:
        values = np.tanh(weights @ values + biases)
    weights, biases = layers[-1]
    return int(np.argmax(weights @ values + biases))


def load_agent(weights: str | Path) -> Layers:
    """Read an agent; `ValueError` names the file and what is wrong with it.

    weights: `truth` or `perceived`, which are shipped, or a file.
    """
    from safetensors import SafetensorError, safe_open

    path = agent_path(weights)
    try:
        with safe_open(path, "np") as file:
            about = json.loads((file.metadata() or {}).get(ABOUT, "{}"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise ValueError(f"cannot read weights {path}: {error.strerror or error}") from error
    except (SafetensorError, ValueError) as error:
        raise ValueError(f"{path} is no file of weights: {error}") from error
    architecture = about.get("architecture") if isinstance(about, dict) else None
    if architecture != ARCHITECTURE:
        raise ValueError(f"{path}: expected architecture '{ARCHITECTURE}', got {architecture!r}")
    return _layers(path, tensors)


def agent_path(weights: str | Path) -> Path:
    """Return the path of an agent's file. weights: name of a shipped agent, or a file."""
    if Path(weights).suffix == ENDING:
        return Path(weights)
    path = FOLDER / f"{weights}{ENDING}"
    if not path.is_file():
        shipped = ", ".join(sorted(each.stem for each in FOLDER.glob(f"*{ENDING}")))
        raise ValueError(
            f"no agent '{weights}': expected {shipped} or a {ENDING} file. Any other policy drives "
            "by a class of yours; the page 'Bring your own' prints one for Stable-Baselines3"
        )
    return path


def _layers(path: Path, tensors: Mapping[str, np.ndarray]) -> Layers:
    """Return the layers of the tensors in a file; raise `ValueError` for wrong ones."""
    widths = (OBSERVED, *HIDDEN, ACTIONS)
    for k, (inputs, outputs) in enumerate(pairwise(widths)):
        for name, shape in ((f"weights.{k}", (outputs, inputs)), (f"biases.{k}", (outputs,))):
            actual = tensors[name].shape if name in tensors else "none"
            if actual != shape:
                raise ValueError(f"{path}: tensor '{name}': expected shape {shape}, got {actual}")
            if not np.isfinite(tensors[name]).all():
                raise ValueError(f"{path}: tensor '{name}': expected finite numbers")
    return [(tensors[f"weights.{k}"], tensors[f"biases.{k}"]) for k in range(len(widths) - 1)]


def save_agent(path: Path, layers: Layers) -> None:
    """Write an agent to a `.safetensors` file."""
    from safetensors.numpy import save_file

    tensors: dict[str, np.ndarray] = {}
    for k, (weights, biases) in enumerate(layers):
        tensors |= {
            f"weights.{k}": np.ascontiguousarray(weights, np.float32),
            f"biases.{k}": np.ascontiguousarray(biases, np.float32),
        }
    save_file(tensors, path, {ABOUT: json.dumps({"architecture": ARCHITECTURE})})
