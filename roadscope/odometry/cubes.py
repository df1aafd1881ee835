"""Kernels for cubes of space with integer keys, and a hash table by open addressing."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

EMPTY = -1
"""Key of a free slot, and of a place that is too far away for a cube."""
BITS, HALF = 20, 1 << 19
"""Bits of a cube's index along each axis, and the index of the cube at the origin."""
Index = int | np.signedinteger


@compiled(borrowing=True)
def cube_of(x: float, y: float, z: float, size_m: float) -> Index:
    """Return the key of the cube that holds a place, metres; `EMPTY` if it is too far away."""
    i = np.int64(np.floor(x / size_m)) + HALF
    j = np.int64(np.floor(y / size_m)) + HALF
    k = np.int64(np.floor(z / size_m)) + HALF
    if min(i, j, k) < 0 or max(i, j, k) >= 2 * HALF:
        return EMPTY
    return (i << 2 * BITS) | (j << BITS) | k


@compiled(borrowing=True)
def slot_of(keys: np.ndarray, key: Index) -> Index:
    """Return the slot that holds a key, or the free one where it belongs.

    keys: (M,) int64, M a power of two and more than the keys held.
    """
    mask = len(keys) - 1
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = np.int64(mixed >> np.uint64(33)) & mask
    while keys[slot] != EMPTY and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot
