"""What a training run is made of; all that decides its outcome."""

from __future__ import annotations

from dataclasses import dataclass

from roadscope.core.checks import require
from roadscope.core.record import Record

TRAIN_SEEDS = range(0, 9000)
CALIBRATION_SEEDS = range(9000, 10000)
"""Train seeds too, but no picture of theirs is learned from: they tell what scores are worth."""
VALIDATION_SEEDS = range(10000, 20000)
TEST_SEEDS = range(20000, 30000)
"""Scored on when all else is settled; nothing is chosen by them."""
SCENARIOS = (
    "street", "town-crossing", "motorway", "street", "town-crossing", "two-way", "roundabout",
    "street", "town-crossing", "merge", "racetrack",
)  # fmt: skip
"""Drawn from in turn; where people walk and ride more often than where nobody does."""
HELD_OUT_SCENARIOS = ("intersection", "waiting", "dense-motorway", "cut-ins")
"""Never trained on, so that they tell how well what was learned carries over."""
WEATHERS = ("clear", "clear", "clear", "rain-1", "rain-3", "fog-1", "fog-2", "fog-3")
"""Drawn from evenly; faults bring rain and fog up to severity `WORST`."""
HELD_OUT_WEATHERS = ("rain-5", "fog-5")
LOOKS = ("unseen-motorway", "unseen-street")
"""Traffic in bodies of shapes that no recipe may train on."""
FAULTS = ("fog", "rain", "night", "glare")
"""What a camera meets and still takes pictures in; severities up to `WORST` are drawn evenly."""
WORST = 4
DARK = 0.25
"""Share of the episodes with a fault that are at night too."""
HELD_OUT_FAULTS = ("fog:5", "rain:5", "night:5", "glare:5", "rain:5 + night:5")


@dataclass(frozen=True, slots=True, eq=False)
class Recipe(Record):
    """Settings of one training run.

    scenarios, weathers: what is drawn from, one episode each.
    faulty: share of the episodes with a fault of `FAULTS`, some of these at night too; these are
        in clear air but for it. lights: what is drawn from for the others.
    conditions: sets of faults that are drawn from instead.
    episodes: of training. images: of an episode, every_s apart.
    steps: of the optimiser. pixels: of a batch, whatever the size of its crops.
    kernel_rate: Muon's highest learning rate, for the kernels of convolutions. learning_rate:
        AdamW's, for all else. weight_decay: of both.
    seed: of all that is drawn.
    """

    scenarios: tuple[str, ...] = SCENARIOS
    weathers: tuple[str, ...] = WEATHERS
    faulty: float = 0.4
    lights: tuple[str, ...] = ("day", "day", "overcast", "dusk")
    conditions: tuple[str, ...] = ()
    episodes: int = 420
    images: int = 10
    every_s: float = 0.5
    calibration_episodes: int = 44
    validation_episodes: int = 33
    steps: int = 10500
    pixels: int = 4 * 256 * 320
    kernel_rate: float = 5e-3
    learning_rate: float = 2e-3
    weight_decay: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("episodes", "images", "steps", "pixels", "calibration_episodes"):
            require(getattr(self, name) >= 1, self, name, "at least 1", getattr(self, name))
        for name in ("every_s", "kernel_rate", "learning_rate"):
            require(getattr(self, name) > 0, self, name, "above 0", getattr(self, name))
        require(0 <= self.faulty <= 1, self, "faulty", "a share in 0 to 1", self.faulty)


RECIPES = {
    "full": Recipe(),
    "small": Recipe(
        episodes=110, calibration_episodes=11, validation_episodes=11, steps=2600
    ),
    "trial": Recipe(
        scenarios=("street",), episodes=1, images=2, calibration_episodes=1,
        validation_episodes=1, steps=4, pixels=320 * 256,
    ),
}  # fmt: skip
"""`full` takes about half an hour on two cores, `small` a quarter of it, `trial` shows that
all is there."""
