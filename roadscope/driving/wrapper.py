"""highway-env environments whose observations are made of what is perceived."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs

from roadscope.core import Tracks
from roadscope.driving.belief import BelievedObservation, check_observation
from roadscope.driving.perception import BLIND, TRUTH, Perception
from roadscope.envs.gym.highway import ScenarioEnv, observe_nothing
from roadscope.envs.gym.observer import rig_of
from roadscope.envs.gym.sensor_wrapper import SensorWrapper, refuse_sensors
from roadscope.envs.gym.spaces import checked_action
from roadscope.envs.gym.vector import PooledVectorEnv, pooled
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.weathers import Weather
from roadscope.envs.traffic.conversion import (
    Constants,
    ForeignEnvError,
    original_constants,
    own_constants,
    refuse_multi_agent,
)


class PerceptionWrapper(gym.Wrapper[np.ndarray, Any, Any, Any], RecordConstructorArgs):
    """Makes the observation of a highway-env environment of tracks in place of true vehicles.

    env: a single-agent environment with an observation of type `Kinematics`, `OccupancyGrid` or
        `TimeToCollision`. The space and the layout of the observation stay as they are. Wrappers
        that change observations go around this one.
    perception: `DETECTOR + TRACKER` or `DETECTOR + TRACKER + 200 ms` (see `Perception`);
        `truth`: highway-env's own observation; `blind`: no other vehicle is ever observed.
    rig, seed, style, weather, light, faults: of the sensors, as in `SensorWrapper`.

    Sensors and perception run at the rate of the sensors between two steps. An observation holds
    the tracks that are not tentative, moved on to the instant of the step at constant velocity, so
    it contains missed vehicles, ghosts, delays and errors as they come. At first nothing is
    tracked. The ego's own state, lanes and fixed obstacles are true; tracks more than 3 m beside
    every lane are left out.

    `info["tracks"]` has the tracks, frame `world`, except with `truth`. Other entries are those of
    `SensorWrapper`; without sensors there is only `time_s`. Traffic, rewards and ends of episodes
    are those of the environment.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        perception: str,
        rig: str | Rig = "hdl32e",
        *,
        seed: int | None = None,
        style: str | None = None,
        weather: str | Weather = "clear",
        light: str | Light | None = None,
        faults: Faults = (),
    ) -> None:
        sensing: dict[str, Any] = {
            "seed": seed,
            "style": style,
            "weather": weather,
            "light": light,
            "faults": faults,
        }
        RecordConstructorArgs.__init__(self, perception=perception, rig=rig, **sensing)
        self._stack: Perception | None = None
        refuse_multi_agent(env)
        if perception != TRUTH:
            check_observation(_observation_of(env))
            refuse_sensors(env)
            _refuse_changed_observations(env)
        if perception in (TRUTH, BLIND):
            gym.Wrapper.__init__(self, env)
        else:
            self._stack = Perception(perception, rig_of(rig))
            sensed: gym.Env[Any, Any] = SensorWrapper(env, rig, **sensing)
            gym.Wrapper.__init__(self, sensed)
        if perception != TRUTH:
            self.observation_space = env.observation_space
        self._perception = perception
        self._belief: BelievedObservation | None = None
        self._tracks: Tracks | None = None
        self._believed_type: dict[str, Any] | None = None
        self._constants: Constants = {}

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """The environment's, with this wrapper, which itself adds the sensors."""
        spec = super().spec
        if spec is None or self._stack is None:
            return spec
        *outer, _, own = spec.additional_wrappers
        return replace(spec, additional_wrappers=(*outer, own))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode."""
        # `SensorWrapper` keeps the constants of drivers too, if there is one.
        with original_constants(self._constants) if self._stack is None else nullcontext():
            observation, info = self.env.reset(seed=seed, options=options)
        if self._perception != TRUTH:
            self._belief = BelievedObservation(self.env.unwrapped, seed or 0, self._believed_type)
            # A reset may change the settings of the environment.
            if self._belief.space != self.observation_space:
                self.observation_space = self._belief.space
        if self._stack is not None:
            self._stack.reset()
        return self._observed(observation, info)

    def step(self, action: Any) -> tuple[np.ndarray, SupportsFloat, bool, bool, dict[str, Any]]:
        """Drive for one step; sense, detect and track meanwhile."""
        action = checked_action(self.action_space, action)
        with own_constants(self._constants) if self._stack is None else nullcontext():
            observation, reward, terminated, truncated, info = self.env.step(action)
        if self._stack is not None:
            self._stack.update(info["frames"], info["truths"], info["time_s"])
        believed, info = self._observed(observation, info)
        return believed, reward, terminated, truncated, info

    def render(self) -> Any:
        """Return the picture of the environment; that of sensors shows the tracks too."""
        if self._stack is None or self.render_mode != "rgb_array":
            return super().render()
        sensors: Any = self.env
        return sensors.draw(self._tracks)

    def _observe_tracks_only(self) -> None:
        """Let the environment make no observations of its own, which nobody reads."""
        self._believed_type = dict(_observation_of(self.env))
        observe_nothing(self.env)

    def _observed(
        self, observation: np.ndarray, info: dict[str, Any]
    ) -> tuple[np.ndarray, dict[str, Any]]:
        if self._stack is None:
            inner: Any = self.env.unwrapped
            # highway-env counts steps of the physics, of which a step may have too few for its
            # nominal period; the sensors' clock counts them too.
            info = {**info, "time_s": inner.steps * (1 / inner.config["simulation_frequency"])}
        if self._belief is None:
            return observation, info
        if self._stack is None:
            tracks = Tracks.empty(info["time_s"], "world")
        else:
            tracks = self._stack.tracks(info["time_s"])
        self._tracks = tracks
        return self._belief.observe(tracks), {**info, "tracks": tracks}


def _refuse_changed_observations(env: gym.Env[Any, Any]) -> None:
    """Raise `ForeignEnvError` if a wrapper changes the observations of the environment.

    Those of tracks are made above it, so it would have no effect.
    """
    layer = env
    while isinstance(layer, gym.Wrapper):
        changes = isinstance(layer, gym.ObservationWrapper)
        if changes or layer.observation_space != layer.env.observation_space:
            raise ForeignEnvError(
                f"{type(layer).__name__} changes observations, but those of tracks are made by "
                f"PerceptionWrapper: put {type(layer).__name__} around it"
            )
        layer = layer.env


def _observation_of(env: gym.Env[Any, Any]) -> dict[str, Any]:
    """Return the settings of the observation of an environment of highway-env."""
    settings: dict[str, Any] = env.unwrapped.config["observation"]  # type: ignore[attr-defined]
    return settings


WITHOUT_EFFECT = {"records": True, "pixel_truth": False}
"""Settings of sensors that change nothing where tracks are observed, and the values they have."""


class PerceivedEnv(ScenarioEnv):
    """A scenario that an agent observes through a perception stack, if one is named.

    perception: as in `PerceptionWrapper`; the observation space is then highway-env's, with the
        extreme values of its type in place of infinite bounds. None: observations are those of the
        sensors. Other arguments: those of `ScenarioEnv`, except records=False and pixel_truth=True.
    """

    def __init__(self, scenario: str, *, perception: str | None = None, **settings: Any) -> None:
        self._perception = perception
        if perception is not None:
            _check_settings(settings)
        super().__init__(scenario, **settings)
        if perception is not None:
            self.observation_space = _bounded(self.observation_space)

    @property
    def compute_reward(self) -> Callable[..., Any]:
        """The reward of `parking-lot` on `truth`, of a goal achieved, a goal desired and an info.

        Learning with other goals in hindsight calls it. Other environments do not have it, since
        libraries recognise observations with goals by it.
        """
        if self._perception != TRUTH:
            raise AttributeError("compute_reward: only with perception='truth'")
        reward: Callable[..., Any] = self._inner.unwrapped.compute_reward  # type: ignore[attr-defined]
        return reward

    def _with_sensors(self, traffic: gym.Env[Any, Any], rig: str | Rig, **sensing: Any) -> Any:
        if self._perception is None:
            return super()._with_sensors(traffic, rig, **sensing)
        for name in WITHOUT_EFFECT:
            del sensing[name]
        perceived = PerceptionWrapper(traffic, self._perception, rig, **sensing)
        # The order of vehicles in an observation may be drawn with the numbers of the traffic.
        if self._perception != TRUTH and _observation_of(traffic).get("order") != "shuffled":
            perceived._observe_tracks_only()
        return perceived


def _check_settings(settings: dict[str, Any]) -> None:
    """Raise `ValueError` for settings that perception excludes; the ego is an agent."""
    if settings.setdefault("ego", "agent") != "agent":
        raise ValueError("perception: only with ego='agent'; a played ego drives itself")
    for name, value in WITHOUT_EFFECT.items():
        if settings.get(name, value) != value:
            raise ValueError(
                f"{name}={settings[name]}: only without perception=, whose observations are tracks"
            )


def _bounded(space: gym.Space[Any]) -> gym.Space[Any]:
    """Return a box of floats with the extreme values of its type in place of infinite bounds."""
    if not isinstance(space, gym.spaces.Box) or not np.issubdtype(space.dtype, np.floating):
        return space
    most = np.finfo(space.dtype).max
    low, high = np.maximum(space.low, -most), np.minimum(space.high, most)
    return gym.spaces.Box(low, high, dtype=space.dtype.type)


def perceived_envs(num_envs: int, **settings: Any) -> PooledVectorEnv:
    """Return several `PerceivedEnv` as one; `pooled` has the settings."""
    return pooled(PerceivedEnv, num_envs, **settings)
