"""The graph of a run: traffic -> detections -> answers -> scores, each computed once and kept.

A `Node` is a kept file, named by a hash of everything that it depends on. A `Job` scores the
answers of one entry on one episode of a board. `run_jobs` computes what is missing: the nodes that
jobs need, level by level, then their scores.
"""

from __future__ import annotations

import json
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from roadscope.benchmarks.cache import Ledger, Saved, cache_dir, checked_by, digest_of, kept
from roadscope.benchmarks.fingerprint import code_hash, fingerprint
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.store import Outcome
from roadscope.benchmarks.workers import Workers, WorkerSettings, open_workers

if TYPE_CHECKING:
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.recorded.recording import Recording

Item = TypeVar("Item")
R = TypeVar("R")


class Node(ABC):
    """Something that is computed once and kept as a file.

    Nodes are frozen dataclasses of names and numbers: they are sent to worker processes.
    """

    stage: ClassVar[str]
    """What is shown while nodes of this class are computed."""
    folder: ClassVar[str]
    """Where in the cache folder its files are."""
    record: ClassVar[Any]
    """Class of what it holds, with `save` and `load`."""

    @abstractmethod
    def content(self) -> Mapping[str, Any]:
        """Return everything that the node depends on, as JSON can hold it."""

    @abstractmethod
    def compute(self, options: RunOptions) -> Saved:
        """Compute what the node holds; what a plug-in does wrong raises `PluginError`."""

    def sources(self) -> tuple[Node, ...]:
        """Return the nodes that this one is computed from."""
        return ()

    @cached_property
    def key(self) -> str:
        """The hash of its content."""
        return fingerprint(self.content())

    @property
    def path(self) -> Path:
        """The kept file."""
        return cache_dir() / self.folder / f"{self.key}.npz"

    def read(self, options: RunOptions | None = None, *, anew: bool = False) -> Any:
        """Read what is kept, or compute and keep it; anew: compute it in any case."""
        make = partial(self.compute, options or RunOptions())
        return kept(self.path, self.record.load, make, anew=anew)


class Scoring(Protocol):
    """What the graph must know of a board."""

    name: str

    def score(self, job: Job, answers: Any, options: RunOptions, /) -> Mapping[str, Score]:
        """Return the scores of a job's answers."""


@dataclass(frozen=True)
class Job:
    """The score of one entry on one episode.

    board: what scores the answers.
    entry: how the board calls the entry.
    mark: which mark of the board it is, or None when it is ranked.
    answers: the node of its answers.
    inputs: whose detections it gets, in words; empty where it makes its own.
    settings: what scores depend on beside the answers, as JSON can hold it.
    missing: what is not installed that the entry needs.
    """

    board: Scoring
    entry: str
    episode: Episode | Recording
    answers: Node
    mark: str | None = None
    inputs: str = ""
    settings: Any = None
    missing: str = ""

    @cached_property
    def spec(self) -> str:
        """Everything that the score depends on, as JSON."""
        content = {
            "board": self.board.name,
            "entry": self.entry,
            "metric_version": METRIC_VERSION,
            "metric_code": code_hash(type(self.board).__module__),
            "settings": fingerprint(self.settings),
            "answers": self.answers.content(),
        }
        return json.dumps(content, sort_keys=True)

    @cached_property
    def key(self) -> str:
        """The hash of `spec`, under which the score is kept."""
        return fingerprint(self.spec)


@dataclass(frozen=True, slots=True)
class NodeFailure:
    """Why a node could not be computed, and what the plug-in printed.

    worker_died: nobody knows why; the reason does not name a plug-in.
    """

    reason: str
    log: str = ""
    worker_died: bool = False


def run_jobs(
    jobs: Sequence[Job],
    take: Callable[[Job, Outcome], None],
    *,
    workers: WorkerSettings | None = None,
    options: RunOptions | None = None,
    progress: Progress = silent,
) -> None:
    """Compute the scores of jobs, and what they need; `take` is called with each outcome.

    Whatever goes wrong becomes the reason of a job's outcome. A source that failed is not run again
    for each job that needs it. Kept files that somebody else changes meanwhile are not used.

    workers: which processes compute; None: this one.
    """
    if not jobs:
        return
    possible = [job for job in jobs if not job.missing]
    for job in jobs:
        if job.missing:
            take(job, Outcome({}, f"{job.entry}: {job.missing}"))
    settings = workers or WorkerSettings()
    # Machines of a cluster may have files of their own under the same names.
    files = KeptFiles(possible if settings.address is None else ())
    with open_workers(settings) as opened:
        run = _Run(files, opened, options or RunOptions(), progress)
        failures = run.compute(_levels(possible))
        for job in possible:
            if failure := _failed(job.answers, failures):
                named = f"{job.entry}: " if failure.worker_died else ""
                take(job, Outcome({}, named + failure.reason, failure.log))
        scored = [job for job in possible if not _failed(job.answers, failures)]
        for board in dict.fromkeys(job.board.name for job in scored):
            own = [job for job in scored if job.board.name == board]
            for job, outcome in run.each(score, own, f"{board} board", on_death=_job_death):
                take(job, outcome)


class _Run:
    """The nodes and jobs of a run, one stage after the other."""

    def __init__(
        self, files: KeptFiles, workers: Workers, options: RunOptions, progress: Progress
    ) -> None:
        self._files, self._workers = files, workers
        self._options, self._progress = options, progress
        self._computed: set[str] = set()

    def compute(self, levels: Sequence[Sequence[Node]]) -> Mapping[str, NodeFailure]:
        """Compute what is missing of the nodes; return by key why some could not be."""
        failures: dict[str, NodeFailure] = {}
        for level in levels:
            wanted = [n for n in level if self._missing(n) and not _failed(n, failures)]
            for stage in dict.fromkeys(node.stage for node in wanted):
                nodes = [node for node in wanted if node.stage == stage]
                for node, failure in self.each(_compute, nodes, stage, on_death=_node_death):
                    self._computed.add(node.key)
                    if failure is not None:
                        failures[node.key] = failure
        return failures

    def each(
        self,
        function: Callable[[RunOptions, _Task[Item]], R],
        items: Sequence[Item],
        stage: str,
        *,
        on_death: Callable[[Item], R],
    ) -> Iterator[tuple[Item, R]]:
        """Apply a function to items, in any order, and report the progress."""
        if items:
            self._progress(stage, 0, len(items))
        work = partial(_checked, function, self._options)
        tasks = _Tasks(items, self._task)
        episodes = [getattr(item, "episode", None) for item in items]
        results = self._workers.each(
            work, tasks, groups=episodes, on_death=lambda task: (on_death(task.item), Ledger())
        )
        for done, (index, (result, ledger)) in enumerate(results, start=1):
            self._files.take(ledger)
            yield items[index], result
            self._progress(stage, done, len(items))

    def _task(self, item: Item) -> _Task[Item]:
        node = _node_of(item)
        anew = self._anew(node) and node.key not in self._computed
        return _Task(item, self._files.of(node), anew)

    def _missing(self, node: Node) -> bool:
        return self._anew(node) or not self._files.has(node)

    def _anew(self, node: Node) -> bool:
        """Return whether a kept node is computed again; traffic never is: it is deterministic."""
        return self._options.fresh and bool(node.sources())


@dataclass(frozen=True, slots=True)
class _Task(Generic[Item]):
    """A node or job for a worker.

    digests: of the files that it reads. anew: compute the node again although it is kept.
    """

    item: Item
    digests: Mapping[str, str | None]
    anew: bool


class _Tasks(Sequence[Any]):
    """Items as tasks, each made when it is asked for: digests are those of that moment."""

    def __init__(self, items: Sequence[Item], make: Callable[[Item], _Task[Item]]) -> None:
        self._items, self._make = items, make

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: Any) -> Any:
        return self._make(self._items[index])


def _node_of(item: Any) -> Node:
    node: Node = item.answers if isinstance(item, Job) else item
    return node


class KeptFiles:
    """The kept files that jobs need, by the digests that they had when the run began.

    Their digests stay in this process, which no plug-in writes to: a file that has another one
    later was changed by somebody else.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        """Read the digests of all files that there are."""
        self._digests: dict[str, str | None] = {}
        paths = {node.path for job in jobs for node in _with_sources(job.answers)}
        for path in sorted(paths):
            digest = self._digests[str(path)] = digest_of(path)
            if digest is None and path.exists():
                _warn(f"{path} is damaged: it has no digest; it is made again")

    def has(self, node: Node) -> bool:
        """Return whether there is a file of a node that may be used."""
        return self._digests.get(str(node.path), "") is not None and node.path.exists()

    def of(self, node: Node) -> Mapping[str, str | None]:
        """Return the digests of the files that a node is computed from, and its own."""
        paths = {str(each.path) for each in _with_sources(node)}
        return {path: self._digests[path] for path in paths if path in self._digests}

    def take(self, ledger: Ledger) -> None:
        """Take the digests of what a task wrote, and show its warnings."""
        known = {path: d for path, d in ledger.written.items() if path in self._digests}
        self._digests.update(known)
        for note in ledger.notes:
            _warn(note)


def _with_sources(node: Node) -> Iterator[Node]:
    """Yield a node and everything that it is computed from."""
    yield node
    for source in node.sources():
        yield from _with_sources(source)


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=2)


def score(options: RunOptions, task: _Task[Job]) -> Outcome:
    """Compute the answers of a job, unless they are kept, and score them."""
    job = task.item
    try:
        answers = job.answers.read(options, anew=task.anew)
    except PluginError as error:
        return Outcome({}, str(error), error.log)
    except Exception as error:
        return Outcome({}, f"not the entry's fault: {described(error)}")
    try:
        return Outcome(job.board.score(job, answers, options))
    except Exception as error:
        return Outcome({}, f"not the entry's fault: {described(error)}")


def described(error: BaseException) -> str:
    """Return in one line what was raised and at which line."""
    import traceback

    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())}{place}"


def _levels(jobs: Sequence[Job]) -> list[list[Node]]:
    """Return the nodes that others are computed from, those without sources first.

    The answers of a job that nobody else needs are computed with its score.
    """
    shared: dict[str, Node] = {}
    depths: dict[str, int] = {}

    def visit(node: Node) -> int:
        if node.key not in depths:
            for source in node.sources():
                shared.setdefault(source.key, source)
            depths[node.key] = 1 + max((visit(s) for s in node.sources()), default=-1)
        return depths[node.key]

    for job in jobs:
        visit(job.answers)
    levels: list[list[Node]] = [[] for _ in range(1 + max(depths.values(), default=-1))]
    for key, node in shared.items():
        levels[depths[key]].append(node)
    return [level for level in levels if level]


def _failed(node: Node, failures: Mapping[str, NodeFailure]) -> NodeFailure | None:
    """Return why a node or one of its sources could not be computed."""
    if not failures:
        return None
    if own := failures.get(node.key):
        return own
    return next((f for source in node.sources() if (f := _failed(source, failures))), None)


def _compute(options: RunOptions, task: _Task[Node]) -> NodeFailure | None:
    """Compute and keep a node."""
    try:
        task.item.read(options, anew=task.anew)
    except PluginError as error:
        return NodeFailure(str(error), error.log)
    except Exception as error:
        return NodeFailure(f"not the entry's fault: {described(error)}")
    return None


def _node_death(node: Node) -> NodeFailure:
    """Return the failure of a node during which workers died repeatedly."""
    reason = f"the worker process died while its {node.stage} were computed (out of memory?)"
    return NodeFailure(reason, worker_died=True)


def _job_death(job: Job) -> Outcome:
    """Return the outcome of a job during which workers died repeatedly."""
    reason = f"the worker process died while it ran on {job.episode.scenario} (out of memory?)"
    return Outcome({}, f"{job.entry}: {reason}")


def _checked(
    function: Callable[[RunOptions, _Task[Item]], R], options: RunOptions, task: _Task[Item]
) -> tuple[R, Ledger]:
    """Apply a function in a worker; return what it wrote and what was wrong with files too."""
    with checked_by(Ledger(task.digests)) as ledger, options.probing():
        result = function(options, task)
    return result, Ledger(written=ledger.written, notes=ledger.notes)
