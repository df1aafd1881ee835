"""The base of boards: which plug-ins they rank, what these get, how scores are shown."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.kinds import Kind, check_plugin_spec
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.breakdown import BANDS, EXCESS, part_name
from roadscope.benchmarks.metrics.calibration import pooled_calibration
from roadscope.benchmarks.metrics.cost import cost
from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.records import CallTimes
from roadscope.benchmarks.references import (
    IMITATION,
    LOWER_MARK,
    LOWER_ODOMETRIES,
    UPPER_MARK,
    is_noise,
)
from roadscope.benchmarks.suite import BoardSettings, Suite
from roadscope.core import Spec, SpecError, Truth
from roadscope.core.spec import ORACLE

if TYPE_CHECKING:
    # Otherwise the scores of all boards would depend on the code that reads recorded data.
    from roadscope.benchmarks.recorded.recording import SequenceSettings
    from roadscope.benchmarks.recorded.suite import DataFolder

Scores = Mapping[str, Score]
Condition = Callable[[Any], str]

CONDITIONS: Mapping[str, Condition] = {
    "weather": lambda episode: episode.weather,
    "scenario": lambda episode: episode.scenario,
    "condition": lambda episode: episode.condition,
}
"""By what whole episodes of simulated traffic are broken down; `condition` is weather, light and
faults together."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a board.

    metric: its name in scores. heading: of the column; it may be broken at spaces.
    decimals: digits after the point. note: its explanation below the table.
    """

    metric: str
    heading: str
    decimals: int = 2
    note: str = ""


@dataclass(frozen=True, slots=True)
class Breakdown:
    """A quantity or condition by which a board's figures are broken down.

    by: its name, as `--by` takes it. title: its name in the title of a table; empty: `by`.
    note: explanation below the tables.
    """

    by: str
    title: str = ""
    note: str = ""


def time_columns(decimals: int, per: str) -> tuple[Column, Column]:
    """Return the columns of the median times of a call. per: what a call is for, `frame`."""
    return (
        Column("call_p50_ms", "ms p50", decimals, f"ms p50: median processor time for one {per}."),
        Column("wall_p50_ms", "wall ms", decimals, "wall: median time on the clock."),
    )


def slow_calls_column(decimals: int) -> Column:
    """Return the column of the times of the slowest calls."""
    return Column("call_p99_ms", "ms p99", decimals, "ms p99: 99th percentile.")


class SuiteCheck(NamedTuple):
    """One check of a suite.

    key: of the suite's file that is checked, `tracking.detectors`.
    check: called with the argument; raises `ValueError` with the reason.
    """

    key: str
    check: Callable[[Any], object]
    argument: Any


NO_RECORDED_REPLAY = "Recorded objects are matched by rules of their own, and have no replay."


class Board(ABC):
    """A leaderboard.

    To add a board, write a subclass in a file of its own and add its line to `boards.BOARDS`.

    A board ranks its entries. Beside them it may show marks, which have no rank: the best that can
    be expected (upper mark), the least (lower mark), noise models, or one sensor alone.
    """

    # What it ranks.
    name: str
    kind: Kind
    """Kind of the plug-ins that it ranks."""
    headline: str
    """The metric that it ranks by."""
    settings_type: type[BoardSettings] = BoardSettings
    """Record of a suite's settings for the board; all of its fields have defaults."""
    default_suite: str = "quick"
    """The suite of a run without `--suite`."""
    takes_scripted: bool = True
    """Whether it can use scenarios whose traffic is scripted."""

    # What entries get.
    detections_field: str = ""
    """Field of its settings that names the detectors whose detections entries get; empty: they get
    none."""
    inputs_name: str = ""
    """The breakdown by the detector whose detections an entry gets; empty: it gets none."""
    uses_calibration: bool = False
    """Whether its plug-ins get the calibration file of a run, if it has one."""

    # Its table.
    columns: Sequence[Column]
    """The columns, the most important first; the table shows as many as its width allows."""
    three_digits: bool = False
    """Whether figures have three significant digits: for metrics from millimetres to kilometres."""
    summed: Sequence[str] = ()
    """Counts that are shown as sums over episodes, as in papers."""
    medians: Sequence[str] = ()
    """Metrics whose median over episodes is shown too, as `NAME_median`."""
    sample: str = "seeds"
    """What intervals are computed over, in words; empty: there are no intervals."""
    marks_notes: Mapping[str, str] = {}
    """What marks are, by the ending of their names; said where one of them is shown."""
    object_metric: str = ""
    """A metric that has a value as soon as one object is eligible."""

    # Its breakdowns.
    breakdowns: Sequence[Breakdown]
    by_condition: Sequence[str]
    """Metrics of whole episodes that are broken down by conditions."""
    shown_parts: Sequence[Column]
    """Metrics that are shown broken down; the heading is part of a title."""
    conditions: Mapping[str, Condition] = CONDITIONS
    alarms: str = ""
    """Heading of `false_alarms` beside detection rates in breakdowns; empty: they are not shown."""
    always_by: tuple[str, str] | None = None
    """A breakdown, and its one metric, that is shown even without `--by`."""

    # Predictions, pictures and views.
    predictors: Sequence[str] = ()
    """Metrics of the inputs of entries that may predict how well these do."""
    predicted: Sequence[str] = ()
    """Metrics of how well entries do, which `predictors` may predict."""
    by_distance: Mapping[str, str] = {}
    """Metrics that `drift.svg` draws over the distance driven, with the labels of their axes."""
    over_time: Sequence[str] = ()
    """Metrics of `box_scores` that `roadscope view` shows over time."""
    without_replay: str = ""
    """Empty, or why the page cannot replay its worst moments."""
    unviewable: str = ""
    """Empty, or why `roadscope view` cannot show its answers: `a drive, which no view shows`."""

    # For recorded data.
    simulated_board: str = ""
    """The board that ranks the same plug-ins on simulated traffic."""
    compared_with: str = ""
    """The board of simulated traffic that its ranks are compared with."""
    comparison_note: str = ""
    """Text in place of the comparison where there is nothing to compare its ranks with."""
    kitti_markers: Sequence[Sequence[str]] = ()
    """Groups of names of files: a folder with a file of each group has KITTI's data for it."""

    @property
    def summary(self) -> str:
        """What it ranks: the first line of its class's docstring."""
        return (type(self).__doc__ or "").partition("\n")[0]

    @abstractmethod
    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return the jobs of entries and marks on all episodes of a suite."""

    @abstractmethod
    def score(self, job: Job, answers: Any, options: RunOptions) -> Scores:
        """Return the scores of a job's answers. options: for reading the inputs of the entry."""

    def kitti_settings(self, place: DataFolder) -> Mapping[str, SequenceSettings]:
        """Return the settings for a folder of KITTI's data, of this board and of others like it.

        Empty for a board without `kitti_markers`. `FormatError` if the data are not complete.
        """
        return {}

    def box_scores(
        self, boxes: Sequence[Any], truths: Sequence[Truth], pairings: Sequence[Pairing]
    ) -> Scores:
        """Return the scores of some frames; empty for a board without metrics in `over_time`.

        boxes: detections for a board of detectors, tracks for one of trackers.
        """
        return {}

    @abstractmethod
    def explanation(self, suite: Suite) -> str:
        """Return as text which objects are eligible and what entries get."""

    def suite_entries(self, suite: Suite) -> Sequence[str]:
        """Return the entries that a suite compares on this board."""
        return suite.settings(self.name, self.settings_type).entries

    def check_entry(self, spec: Spec) -> Spec:
        """Return an entry's resolved spec; raise `SpecError` if it cannot be an entry."""
        return check_plugin_spec(spec, self.kind)

    def suite_checks(self, suite: Suite) -> list[SuiteCheck]:
        """Return the checks of a suite's settings beside its entries, done before anything runs."""
        return []

    def pooled(self, metric: str, scores: Sequence[Scores]) -> list[Score]:
        """Return the scores of episodes from which the board's figure of a metric is pooled.

        They are those of the metric itself, but for the calibration error: it is pooled from the
        bins of all episodes, where these have bins.
        """
        if metric == "calibration_error":
            bins = [part_name(EXCESS, "score", band) for band in BANDS["score"].labels]
            if all(name in of_episode for of_episode in scores for name in bins):
                return pooled_calibration([[each[name] for name in bins] for each in scores])
        return [of_episode[metric] for of_episode in scores]

    def is_silent(self, metric: str, scores: Sequence[Scores]) -> bool:
        """Return whether a metric is left out because the entry never reports what it measures."""
        return False

    def remark(self, calibration: str) -> str:
        """Return a remark on a run with a calibration file; empty if there is none."""
        return ""


@dataclass(frozen=True, slots=True)
class JobOptions:
    """Options of a run that change the jobs of a board.

    marks: whether marks are shown beside the entries.
    calibration: a file with the calibration that plug-ins get; empty: that of the rig.
    """

    marks: bool = True
    calibration: str = ""


def check_camera(suite: Suite) -> None:
    """Raise `ValueError` for a suite whose rig has no camera."""
    from roadscope.benchmarks.images import camera_of
    from roadscope.envs.sensors.rigs import rig

    camera_of(rig(suite.rig))


def check_inputs(suite: Suite, key: str, names: Sequence[str]) -> None:
    """Raise `SpecError` if a suite names nothing whose answers the entries of a board get.

    key: of the suite's file, `tracking.detectors`. names: what it has there.
    """
    if not names:
        raise SpecError(f"suite {suite.title} has no {key}, whose answers its entries get")


def input_checks(suite: Suite, inputs: Mapping[str, Sequence[str]]) -> list[SuiteCheck]:
    """Return the checks that there are inputs. inputs: names by key, as in `check_inputs`."""

    def check(key: str) -> None:
        check_inputs(suite, key, inputs[key])

    return [SuiteCheck("", check, key) for key in inputs]


def episodes(suite: Suite) -> list[Episode]:
    """Return every scenario with every seed in every weather, light and set of faults.

    They are not combined: only one of weather, light and faults differs from its first value.
    """
    weather, *other_weathers = suite.weathers
    light, *other_lights = suite.lights
    faults, *other_faults = suite.faults
    conditions = [
        (weather, light, faults),
        *((other, light, faults) for other in other_weathers),
        *((weather, other, faults) for other in other_lights),
        *((weather, light, other) for other in other_faults),
    ]
    return [
        Episode(scenario, seed, suite.rig, suite.duration_s, *condition)
        for seed in suite.seeds
        for scenario in suite.scenarios
        for condition in conditions
    ]


def mark_of(source: Spec) -> str | None:
    """Return the mark of what image boxes or poses come from; None for an entry with a rank."""
    if source.kind == ORACLE:
        return UPPER_MARK
    if is_noise(source):
        return IMITATION
    return LOWER_MARK if str(source) in LOWER_ODOMETRIES else None


def call_cost(times: CallTimes, percentiles: Sequence[int] = (50, 99)) -> dict[str, Score]:
    """Return the times of a plug-in's calls: percentiles of processor time, median of wall time.

    The first call is left out: it may compile or load what the plug-in needs.
    """
    median_wall = cost(times.wall_ms, (50,))["call_p50_ms"]
    return {**cost(times.processor_ms, percentiles), "wall_p50_ms": median_wall}
