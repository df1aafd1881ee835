"""Drivers as a user would bring them, most of them bad."""

import numpy as np

from roadscope import DrivingCommand


class Good:
    """Does what the drivers of the simulation do."""

    def __init__(self, *, caution_m_s2=0.0):
        self.caution_m_s2 = caution_m_s2

    def reset(self): ...

    def drive(self, scene):
        return DrivingCommand(
            scene.model.acceleration_m_s2 - self.caution_m_s2, scene.model.target_lane
        )


class WithoutReset:
    def drive(self, scene):
        return scene.model


class ReturnsNumbers(Good):
    def drive(self, scene):
        return 0.5, scene.lane


class ReturnsNan(Good):
    def drive(self, scene):
        return DrivingCommand(np.nan, scene.lane)


class LeavesTheRoad(Good):
    def drive(self, scene):
        return DrivingCommand(0.0, scene.lanes)


class Collides(Good):
    """Drives as if there were no other road user."""

    def drive(self, scene):
        return DrivingCommand(2.0, scene.lane)


class Parks(Good):
    def drive(self, scene):
        return DrivingCommand(-8.0, scene.lane)


class Scribbles(Good):
    def drive(self, scene):
        command = super().drive(scene)
        scene.path[:] = 0.0
        return command


class Random(Good):
    def drive(self, scene):
        self.caution_m_s2 = np.random.default_rng().random()
        return super().drive(scene)


class KeepsTheFirstScene(Good):
    caution_of_first = None

    def drive(self, scene):
        if self.caution_of_first is None:
            self.caution_of_first = 0.01 * scene.speed_m_s
        self.caution_m_s2 = self.caution_of_first
        return super().drive(scene)
