"""The graph of a run: traffic -> detections -> answers -> scores, each computed once and kept.

A `Node` is the content of one kept file, named by a hash of everything that the content depends
on. A `Job` is the score of one entry on one episode of a board; its answers are a node.
`run_jobs` computes the nodes that several jobs need, sources first, and then the scores.
"""

from __future__ import annotations

import json
import warnings
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, fields
from functools import cached_property, partial
from graphlib import TopologicalSorter
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

from roadscope.benchmarks.cache import Ledger, Saved, cache_dir, checked_by, digest_of, read_or_make
from roadscope.benchmarks.fingerprints import code_hash, fingerprint
from roadscope.benchmarks.isolation import PluginError, describe
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.plugin_sources import plugin_hash
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.store import Outcome
from roadscope.benchmarks.workers import Workers, WorkerSettings, open_workers
from roadscope.core import Spec

if TYPE_CHECKING:
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.recorded.kitti_drive import KittiDrives
    from roadscope.benchmarks.recorded.recording import Recording

Item = TypeVar("Item", bound="Node | Job")

FIRST_CALLS = "first calls"
"""What progress shows while plug-ins are called for the first time, which compiles kernels."""
WORKER_DIED = "the worker process died"
"""Beginning of the reason where a worker died; nobody knows whether a plug-in was the cause."""


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
    # A field such as an episode or a perception stack may say itself what it depends on.
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
    # Each machine of a cluster may have its own files under these names: no digest fits them all.
    files = KeptFiles(installed if settings.address is None else ())
    # Our own plug-ins change no kept files.
    only_ours = all(spec.ours for job in installed for spec in plugins_of(job.answers))
    guard = nullcontext() if only_ours else files.guarded()
    with guard, open_workers(settings) as opened_workers:
        run = _StageRunner(files, opened_workers, options or RunOptions(), progress)
        # Outcomes are dropped: an error that matters comes again in the run itself.
        for _ in run.each(first_calls, FIRST_CALLS):
            pass
        failures = run.compute(_shared_nodes(installed))
        jobs_by_board: dict[str, list[Job]] = {}
        for job in installed:
            failure = _failure_of(job.answers, failures)
            if failure is None:
                jobs_by_board.setdefault(job.board.name, []).append(job)
            else:
                on_outcome(job, _named(job, failure))
        for board, board_jobs in jobs_by_board.items():
            for job, outcome in run.each(board_jobs, f"{board} board"):
                on_outcome(job, _named(job, outcome))


def _named(job: Job, outcome: Outcome) -> Outcome:
    """Return the outcome; if a worker died, its reason begins with the name of the entry."""
    if outcome.reason is None or not outcome.reason.startswith(WORKER_DIED):
        return outcome
    return Outcome({}, f"{job.entry}: {outcome.reason}")


class _StageRunner:
    """Computes the stages of a run in its workers, one after the other."""

    def __init__(
        self, files: KeptFiles, workers: Workers, options: RunOptions, progress: Progress
    ) -> None:
        self._files, self._workers = files, workers
        self._options, self._progress = options, progress
        self._computed: set[str] = set()

    def compute(self, levels: Sequence[Sequence[Node]]) -> Mapping[str, Outcome]:
        """Compute the nodes that are not kept; return the failures by the key of the node.

        levels: sources before the nodes that are computed from them. A node with a source that
            failed is left out.
        """
        failures: dict[str, Outcome] = {}
        for level in levels:
            nodes_by_stage: dict[str, list[Node]] = {}
            for node in level:
                is_due = self._recomputes(node) or not self._files.has(node)
                if is_due and _failure_of(node, failures) is None:
                    nodes_by_stage.setdefault(node.stage, []).append(node)
            for stage, nodes in nodes_by_stage.items():
                for node, outcome in self.each(nodes, stage):
                    self._computed.add(node.key)
                    if outcome.reason is not None:
                        failures[node.key] = outcome
        return failures

    def each(self, items: Sequence[Item], stage: str) -> Iterator[tuple[Item, Outcome]]:
        """Compute nodes or score jobs in the workers; yield outcomes as they come."""
        if items:
            self._progress(stage, 0, len(items))
        outcomes = self._workers.each(
            partial(_outcome, self._options),
            items,
            prepare=self._task_of,
            groups=[getattr(item, "episode", None) for item in items],
            on_death=lambda item: (_death(item), Ledger()),
        )
        for done, (index, (outcome, ledger)) in enumerate(outcomes, start=1):
            self._files.update(ledger)
            yield items[index], outcome
            self._progress(stage, done, len(items))

    def _task_of(self, item: Node | Job) -> _WorkerTask:
        """Return the task of an item.

        It is called when a worker takes the item, so that files written until then are known.
        """
        node = item.answers if isinstance(item, Job) else item
        return _WorkerTask(item, self._files.digests_for(node), self._recomputes(node))

    def _recomputes(self, node: Node) -> bool:
        """Return whether to compute a node although it is kept.

        That is so once in a fresh run, and once if code of others is trusted.
        """
        fresh = self._options.fresh or runs_trusted_code(node, self._options)
        return fresh and node.recomputed_if_fresh and node.key not in self._computed


@dataclass(frozen=True, slots=True)
class _WorkerTask:
    """A node or job for a worker.

    digests: of the files that it reads, by path.
    recompute: compute the node, or the answers of the job, although they are kept.
    """

    item: Node | Job
    digests: Mapping[str, str | None]
    recompute: bool


class KeptFiles:
    """The digests of the kept files that jobs need, from the start of the run or written by it.

    They stay in this process, which no plug-in can change: if a file has another digest later,
    another program changed it.

    jobs: those whose files are watched; other files are used as they are.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        """Read the digests of the files that exist."""
        self._digests: dict[str, str | None] = {}
        """By path; None for a file that did not exist, or was damaged, when the run began."""
        paths = {node.path for job in jobs for node in _with_sources(job.answers)}
        for path in sorted(paths):
            digest = self._digests[str(path)] = digest_of(path)
            if digest is None and path.exists():
                _warn(f"{path} is damaged: it has no digest; it is made again")

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Remove at the end each file that another program changed, so that no later run uses it.

        If the run is interrupted, new files that no task has reported are removed without a
        warning: the run itself may have written them.
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
        path = str(node.path)
        is_untrusted = path in self._digests and self._digests[path] is None
        return not is_untrusted and node.path.exists()

    def digests_for(self, node: Node) -> Mapping[str, str | None]:
        """Return the digests of the node's own file and of those that it is computed from."""
        paths = {str(each.path) for each in _with_sources(node)}
        return {path: self._digests[path] for path in paths if path in self._digests}

    def update(self, ledger: Ledger) -> None:
        """Store the digests of the files that a task wrote, and show its warnings."""
        for path, digest in ledger.written.items():
            if path in self._digests:
                self._digests[path] = digest
        for note in ledger.notes:
            _warn(note)


def plugins_of(node: Node) -> Iterator[Spec]:
    """Yield the resolved specs of all plug-ins that compute a node and its sources."""
    return chain.from_iterable(each.plugins() for each in _with_sources(node))


def runs_trusted_code(node: Node, options: RunOptions) -> bool:
    """Return whether code of others computes a node inside the processes of the run."""
    return options.trust and not all(spec.ours for spec in plugins_of(node))


@contextmanager
def trusted_files_removed(jobs: Sequence[Job], options: RunOptions) -> Iterator[None]:
    """Remove at the end what trusted code of others computed, which no later run may use."""
    try:
        yield
    finally:
        nodes = (node for job in jobs for node in _with_sources(job.answers))
        for path in {node.path for node in nodes if runs_trusted_code(node, options)}:
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _with_sources(node: Node) -> Iterator[Node]:
    """Yield a node and everything that it is computed from."""
    yield node
    for source in node.sources():
        yield from _with_sources(source)


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=2)


def _outcome(options: RunOptions, task: _WorkerTask) -> tuple[Outcome, Ledger]:
    """Compute a node, or the answers of a job and their scores, unless the content is kept.

    The outcome of a node has no scores. The ledger has the files that were written, and warnings.
    """
    item = task.item
    scores: dict[str, Score] = {}
    reason, log = None, ""
    with checked_by(Ledger(task.digests)) as ledger, options.probing():
        try:
            if isinstance(item, Job):
                answers = item.answers.read(options, recompute=task.recompute)
                scores = dict(item.board.score(item, answers, options))
            else:
                item.read(options, recompute=task.recompute)
        except PluginError as error:
            reason, log = str(error), error.log
        except Exception as error:
            reason = f"not the entry's fault: {describe(error)}"
    return Outcome(scores, reason, log), Ledger(written=ledger.written, notes=ledger.notes)


def _death(item: Node | Job) -> Outcome:
    """Return the outcome of a node or job whose workers died repeatedly."""
    if isinstance(item, Job):
        during = f"it ran on {item.episode.scenario}"
    else:
        during = f"its {item.stage} were computed"
    return Outcome({}, f"{WORKER_DIED} while {during} (out of memory?)")


def _shared_nodes(jobs: Sequence[Job]) -> list[list[Node]]:
    """Return the nodes that are computed before the jobs, in levels: sources before dependents.

    These are the sources of nodes, and the answers that several jobs score. The answers of a single
    job are computed with its score.
    """
    nodes = {node.key: node for job in jobs for node in _with_sources(job.answers)}
    sources = {key: [source.key for source in node.sources()] for key, node in nodes.items()}
    jobs_of_answers = Counter(job.answers.key for job in jobs)
    shared = {key for key, count in jobs_of_answers.items() if count > 1}
    shared.update(*sources.values())
    sorter = TopologicalSorter(sources)
    sorter.prepare()
    levels = []
    while ready := sorter.get_ready():
        levels.append([nodes[key] for key in ready if key in shared])
        sorter.done(*ready)
    return levels


def _failure_of(node: Node, failures: Mapping[str, Outcome]) -> Outcome | None:
    """Return why a node or one of its sources could not be computed; None if nothing failed."""
    if not failures:
        return None  # Otherwise every key would be computed.
    failed = (failures[each.key] for each in _with_sources(node) if each.key in failures)
    return next(failed, None)
