"""Render the pictures of the documentation: python examples/camera_pictures.py docs/images."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from roadscope.envs import (
    CameraMount,
    CameraSpec,
    Pinhole,
    Sensing,
    camera_pose,
    find_rig,
    record_traffic,
)

# Scenario, seed, time, kind of light, weather.
PICTURES = {
    "street-day": ("street", 5181, 4.55, "day", "clear"),
    "motorway-rain": ("motorway", 5, 3.0, "overcast", "rain-3"),
    "roundabout-dusk": ("roundabout", 1, 4.0, "dusk", "clear"),
    "street-night": ("street", 11, 8.0, "night", "clear"),
    "town-fog": ("town-crossing", 7842, 4.05, "day", "fog-2"),
}
SPEC = CameraSpec("picture", Pinhole.centred(1280, 960, 900.0), period_s=0.05)


def picture(scenario: str, seed: int, stamp_s: float, light: str, air: str) -> np.ndarray:
    """Return what a camera behind the ego's windscreen sees, (960, 1280, 3) uint8."""
    timeline = record_traffic(scenario, seed, stamp_s + 1.0)
    camera = CameraMount("camera", SPEC, camera_pose(2.0, 0.0, 1.4))
    sensing = Sensing(replace(find_rig("wide"), camera=camera), seed, weather=air, light=light)
    frame, _ = sensing.sense_image_at(timeline, stamp_s)
    return frame.camera.pixels


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
