"""Train PPO on LiDAR images: pip install 'roadscope[rl]', then python examples/train_ppo.py.

The budget is tiny, to show that it runs; `python examples/train_ppo.py 200000` begins to learn.
"""

import sys

import gymnasium as gym
from stable_baselines3 import PPO

import roadscope  # noqa: F401  (registers its ids)


def make() -> gym.Env:
    """Return a light environment: few beams, dense records left out, a decision every second."""
    return gym.make("roadscope/Merge-v0", rig="lux", records=False)


def main(total_timesteps: int = 64) -> None:
    """Train, then drive one episode with what was learnt."""
    model = PPO("MultiInputPolicy", make(), n_steps=32, batch_size=32, n_epochs=2, seed=0)
    model.learn(total_timesteps)
    env = make()
    observation, _ = env.reset(seed=1)
    total, done = 0.0, False
    while not done:
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, terminated, truncated, _ = env.step(int(action))
        total, done = total + float(reward), terminated or truncated
    print(f"trained for {model.num_timesteps} steps; return of one episode: {total:.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
