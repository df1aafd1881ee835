"""Recipes: the settings of a training run, and the episodes that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.train.pictures import PictureEpisode
from roadscope.core.bounds import Bounds
from roadscope.core.checks import require
from roadscope.core.record import Record
from roadscope.envs.sensors.faults import condition_name, faults_of

# --------------------------------------------------------------------------------------------------
# Which seeds, places and conditions are for training, and which are held out.

TRAIN_SEEDS = range(0, 9000)
CALIBRATION_SEEDS = range(9000, 10000)
"""Train seeds of the suites too. The network is not trained on them: its scores are calibrated on
them."""
VALIDATION_SEEDS = range(10000, 20000)
TEST_SEEDS = range(20000, 30000)
"""Scored on when all settings are fixed; nothing is chosen by these scores."""
SCENARIOS = (
    "street",
    "town-crossing",
    "motorway",
    "street",
    "town-crossing",
    "two-way",
    "roundabout",
    "street",
    "town-crossing",
    "merge",
    "racetrack",
)
"""Used in turn; those with pedestrians and cyclists are listed more than once."""
HELD_OUT_SCENARIOS = ("intersection", "waiting", "dense-motorway", "cut-ins")
"""Never trained on: scores there show how well the network generalises to other places."""
WEATHERS = ("clear", "clear", "clear", "rain-1", "rain-3", "fog-1", "fog-2", "fog-3")
"""Each equally likely; faults bring rain and fog up to `GREATEST_SEVERITY`."""
HELD_OUT_WEATHERS = ("rain-5", "fog-5")
HELD_OUT_BODIES = ("unseen-motorway", "unseen-street")
"""Scenarios whose vehicles have body shapes that no recipe may train on."""
FAULTS = ("fog", "rain", "night", "glare")
"""Faults in which a camera still takes pictures; each is equally likely, and so is each severity
up to `GREATEST_SEVERITY`."""
GREATEST_SEVERITY = 4
NIGHT_SHARE = 0.25
"""Share of the episodes with a fault that are at night too."""
HELD_OUT_FAULTS = ("fog:5", "rain:5", "night:5", "glare:5", "rain:5 + night:5")

# --------------------------------------------------------------------------------------------------
# Cameras that pictures are taken with.

FOCAL_LENGTHS_PX = Bounds(360.0, 840.0)
"""Between a wide camera's and half of a Bumblebee's."""
HEIGHTS_M = Bounds(1.2, 1.9)
PITCHES_RAD = Bounds(-0.03, 0.03)
WIDE_RIG_SHARE = 0.5
"""Share of the episodes whose camera is that of the rig `wide`, unchanged."""


@dataclass(frozen=True, slots=True, eq=False)
class Recipe(Record):
    """Settings of one training run.

    scenarios: used in turn, one for each episode. weathers: one is drawn for each episode.
    faulty: share of the episodes with a fault of `FAULTS`, some of these at night too; their
        weather is clear but for the fault. lights: one is drawn for each of the other episodes.
    conditions: sets of faults; if there are any, one is drawn for each episode, and `faulty` and
        `lights` have no effect.
    episodes: how many to train on. images: pictures of an episode. every_s: seconds from one
        picture to the next.
    calibration_episodes, validation_episodes: how many to calibrate and to score on.
    steps: of the optimiser. pixels: of a batch, whatever the size of its crops.
    kernel_rate: Muon's highest learning rate, for the kernels of convolutions. learning_rate:
        AdamW's highest, for all other weights. weight_decay: of both.
    seed: of all random draws.
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
    "small": Recipe(episodes=110, calibration_episodes=11, validation_episodes=11, steps=2600),
    "trial": Recipe(
        scenarios=("street",),
        episodes=1,
        images=2,
        calibration_episodes=1,
        validation_episodes=1,
        steps=4,
        pixels=320 * 256,
    ),
}
"""`full` takes about half an hour on two cores, `small` a quarter of it; `trial` shows that
everything needed is installed."""


class Split(NamedTuple):
    """Episodes to train on, to calibrate scores on, and to score on."""

    training: list[PictureEpisode]
    calibration: list[PictureEpisode]
    validation: list[PictureEpisode]


def split_episodes(recipe: Recipe) -> Split:
    """Draw the episodes of a recipe; raise `ValueError` for scenarios that are held out."""
    if forbidden := set(recipe.scenarios) & set(HELD_OUT_BODIES):
        names = ", ".join(sorted(forbidden))
        raise ValueError(f"scenarios {names} are held out: no recipe may train on them")
    return Split(
        draw_episodes(recipe, recipe.episodes, TRAIN_SEEDS),
        draw_episodes(recipe, recipe.calibration_episodes, CALIBRATION_SEEDS),
        draw_episodes(recipe, recipe.validation_episodes, VALIDATION_SEEDS, varied=False),
    )


def held_out_episodes(recipe: Recipe) -> dict[str, list[PictureEpisode]]:
    """Draw further episodes to score on, by section of the record.

    `clear_days` is the reference: clear weather by day. The sections `held_out_...` have places,
    bodies, weather and faults that the recipe does not train on. All these are on validation
    seeds; `test` and `test_clear_days` are on test seeds, the former with the conditions of
    training.
    """
    count = max(1, recipe.validation_episodes // 3)
    plain = replace(recipe, weathers=WEATHERS, faulty=0.0, lights=("day",))
    recipes = {
        "clear_days": replace(plain, weathers=("clear",)),
        "held_out_scenarios": replace(plain, scenarios=HELD_OUT_SCENARIOS),
        "held_out_looks": replace(plain, scenarios=HELD_OUT_BODIES),
        "held_out_weathers": replace(plain, weathers=HELD_OUT_WEATHERS),
        "held_out_faults": replace(plain, weathers=("clear",), conditions=HELD_OUT_FAULTS),
    }
    sections = {
        name: draw_episodes(other, count, VALIDATION_SEEDS, varied=False)
        for name, other in recipes.items()
    }
    return sections | {
        "test": draw_episodes(recipe, recipe.validation_episodes, TEST_SEEDS, varied=False),
        "test_clear_days": draw_episodes(recipes["clear_days"], count, TEST_SEEDS, varied=False),
    }


def draw_episodes(
    recipe: Recipe, count: int, seeds: range, *, varied: bool = True
) -> list[PictureEpisode]:
    """Draw episodes for a recipe; the same recipe and seeds give the same episodes.

    varied: whether some have cameras other than that of the rig `wide`.
    """
    rng = np.random.default_rng([recipe.seed, seeds.start])
    # Conditions have a generator of their own: other settings of them change nothing else.
    conditions_rng = np.random.default_rng([recipe.seed, seeds.start, 1])
    numbers = np.sort(rng.choice(seeds, count, replace=False))
    episodes = []
    for i, number in enumerate(rng.permutation(numbers).tolist()):
        episode = PictureEpisode(
            scenario=recipe.scenarios[i % len(recipe.scenarios)],
            seed=number,
            weather=str(rng.choice(recipe.weathers)),
            images=recipe.images,
            every_s=recipe.every_s,
        )
        focal, height, pitch, camera = rng.random(4)
        if varied and camera > WIDE_RIG_SHARE:
            low, high = FOCAL_LENGTHS_PX
            episode = replace(
                episode,
                focal_px=round(float(low * (high / low) ** focal), 1),
                height_m=round(_between(HEIGHTS_M, height), 2),
                pitch_rad=round(_between(PITCHES_RAD, pitch), 4),
            )
        episodes.append(_with_conditions(recipe, episode, conditions_rng))
    return episodes


def _with_conditions(
    recipe: Recipe, episode: PictureEpisode, rng: np.random.Generator
) -> PictureEpisode:
    """Draw light and faults of an episode."""
    if recipe.conditions:
        return replace(episode, faults=str(rng.choice(recipe.conditions)))
    chance, night_chance = rng.random(2)
    light = str(rng.choice(recipe.lights))
    kind = str(rng.choice(FAULTS))
    severity, night = (int(n) for n in rng.integers(1, GREATEST_SEVERITY + 1, 2))
    if chance >= recipe.faulty:
        return replace(episode, light=light)
    faults = [f"{kind}:{severity}"]
    if night_chance < NIGHT_SHARE and kind != "night":
        faults.append(f"night:{night}")
    return replace(episode, weather="clear", faults=condition_name(faults_of(faults)))


def _between(bounds: Bounds, share: float) -> float:
    return float(bounds.low + share * (bounds.high - bounds.low))
