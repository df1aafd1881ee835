"""What a sensor makes of the light: vignetting and noise."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled(borrowing=True)
def develop(
    pixels: np.ndarray,
    linear: np.ndarray,
    curve: np.ndarray,
    loss: np.ndarray,
    electrons: np.ndarray,
    key: np.uint64,
) -> None:
    """Darken and roughen pixels (H, W, 3) in place.

    linear: (256,) light of each byte. curve: (4096,) bytes of light. loss: (3,) share lost in
    the corners, then the principal point in pixels. electrons: (2,) full well and read noise.
    Draws depend on key and place alone.
    """
    height, width = pixels.shape[:2]
    corner = max(loss[1], width - loss[1]) ** 2 + max(loss[2], height - loss[2]) ** 2
    steps = len(curve) - 1
    for r in range(height):
        dy = (r + 0.5 - loss[2]) ** 2
        for c in range(width):
            dx = c + 0.5 - loss[1]
            pass_through = 1.0 - loss[0] * (dx * dx + dy) / corner
            state = key + np.uint64(r * width + c) * np.uint64(0x9E3779B97F4A7C15)
            for k in range(3):
                state ^= state >> np.uint64(30)
                state *= np.uint64(0xBF58476D1CE4E5B9)
                state ^= state >> np.uint64(27)
                light = linear[pixels[r, c, k]] * pass_through
                spread = np.sqrt(light / electrons[0] + (electrons[1] / electrons[0]) ** 2)
                value = light + spread * _bell(state)
                pixels[r, c, k] = curve[int(min(1.0, max(0.0, value)) * steps)]


@compiled(forceinline=True, borrowing=True)
def _bell(state: np.uint64) -> float:
    """Sum of four uniform draws, mean 0, variance 1; bounded at 3.5."""
    total = 0.0
    for i in range(4):
        total += np.float64((state >> np.uint64(16 * i)) & np.uint64(0xFFFF))
    bell: float = (total / 65536.0 - 2.0) * 1.7320508075688772
    return bell
