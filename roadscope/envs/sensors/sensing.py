"""Sensing of a timeline by a rig, frame by frame, with the truth of each frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import count, takewhile
from typing import Any, NamedTuple

import numpy as np

from roadscope.core import (
    GROUND,
    SKY,
    Calibration,
    CameraImage,
    Frame,
    PixelTruth,
    Pose,
    RecordError,
    Truth,
)
from roadscope.core.pixel_truth import GROUND_CLASS, SCENERY_CLASS, SKY_CLASS
from roadscope.envs.imaging.ground import Ground
from roadscope.envs.imaging.light import Light, daylight, light_named
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.camera import ImageTruth, expose, motion_during
from roadscope.envs.sensors.disturbance import Disturbance
from roadscope.envs.sensors.ego_motion import EgoMotion, settled_s
from roadscope.envs.sensors.faults import Fault, Faults, faults_of
from roadscope.envs.sensors.imu import InertialSampler
from roadscope.envs.sensors.lidar import LidarPath, SweepTruth, sweep
from roadscope.envs.sensors.rig import CameraMount, Rig
from roadscope.envs.sensors.rigs import RIGS
from roadscope.envs.sensors.weathers import CLEAR, Weather
from roadscope.envs.sensors.weathers import weather as find_weather
from roadscope.envs.traffic.timeline import States, Timeline
from roadscope.envs.world.ground import surface_of
from roadscope.envs.world.world import World, build_world

# --------------------------------------------------------------------------------------------------
# Truth of sweeps and images.


class _Placed(NamedTuple):
    """Where all bodies are during a sweep or an image.

    scene: without the ego's body. knots: states at the knots of the scene. around: states
    `VELOCITY_S` before the middle, in the middle, and after it. before: states at an earlier
    instant.
    """

    scene: Scene
    knots: States
    around: States
    before: States


def truth_of_sweep(timeline: Timeline, around: States, sweep_truth: SweepTruth) -> Truth:
    """Return the states of the road users, with the sources of the sweep's returns.

    around: of `_Placed`.
    """
    sources = sweep_truth.owners.astype(np.int64)
    actors = np.flatnonzero(sources >= 0)
    sources[actors] = timeline.ids[sources[actors]]
    rows, states = _present_users(timeline, around)
    return Truth(
        **states,
        lidar_returns=sweep_truth.returns[rows],
        visible_pixels=np.zeros(len(rows), np.int64),
        occluded_fraction=sweep_truth.occluded_fraction[rows],
        sources=sources,
    )


def truth_of_image(timeline: Timeline, around: States, image_truth: ImageTruth) -> Truth:
    """Return the states of the road users, with their visibility in the image.

    around: of `_Placed`.
    """
    rows, states = _present_users(timeline, around)
    return Truth(
        **states,
        lidar_returns=np.zeros(len(rows), np.int64),
        visible_pixels=image_truth.visible_pixels[rows],
        occluded_fraction=image_truth.occluded_fraction[rows],
        sources=np.empty(0, np.int64),
        image_boxes=image_truth.boxes[rows],
    )


def pixel_truth_of(timeline: Timeline, stamp_s: float, image_truth: ImageTruth) -> PixelTruth:
    """Return depth, actor id and category of every pixel, (H, W) each."""
    owners = image_truth.owners
    actors = owners >= 0
    instances = owners.astype(np.int64)
    instances[actors] = timeline.ids[owners[actors]]
    categories = np.full(owners.shape, SCENERY_CLASS, np.int8)
    categories[owners == GROUND] = GROUND_CLASS
    categories[owners == SKY] = SKY_CLASS
    categories[actors] = timeline.categories[owners[actors]]
    return PixelTruth(image_truth.depth, instances, categories, stamp_s)


def _present_users(timeline: Timeline, around: States) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the rows of all present road users except the ego, and their states in the middle."""
    centres = timeline.centres(around)
    rows = np.flatnonzero(around.present[1])
    rows = rows[rows > 0]
    heights = timeline.stances(around)[1, rows, 0] + timeline.sizes[rows, 2] / 2
    return rows, {
        "ids": timeline.ids[rows],
        "categories": timeline.categories[rows],
        "centres": np.column_stack([centres[1, rows], heights]),
        "sizes": timeline.sizes[rows],
        "yaws": around.yaws[1, rows],
        "velocities": (centres[2, rows] - centres[0, rows]) / (2 * VELOCITY_S),
        "world_from_ego": timeline.ego_poses(around.select(slice(1, 2)))[0],
        "stamp_s": float(around.stamps_s[1]),
    }


# --------------------------------------------------------------------------------------------------
# Sensing.

IMAGE_RANGE_M = 250.0
"""Scenery farther from the camera than this is not drawn."""
VELOCITY_S = 1e-3
"""True velocities are differences of places this long before and after an instant."""
KNOT_S = 0.02
"""Within a sweep poses are linear between knots this close; at 5 m/s^2 that errs by 0.25 mm."""


class Sensing:
    """Measures a timeline that may still be growing; every sweep is returned exactly once.

    The noise of a sweep depends only on the seed and the number of the sweep, so that a live
    environment and a recorded timeline give the same bytes. Faults change measurements, stamps
    and the calibration; the truth of a frame is not affected by them.

    Inertial and wheel samples come with the sweep at whose end they are complete. A rig with
    these sensors or with sway gets its frames a few recorded states late (0.3 s more in foreign
    environments), when the ego's smooth motion is settled. With sway, and with such
    a rig in foreign environments and on uneven ground, that smooth motion is the true one.
    """

    def __init__(
        self,
        rig: Rig,
        seed: int,
        style: str | None = None,
        *,
        weather: str | Weather = CLEAR,
        light: str | Light | None = None,
        faults: Faults = (),
        pixel_truth: bool = False,
    ) -> None:
        """Prepare the sensing of episodes with a rig.

        seed: of world and noise. style: roadside style; None for that of the timeline.
        light: a name of `imaging.light.LIGHTS` or a light, for the camera; None draws a daylight.
        faults: such as `fog:3` or `("night:2", "dropped-scans:1")`, see `faults.FAULTS`; they
            must not contradict weather or light. `idle_faults` are those without a sensor in the
            rig: they change nothing.
        pixel_truth: whether the truth of an image contains depth, instance and category of
            every pixel (`Truth.pixels`); needs a camera.
        """
        self.rig = rig
        self.pixel_truth = pixel_truth
        if pixel_truth:
            self._camera()
        self.style = style
        self.faults = faults_of(faults)
        self._disturbance = Disturbance.of(self.faults, seed)
        self.weather = self._disturbance.weather(find_weather(weather))
        self.light = light
        if light is not None:
            _refuse_night(light, self.faults)
        self.reset(seed)

    @property
    def idle_faults(self) -> tuple[Fault, ...]:
        """The faults without an effect on the rig."""
        return self._disturbance.idle_on(self.rig)

    @property
    def calibration(self) -> Calibration:
        """The calibration that every frame contains; an extrinsic error makes it wrong."""
        return self._disturbance.calibration(self.rig)

    @property
    def image_late_s(self) -> float:
        """Delay of the stamps of images, seconds."""
        return self._disturbance.image_late_s

    def scan_lost(self, index: int) -> bool:
        """Return whether a fault drops the index-th scan."""
        return self._disturbance.scan_lost(index)

    def image_lost(self, index: int) -> str | None:
        """Return `missing` or `black` if a fault affects the index-th image, else None."""
        return self._disturbance.image_lost(index, self._camera().spec.period_s)

    def reset(self, seed: int) -> None:
        """Start again at the first sweep, with the world of a seed."""
        self._world_seed, self._noise_seed, self._motion_seed, self._weather_seed = _seeds(seed)
        self._image_seed, light_seed = image_seeds(seed)
        rng = np.random.default_rng(light_seed)
        self._light = daylight(rng) if self.light is None else light_named(self.light, rng)
        self._disturbance = Disturbance.of(self.faults, seed)
        self._first_heading_rad: float | None = None
        self._world: World | None = None
        self._ground: Ground | None = None
        self._inertial = InertialSampler(self.rig, seed)
        self._motion_cache: EgoMotion | None = None
        self._next = 0
        self._next_image = 0

    def advance(
        self, timeline: Timeline, until_s: float, *, newest: bool = False
    ) -> list[tuple[Frame, Truth]]:
        """Return all sweeps and images that end by a time and were not returned before.

        newest: leave out, and do not cast, sweeps that are followed by another. Of a rig with an
            IMU or wheels none is left out, because their samples come with sweeps.

        A sweep that ends after the timeline waits until the timeline has grown.
        """
        return list(self._sweeps(timeline, until_s, newest=newest and not self.rig.inertial))

    def whole(self, timeline: Timeline) -> Iterator[tuple[Frame, Truth]]:
        """Yield the sweeps and images up to the timeline's end that were not returned before."""
        yield from self._sweeps(timeline, timeline.end_s)

    def _sweeps(
        self, timeline: Timeline, until_s: float, *, newest: bool = False
    ) -> Iterator[tuple[Frame, Truth]]:
        if self.rig.camera is not None:
            _refuse_terrain(timeline)
        # Rounding errors of stamps must not delay a sweep.
        settled_until_s = settled_s(timeline) if self.rig.inertial else timeline.end_s
        end_s = min(until_s, settled_until_s) + 1e-9
        while True:
            sweep_s, image_s = self._sweep_end_s(), self._image_end_s()
            if min(sweep_s, image_s) > end_s:
                return
            if sweep_s <= image_s:
                self._next += 1
                if not (newest and self._another_sweep_ends_by(end_s)):
                    yield self.sense(timeline, self._next - 1)
            else:
                self._next_image += 1
                yield self.sense_image(timeline, self._next_image - 1)

    def _sweep_end_s(self, ahead: int = 0) -> float:
        mount = self.rig.lidar
        return mount.stamp_s(self._next + ahead) + mount.spec.sweep_s / 2

    def _another_sweep_ends_by(self, end_s: float) -> bool:
        """Return whether one of the next sweeps ends by then and is not lost to a fault."""
        return any(
            not self.scan_lost(self._next + ahead)
            for ahead in takewhile(lambda n: self._sweep_end_s(n) <= end_s, count())
        )

    def _image_end_s(self) -> float:
        mount = self.rig.camera
        if mount is None:
            return np.inf
        return mount.stamp_s(self._next_image) + mount.spec.exposure_s / 2

    def sense(self, timeline: Timeline, index: int) -> tuple[Frame, Truth]:
        """Return the frame and the truth of one sweep."""
        mount = self.rig.lidar
        stamp_s = mount.stamp_s(index)
        rng = np.random.default_rng([self._noise_seed, index])
        placed = self._place_bodies(
            timeline,
            self._sweep_knots_s(stamp_s),
            stamp_s,
            mount.spec.range_max_m,
            before_s=mount.stamp_s(index - 1),
        )
        scan, sweep_truth = sweep(
            placed.scene,
            mount.spec,
            self._lidar_path(timeline, placed.knots),
            stamp_s,
            sensor=mount.name,
            rng=rng,
            weather=self.weather,
            weather_seed=self._weather_seed,
        )
        truth = truth_of_sweep(timeline, placed.around, sweep_truth)
        motion = self._motion(timeline, index, placed.before, truth.world_from_ego)
        frame = Frame(stamp_s, self.calibration, lidar=scan, previous_from_ego=motion)
        if self.rig.inertial:
            frame = self._inertial.with_samples(frame, self.rig, self._ego_motion(timeline), index)
            truth = self._with_smooth_pose(truth, timeline)
        if self.scan_lost(index):
            return replace(frame, lidar=None), replace(truth, sources=np.empty(0, np.int64))
        return frame, truth

    def sense_image(self, timeline: Timeline, index: int) -> tuple[Frame, Truth]:
        """Return the frame and the truth of one image."""
        return self.sense_image_at(timeline, self._camera().stamp_s(index))

    def sense_image_at(self, timeline: Timeline, stamp_s: float) -> tuple[Frame, Truth]:
        """Return the frame and the truth of an image whose exposure has its middle at the stamp."""
        _refuse_terrain(timeline)
        mount = self._camera()
        placed = self._place_bodies(timeline, np.array([stamp_s]), stamp_s, IMAGE_RANGE_M)
        ego_at = self._ego_at(timeline)
        smooth = self._has_smooth_motion(timeline)
        world_from_ego = ego_at(stamp_s) if smooth else timeline.ego_poses(placed.knots)[0]
        if self._ground is None:
            style = timeline.style if self.style is None else self.style
            self._ground = Ground(surface_of(timeline.road), style)
        blurred = mount.spec.motion_blur and not mount.spec.plain
        image, image_truth = expose(
            placed.scene,
            mount.spec,
            world_from_ego @ mount.ego_from_camera,
            stamp_s,
            ground=self._ground,
            light=self._light_of(timeline, stamp_s),
            categories=timeline.categories,
            sensor=mount.name,
            noise_seed=self._image_seed,
            extinction_per_m=self.weather.extinction_per_m,
            rain_mm_h=self.weather.rain_rate_mm_h,
            motion=motion_during(timeline, mount, stamp_s, ego_at) if blurred else None,
        )
        believed_s = stamp_s + self.image_late_s
        frame = Frame(believed_s, self.calibration, camera=self._delivered(image, believed_s))
        truth = truth_of_image(timeline, placed.around, image_truth)
        truth = self._with_smooth_pose(truth, timeline)
        if self.pixel_truth:
            truth = replace(truth, pixels=pixel_truth_of(timeline, stamp_s, image_truth))
        return frame, truth

    def _ego_motion(self, timeline: Timeline) -> EgoMotion:
        """Return the smooth motion of the ego, cached while the timeline is the same."""
        if self._motion_cache is None or self._motion_cache.timeline is not timeline:
            self._motion_cache = EgoMotion(timeline, self.rig.sway)
        return self._motion_cache

    def _has_smooth_motion(self, timeline: Timeline) -> bool:
        """Return whether the sensors follow a smooth motion instead of the recorded states.

        They do on a body with sway, and on an inertial rig if the recorded motion may jump or the
        ground is uneven.
        """
        rough = timeline.raw or timeline.terrain is not None
        return self.rig.sway is not None or (rough and self.rig.inertial)

    def _ego_at(self, timeline: Timeline) -> Callable[[float], Pose]:
        """Return the function from a stamp to the pose of the body with the sensors."""
        if not self._has_smooth_motion(timeline):
            return timeline.world_from_ego
        return self._ego_motion(timeline).world_from_ego

    def _with_smooth_pose(self, truth: Truth, timeline: Timeline) -> Truth:
        """Return the truth with the pose of the body with the sensors."""
        if not self._has_smooth_motion(timeline):
            return truth
        return truth._trusted(world_from_ego=self._ego_at(timeline)(truth.stamp_s))

    def _lidar_path(self, timeline: Timeline, knots: States) -> LidarPath:
        """Return the path of the LiDAR; knots: of `_Placed`."""
        ego_from_lidar = self.rig.lidar.ego_from_lidar
        if not self._has_smooth_motion(timeline):
            poses = timeline.ego_poses(knots)
            return [world_from_ego @ ego_from_lidar for world_from_ego in poses]
        return partial(self._ego_motion(timeline).mounted, ego_from_lidar)

    def _light_of(self, timeline: Timeline, stamp_s: float) -> Light:
        """Return the light, which may depend on the camera's heading at its first image.

        That heading is stored, since a live timeline drops its beginning.
        """
        first_s = self._camera().stamp_s(0)
        covered = timeline.start_s <= first_s <= timeline.end_s
        if self._first_heading_rad is None and covered:
            self._first_heading_rad = self._camera_heading(timeline, first_s)
        ahead = (
            self._camera_heading(timeline, stamp_s)
            if self._first_heading_rad is None
            else self._first_heading_rad
        )
        return self._disturbance.light(self._light, ahead)

    def _camera_heading(self, timeline: Timeline, stamp_s: float) -> float:
        """Return the heading of the camera, world frame, radians."""
        pose = timeline.world_from_ego(stamp_s) @ self._camera().ego_from_camera
        return float(np.arctan2(pose.matrix[1, 2], pose.matrix[0, 2]))

    def _delivered(self, image: CameraImage, stamp_s: float) -> CameraImage | None:
        """Return the image as it reaches the user, None if it is missing."""
        mount = self._camera()
        index = int(np.floor((image.stamp_s - mount.first_stamp_s) / mount.spec.period_s + 0.5))
        lost = self.image_lost(index)
        if lost == "missing":
            return None
        pixels = np.zeros_like(image.pixels) if lost == "black" else image.pixels
        return replace(image, pixels=pixels, stamp_s=stamp_s)

    def _camera(self) -> CameraMount:
        if self.rig.camera is None:
            raise RecordError(f"rig '{self.rig.name}' has no camera")
        return self.rig.camera

    def _motion(
        self, timeline: Timeline, index: int, before: States, world_from_ego: Pose
    ) -> Pose | None:
        """Return the estimated ego motion since the previous sweep; None for the first one.

        before: states in the middle of that sweep. world_from_ego: pose in the middle of this one.
        """
        if index == 0:
            return None
        mount = self.rig.lidar
        if timeline.raw and self.rig.inertial:
            # The states may jump where the sensors did not.
            ego_at = self._ego_motion(timeline).world_from_ego
            previous, world_from_ego = ego_at(before.stamps_s[0]), ego_at(mount.stamp_s(index))
        else:
            (previous,) = timeline.ego_poses(before)
        return self.rig.dead_reckoning.estimate(
            previous.inverse() @ world_from_ego,
            mount.spec.period_s,
            seed=self._motion_seed,
            index=index,
        )

    def _sweep_knots_s(self, stamp_s: float) -> np.ndarray:
        """Return the (K,) knots of a sweep whose middle is at the stamp."""
        half = self.rig.lidar.spec.sweep_s / 2
        return np.linspace(stamp_s - half, stamp_s + half, int(np.ceil(2 * half / KNOT_S)) + 1)

    def _place_bodies(
        self,
        timeline: Timeline,
        knots_s: np.ndarray,
        middle_s: float,
        radius_m: float,
        *,
        before_s: float = 0.0,
    ) -> _Placed:
        """Return the scene, and the states of all actors.

        knots_s: (K,) between which bodies move. The actors present and the scenery are those of
            the middle.
        radius_m: of the scenery around the ego. before_s: see `_Placed.before`.
        """
        around_s = (middle_s - VELOCITY_S, middle_s, middle_s + VELOCITY_S)
        states = timeline.at(np.concatenate([knots_s, around_s, [before_s]]))
        parts = slice(len(knots_s)), slice(len(knots_s), -1), slice(-1, None)
        knots, around, before = map(states.select, parts)
        present = around.present[1].copy()
        present[0] = False
        poses = np.concatenate([timeline.centres(knots), knots.yaws[..., None]], axis=-1)
        world = self._world_of(timeline)
        scenery = world.static_around(around.axles[1, 0], radius_m)
        scene = Scene(scenery, world.moving, knots_s, poses, present, self._world_seed)
        if timeline.terrain is not None:
            stances = timeline.stances(knots)
            scene = replace(scene, terrain=timeline.terrain, stances=stances)
        return _Placed(scene, knots, around, before)

    def _world_of(self, timeline: Timeline) -> World:
        if self._world is None:
            self._world = build_world(timeline, self._world_seed, style=self.style)
        self._world = self._world.with_actors(timeline)
        return self._world


def sense(
    timeline: Timeline, rig: Rig, seed: int, *, weather: str | Weather = CLEAR, faults: Faults = ()
) -> Iterator[tuple[Frame, Truth]]:
    """Yield the frame and the truth of every sweep of a timeline, in order."""
    yield from Sensing(rig, seed, weather=weather, faults=faults).whole(timeline)


def check_light(light: str | Light | None, rig: Rig) -> None:
    """Raise `RecordError` for a light other than day if the rig has no camera."""
    if light is None or light == "day" or rig.camera is not None:
        return
    name = light if isinstance(light, str) else "of your own"
    raise RecordError(
        f"light '{name}' changes only images, and rig '{rig.name}' has no camera; rigs with one: "
        f"{', '.join(name for name, place in RIGS.items() if place.camera)}"
    )


def _refuse_terrain(timeline: Timeline) -> None:
    """Raise `RecordError` for images of uneven ground."""
    if timeline.terrain is not None:
        raise RecordError("images show level ground only, and the ground here is uneven")


def _refuse_night(light: str | Light, faults: tuple[Fault, ...]) -> None:
    """Raise `ValueError` for a light together with a fault that sets the light."""
    for fault in faults:
        if fault.kind == "night":
            name = light if isinstance(light, str) else "of your own"
            raise ValueError(
                f"light '{name}' and fault '{fault}' both say what the light is: leave one out"
            )


def world_of(timeline: Timeline, seed: int) -> World:
    """Return the world in which `sense` measures a timeline with the same seed."""
    return build_world(timeline, _seeds(seed)[0])


def _seeds(seed: int) -> tuple[int, int, int, int]:
    """Return the seeds of world, LiDAR noise, ego-motion estimate, and weather."""
    world, noise, motion, weather = np.random.SeedSequence(seed).generate_state(4)
    return int(world), int(noise), int(motion), int(weather)


def image_seeds(seed: int) -> tuple[int, int]:
    """Return the seeds of the camera's noise and of the light; no other seed depends on them."""
    *_, noise, light = np.random.SeedSequence(seed).generate_state(6)
    return int(noise), int(light)
