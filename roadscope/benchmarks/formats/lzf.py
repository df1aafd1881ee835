"""Bytes that LZF compressed, as in PCD files."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled()
def decompress_lzf(packed: np.ndarray, size: int) -> np.ndarray:
    """Return the bytes that LZF (Lehmann 2000) packed, fewer than `size` if they are damaged.

    packed: (P,) uint8. A control byte below 32 is followed by one more literals than it says.
    Another one has a length in its upper three bits (7: another byte is added) and, in its lower
    five and the byte behind, how far back the bytes are that are repeated.
    """
    out, count, at = np.empty(size, np.uint8), 0, 0
    while at < len(packed):
        control = int(packed[at])
        at += 1
        if control < 32:
            length, back = control + 1, 0
            if at + length > len(packed):
                break
        else:
            length = control >> 5
            if length == 7 and at < len(packed):
                length += int(packed[at])
                at += 1
            if at >= len(packed):
                break
            length += 2
            back = ((control & 31) << 8) + int(packed[at]) + 1
            at += 1
        if count + length > size or back > count:
            break
        for k in range(length):
            out[count + k] = out[count + k - back] if back else packed[at + k]
        count += length
        at += 0 if back else length
    return out[:count]
