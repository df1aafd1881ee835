"""Reads recordings of Rerun, for tests."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Logged:
    """The values of a component by time in seconds; static ones have the time None."""

    values: dict[float | None, Any]

    @property
    def static(self) -> Any:
        return self.values[None]

    def times(self) -> np.ndarray:
        return np.array(sorted(self.values))

    def at(self, stamp_s: float) -> Any:
        """Return the values that were logged at a time."""
        nearest = min(self.values, key=lambda time_s: abs(time_s - stamp_s))
        assert abs(nearest - stamp_s) < 1e-6
        return self.values[nearest]


def read_recording(path: Path) -> dict[str, dict[str, Logged]]:
    """Return what was logged, by entity and component, such as `Boxes3D:labels`."""
    from rerun.chunk import RrdReader

    entities: dict[str, dict[str, Logged]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        assert chunk.timeline_names in ([], ["time"])
        times: list[float | None] = [None] * batch.num_rows
        if not chunk.is_static:
            times = [each.as_py().total_seconds() for each in batch["time"]]
        for name in batch.schema.names:
            if ":" in name:
                components = entities.setdefault(chunk.entity_path, {})
                logged = components.setdefault(name, Logged({}))
                cells = zip(times, batch[name].to_pylist(), strict=True)
                logged.values.update({t: cell for t, cell in cells if cell is not None})
    return entities
