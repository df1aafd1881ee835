"""The graph of a run: traffic -> detections -> answers -> scores, each computed once and kept.

A `Node` is the content of one kept file, named by a hash of everything that the content depends
on. A `Job` is the score of one entry on one episode of a board; its answers are a node.
`run_jobs` computes the nodes that several jobs need, sources first, and then the scores.
"""

from __future__ import annotations

import json
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, fields
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar, cast

from roadscope.benchmarks.cache import Ledger, Saved, cache_dir, checked_by, digest_of, read_or_make
from roadscope.benchmarks.fingerprints import code_hash, fingerprint, plugin_hash
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.store import Outcome
from roadscope.benchmarks.workers import Workers, WorkerSettings, open_workers
from roadscope.core import Spec

if TYPE_CHECKING:
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.recorded.kitti_drive import KittiDrives
    from roadscope.benchmarks.recorded.recording import Recording

Item = TypeVar("Item")
R = TypeVar("R")

FIRST_CALLS = "first calls"
"""What progress shows while plug-ins are called for the first time, which compiles kernels."""


@dataclass(frozen=True)
class Node(ABC):
    """A step of a run whose content is computed once and kept as a file.

    The fields of nodes are names, numbers and other nodes: they are sent to worker processes.
    """

    stage: ClassVar[str]
    """What progress shows while nodes of this class are computed."""
    folder: ClassVar[str] = "answers"
    """Folder of its files in the cache folder, a kind of `cached_files.FILE_KINDS`."""
    record: ClassVar[Any]
    """Class of its content, with `save` and `load`."""
    recomputed_if_fresh: ClassVar[bool] = True
    """Whether a run with `--fresh` computes it again. False for nodes without plug-ins, whose
    content is always the same."""

    @abstractmethod
    def compute(self, options: RunOptions) -> Saved:
        """Compute its content; raise `PluginError` if a plug-in fails."""

    def content(self) -> Mapping[str, Any]:
        """Return everything that its content depends on, as JSON can hold it: code and fields."""
        own = {each.name: _content(getattr(self, each.name)) for each in fields(self)}
        return {"code": code_hash(type(self).__module__), **own}

    def sources(self) -> tuple[Node, ...]:
        """Return the nodes that this one is computed from."""
        values = (getattr(self, each.name) for each in fields(self))
        return tuple(value for value in values if isinstance(value, Node))

    def plugins(self) -> Iterator[Spec]:
        """Yield the resolved specs of the plug-ins that compute it; none for an oracle."""
        values = (getattr(self, each.name) for each in fields(self))
        return (value for value in values if isinstance(value, Spec) and value.target)

    @cached_property
    def key(self) -> str:
        """The hash that names its file."""
        return fingerprint(self.content())

    @property
    def path(self) -> Path:
        """Its file."""
        return cache_dir() / self.folder / f"{self.key}.cache"

    def read(self, options: RunOptions | None = None, *, recompute: bool = False) -> Any:
        """Return its content from its file, or compute it and write the file.

        recompute: compute it although there is a file. Its sources are read from theirs.
        """
        compute = partial(self.compute, options or RunOptions())
        return read_or_make(self.path, self.record.load, compute, recompute=recompute)


def _content(value: Any) -> Any:
    """Return the value of a node's field and what it depends on."""
    if isinstance(value, Node):
        return value.content()
    if isinstance(value, Spec):
        return [str(value), plugin_hash(value)]
    return value.spec() if hasattr(value, "spec") else fingerprint(value)


class Scoring(Protocol):
    """The part of a board that the graph uses."""

    name: str

    def score(self, job: Job, answers: Any, options: RunOptions, /) -> Mapping[str, Score]:
        """Return the scores of a job's answers."""


@dataclass(frozen=True)
class Job:
    """The score of one entry on one episode.

    board: it scores the answers.
    entry: its name on the board.
    answers: the node of its answers.
    mark: `upper mark` or the like for an entry without a rank; None for an entry with a rank.
    inputs: name of the detector whose detections it gets; empty if it gets none.
    settings: what scores depend on beside the answers, as JSON can hold it.
    missing: what the entry needs and is not installed; empty if nothing.
    """

    board: Scoring
    entry: str
    episode: Episode | Recording | KittiDrives
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
    """Why a node could not be computed.

    reason: for the reader; it names the plug-in, unless the worker process died.
    log: what the plug-in printed.
    """

    reason: str
    log: str = ""
    worker_died: bool = False


def run_jobs(
    jobs: Sequence[Job],
    on_outcome: Callable[[Job, Outcome], None],
    *,
    workers: WorkerSettings | None = None,
    options: RunOptions | None = None,
    progress: Progress = silent,
    first_calls: Sequence[Node | Job] = (),
) -> None:
    """Compute the scores of jobs; call `on_outcome` with each outcome as soon as it is computed.

    An error becomes the reason of a job's outcome. A node that several jobs need is computed once,
    also if it fails. A kept file that another program changes during the run is not used.

    workers: the processes that compute; None: this process.
    first_calls: short nodes and jobs that are computed before, so that kernels are compiled. Their
        outcomes are dropped.
    """
    if not jobs:
        return
    installed = [job for job in jobs if not job.missing]
    for job in jobs:
        if job.missing:
            on_outcome(job, Outcome({}, f"{job.entry}: {job.missing}"))
    settings = workers or WorkerSettings()
    # Machines of a cluster may have files of their own under the same names.
    files = KeptFiles(installed if settings.address is None else ())
    only_ours = all(spec.ours for job in installed for spec in plugins_of(job.answers))
    with nullcontext() if only_ours else files.guarded(), open_workers(settings) as opened:
        run = _Run(files, opened, options or RunOptions(), progress)
        run.call_first(first_calls)
        failures = run.compute(_shared_nodes(installed))
        scored = []
        for job in installed:
            failure = _failure_of(job.answers, failures)
            if failure is None:
                scored.append(job)
                continue
            reason = f"{job.entry}: {failure.reason}" if failure.worker_died else failure.reason
            on_outcome(job, Outcome({}, reason, failure.log))
        for board in dict.fromkeys(job.board.name for job in scored):
            of_board = [job for job in scored if job.board.name == board]
            for job, outcome in run.each(_score, of_board, f"{board} board", on_death=_job_death):
                on_outcome(job, outcome)


class _Run:
    """Computes the stages of a run in its workers, one after the other."""

    def __init__(
        self, files: KeptFiles, workers: Workers, options: RunOptions, progress: Progress
    ) -> None:
        self._files, self._workers = files, workers
        self._options, self._progress = options, progress
        self._computed: set[str] = set()

    def compute(self, levels: Sequence[Sequence[Node]]) -> Mapping[str, NodeFailure]:
        """Compute the nodes that are not kept; return the failures by the key of the node."""
        failures: dict[str, NodeFailure] = {}
        for level in levels:
            wanted = [
                node
                for node in level
                if (self._recomputes(node) or not self._files.has(node))
                and _failure_of(node, failures) is None
            ]
            for stage in dict.fromkeys(node.stage for node in wanted):
                nodes = [node for node in wanted if node.stage == stage]
                for node, failure in self.each(_compute, nodes, stage, on_death=_node_death):
                    self._computed.add(node.key)
                    if failure is not None:
                        failures[node.key] = failure
        return failures

    def call_first(self, items: Sequence[Node | Job]) -> None:
        """Compute short nodes and jobs in any order, and drop their outcomes.

        Unlike the stages of a run they do not wait for one another: each computes its own sources.
        """
        for _ in self.each(_compute_or_score, items, FIRST_CALLS, on_death=lambda item: None):
            pass

    def each(
        self,
        function: Callable[[RunOptions, _Task[Item]], R],
        items: Sequence[Item],
        stage: str,
        *,
        on_death: Callable[[Item], R],
    ) -> Iterator[tuple[Item, R]]:
        """Apply a function to nodes or jobs in the workers; yield results as they come.

        on_death: returns the result of an item during which workers died repeatedly.
        """
        if items:
            self._progress(stage, 0, len(items))
        work = partial(_with_ledger, function, self._options)
        tasks = _Tasks(items, self._task_of)
        episodes = [getattr(item, "episode", None) for item in items]
        results = self._workers.each(
            work, tasks, groups=episodes, on_death=lambda task: (on_death(task.item), Ledger())
        )
        for done, (index, (result, ledger)) in enumerate(results, start=1):
            self._files.update(ledger)
            yield items[index], result
            self._progress(stage, done, len(items))

    def _task_of(self, item: Item) -> _Task[Item]:
        node: Node = item.answers if isinstance(item, Job) else cast("Node", item)
        return _Task(item, self._files.digests_for(node), self._recomputes(node))

    def _recomputes(self, node: Node) -> bool:
        """Return whether to compute a node although it is kept: once in a fresh run."""
        fresh = self._options.fresh and node.recomputed_if_fresh
        return fresh and node.key not in self._computed


@dataclass(frozen=True, slots=True)
class _Task(Generic[Item]):
    """A node or job for a worker.

    digests: of the files that it reads, by path.
    recompute: compute the node, or the answers of the job, although they are kept.
    """

    item: Item
    digests: Mapping[str, str | None]
    recompute: bool


class _Tasks(Sequence[Any]):
    """The tasks of items; each is made when a worker takes it, with the digests at that moment."""

    def __init__(self, items: Sequence[Item], task_of: Callable[[Item], _Task[Item]]) -> None:
        self._items, self._task_of = items, task_of

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: Any) -> Any:
        return self._task_of(self._items[index])


class KeptFiles:
    """The digests of the kept files that jobs need, from the start of the run or written by it.

    They stay in this process, which no plug-in can change: if a file has another digest later,
    another program changed it.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        """Read the digests of the files that exist."""
        self._digests: dict[str, str | None] = {}
        paths = {node.path for job in jobs for node in _with_sources(job.answers)}
        for path in sorted(paths):
            digest = self._digests[str(path)] = digest_of(path)
            if digest is None and path.exists():
                _warn(f"{path} is damaged: it has no digest; it is made again")

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Remove in the end what another program changed meanwhile: later runs would use it.

        If the run is interrupted, new files that no task has reported are removed without a
        warning: they may be its own.
        """
        interrupted = True
        try:
            yield
            interrupted = False
        finally:
            for path, expected in self._digests.items():
                if digest_of(Path(path)) in (None, expected):
                    continue
                if expected is not None or not interrupted:
                    _warn(f"{path} was changed by another program during the run; it is removed")
                try:
                    Path(path).unlink(missing_ok=True)
                except OSError as error:
                    _warn(f"{path} cannot be removed ({error.strerror}); do not use it")

    def has(self, node: Node) -> bool:
        """Return whether the file of a node exists and may be used."""
        return self._digests.get(str(node.path), "") is not None and node.path.exists()

    def digests_for(self, node: Node) -> Mapping[str, str | None]:
        """Return the digests of the node's own file and of those that it is computed from."""
        paths = {str(each.path) for each in _with_sources(node)}
        return {path: self._digests[path] for path in paths if path in self._digests}

    def update(self, ledger: Ledger) -> None:
        """Store the digests of the files that a task wrote, and show its warnings."""
        written = {path: d for path, d in ledger.written.items() if path in self._digests}
        self._digests.update(written)
        for note in ledger.notes:
            _warn(note)


def plugins_of(node: Node) -> Iterator[Spec]:
    """Yield the resolved specs of all plug-ins that compute a node and its sources."""
    return chain.from_iterable(each.plugins() for each in _with_sources(node))


def _with_sources(node: Node) -> Iterator[Node]:
    """Yield a node and everything that it is computed from."""
    yield node
    for source in node.sources():
        yield from _with_sources(source)


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=2)


def _score(options: RunOptions, task: _Task[Job]) -> Outcome:
    """Compute the answers of a job, unless they are kept, and score them."""
    job = task.item
    try:
        answers = job.answers.read(options, recompute=task.recompute)
    except PluginError as error:
        return Outcome({}, str(error), error.log)
    except Exception as error:
        return Outcome({}, f"not the entry's fault: {_in_words(error)}")
    try:
        return Outcome(job.board.score(job, answers, options))
    except Exception as error:
        return Outcome({}, f"not the entry's fault: {_in_words(error)}")


def _compute_or_score(options: RunOptions, task: _Task[Node | Job]) -> None:
    """Compute a node or a job. Errors are dropped: the run itself meets and reports them."""
    if isinstance(task.item, Node):
        _compute(options, cast("_Task[Node]", task))
    else:
        _score(options, cast("_Task[Job]", task))


def _in_words(error: BaseException) -> str:
    """Return an error and its line of code as one line of text."""
    import traceback

    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())}{place}"


def _shared_nodes(jobs: Sequence[Job]) -> list[list[Node]]:
    """Return the nodes that are computed before the jobs, in levels: sources before dependents.

    These are the sources of nodes, and the answers that several jobs score. The answers of a single
    job are computed with its score.
    """
    shared: dict[str, Node] = {}
    depths: dict[str, int] = {}

    def depth_of(node: Node) -> int:
        if node.key not in depths:
            sources = node.sources()
            shared.update((source.key, source) for source in sources)
            depths[node.key] = 1 + max(map(depth_of, sources), default=-1)
        return depths[node.key]

    scored: set[str] = set()
    for job in jobs:
        depth_of(job.answers)
        if job.answers.key in scored:
            shared[job.answers.key] = job.answers
        scored.add(job.answers.key)
    levels: dict[int, list[Node]] = {}
    for key, node in shared.items():
        levels.setdefault(depths[key], []).append(node)
    return [levels[depth] for depth in sorted(levels)]


def _failure_of(node: Node, failures: Mapping[str, NodeFailure]) -> NodeFailure | None:
    """Return why a node or one of its sources could not be computed; None if nothing failed."""
    if not failures:
        return None
    every = (failures.get(each.key) for each in _with_sources(node))
    return next(filter(None, every), None)


def _compute(options: RunOptions, task: _Task[Node]) -> NodeFailure | None:
    """Compute and keep a node."""
    try:
        task.item.read(options, recompute=task.recompute)
    except PluginError as error:
        return NodeFailure(str(error), error.log)
    except Exception as error:
        return NodeFailure(f"not the entry's fault: {_in_words(error)}")
    return None


def _node_death(node: Node) -> NodeFailure:
    """Return the failure of a node whose workers died repeatedly."""
    reason = f"the worker process died while its {node.stage} were computed (out of memory?)"
    return NodeFailure(reason, worker_died=True)


def _job_death(job: Job) -> Outcome:
    """Return the outcome of a job whose workers died repeatedly."""
    reason = f"the worker process died while it ran on {job.episode.scenario} (out of memory?)"
    return Outcome({}, f"{job.entry}: {reason}")


def _with_ledger(
    function: Callable[[RunOptions, _Task[Item]], R], options: RunOptions, task: _Task[Item]
) -> tuple[R, Ledger]:
    """Apply a function in a worker; return its result and a ledger of its files and warnings."""
    with checked_by(Ledger(task.digests)) as ledger, options.probing():
        result = function(options, task)
    return result, Ledger(written=ledger.written, notes=ledger.notes)
