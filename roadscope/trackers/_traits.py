"""What training data say of a detector's errors and scores and of how road users move.

The folder `learned` has one file for each detector and its training data; they are written by
`research.tracker_traits` of the repository.
"""

from __future__ import annotations

import tomllib
import warnings
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

FOLDER = Path(__file__).parent / "learned"
SECTION_OF = {
    Category.CAR: "car",
    Category.VAN: "car",
    Category.TRUCK: "car",
    Category.BUS: "car",
    Category.MOTORCYCLE: "cyclist",
    Category.CYCLIST: "cyclist",
    Category.PEDESTRIAN: "pedestrian",
}
"""Training data distinguish three kinds of road users."""
SECTIONS = tuple(dict.fromkeys(SECTION_OF.values()))
SECTION_NUMBER = np.array([SECTIONS.index(SECTION_OF[category]) for category in Category])
"""For each value of `Category` the number of its section."""
FIRST_OF_SECTION = [int(np.equal(SECTION_NUMBER, n).argmax()) for n in range(len(SECTIONS))]
"""For each section the value of its first `Category`."""
COUNT = len(Category)


@dataclass(frozen=True, slots=True, eq=False)
class DetectorTraits(Record):
    """Traits of detections and road users, (7,) float64 each, by value of `Category`.

    score_slope, score_offset, score_per_m: the log odds that a detection at a range of r metres,
        whose score has the log odds s, is right are slope * s + offset + per_m * r; 1, 0 and 0 for
        calibrated scores.
    along_m, across_m: standard deviations of detected positions along and across the box.
    height_m, yaw_rad: standard deviations of z, and of the heading modulo half a turn.
    lasting: share of the variance of positions that is correlated over time: it decays to 1/e
        within lasting_s. An object of which one corner is visible often shows the same corner for
        many frames.
    yaw_lasting: share of the variance of headings that does not change with time.
    growth_per_m: share by which these deviations grow with every metre of range.
    accelerate_m_s2, swerve_m_s2: standard deviations that velocities gain in one second along and
        across the heading; they grow with the square root of time.
    turn_rad_s, climb_m_s: the same of heading and z.
    speed_m_s: root mean square of speeds; cruise_m_s: mean of speeds forward; aside_m_s: root mean
        square of velocities across the heading.
    front: share of detections whose heading is right rather than half a turn off.
    top_speed_m_s: a speed that nobody exceeds.
    memory_s: time in which the evidence of earlier frames for existence decays to 1/e.
    score_gain, seen_gain, misfit: after a detection the log odds of existence tend towards
        score_gain * (log odds of the detection) + seen_gain - misfit * (squared Mahalanobis
        distance of its position).
    back, back_per_m, away_per_s: the log odds that a missed target is still there are back +
        back_per_m * (range in metres) - away_per_s * (seconds without a detection).
    returned, born: shares, in training, of missed targets and of targets detected once that were
        detected again, among all that were believed to exist.
    seen_once: added to the log odds of existence of targets detected once, which their scores
        overestimate: where nothing was expected a detection is right less often.
    surplus: factor by which squared errors of tracked positions exceeded the filter's covariances
        in training.
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

    def detection_log_odds(
        self, score_log_odds: np.ndarray, categories: np.ndarray, ranges_m: np.ndarray
    ) -> np.ndarray:
        """Return (N,) log odds that detections are right."""
        log_odds: np.ndarray = (
            self.score_offset[categories]
            + self.score_slope[categories] * score_log_odds
            + self.score_per_m[categories] * ranges_m
        )
        return log_odds


@dataclass(frozen=True, slots=True, eq=False)
class ScoreDistribution(Record):
    """Which scores a detector gave in training, by value of `Category`.

    deciles: (7, 11) float64, log odds of scores.
    counts: (7,) int64, number of scores.
    """

    deciles: np.ndarray
    counts: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, deciles=(np.float64, (COUNT, 11)), counts=(np.int64, (COUNT,)))


class KnownDetector(NamedTuple):
    """The content of a file of traits."""

    traits: DetectorTraits
    scores: ScoreDistribution


OF_ANY_SIGN = ("score_offset", "score_per_m", "seen_gain", "back", "back_per_m", "seen_once")
SHARES = ("returned", "born")
TRAITS = tuple(field.name for field in fields(DetectorTraits))
SCORE_EDGE = 1e-4
"""Scores are taken to be no nearer to 0 or 1 than this, where scores of five digits end."""


def score_log_odds(scores: np.ndarray) -> np.ndarray:
    """Return (N,) log odds of scores in 0 to 1."""
    shares = np.clip(scores, SCORE_EDGE, 1 - SCORE_EDGE)
    odds: np.ndarray = np.log(shares / (1 - shares))
    return odds


def detector_names() -> list[str]:
    """Return the names of the detectors whose traits are part of the package."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def read_detector(name: str) -> KnownDetector:
    """Return what the file of a detector's name, or a path ending with `.toml`, says."""
    path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
    if not path.is_file():
        raise ValueError(
            f"no traits are called '{name}'; known: {', '.join(detector_names())}, or a .toml file"
        )
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: {error}") from error
    traits = DetectorTraits(*(_trait(path, data, trait) for trait in TRAITS))
    return KnownDetector(traits, _score_distribution(path, data))


def _score_distribution(path: Path, data: dict[str, object]) -> ScoreDistribution:
    rows, counts = [], []
    for category in Category:
        section = data.get(SECTION_OF[category])
        table = section if isinstance(section, dict) else {}
        row, count = table.get("log_odds_deciles"), table.get("scores")
        where = f"[{SECTION_OF[category]}]"
        if not isinstance(row, list) or len(row) != 11 or sorted(row) != row:
            raise ValueError(
                f"{path}: expected 11 increasing log_odds_deciles in {where}, got {row!r}"
            )
        if type(count) is not int or count < 0:
            raise ValueError(
                f"{path}: expected the number of scores in {where}, as scores, got {count!r}"
            )
        rows.append(row)
        counts.append(count)
    return ScoreDistribution(np.array(rows, float), np.array(counts))


def _trait(path: Path, data: dict[str, object], trait: str) -> np.ndarray:
    """Return the (7,) values of a trait by value of `Category`."""
    values = []
    for category in Category:
        section = data.get(SECTION_OF[category])
        value = section.get(trait) if isinstance(section, dict) else None
        if not isinstance(value, int | float) or not (value > 0 or trait in OF_ANY_SIGN):
            wanted = "a number" if trait in OF_ANY_SIGN else "a positive number"
            raise ValueError(
                f"{path}: expected {wanted} as {trait} in [{SECTION_OF[category]}], got {value!r}"
            )
        if trait in SHARES and value >= 1:
            raise ValueError(
                f"{path}: expected a share below 1 as {trait} in [{SECTION_OF[category]}], got "
                f"{value!r}"
            )
        values.append(float(value))
    return np.array(values)


# How a detector is recognised by its scores.
AUTO = "auto"
UNKNOWN = "unknown"
UNSCALED = "unscaled"
"""Name for an unknown detector whose scores are no probabilities: only their order counts."""
EDGES = np.concatenate([[-9.22], np.linspace(-9.16, 9.16, 25), [9.22]])
"""Of intervals of log odds; scores of 0 and of 1 have an interval each."""
ROUNDING = 0.005
"""Rounding error, in log odds, of the lowest and the highest score in a detector's file."""
OUTLIER_SHARE = 0.05
"""Share of log odds taken to be anywhere between the lowest and the highest of training."""
CONCENTRATION = 30.0
"""Weight, in scores, of a detector's training: scenes differ from training and from each other."""
DECIDED = 20.0
"""Lead in log likelihood from which on the choice no longer changes."""
# Chosen by hand: of PointRCNN on five of KITTI's sequences the first 100 scores of cars were off by
# up to 0.22, and by 0.32 and more where half of each log odds was taken for the score.
FEWEST, FEWEST_OFF = 30, 300
"""Least number of scores in a section for tests of scores beyond training, and of their shares."""
MOST_OFF, MOST_OFF_OF_ONE = 0.32, 0.5
"""Greatest difference of cumulative shares from those of training, for n scores: the first plus the
second divided by the root of n."""
MOST_BEYOND, MOST_BEYOND_SHARE = 2, 0.01
"""Greatest number of n scores beyond all those of training: the first plus the second times n."""


class UnknownDetectorWarning(UserWarning):
    """The scores are not those of a detector whose traits were learned."""


class TraitsChoice:
    """The traits of the detector at hand; `auto`: of the known one whose scores are likeliest.

    The scores of each scene are taken to have an interval distribution of their own, drawn around
    that of the detector (Dirichlet), so a score that repeats tells less each time. Scores unlike
    those of any known detector are likeliest under `unknown`, whose scores are spread widely.
    The prior gives `unknown` as much weight as all others together, and it is chosen until another
    is likelier than all the rest together and its scores fit those of training. Once the lead is
    `DECIDED` the choice stays, unless scores turn out not to fit until a section has `FEWEST_OFF`.
    It only uses scores up to now.

    has_warned: whether this process was told of an unknown detector. A process makes a tracker for
        each drive and says so once.
    """

    has_warned: ClassVar[bool] = False

    def __init__(self, name: str) -> None:
        """Take a name of `detector_names`, the path of a .toml file, or `auto`."""
        known = [each for each in detector_names() if each != UNSCALED]
        names = known if name == AUTO else [name]
        self._names, self._detectors = names, [read_detector(each) for each in names]
        distributions = [detector.scores for detector in self._detectors]
        self._edges = _edges([each.deciles for each in distributions])
        self._shares = np.array([_shares(each, self._edges).ravel() for each in distributions])
        self._inside = np.array([_inside(each, self._edges).ravel() for each in distributions])
        self._unknown = names.index(UNKNOWN) if UNKNOWN in names else 0
        self._prior = np.zeros(len(names))
        self._prior[self._unknown] = np.log(max(len(names) - 1, 1))
        self.reset()

    def reset(self) -> None:
        """Forget all scores."""
        self._log_weights = self._prior.copy()
        self._counts = np.zeros(self._shares.shape[1])
        self._best, self._decided = self._unknown, False

    def update(self, score_log_odds: np.ndarray, categories: np.ndarray) -> DetectorTraits:
        """Take the (N,) scores of a tick and return the traits that fit all scores best."""
        before = self._most_of_section()
        settled = self._decided and before >= FEWEST_OFF
        if len(self._detectors) > 1 and len(score_log_odds) and not settled:
            # The outermost intervals have no end.
            interval = np.searchsorted(self._edges[1:-1], score_log_odds, "right")
            self._weigh(SECTION_NUMBER[categories] * (len(self._edges) - 1) + interval)
            if not self._decided:
                self._best = self._likeliest()
            elif not self._fit()[self._best]:
                self._best = self._unknown
            is_sure = before < FEWEST_OFF <= self._most_of_section()
            if self.is_unknown and is_sure and not TraitsChoice.has_warned:
                TraitsChoice.has_warned = True
                warnings.warn(
                    "no detector known to the tracker's option traits=auto has such scores: they "
                    "are taken for probabilities (by the tracker existence until the persistence "
                    "of detections contradicts it); traits= names what was learned of a detector",
                    UnknownDetectorWarning,
                    stacklevel=3,
                )
        return self._detectors[self._best].traits

    def base_log_odds(self, range_m: float) -> np.ndarray:
        """Return (7,) log odds that any detection of a category was right in training."""
        traits, scores = self._detectors[self._best]
        middles = (scores.deciles[:, 1:] + scores.deciles[:, :-1]) / 2
        categories = np.repeat(np.arange(COUNT), middles.shape[1])
        ranges_m = np.full(middles.size, range_m)
        odds = traits.detection_log_odds(middles.ravel(), categories, ranges_m)
        shares = (1 / (1 + np.exp(-odds))).reshape(middles.shape).mean(axis=1)
        base: np.ndarray = np.log(shares / (1 - shares))
        return base

    @property
    def is_unknown(self) -> bool:
        """Whether nothing was learned of the detector."""
        return self._names[self._best] == UNKNOWN

    @property
    def is_unscaled(self) -> bool:
        """Whether only the order of scores counts."""
        return self._names[self._best] == UNSCALED

    def _most_of_section(self) -> float:
        """Return the number of scores of the section that has most."""
        return float(self._counts.reshape(len(SECTIONS), -1).sum(axis=1).max())

    def _likeliest(self) -> int:
        weights = np.where(self._fit(), self._log_weights, -np.inf)
        first = int(weights.argmax())
        rest = np.delete(weights, first)
        second, most = sorted(self._log_weights.tolist())[-2:]
        self._decided = most - second >= DECIDED
        return first if weights[first] > np.logaddexp.reduce(rest) else self._unknown

    def _fit(self) -> np.ndarray:
        """Return (D,) bool, whether scores may be those of each detector."""
        counts = self._counts.reshape(len(SECTIONS), -1)
        fit = np.ones(len(self._detectors), bool)
        for section in np.flatnonzero(counts.sum(axis=1) >= FEWEST):
            own, total = counts[section], counts[section].sum()
            shares, inside = (
                each.reshape(len(fit), len(SECTIONS), -1)[:, section]
                for each in (self._shares, self._inside)
            )
            off = np.abs(np.cumsum(shares, axis=1) - np.cumsum(own) / total).max(axis=1)
            if total >= FEWEST_OFF:
                fit &= off <= MOST_OFF + MOST_OFF_OF_ONE / np.sqrt(total)
            fit &= (own * ~inside).sum(axis=1) <= MOST_BEYOND + MOST_BEYOND_SHARE * total
        fit[self._unknown] = True
        return fit

    def _weigh(self, intervals: np.ndarray) -> None:
        """Take (N,) numbers of intervals; their order does not matter (Dirichlet multinomial)."""
        from scipy.special import gammaln

        new = np.bincount(intervals, minlength=len(self._counts)).astype(float)
        used = np.flatnonzero(new)
        before = CONCENTRATION * self._shares[:, used] + self._counts[used]
        # Factors that all detectors share, widths and counts, are left out.
        if not self._decided:
            self._log_weights += (gammaln(before + new[used]) - gammaln(before)).sum(axis=1)
        self._counts += new


def _edges(deciles: list[np.ndarray]) -> np.ndarray:
    """Return (E,) `EDGES` and the ends of each detector's (7, 11) deciles."""
    lowest = [each[:, 0] - ROUNDING for each in deciles]
    highest = [each[:, -1] + ROUNDING for each in deciles]
    ends = np.concatenate(lowest + highest)
    edges: np.ndarray = np.union1d(EDGES, ends[np.abs(ends) < EDGES[-2]])
    return edges


def _shares(scores: ScoreDistribution, edges: np.ndarray) -> np.ndarray:
    """Return (3, E - 1) probabilities of the intervals between edges, by section.

    The next score lies beyond the lowest and highest of n scores with the probability 1 / (n + 2)
    (rule of succession). Deciles beyond the edges sum to less than 1: they make no score likely.
    """
    within, counts = _within(scores, edges), scores.counts[FIRST_OF_SECTION, None]
    inside = within > 0
    beyond = np.where(inside.all(axis=1, keepdims=True), 0.0, 1 / (counts + 2))
    with_outliers = (1 - OUTLIER_SHARE) * within + OUTLIER_SHARE * _uniform(edges, inside)
    shares: np.ndarray = (1 - beyond) * with_outliers + beyond * _uniform(edges, ~inside)
    return shares


def _within(scores: ScoreDistribution, edges: np.ndarray) -> np.ndarray:
    """Return (3, E - 1) shares of training's scores in the intervals between edges, by section."""
    rows = scores.deciles[FIRST_OF_SECTION]
    return np.diff([np.interp(edges, row, np.linspace(0, 1, len(row))) for row in rows])


def _inside(scores: ScoreDistribution, edges: np.ndarray) -> np.ndarray:
    """Return (3, E - 1) bool, which intervals are not beyond training's scores, by section."""
    inside: np.ndarray = _within(scores, edges) > 0
    return inside


def _uniform(edges: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return (3, E - 1) probabilities proportional to the widths of the chosen intervals."""
    widths = np.where(where, np.diff(edges), 0.0)
    total = np.maximum(widths.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    shares: np.ndarray = widths / total
    return shares
