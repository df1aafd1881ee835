"""Specs of strangers' plug-ins."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.core import Detections, load_class
from tests.core.wire_values import make_value

BAD = Path(__file__).with_name("bad_trackers.py")
HOSTILE = Path(__file__).parents[2] / "torture" / "hostile.py"


@dataclass(frozen=True)
class Named:
    """A parsed spec, as far as isolation needs one."""

    text: str
    target: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    isolated: bool = True

    def __str__(self) -> str:
        return self.text

    def make(self) -> Any:
        return load_class(self.target)(**self.arguments)


def bad(name: str, /, **arguments: Any) -> Named:
    """Name a class of `bad_trackers.py`."""
    query = "&".join(f"{key}={value}" for key, value in arguments.items())
    return Named(f"bad.py:{name}" + ("?" + query if query else ""), f"{BAD}:{name}", arguments)


def hostile(act: str) -> Named:
    """Name the tracker of `hostile.py` that does this act."""
    return Named(f"hostile.py:Tracker?act={act}", f"{HOSTILE}:Tracker", {"act": act})


def written(folder: Path, code: str, name: str = "Tracker") -> Named:
    """Name a class in a new file."""
    file = folder / "plugin.py"
    file.write_text(code)
    return Named(f"plugin.py:{name}", f"{file}:{name}")


def detections(count: int = 30) -> Detections:
    """Make detections with random content."""
    return make_value("detections", np.random.default_rng(count), count)
