"""The number formats with which a network computes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

AUTO = "auto"
PRECISIONS = (AUTO, "float32", "bfloat16")
PROCESSOR = Path("/proc/cpuinfo")
"""Where Linux lists what the processor can do."""


def has_bfloat16(device: str, processor: Path = PROCESSOR) -> bool:
    """Return whether bfloat16 is faster than float32 on a device such as `cpu` or `cuda:0`.

    processor: the file that lists what the processor can do.
    """
    if device.partition(":")[0] == "cuda":
        return True
    return processor.exists() and "avx512_bf16" in processor.read_text("utf-8", errors="replace")


def fastest(device: str, processor: Path = PROCESSOR) -> str:
    """Return the faster of `float32` and `bfloat16` on a device; see `has_bfloat16`."""
    return "bfloat16" if has_bfloat16(device, processor) else "float32"


@contextmanager
def whole_float32() -> Iterator[None]:
    """Let a graphics card compute with all digits of float32: by default torch drops ten bits."""
    import torch

    cudnn: Any = torch.backends.cudnn
    convolutions = cudnn.conv
    before = convolutions.fp32_precision
    convolutions.fp32_precision = "ieee"
    try:
        yield
    finally:
        convolutions.fp32_precision = before
