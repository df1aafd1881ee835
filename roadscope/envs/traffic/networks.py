"""Road networks of highway-env's environments without their traffic."""

from __future__ import annotations

from typing import Any

import numpy as np


def network_of(
    env_class: Any, *, builder: str = "_make_road", config: Any = None, **arguments: Any
) -> Any:
    """Return the road that an environment class builds, with no vehicle on it.

    The environment is never constructed: that would run its own traffic and, for intersections,
    change constants of highway-env's drivers for the whole process.
    """
    env = env_class.__new__(env_class)
    env.config = {**env_class.default_config(), **(config or {})}
    env._np_random = np.random.default_rng(0)
    env._np_random_seed = 0
    getattr(env, builder)(**arguments)
    return env.road
