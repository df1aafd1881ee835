"""Comparison of two runs, or of two entries of one run, on the same jobs."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import msgspec

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.metrics.breakdown import split_name
from roadscope.benchmarks.metrics.score import Better, Score
from roadscope.benchmarks.results.rows import Block, JobName, JobScores, blocks
from roadscope.benchmarks.results.statistics import (
    linearised,
    measured,
    paired_interval,
    paired_p_value,
)
from roadscope.core.names import unknown

Verdict = Literal["better", "worse", "same", "unknown"]
Side = Literal["a", "b"]

NAME = "leaderboard.json"
TIMES = re.compile(r"(call|wall)_.*_ms")
"""Names of metrics that are computing times and depend on the machine too."""


class CompareError(ValueError):
    """Two results cannot be compared."""


class WithJson(Protocol):
    """Results of a run, such as `Results`."""

    def to_json(self) -> str:
        """Return the content of its `leaderboard.json`."""


Source = Path | str | Mapping[str, Any] | WithJson
"""A `leaderboard.json`, a folder that holds one, its content, or results of a run."""


@dataclass(frozen=True, slots=True)
class ScoredRun:
    """The scores of all jobs of one run, and where they come from."""

    label: str
    manifest: Mapping[str, Any]
    jobs: tuple[JobScores, ...]

    def entries(self) -> list[str]:
        """Return the names of its entries."""
        return list(dict.fromkeys(job.entry for job in self.jobs))


@dataclass(frozen=True, slots=True)
class Difference:
    """How one metric differs between A and B.

    a, b: values pooled over the blocks that both runs have; a block is a scenario with a seed.
    difference: b minus a, with its interval low to high; NaN where there is none.
    p: p-value of no difference; q: the same, adjusted to the number of metrics compared.
    n: number of blocks.
    timed: whether it is a time, which depends on the machine too.
    verdict: of B. `unknown` where there are too few blocks to tell.
    """

    board: str
    entry_a: str
    entry_b: str
    metric: str
    a: float
    b: float
    difference: float
    low: float
    high: float
    p: float
    q: float
    n: int
    unit: str
    better: Better
    timed: bool
    verdict: Verdict

    @property
    def entry(self) -> str:
        """The entry, or B's against A's."""
        return _label_of_entries(self.entry_a, self.entry_b)


@dataclass(frozen=True, slots=True)
class FailedJob:
    """A job that failed on one side or on both, with the reason (of B where both have one)."""

    name: JobName
    entry_a: str
    entry_b: str
    failed_in_a: bool
    failed_in_b: bool
    reason: str

    @property
    def entry(self) -> str:
        """The entry, or B's against A's."""
        return _label_of_entries(self.entry_a, self.entry_b)


@dataclass(frozen=True, slots=True)
class Unpaired:
    """Jobs that only one side has, or in which only one side has a metric.

    metric: its name; empty if whole jobs have no counterpart.
    """

    side: Side
    board: str
    entry: str
    metric: str
    jobs: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """All differences between A and B.

    level: of the intervals; 1 - level is the false discovery rate of the verdicts.
    times: whether times count as regressions.
    """

    a: str
    b: str
    level: float
    times: bool
    differences: tuple[Difference, ...]
    failures: tuple[FailedJob, ...]
    unpaired: tuple[Unpaired, ...]

    @property
    def changed(self) -> tuple[Difference, ...]:
        """The metrics that are better or worse in B."""
        return tuple(d for d in self.differences if d.verdict in ("better", "worse"))

    @property
    def regressions(self) -> tuple[Difference, ...]:
        """The metrics that are worse in B; times only if they count."""
        worse = [d for d in self.differences if d.verdict == "worse"]
        return tuple(d for d in worse if self.times or not d.timed)

    @property
    def new_failures(self) -> tuple[FailedJob, ...]:
        """The jobs that failed in B and not in A."""
        return tuple(f for f in self.failures if f.failed_in_b and not f.failed_in_a)

    @property
    def regressed(self) -> bool:
        """Whether B is worse than A anywhere."""
        return bool(self.regressions or self.new_failures)

    def to_json(self) -> str:
        """Return everything as JSON text."""
        content = {**asdict(self), "regressed": self.regressed}
        content["failures"] = [{**asdict(f), "name": f.name._asdict()} for f in self.failures]
        # NaN becomes null.
        return msgspec.json.format(msgspec.json.encode(content), indent=1).decode() + "\n"


def compare(
    a: Source,
    b: Source | None = None,
    *,
    entries: Sequence[str] | None = None,
    metrics: Iterable[str] | None = None,
    level: float = 0.95,
    times: bool = False,
) -> Comparison:
    """Compare each metric of each entry of B with that of A, on the jobs that both have.

    entries: two names: an entry of A and one of B (of A, if B is left out). If left out, each
        entry is compared with the one of the same name.
    metrics: their names; if left out, all metrics of whole episodes. One that is broken down is
        named as in `f1 by range: 0-20`.
    times: whether times (`call_*_ms`, `wall_*_ms`) count as regressions too.

    The seeds of each scenario are the sample; intervals are those of `paired_interval`, p-values of
    `paired_p_value`. At a level of 0.95, a score that is 0 or 1 must differ in at least six blocks:
    if only five differ, and all alike, the verdict is `same`. A metric is better or worse where its
    p-value, adjusted by Benjamini and Hochberg (1995), is at most 1 - level and its interval
    excludes zero. Metrics that are equal in every block are not counted among those compared: they
    cannot become a false discovery.
    """
    if not 0.5 <= level < 1:
        raise CompareError(f"a level lies between 0.5 and 1, got {level:g}")
    run_a, run_b = _runs(a, b, entries)
    check_comparable(run_a, run_b)
    matched: list[list[_Pair]] = []
    unpaired: list[Unpaired] = []
    for entry_a, entry_b in _entry_pairs(run_a, run_b, entries):
        by_board, alone = _match(run_a, run_b, entry_a, entry_b)
        matched += by_board
        unpaired += alone
    if not matched:
        raise CompareError(f"{run_a.label} and {run_b.label} have no job in common")
    wanted = _wanted(matched, metrics)
    differences: list[Difference] = []
    for pairs in matched:
        of_entry, missing = _differences(pairs, wanted, level)
        differences += of_entry
        unpaired += missing
    label_a, label_b = run_a.label, run_b.label
    if entries is not None:
        label_a, label_b = f"{label_a}, {entries[0]}", f"{label_b}, {entries[1]}"
    return Comparison(
        label_a,
        label_b,
        level,
        times,
        tuple(_judged(differences, level, times)),
        tuple(_failures(chain.from_iterable(matched))),
        tuple(unpaired),
    )


def read_run(source: Source) -> ScoredRun:
    """Read the scores of all jobs of a run; a file without them raises `CompareError`."""
    label, content = _content(source)
    if not isinstance(content, Mapping):
        raise CompareError(f"{label} is not a {NAME} of roadscope leaderboard")
    items, manifest = content.get("scores"), content.get("manifest", {})
    if not isinstance(items, list):
        raise CompareError(
            f'{label} has no list "scores", by which single seeds are compared; files of '
            "earlier versions have only means: run the leaderboard again"
        )
    jobs = []
    for number, item in enumerate(items):
        try:
            jobs.append(JobScores.from_json(item))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise CompareError(
                f'{label}: item {number} of "scores" is not as expected ({error!r})'
            ) from error
    names = [(job.name, job.entry) for job in jobs]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise CompareError(f"{label} has two jobs of {twice[1]} on {' '.join(map(str, twice[0]))}")
    return ScoredRun(label, manifest if isinstance(manifest, Mapping) else {}, tuple(jobs))


class _Pair(NamedTuple):
    """A job of A and the same job of B."""

    a: JobScores
    b: JobScores


def _content(source: Source) -> tuple[str, Any]:
    if isinstance(source, Mapping):
        return "the results", source
    if hasattr(source, "to_json"):
        return "the results", json.loads(source.to_json())
    if not isinstance(source, str | Path):
        raise CompareError(f"expected a {NAME}, its content or results, got {source!r}")
    path = Path(source)
    if path.is_dir():
        path = path / NAME
    if not path.is_file():
        raise CompareError(f"no file {path}: name a {NAME} or a folder that holds one")
    try:
        return str(path), json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise CompareError(f"{path} is no JSON file: {error}") from error


def _runs(
    a: Source, b: Source | None, entries: Sequence[str] | None
) -> tuple[ScoredRun, ScoredRun]:
    if entries is not None and (isinstance(entries, str) or len(entries) != 2):
        raise CompareError(f"entries are two names, one of A and one of B, got {entries!r}")
    if b is None and entries is None:
        raise CompareError("name a second file, or two entries of the first one")
    run_a = read_run(a)
    return run_a, run_a if b is None else read_run(b)


def check_comparable(a: ScoredRun, b: ScoredRun) -> None:
    """Raise `CompareError` for runs of different suites or versions of suite or metrics.

    Likewise if what a suite measures differs although its version is the same.
    """
    for key, what in (
        ("suite", "suites"),
        ("suite_version", "versions of the suite"),
        ("metric_version", "versions of the metrics"),
    ):
        of_a, of_b = a.manifest.get(key), b.manifest.get(key)
        if of_a is not None and of_b is not None and of_a != of_b:
            raise CompareError(f"A and B are of different {what}: {of_a} and {of_b}")
    for key, what in (
        ("duration_s", "length of the episodes"),
        ("eligibility_hash", "rule of eligibility"),
        ("rig_hash", "rig"),
    ):
        # Manifests of earlier versions of roadscope lack these keys.
        if key in a.manifest and key in b.manifest and a.manifest[key] != b.manifest[key]:
            suite, version = a.manifest.get("suite"), a.manifest.get("suite_version")
            raise CompareError(
                f"A and B differ in the {what}, although both are of suite {suite} v{version}: "
                "run A again, and raise the version of a suite when you change it"
            )


def _entry_pairs(
    a: ScoredRun, b: ScoredRun, entries: Sequence[str] | None
) -> list[tuple[str, str]]:
    if entries is None:
        return [(entry, entry) for entry in dict.fromkeys([*a.entries(), *b.entries()])]
    for run, entry in ((a, entries[0]), (b, entries[1])):
        if entry not in run.entries():
            raise CompareError(f"{run.label}: {unknown('entry', entry, run.entries())}")
    return [(entries[0], entries[1])]


def _match(
    a: ScoredRun, b: ScoredRun, entry_a: str, entry_b: str
) -> tuple[list[list[_Pair]], list[Unpaired]]:
    """Pair the jobs of two entries, board by board, and count those that only one side has."""
    of_a = {_paired_by(job): job for job in a.jobs if job.entry == entry_a}
    of_b = {_paired_by(job): job for job in b.jobs if job.entry == entry_b}
    pairs: dict[str, list[_Pair]] = {}
    for name in of_a:
        if name in of_b:
            pairs.setdefault(name.board, []).append(_Pair(of_a[name], of_b[name]))
    only_a = Counter(name.board for name in of_a if name not in of_b)
    only_b = Counter(name.board for name in of_b if name not in of_a)
    unpaired = [Unpaired("a", board, entry_a, "", count) for board, count in only_a.items()]
    unpaired += [Unpaired("b", board, entry_b, "", count) for board, count in only_b.items()]
    return list(pairs.values()), unpaired


def _paired_by(job: JobScores) -> JobName:
    """Return the name by which a job is paired: without inputs that the entry itself names.

    So drivers on different perception stacks are compared on the same traffic.
    """
    names_inputs = bool(job.inputs) and job.entry.endswith(f" on {job.inputs}")
    return job.name._replace(inputs="") if names_inputs else job.name


def _failures(pairs: Iterable[_Pair]) -> Iterator[FailedJob]:
    """Yield the jobs that failed on either side."""
    for a, b in pairs:
        failed_in_a, failed_in_b = a.reason is not None, b.reason is not None
        if failed_in_a or failed_in_b:
            reason = b.reason or a.reason or ""
            yield FailedJob(a.name, a.entry, b.entry, failed_in_a, failed_in_b, reason)


def _wanted(matched: Sequence[Sequence[_Pair]], metrics: Iterable[str] | None) -> set[str]:
    """Return the names of the metrics to compare."""
    names = {
        name: None
        for pair in chain.from_iterable(matched)
        for name in (*pair.a.scores, *pair.b.scores)
    }
    whole = [name for name in names if not split_name(name)[1]]
    if metrics is None:
        return set(whole)
    wanted = {metrics} if isinstance(metrics, str) else set(metrics)
    for name in sorted(wanted):
        if name not in names:
            raise CompareError(unknown("metric", name, whole))
    return wanted


def _differences(
    pairs: Sequence[_Pair], wanted: set[str], level: float
) -> tuple[list[Difference], list[Unpaired]]:
    """Return how the wanted metrics of an entry differ, and which of them only one side has."""
    first = pairs[0]
    sound = [pair for pair in pairs if pair.a.reason is None and pair.b.reason is None]
    names = dict.fromkeys(n for pair in sound for n in (*pair.a.scores, *pair.b.scores))
    differences, unpaired = [], []
    for name in (n for n in names if n in wanted):
        has = Counter((name in pair.a.scores, name in pair.b.scores) for pair in sound)
        if has[True, False]:
            unpaired.append(Unpaired("a", first.a.board, first.a.entry, name, has[True, False]))
        if has[False, True]:
            unpaired.append(Unpaired("b", first.b.board, first.b.entry, name, has[False, True]))
        if has[True, True]:
            both = [pair for pair in sound if name in pair.a.scores and name in pair.b.scores]
            differences.append(_difference(both, name, level))
    return differences, unpaired


def _by_block(jobs: Sequence[JobScores], metric: str) -> dict[Block, Score]:
    """Return a metric of an entry by scenario and seed."""
    scores = board_named(jobs[0].board).pooled(metric, [job.scores for job in jobs])
    return blocks([((j.scenario, j.seed), s) for j, s in zip(jobs, scores, strict=True)])


def _difference(pairs: Sequence[_Pair], metric: str, level: float) -> Difference:
    """Return how a metric differs that both jobs of each pair have."""
    ones = _by_block([pair.a for pair in pairs], metric)
    others = _by_block([pair.b for pair in pairs], metric)
    used = [block for block in ones if measured(ones[block]) and measured(others[block])]
    scores_a, scores_b = [ones[block] for block in used], [others[block] for block in used]
    strata = [scenario for scenario, _ in used]
    interval = paired_interval(scores_b, scores_a, strata, level=level)
    first = next(iter(ones.values()))
    return Difference(
        pairs[0].a.board,
        pairs[0].a.entry,
        pairs[0].b.entry,
        metric,
        linearised(scores_a)[0] if used else math.nan,
        linearised(scores_b)[0] if used else math.nan,
        interval.mean,
        interval.low,
        interval.high,
        p=paired_p_value(scores_b, scores_a, strata) if used else math.nan,
        q=math.nan,
        n=len(used),
        unit=first.unit,
        better=first.better,
        timed=TIMES.fullmatch(metric) is not None,
        verdict="unknown",
    )


def _judged(differences: Sequence[Difference], level: float, times: bool) -> list[Difference]:
    """Return differences with adjusted p-values and verdicts; times are adjusted separately."""
    from scipy.stats import false_discovery_control

    adjusted = [d.p for d in differences]
    # A metric that is equal in every block is not among those compared.
    differing = [
        i
        for i, d in enumerate(differences)
        if math.isfinite(d.p) and (d.difference != 0 or d.low < 0 or d.high > 0)
    ]
    for timed in (False, True):
        family = [i for i in differing if (differences[i].timed and not times) == timed]
        if family:
            q_values = false_discovery_control([adjusted[i] for i in family], method="bh")
            for i, q in zip(family, q_values, strict=True):
                adjusted[i] = float(q)
    return [
        replace(d, q=q, verdict=_verdict(d, q, level))
        for d, q in zip(differences, adjusted, strict=True)
    ]


def _verdict(difference: Difference, q: float, level: float) -> Verdict:
    if math.isnan(q):
        return "unknown"
    excluded = difference.low > 0 or difference.high < 0
    if q > 1 - level or not excluded:
        return "same"
    return "better" if (difference.difference > 0) == (difference.better == "higher") else "worse"


def _label_of_entries(a: str, b: str) -> str:
    return b if a == b else f"{b} against {a}"
