"""Follow the ego's motion in a highway-env environment: python examples/odometry_on_board.py.

The odometry gets the scans of a VLP-16 and the samples of an inertial unit. Printed errors are
computed from the truth, which the odometry never gets.
"""

import gymnasium as gym
import highway_env  # noqa: F401  (registers its ids)
import numpy as np

from roadscope import ODOMETRIES, SensorWrapper

IDLE = 1


def main(steps: int = 10) -> None:
    """Keep the lane for some steps of a second each; the odometry gets every scan."""
    env = SensorWrapper(gym.make("highway-v0"), rig="vlp16-imu")
    odometry = ODOMETRIES.make("lidar-inertial")
    env.reset(seed=0)
    start = None
    for step in range(steps):
        *_, terminated, truncated, info = env.step(IDLE)
        for frame, truth in zip(info["frames"], info["truths"], strict=True):
            lidar, imu = (frame.calibration.pose(name) for name in ("lidar", "imu"))
            true = truth.world_from_ego @ lidar
            if start is None:
                start = true
                odometry.reset(lidar.inverse() @ imu)
            estimate = odometry.update(frame.lidar, frame.imu)
        moved = (start.inverse() @ true).translation
        error_m = np.linalg.norm(estimate.start_from_lidar.translation - moved)
        note = f", degraded: {estimate.reason}" if estimate.reason else ""
        print(f"step {step}: {np.linalg.norm(moved):.1f} m away, {error_m:.2f} m off{note}")
        if terminated or truncated:
            break
    env.close()


if __name__ == "__main__":
    main()
