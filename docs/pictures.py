"""Draw a picture of every scenario: python docs/pictures.py docs/images/scenarios [NAME ...]."""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image

import roadscope
from roadscope.benchmarks import names_of

MOMENTS = {"cold-start": 1.0, "convoy-pull-away": 6.0, "stop-and-go": 6.0, "cut-ins": 6.0}
"""Seconds after which the picture is taken, where it is not `USUAL_S`; chosen by looking."""
USUAL_S = 3.0
SEED = 1
HEIGHT = 300
COLOURS = ((160, Image.Quantize.MEDIANCUT), (96, Image.Quantize.FASTOCTREE))
"""Most colours of the camera's image and of the view from above, 256 together, so that files are
small; the second method keeps rare colours."""


def picture(scenario: str) -> Image.Image:
    """Return the camera's image and the view from above, side by side."""
    try:
        views = seen(scenario, "wide")
    except roadscope.RecordError:  # images show level ground only
        views = seen(scenario, "hdl32e")
    sides = [
        view.resize((round(view.width * HEIGHT / view.height), HEIGHT), Image.Resampling.LANCZOS)
        .quantize(colours, method, dither=Image.Dither.NONE)
        .convert("RGB")
        for view, (colours, method) in zip(views, COLOURS[-len(views) :], strict=True)
    ]
    whole = Image.new("RGB", (sum(side.width for side in sides), HEIGHT))
    for k, side in enumerate(sides):
        whole.paste(side, (sum(each.width for each in sides[:k]), 0))
    return whole


def seen(scenario: str, rig: str) -> list[Image.Image]:
    """Return the camera's image, if the rig has a camera, and the view from above."""
    env = roadscope.make(scenario, ego="idm", rig=rig, render_mode="rgb_array")
    observation, _ = env.reset(seed=SEED)
    for _ in range(round(MOMENTS.get(scenario, USUAL_S) / 0.1)):
        observation, _, ended, cut, _ = env.step(0)
        if ended or cut:
            break
    images = [observation["image"]] if "image" in observation else []
    above = _from_above(env)
    env.close()
    return [Image.fromarray(each) for each in (*images, above)]


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
