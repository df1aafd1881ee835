"""Draw a picture of every scenario: python docs/pictures.py docs/images/scenarios [NAME ...]."""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image

import roadscope
from roadscope.benchmarks.listing import names_of

MOMENTS = {"cold-start": 1.0, "convoy-pull-away": 6.0, "stop-and-go": 6.0, "cut-ins": 6.0}
"""Seconds after which the picture is taken, where it is not `USUAL_S`; chosen by looking."""
USUAL_S = 3.0
SEED = 1
HEIGHT = 300
COLOURS = (
    (160, Image.Quantize.MEDIANCUT),
    (96, Image.Quantize.FASTOCTREE),
)
"""Most colours of the camera's image and of the view from above, 256 together, so that files are
small; the second method keeps rare colours."""


def picture(scenario: str) -> Image.Image:
    """Return the camera's image and the view from above, side by side."""
    settings = {"ego": "idm", "rig": "wide", "render_mode": "rgb_array"}
    env = roadscope.make(scenario, **settings)
    observation, _ = env.reset(seed=SEED)
    for _ in range(round(MOMENTS.get(scenario, USUAL_S) / 0.1)):
        observation, _, ended, cut, _ = env.step(0)
        if ended or cut:
            break
    both = [Image.fromarray(np.asarray(a)) for a in (observation["image"], _from_above(env))]
    env.close()
    sides = [
        each.resize((round(each.width * HEIGHT / each.height), HEIGHT), Image.Resampling.LANCZOS)
        .quantize(colours, method, dither=Image.Dither.NONE)
        .convert("RGB")
        for each, (colours, method) in zip(both, COLOURS, strict=True)
    ]
    whole = Image.new("RGB", (sum(a.width for a in sides), HEIGHT))
    whole.paste(sides[0], (0, 0))
    whole.paste(sides[1], (sides[0].width, 0))
    return whole


def _from_above(env: gym.Env) -> np.ndarray:
    """Return the left part of the frame that an environment draws, a square."""
    frame = np.asarray(env.render())
    return frame[:, : len(frame)]


def main() -> None:
    """Write the pictures into the folder given."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/scenarios")
    folder.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[2:] or [name for name, _ in names_of("scenarios")]:
        picture(name).quantize(256, Image.Quantize.MAXCOVERAGE).save(
            folder / f"{name}.png", optimize=True
        )
        print(folder / f"{name}.png", (folder / f"{name}.png").stat().st_size)


if __name__ == "__main__":
    main()
