"""What MOTChallenge's `seqinfo.ini` says of a sequence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from roadscope.benchmarks.formats.table import MAX_FRAMES, FormatError, read_lines, refuse

SECTION = "[Sequence]"
DEFAULT_RATE_HZ = 30.0
RATES_HZ = (1e-6, 1e6)
"""Slower and faster than any camera."""
MAX_SIDE_PX = 1_000_000
Given = tuple[int, str]
"""The line that a value stands in, and its text."""


@dataclass(frozen=True, slots=True)
class SequenceInfo:
    """As far as the file says it.

    length: number of frames. image_size: width and height in pixels.
    """

    length: int | None = None
    rate_hz: float = DEFAULT_RATE_HZ
    image_size: tuple[int, int] | None = None


def read_info(path: Path) -> SequenceInfo:
    """Read `[Sequence]`, of whose keys all may be missing; so may the file."""
    if not path.is_file():
        return SequenceInfo()
    given = _given(path)
    width = _whole(path, given, "imWidth", MAX_SIDE_PX)
    height = _whole(path, given, "imHeight", MAX_SIDE_PX)
    return SequenceInfo(
        _whole(path, given, "seqLength", MAX_FRAMES), _rate(path, given),
        None if width is None or height is None else (width, height),
    )  # fmt: skip


def _given(path: Path) -> Mapping[str, Given]:
    """Return what stands under `[Sequence]`, by key in lower case."""
    found: dict[str, Given] = {}
    seen: list[str] = []
    section, wanted = "", f"{SECTION} with seqLength and frameRate"
    for number, line in enumerate(map(str.strip, read_lines(path)), start=1):
        if not line or line[0] in "#;":
            continue
        if line[0] == "[":
            section = line.lower()
            seen.append(line)
            continue
        if not section:
            refuse(path, number, wanted, line)
        key, sign, value = line.partition("=")
        if section != SECTION.lower():
            continue
        if not sign:
            refuse(path, number, "KEY=VALUE", line)
        name = key.strip().lower()
        if name in found:
            refuse(path, number, f"{key.strip()} once", line)
        found[name] = number, value.strip()
    if SECTION.lower() not in map(str.lower, seen):
        raise FormatError(f"{path}: expected {wanted}, got {', '.join(seen) or 'nothing'}")
    return found


def _whole(path: Path, given: Mapping[str, Given], key: str, most: int) -> int | None:
    if key.lower() not in given:
        return None
    line, text = given[key.lower()]
    proper = text.isascii() and text.isdigit() and 1 <= float(text) <= most
    if not proper:
        refuse(path, line, f"{key} as a whole number of 1 to {most}", text)
    return int(text)


def _rate(path: Path, given: Mapping[str, Given]) -> float:
    if "framerate" not in given:
        return DEFAULT_RATE_HZ
    line, text = given["framerate"]
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not RATES_HZ[0] <= rate <= RATES_HZ[1]:
        low, high = RATES_HZ
        refuse(path, line, f"frameRate as a number of {low:g} to {high:g}", text)
    return rate
