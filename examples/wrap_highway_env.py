"""Put sensors on a highway-env environment, find vehicles: python examples/wrap_highway_env.py.

The policy runs at 1 Hz and the LiDAR at 12.5 Hz: `info["frames"]` has every scan in between.
"""

import gymnasium as gym
import highway_env  # noqa: F401  (registers its ids)

from roadscope import DETECTORS, SensorWrapper

IDLE = 1


def main(steps: int = 5) -> None:
    """Keep the lane for some steps and detect vehicles in every scan."""
    env = SensorWrapper(gym.make("roundabout-v1"), rig="lux")
    detector = DETECTORS.make("pag")
    env.reset(seed=0)
    for step in range(steps):
        *_, terminated, truncated, info = env.step(IDLE)
        counts = [len(detector.detect(frame)) for frame in info["frames"]]
        print(f"step {step}: {len(counts)} scans, detections in each: {counts}")
        if terminated or truncated:
            break
    env.close()


if __name__ == "__main__":
    main()
