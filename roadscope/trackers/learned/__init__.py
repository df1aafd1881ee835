"""What training data say of a detector's errors and scores and of how road users move.

One file for each detector and its training data; `roadscope.benchmarks.fit.trackers` writes them.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

FOLDER = Path(__file__).parent
SECTION_OF = {
    Category.CAR: "car", Category.VAN: "car", Category.TRUCK: "car", Category.BUS: "car",
    Category.MOTORCYCLE: "cyclist", Category.CYCLIST: "cyclist",
    Category.PEDESTRIAN: "pedestrian",
}  # fmt: skip
"""Training data tell three kinds of road users apart."""
COUNT = len(Category)


@dataclass(frozen=True, slots=True, eq=False)
class Learned(Record):
    """Traits of each category, all (7,) float64, by value of `Category`.

    score_slope, score_offset, score_per_m: a detection whose score has the log odds s is right,
        at a range of r metres, with log odds slope * s + offset + per_m * r; 1, 0 and 0 for
        calibrated scores.
    along_m, across_m: standard deviations of detected places along and across the box.
    height_m, yaw_rad: likewise of z, and of the heading up to half turns.
    lasting: share of the variance of places that stays for lasting_s, the time in which it changes
        to 1/e: of who shows but a corner, the same is seen of again and again.
    yaw_lasting: share of the variance of headings that stays.
    growth_per_m: by which share of their values these grow with every metre of range.
    accelerate_m_s2, swerve_m_s2: how far velocities wander in a second, standard deviations
        along and across the heading, growing with the root of time.
    turn_rad_s, climb_m_s: likewise heading and z.
    speed_m_s: root mean square of speeds; cruise_m_s: mean of those forward; aside_m_s: root mean
        square of those across the heading.
    front: share of detections whose front is at the front.
    top_speed_m_s: what nobody exceeds.
    memory_s: time in which what earlier frames said of existence fades to 1/e.
    score_gain, seen_gain, misfit: log odds of existence lean towards gain * log odds of the
        detection + seen - misfit * squared Mahalanobis distance of its place.
    back, back_per_m: log odds that who is missed is still there, and by how much they grow with
        every metre of range; away_per_s: by how much they fall with every second of it.
    returned, born: share of those missed, and of those seen but once, all of them believed in,
        who were seen again in training.
    seen_once: by how much the log odds of existence of who was seen but once differ from those
        that its score says: where nothing was expected a detection is right less often.
    surplus: by what factor squared errors of tracks' places were greater in training than their
        filter says.
    """

    score_slope: np.ndarray
    score_offset: np.ndarray
    score_per_m: np.ndarray
    along_m: np.ndarray
    across_m: np.ndarray
    height_m: np.ndarray
    yaw_rad: np.ndarray
    growth_per_m: np.ndarray
    lasting: np.ndarray
    lasting_s: np.ndarray
    yaw_lasting: np.ndarray
    accelerate_m_s2: np.ndarray
    swerve_m_s2: np.ndarray
    turn_rad_s: np.ndarray
    climb_m_s: np.ndarray
    speed_m_s: np.ndarray
    cruise_m_s: np.ndarray
    aside_m_s: np.ndarray
    front: np.ndarray
    top_speed_m_s: np.ndarray
    memory_s: np.ndarray
    score_gain: np.ndarray
    seen_gain: np.ndarray
    misfit: np.ndarray
    back: np.ndarray
    back_per_m: np.ndarray
    away_per_s: np.ndarray
    returned: np.ndarray
    born: np.ndarray
    seen_once: np.ndarray
    surplus: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, **{f.name: (np.float64, (COUNT,)) for f in fields(self)})

    def right(self, odds: np.ndarray, kinds: np.ndarray, ranges_m: np.ndarray) -> np.ndarray:
        """Return (N,) log odds that detections are right, of log odds of scores and ranges."""
        told: np.ndarray = (
            self.score_offset[kinds]
            + self.score_slope[kinds] * odds
            + self.score_per_m[kinds] * ranges_m
        )
        return told


@dataclass(frozen=True, slots=True, eq=False)
class Scores(Record):
    """What scores a detector gave where it was learned of, by value of `Category`.

    deciles: (7, 11) float64, log odds.
    counts: (7,) int64, how many there were.
    """

    deciles: np.ndarray
    counts: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, deciles=(np.float64, (COUNT, 11)), counts=(np.int64, (COUNT,)))


OF_ANY_SIGN = ("score_offset", "score_per_m", "seen_gain", "back", "back_per_m", "seen_once")
TRAITS = tuple(field.name for field in fields(Learned))


def names() -> list[str]:
    """Return what is shipped."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def learned(name: str) -> Learned:
    """Read what is shipped under a name, or a TOML file of one's own."""
    return read(name)[0]


def read(name: str) -> tuple[Learned, Scores]:
    """Likewise, with what scores there were."""
    path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
    if not path.is_file():
        raise ValueError(f"nothing learned is called '{name}'; known: {', '.join(names())}, or a "
                         ".toml file")  # fmt: skip
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: {error}") from error
    return Learned(*(_trait(path, data, trait) for trait in TRAITS)), _scores(path, data)


def _scores(path: Path, data: dict[str, object]) -> Scores:
    rows, counts = [], []
    for category in Category:
        section = data.get(SECTION_OF[category])
        told = section if isinstance(section, dict) else {}
        row, count = told.get("log_odds_deciles"), told.get("scores")
        where = f"[{SECTION_OF[category]}]"
        if not isinstance(row, list) or len(row) != 11 or sorted(row) != row:
            raise ValueError(
                f"{path}: expected 11 increasing log_odds_deciles in {where}, got {row!r}"
            )
        if type(count) is not int or count < 0:
            raise ValueError(f"{path}: expected how many scores there were in {where}, as scores, "
                             f"got {count!r}")  # fmt: skip
        rows.append(row)
        counts.append(count)
    return Scores(np.array(rows, float), np.array(counts))


def _trait(path: Path, data: dict[str, object], trait: str) -> np.ndarray:
    """Return (7,) values of a trait, in the order of `Category`."""
    values = []
    for category in Category:
        section = data.get(SECTION_OF[category])
        value = section.get(trait) if isinstance(section, dict) else None
        if not isinstance(value, int | float) or not (value > 0 or trait in OF_ANY_SIGN):
            wanted = "a number" if trait in OF_ANY_SIGN else "a positive number"
            raise ValueError(
                f"{path}: expected {wanted} as {trait} in [{SECTION_OF[category]}], got {value!r}"
            )
        values.append(float(value))
    return np.array(values)
