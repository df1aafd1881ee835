"""Records our own traffic."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic.flow import Flow
from roadscope.envs.traffic.recording import (
    RecordedMotion,
    Samples,
    obstacles_of,
    tabulate,
    timeline_of,
)
from roadscope.envs.traffic.road_users import OBSTACLE, Bodies, copied, joined
from roadscope.envs.traffic.timeline import Timeline


class FlowRecorder:
    """Records a timeline of our own traffic; the ego is actor 0."""

    def __init__(self, flow: Flow, ego: int) -> None:
        """Record the first sample."""
        self._flow, self._ego = flow, ego
        self._snapshots: list[Bodies] = []
        self.tick()

    def tick(self) -> None:
        """Record all bodies as they are."""
        self._snapshots.append(copied(self._flow.bodies))

    def timeline(self, step_s: float, style: str, *, last: int | None = None) -> Timeline:
        """Return the recording, with samples every `step_s` seconds.

        last: how many samples to return, the last ones. Bodies then have their numbers on the road,
            from 1 on, as ids, for the recording may still grow; None: all samples.
        """
        snapshots = self._snapshots if last is None else self._snapshots[-last:]
        samples = joined(snapshots)
        rows = np.repeat(np.arange(len(snapshots)), list(map(len, snapshots)))
        moving = samples["kind"] != OBSTACLE
        samples, rows = copied(samples, moving), rows[moving]
        # The ego is actor 0, the others are numbered as they appear.
        numbers, first = np.unique(np.append(self._ego, samples["number"]), return_index=True)
        order = np.argsort(first)
        ids = np.argsort(order)
        present, crashed, centres, states = tabulate(
            Samples(
                rows=rows,
                columns=ids[np.searchsorted(numbers, samples["number"])],
                centres=np.stack([samples["x"], samples["y"]], axis=-1),
                states=np.stack([samples[n] for n in ("heading", "speed", "steering")], axis=-1),
                crashed=samples["crashed"],
            ),
            snapshots=len(snapshots),
            actors=len(ids),
        )
        users = [self._flow.users[number] for number in numbers[order]]
        bodies = [user for user in users if user is not None]
        standing = self._flow.bodies[self._flow.bodies["kind"] == OBSTACLE]
        places = [standing[name] for name in ("x", "y", "heading", "length", "width")]
        return timeline_of(
            RecordedMotion(
                step_s * (np.arange(len(snapshots)) + len(self._snapshots) - len(snapshots)),
                present,
                crashed,
                centres,
                states,
            ),
            np.arange(len(ids)) if last is None else np.append(0, numbers[order][1:] + 1),
            bodies,
            np.array([body.size.length_m / 2 for body in bodies]),
            road=self._flow.roads.map,
            style=style,
            raw=False,
            obstacles=obstacles_of(np.stack(places, axis=-1)),
        )
