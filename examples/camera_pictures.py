"""Render the pictures of the documentation: python examples/camera_pictures.py docs/images."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from roadscope.core import Pose
from roadscope.envs.imaging.ground import Ground
from roadscope.envs.imaging.light import light_named
from roadscope.envs.imaging.pinhole import Pinhole, mounted
from roadscope.envs.sensors.camera import expose
from roadscope.envs.sensors.camera_spec import CameraSpec
from roadscope.envs.sensors.exposure import Motion
from roadscope.envs.sensors.rigs import rig
from roadscope.envs.sensors.sensing import Sensing
from roadscope.envs.sensors.weather import weather
from roadscope.envs.traffic.scenarios import record
from roadscope.envs.world.ground import surface_of

# Scenario, seed, time, kind of light, weather.
PICTURES = {
    "street-day": ("town-crossing", 5, 4.0, "day", "clear"),
    "motorway-rain": ("motorway", 5, 3.0, "overcast", "rain-3"),
    "roundabout-dusk": ("roundabout", 1, 4.0, "dusk", "clear"),
    "street-night": ("street", 11, 8.0, "night", "clear"),
    "town-fog": ("town-crossing", 3, 4.0, "day", "fog-2"),
}
SPEC = CameraSpec("picture", Pinhole.centred(1280, 960, 900.0), period_s=0.05)


def picture(scenario: str, seed: int, stamp_s: float, kind: str, air: str) -> np.ndarray:
    """Return what a camera behind the ego's windscreen sees, (960, 1280, 3) uint8."""
    timeline = record(scenario, seed, stamp_s + 1.0)
    scene, egos = Sensing(rig("wide"), seed)._place(timeline, np.array([stamp_s]), 250.0)
    axles = timeline.at(np.array([stamp_s - 0.01, stamp_s + 0.01])).axles
    speeds = (axles[1] - axles[0]) / 0.02
    motion = Motion(np.append(speeds[0], 0.0), np.zeros(3), speeds)
    world_from_camera: Pose = egos[0] @ mounted(2.0, 0.0, 1.4)
    rain_or_fog = weather(air)
    image, _ = expose(
        scene, SPEC, world_from_camera, stamp_s, motion=motion,
        ground=Ground(surface_of(timeline.road), timeline.style),
        light=light_named(kind, np.random.default_rng(seed)), categories=timeline.categories,
        extinction_per_m=rain_or_fog.extinction_per_m, rain_mm_h=rain_or_fog.rain_rate_mm_h,
    )  # fmt: skip
    return image.pixels


def main() -> None:
    """Write all pictures into the folder given, at half size."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images")
    folder.mkdir(parents=True, exist_ok=True)
    for name, choice in PICTURES.items():
        half = Image.fromarray(picture(*choice)).reduce(2)
        # Noise in the last bits is what makes such files large; at night there is more of it.
        step = 8 if choice[3] == "night" else 4
        smooth = half.point([step * (v // step) for v in range(256)] * 3)
        smooth.save(folder / f"{name}.png", optimize=True)
        print(folder / f"{name}.png")


if __name__ == "__main__":
    main()
