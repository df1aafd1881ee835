"""Drive at random on a motorway and print what the LiDAR measures: python examples/random_agent.py.

No import of roadscope is needed: the id names the package that Gymnasium should import.
"""

import gymnasium as gym


def main(steps: int = 10) -> None:
    """Play one episode of at most this many steps."""
    env = gym.make("roadscope:roadscope/Highway-v0", rig="vlp16")
    env.action_space.seed(0)
    observation, info = env.reset(seed=0)
    print({name: box.shape for name, box in observation.items()})
    for step in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        truth = info["truth"]
        print(
            f"step {step}: reward {reward:.2f}, {len(info['frames'])} scans, "
            f"{(observation['lidar_range'] > 0).mean():.0%} of the rays came back, "
            f"{(truth.lidar_returns > 0).sum()} of {len(truth)} road users seen"
        )
        if terminated or truncated:
            break
    env.close()


if __name__ == "__main__":
    main()
