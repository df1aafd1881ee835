"""One pass over the pixels of a crop that gives it other light."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled()
def relight(
    pixels: np.ndarray,
    tables: np.ndarray,
    colour: np.float32,
    noise: np.float32,
    normals: np.ndarray,
    first: int,
    lit: np.ndarray,
) -> None:
    """Write (h, w, 3) float32 in 0 to 1 into `lit`.

    tables: (3, 256) float32, what becomes of the bytes of each colour. colour: of a pixel, times
    its distance from grey. noise: standard deviation; its draws are read from normals (N,),
    N a multiple of 3, from place `first` on, round and round.
    """
    zero, one, third = np.float32(0), np.float32(1), np.float32(1 / 3)
    place = first
    for i in range(pixels.shape[0]):
        for j in range(pixels.shape[1]):
            red = tables[0, pixels[i, j, 0]]
            green = tables[1, pixels[i, j, 1]]
            blue = tables[2, pixels[i, j, 2]]
            grey = (red + green + blue) * third
            lit[i, j, 0] = grey + (red - grey) * colour
            lit[i, j, 1] = grey + (green - grey) * colour
            lit[i, j, 2] = grey + (blue - grey) * colour
            for c in range(3):
                value = lit[i, j, c]
                if noise > zero:
                    value += noise * normals[place + c]
                lit[i, j, c] = min(max(value, zero), one)
            place += 3
            if place >= len(normals):
                place = 0
