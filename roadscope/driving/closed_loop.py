"""A drive in a closed loop: sensors, perception and a driver among traffic that reacts."""

from __future__ import annotations

from roadscope.core import DrivingCommand, DrivingScene, Frame, Tracks, Truth
from roadscope.driving.perception import BLIND, TRUTH, Perception, ProcessedScan
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.ego_motion import STATES_AROUND
from roadscope.envs.sensors.faults import Faults
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as rig_named
from roadscope.envs.sensors.sensing import Sensing
from roadscope.envs.sensors.weathers import Weather
from roadscope.envs.traffic.driven import DrivenTraffic, Outlook
from roadscope.envs.traffic.simulated import STEP_S

STEPS = 2
"""Steps of the simulation from one decision to the next."""


class ClosedLoop:
    """A drive of the ego through a scenario, on what is perceived.

    scenario: a simulated one of `SCENARIOS`. seed: of traffic, world and noise.
    perception: a stack; `truth`: all road users as they are; `blind`: none.
    rig: the rig, or its name, for which the stack was made. duration_s: most seconds of the drive.
    weather, light, faults: as in `SensorWrapper`.

    Sensors measure between the steps, at their own rates. The driver gets the latest tracks, moved
    on to the step at constant velocity. Of itself and of the road it knows the truth.
    """

    def __init__(
        self,
        scenario: str,
        seed: int,
        *,
        perception: Perception | str,
        rig: Rig | str,
        duration_s: float,
        weather: str | Weather = "clear",
        light: str | Light | None = None,
        faults: Faults = (),
    ) -> None:
        self.traffic = DrivenTraffic(scenario, seed, duration_s)
        self.duration_s = duration_s
        self.truths: list[Truth] = []
        self.processed: list[tuple[Truth, ProcessedScan]] = []
        self.scan: tuple[Frame, Truth] | None = None
        """The latest frame with a scan, and its truth."""
        self._unprocessed: dict[float, Truth] = {}
        self._perception = perception
        self._sensing: Sensing | None = None
        if isinstance(perception, Perception):
            perception.reset()
            used = perception.used_sensors(rig_named(rig) if isinstance(rig, str) else rig)
            self._sensing = Sensing(used, seed, weather=weather, light=light, faults=faults)
            self._memory_s = 2 * used.lidar.spec.period_s + used.memory_s
            if used.inertial:
                self._memory_s += STATES_AROUND * STEP_S

    @property
    def over(self) -> bool:
        """Whether the time is up, the road has ended, or the ego has collided."""
        traffic = self.traffic
        is_time_up = traffic.now_s >= self.duration_s - STEP_S / 2
        return is_time_up or traffic.collided_with is not None or traffic.arrived

    def tracks(self) -> Tracks:
        """Return the road users as they are perceived now, frame `world`.

        Call it once at every step. `truths` are then those of the frames that sensors completed
        since the last call, and `processed` those of the scans that the stack processed since then,
        each with what the stack made of it.
        """
        traffic = self.traffic
        if not isinstance(self._perception, Perception):
            if self._perception == TRUTH:
                return traffic.true_tracks()
            assert self._perception == BLIND
            return Tracks.empty(traffic.now_s, "world")
        assert self._sensing is not None
        pairs = self._sensing.advance(traffic.timeline(self._memory_s), traffic.now_s)
        self.truths = [truth for _, truth in pairs]
        self.scan = next((pair for pair in reversed(pairs) if pair[0].lidar is not None), self.scan)
        self._unprocessed |= {
            frame.lidar.stamp_s: truth for frame, truth in pairs if frame.lidar is not None
        }
        self._perception.update([frame for frame, _ in pairs], self.truths, traffic.now_s)
        self.processed = [
            (self._unprocessed.pop(scan.tracks.stamp_s), scan)
            for scan in self._perception.take_processed()
            if scan.tracks.stamp_s in self._unprocessed
        ]
        return self._perception.tracks(traffic.now_s)

    def scene(self, tracks: Tracks) -> DrivingScene:
        """Return what the driver gets. tracks: of this step, frame `world`."""
        return scene_of(self.traffic, tracks, self.traffic.outlook(tracks))

    def step(self, command: DrivingCommand) -> None:
        """Drive on for 0.1 s, or until the drive is over."""
        for k in range(STEPS):
            if not self.over:
                self.traffic.step(command, is_new=k == 0)


def scene_of(traffic: DrivenTraffic, tracks: Tracks, outlook: Outlook) -> DrivingScene:
    """Return what a driver gets. outlook: the one of these tracks."""
    return DrivingScene(
        stamp_s=traffic.now_s,
        world_from_ego=traffic.world_from_ego,
        speed_m_s=traffic.speed_m_s,
        size=traffic.size,
        tracks=tracks,
        lanes=outlook.lanes,
        lane=outlook.lane,
        target_lane=outlook.target_lane,
        desired_speed_m_s=traffic.desired_speed_m_s,
        allowed_speed_m_s=outlook.allowed_speed_m_s,
        gap_m=outlook.gap_m,
        leader_speed_m_s=outlook.leader_speed_m_s,
        line_m=outlook.line_m,
        path=outlook.path,
        model=outlook.model,
        following=outlook.following,
    )
