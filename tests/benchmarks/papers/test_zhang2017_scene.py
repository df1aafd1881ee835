import numpy as np
import pytest

from roadscope.benchmarks.papers import DRIVES, drive_of, sense_drive

SEED = 12345
"""Outside the seeds of the published figures."""
SIMULATED = ("straight", "straight-past", "curve")


@pytest.fixture(scope="module")
def curve():
    return sense_drive("curve", SEED)


def in_box(shot, margin_m):
    offsets = shot.points_xy - shot.truth[:2]
    c, s = np.cos(shot.truth[2]), np.sin(shot.truth[2])
    local = np.abs(offsets @ np.array([[c, -s], [s, c]]))
    return (local <= np.array([4.87, 1.85]) / 2 + margin_m).all(axis=1)


def test_simulated_drives_are_the_papers():
    k = np.arange(37)
    away = sense_drive("straight", SEED).truth
    assert np.allclose(away, np.column_stack([40 + 2 * k, 3.75 + 0 * k, 0 * k]))
    past = sense_drive("straight-past", SEED).truth
    assert np.allclose(past, np.column_stack([40 - 2 * k, 3.75 + 0 * k, -np.pi + 0 * k]))


def test_curve_is_an_arc_with_two_metres_a_frame(curve):
    truth, radius = curve.truth, 72 / np.pi
    assert len(truth) == 27
    assert truth[0] == pytest.approx([34, 0, np.pi / 2])
    assert np.diff(truth[:, 2]) == pytest.approx(-np.pi / 36)
    assert np.hypot(truth[:, 0] - 34 - radius, truth[:, 1]) == pytest.approx(radius)
    steps = np.linalg.norm(np.diff(truth[:, :2], axis=0), axis=1)
    assert steps == pytest.approx(2 * radius * np.sin(np.pi / 72))


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("body", ["sharp", "rounded"])
def test_returns_of_the_target_lie_in_its_box(name, body):
    run = sense_drive(name, SEED, body=body, frames=12)
    for shot in run.sweeps:
        assert len(shot.scan) == len(shot.target)
        assert shot.target.sum() >= 5
        # Five standard deviations of range; in a rolling sweep the car also moves a little.
        assert in_box(shot, 0.1 if name in SIMULATED else 0.15).all()
        assert not in_box(shot, -0.6).all()


@pytest.mark.parametrize("distance", [10, 50])
def test_following_keeps_the_distance_within_three_metres(distance):
    for seed in range(5):
        drive = drive_of(f"following-{distance}", seed)
        stamps = np.linspace(0, 50, 501)
        car, sensor = drive.car(stamps), drive.sensor(stamps)
        gap = np.linalg.norm((car - sensor)[:, :2], axis=1)
        assert (np.abs(gap - distance) < 3.5).all()
        assert np.ptp(gap) > 0.5
        speed = np.linalg.norm(np.diff(sensor[:, :2], axis=0), axis=1) / 0.1
        assert (np.abs(speed - 3.0) < 0.03).all()
        heading = np.arctan2(np.diff(car[:, 1]), np.diff(car[:, 0]))
        assert np.abs(heading - car[:-1, 2]).max() < 0.02


def test_a_snapshot_stands_and_a_rolling_sweep_does_not():
    """Away from the middle of the sweep, at the rear, a moving car is seen behind its stamp."""
    still, moving = (
        sense_drive("straight-past", SEED, rolling=r).sweeps[-1] for r in (False, True)
    )
    assert np.array_equal(still.truth, moving.truth)
    assert in_box(still, 0.1).all()
    assert not in_box(moving, 0.3).all()


def test_seeds_vary_noise_and_phase_only(curve):
    again, other = sense_drive("curve", SEED), sense_drive("curve", SEED + 1)
    assert np.array_equal(curve.sweeps[3].scan.points, again.sweeps[3].scan.points)
    assert np.array_equal(curve.truth, other.truth)
    assert not np.array_equal(curve.sweeps[3].points_xy, other.sweeps[3].points_xy)
    step = 2 * np.pi / curve.spec.columns
    assert all(0 <= shot.phase < step for shot in curve.sweeps)
    assert len({shot.phase for shot in curve.sweeps}) == 27


def test_half_the_noise_is_half_the_scatter():
    usual, quiet = (sense_drive("straight", SEED, noise=n, frames=8) for n in (1.0, 0.5))
    errors = [
        np.concatenate([s.points_xy[:, 0] - s.truth[0] + 2.435 for s in run.sweeps])
        for run in (usual, quiet)
    ]
    assert np.median(np.abs(errors[1])) == pytest.approx(np.median(np.abs(errors[0])) / 2, rel=0.2)


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="no drive 'circle'; known: straight, straight-past"):
        sense_drive("circle", SEED)
    with pytest.raises(ValueError, match="no body 'brick'"):
        sense_drive("curve", SEED, body="brick")
