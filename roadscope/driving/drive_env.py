"""The closed loop as a Gymnasium environment: an agent learns to drive on what is perceived."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from roadscope.core import DrivingScene
from roadscope.driving.agent import ACTIONS, DECISION_STEPS, LARGEST, OBSERVED, command_of, observed
from roadscope.driving.closed_loop import ClosedLoop
from roadscope.driving.perception import TRUTH, stack_of
from roadscope.envs.gym.observer import checked_seed, warn_without_render_mode
from roadscope.envs.gym.spaces import checked_action
from roadscope.envs.gym.vector import PooledVectorEnv, pooled
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as rig_named
from roadscope.envs.sensors.sensing import Sensing, check_light
from roadscope.envs.sensors.weathers import Weather
from roadscope.envs.traffic.driven import check_driven
from roadscope.envs.traffic.scenarios import find

if TYPE_CHECKING:
    from roadscope.driving.picture import DrivePictures

Names = str | Sequence[str]


class DriveEnv(gym.Env[np.ndarray, np.int64]):
    """Drives of an agent on perceived traffic; the traffic reacts to the agent.

    scenario: one that the board `driving` takes, or several, of which each episode has one at
        random.
    perception: a stack, `DETECTOR + TRACKER [+ N ms]`; `truth`; `blind`; or several, likewise.
    rig: for all stacks. duration_s: of an episode; None: that of the scenario.
    weather, light, faults: of the sensors in all episodes, as in `SensorWrapper`; `truth` and
        `blind` have no sensors.
    seeds: of traffic and world, of which each episode has one at random. The default, 0 to 9999,
        are the training seeds of suites: the test seeds of boards begin at 20,000.

    An observation is (71,) float32 (`observed`), an action one of 7 (`command_of`): five
    accelerations, and a change to the left and to the right. A step lasts 0.2 s. Its reward is its
    duration in seconds, times the ratio of speed to desired speed, which counts as at most 1. An
    episode terminates with a collision. It is truncated when the time is up or the road ends.
    `render_mode="rgb_array"` draws what is true, what was sensed and what the agent believes.
    `info` has `scenario`, `seed`, `perception` and, from the first step on, `time_s` since the
    start and `collided`.

    Gymnasium's own seed decides what is drawn for an episode. `options` of `reset` may have `seed`,
    `scenario` and `perception`, which then are not drawn; None is drawn.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012

    def __init__(
        self,
        scenario: Names = "motorway",
        *,
        perception: Names = TRUTH,
        rig: str | Rig = "vlp16",
        duration_s: float | None = None,
        seeds: range = range(10_000),
        weather: str | Weather = "clear",
        light: str | Light | None = None,
        faults: Faults = (),
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode: expected 'rgb_array' or None, got {render_mode!r}")
        self.render_mode = render_mode
        self._scenarios, self._perceptions = _several(scenario), _several(perception)
        for name, values in (
            ("scenario", self._scenarios),
            ("perception", self._perceptions),
            ("seeds", seeds),
        ):
            if not values:
                raise ValueError(f"{name}: expected at least one")
        if duration_s is not None and not duration_s > 0:
            raise ValueError(f"duration_s: expected more than 0, got {duration_s}")
        self._rig = rig_named(rig) if isinstance(rig, str) else rig
        self._duration_s, self._seeds = duration_s, seeds
        self._conditions: dict[str, Any] = {"weather": weather, "light": light, "faults": faults}
        Sensing(self._rig, 0, **self._conditions)  # Wrong names are reported before a drive begins.
        check_light(light, self._rig)
        for each in self._scenarios:
            check_driven(each)
        self._stacks = {text: stack_of(text, self._rig) for text in self._perceptions}
        self.observation_space = gym.spaces.Box(-LARGEST, LARGEST, (OBSERVED,), np.float32)
        self.action_space = gym.spaces.Discrete(ACTIONS)
        self._loop: ClosedLoop | None = None
        self._scene: DrivingScene | None = None
        self._pictures: DrivePictures | None = None

    @property
    def scene(self) -> DrivingScene:
        """What a driver of the board would get now; the observation is made from it."""
        if self._scene is None:
            raise gym.error.ResetNeeded("call reset before asking for the scene")
        return self._scene

    @property
    def true_scene(self) -> DrivingScene:
        """The scene with all road users as they are, whatever is perceived: for a teacher."""
        if self._loop is None:
            raise gym.error.ResetNeeded("call reset before asking for the true scene")
        return self._loop.scene(self._loop.traffic.true_tracks())

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a drive."""
        super().reset(seed=seed)
        drawn = {
            "scenario": str(self.np_random.choice(self._scenarios)),
            "perception": str(self.np_random.choice(self._perceptions)),
            "seed": int(self._seeds[self.np_random.integers(len(self._seeds))]),
        }
        if unknown := set(options or {}) - set(drawn):
            raise ValueError(
                f"unknown options: {', '.join(map(repr, sorted(unknown)))}; "
                f"possible: {', '.join(drawn)}"
            )
        info = {**drawn, **_checked(options or {})}
        scenario, perception = info["scenario"], info["perception"]
        if perception not in self._stacks:
            self._stacks[perception] = stack_of(perception, self._rig)
        duration_s = find(scenario).duration_s if self._duration_s is None else self._duration_s
        self._loop = ClosedLoop(
            scenario,
            info["seed"],
            perception=self._stacks[perception],
            rig=self._rig,
            duration_s=duration_s,
            **self._conditions,
        )
        self._info, self._scene = info, self._loop.scene(self._loop.tracks())
        self._reward = 0.0
        if self.render_mode is not None:
            from roadscope.driving.picture import DrivePictures

            self._pictures = DrivePictures(f"{scenario}, {perception}")
            self._pictures.add(self._loop, self._scene, self._reward)
        return observed(self._scene), dict(info)

    def step(self, action: np.int64 | int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Drive for 0.2 s; raise `ValueError` for an action that is not in the space."""
        loop, scene, reward = self._loop, self._scene, 0.0
        if loop is None or scene is None:
            raise gym.error.ResetNeeded("call reset before step")
        number = int(checked_action(self.action_space, action))
        for _ in range(DECISION_STEPS):
            if loop.over:
                break
            traffic = loop.traffic
            before_s = traffic.now_s
            speed_ratio = min(traffic.speed_m_s / max(traffic.desired_speed_m_s, 0.1), 1.0)
            loop.step(command_of(number, scene))
            reward += (traffic.now_s - before_s) * speed_ratio
            scene = loop.scene(loop.tracks())
        self._scene = scene
        self._reward += reward
        if self._pictures is not None:
            self._pictures.add(loop, scene, self._reward)
        collided = loop.traffic.collided_with is not None
        info = {**self._info, "time_s": loop.traffic.now_s, "collided": collided}
        return observed(scene), reward, collided, loop.over and not collided, info

    def render(self) -> np.ndarray | None:
        """Return a picture of what is true and what the agent believes, (720, 1280, 3) uint8.

        Without a render mode it warns and returns None.
        """
        if self.render_mode is None:
            warn_without_render_mode()
            return None
        if self._loop is None or self._pictures is None:
            raise gym.error.ResetNeeded("call reset before render")
        return self._pictures.draw(self._loop)


def _checked(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a reset that are not None; raise an error for impossible values."""
    chosen = {name: value for name, value in options.items() if value is not None}
    for name, value in chosen.items():
        if name == "seed":
            chosen[name] = checked_seed(value)
        elif not isinstance(value, str):
            raise TypeError(f"options['{name}']: expected one name, got {value!r}")
    return chosen


def _several(names: Names) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def drive_envs(num_envs: int, **settings: Any) -> PooledVectorEnv:
    """Return several `DriveEnv` as one; `pooled` has the settings."""
    return pooled(DriveEnv, num_envs, **settings)
