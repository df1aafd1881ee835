"""Metrics of a drive: collisions and near ones, braking, progress and comfort."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.score import Score, ScoreFamily, ratio, rms

NEAR_MISS_S = 1.0
"""A near miss: the time to collision is shorter."""
HARD_BRAKING_M_S2, REASON_M_S2 = 3.0, 1.0
"""Braking harder than the first value is hard. It is phantom braking if a driver of the simulation
(IDM) that gets the true road users would brake with less than the second value."""
REACTION_S = 1.0
"""A reason for hard braking counts so long after it: a driver may go on braking."""
SEPARATE_S = 1.0
"""Events of one kind that are closer in time are one event."""
WITHIN_M = 60.0
"""Road users farther away have no time to collision."""
LONGEST_S = 10.0
"""Longer times to collision count as this."""
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True)
class DrivingScores(ScoreFamily):
    """Scores of a drive.

    reward: 0 to 1: mean of speed over desired speed, at most 1 and 0 after a collision, over the
        planned time or until the end of the road.
    collided: 1 if the drive ended in a collision.
    collisions, near_misses, hard_braking, phantom_braking: events in an hour of driving.
    least_ttc_s: shortest time to collision, at constant velocities, at most 10 s.
    progress: distance over that at desired speed, while it lasted.
    comfort_m_s2: RMS of the longitudinal acceleration.
    """

    reward: Score
    collided: Score
    collisions: Score
    near_misses: Score
    least_ttc_s: Score
    hard_braking: Score
    phantom_braking: Score
    progress: Score
    comfort_m_s2: Score


@dataclass(frozen=True, slots=True)
class ScoredDrive:
    """What scores of a drive are made of: K instants of the ego among A others.

    stamps_s: (K,); end_s: when the drive ended. speeds, accelerations: (K,) of the ego, m/s and
    m/s^2. reference_accelerations: (K,) of a driver of the simulation that gets the true others.
    ego: (K, 3) box centre and yaw. others: (K, A, 3), NaN where absent. velocities: (K, 1 + A, 2),
    m/s, that of the ego first. sizes: (1 + A, 2) length and width, metres. planned_s: how long the
    drive should last. collided: whether it ended in a collision.
    """

    stamps_s: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray
    reference_accelerations: np.ndarray
    ego: np.ndarray
    others: np.ndarray
    velocities: np.ndarray
    sizes: np.ndarray
    end_s: float
    desired_speed_m_s: float
    planned_s: float
    collided: bool


def score_drive(drive: ScoredDrive) -> DrivingScores:
    """Return the scores of a drive."""
    stamps_s = drive.stamps_s
    driven_s = drive.end_s - float(stamps_s[0])
    times_s = times_to_collision(drive)
    shares = np.minimum(drive.speeds / max(drive.desired_speed_m_s, 0.1), 1.0)
    planned = drive.planned_s if drive.collided else driven_s
    least_s = float(times_s.min(initial=LONGEST_S))
    return DrivingScores(
        reward=Score(
            min(float(shares.mean()) * driven_s / max(planned, driven_s), 1.0),
            "1",
            "higher",
            len(stamps_s),
            0.0,
            1.0,
        ),
        collided=ratio(int(drive.collided), 1, "lower"),
        collisions=_rate(int(drive.collided), driven_s),
        near_misses=_rate(_events(near_misses(drive, times_s), stamps_s), driven_s),
        least_ttc_s=Score(0.0 if drive.collided else least_s, "s", "higher", len(stamps_s)),
        hard_braking=_rate(_events(_brakes_hard(drive), stamps_s), driven_s),
        phantom_braking=_rate(_events(phantom_braking(drive), stamps_s), driven_s),
        progress=Score(
            float(drive.speeds.mean()) / max(drive.desired_speed_m_s, 0.1),
            "1",
            "higher",
            len(stamps_s),
            weight=driven_s,
        ),
        comfort_m_s2=rms(float((drive.accelerations**2).sum()), len(stamps_s), "m/s^2"),
    )


def near_misses(drive: ScoredDrive, times_s: np.ndarray) -> np.ndarray:
    """Return (K,) bool: when a collision is near that does not happen.

    times_s: of `times_to_collision`.
    """
    near: np.ndarray = times_s < NEAR_MISS_S
    if drive.collided:
        near &= drive.stamps_s < drive.end_s - NEAR_MISS_S - SEPARATE_S
    return near


def phantom_braking(drive: ScoredDrive) -> np.ndarray:
    """Return (K,) bool: when the ego brakes hard without a reason."""
    has_reason = drive.reference_accelerations < -REASON_M_S2
    lasting: np.ndarray = np.convolve(has_reason, np.ones(1 + round(REACTION_S / _step_s(drive))))
    phantom: np.ndarray = _brakes_hard(drive) & (lasting[: len(has_reason)] == 0)
    return phantom


def _brakes_hard(drive: ScoredDrive) -> np.ndarray:
    hard: np.ndarray = drive.accelerations < -HARD_BRAKING_M_S2
    return hard


def _step_s(drive: ScoredDrive) -> float:
    """Return the time from one instant to the next."""
    steps = np.diff(drive.stamps_s)
    return float(np.median(steps)) if len(steps) else 0.1


def times_to_collision(drive: ScoredDrive) -> np.ndarray:
    """Return (K,) seconds until the ego would touch the first road user, at most `LONGEST_S`.

    All keep their velocities and headings. Two boxes touch while their projections overlap on the
    normals of all their sides (separating axes); on each axis that is one interval of time.
    """
    count = drive.others.shape[1]
    if not count:
        return np.full(len(drive.ego), LONGEST_S)
    offsets = drive.others[..., :2] - drive.ego[:, None, :2]
    moving = drive.velocities[:, 1:] - drive.velocities[:, :1]
    start = np.full(offsets.shape[:2], -np.inf)
    end = np.full(offsets.shape[:2], np.inf)
    yaws = (np.broadcast_to(drive.ego[:, None, 2], start.shape), drive.others[..., 2])
    halves = (np.broadcast_to(drive.sizes[0] / 2, (count, 2)), drive.sizes[1:] / 2)
    for yaw in yaws:
        for turn in (0.0, math.pi / 2):
            axis = np.stack([np.cos(yaw + turn), np.sin(yaw + turn)], axis=-1)
            reach = _half_extent(halves[0], yaws[0] - yaw - turn)
            reach = reach + _half_extent(halves[1], yaws[1] - yaw - turn)
            gap, rate = (offsets * axis).sum(axis=-1), (moving * axis).sum(axis=-1)
            with np.errstate(divide="ignore", invalid="ignore"):
                one, other = (-reach - gap) / rate, (reach - gap) / rate
            still = abs(rate) < 1e-9
            is_separate = still & (abs(gap) > reach)
            start = np.maximum(start, np.where(still, -np.inf, np.minimum(one, other)))
            end = np.minimum(end, np.where(still, np.inf, np.maximum(one, other)))
            end = np.where(is_separate, -np.inf, end)
    with np.errstate(invalid="ignore"):
        meets = (start <= end) & (end >= 0.0) & (np.hypot(*offsets.T).T <= WITHIN_M)
    times_s = np.where(meets, np.maximum(start, 0.0), LONGEST_S)
    shortest: np.ndarray = np.minimum(times_s.min(axis=1), LONGEST_S)
    return shortest


def _half_extent(half: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return half the extent of boxes along an axis. half: (A, 2). turns: (K, A) from the axis."""
    extent: np.ndarray = abs(np.cos(turns)) * half[:, 0] + abs(np.sin(turns)) * half[:, 1]
    return extent


def _events(happens: np.ndarray, stamps_s: np.ndarray) -> int:
    """Return the number of events: instants at most `SEPARATE_S` apart belong to one."""
    times_s = stamps_s[happens]
    return int(len(times_s) > 0) + int((np.diff(times_s) > SEPARATE_S).sum())


def _rate(events: int, driven_s: float) -> Score:
    """Return events in an hour; drives are weighed by their duration."""
    hours = driven_s / HOUR_S
    return Score(events / hours, "1/h", "lower", 1, weight=hours)
