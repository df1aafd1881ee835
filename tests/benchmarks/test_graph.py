"""The graph of a run: every node is computed once and kept; failures are named once."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import pytest

from roadscope import Episode, Spec
from roadscope.benchmarks import Job, Node, Outcome, RunOptions, WorkerSettings, run_jobs
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.metrics import Score


class Text(str):
    """What the nodes of these tests hold."""

    def save(self, file: BinaryIO) -> None:
        file.write(self.encode())

    @staticmethod
    def load(file: BinaryIO) -> "Text":
        return Text(file.read().decode())


@dataclass(frozen=True)
class ToyNode(Node):
    """Writes its name to a log, waits, and joins the texts of its sources.

    fault: `plug-in` or `ours`, what goes wrong.
    """

    name: str
    log: Path
    parts: tuple["ToyNode", ...] = ()
    fault: str = ""
    wait_s: float = 0.0

    stage = "steps"
    folder = "steps"
    record = Text

    def content(self) -> Mapping[str, Any]:
        return {"name": self.name, "parts": [part.content() for part in self.parts]}

    def sources(self) -> tuple[Node, ...]:
        return self.parts

    def compute(self, options: RunOptions) -> Text:
        note(self.log, self.name)
        time.sleep(self.wait_s)
        if self.fault == "plug-in":
            raise PluginError(self.name, "it broke", "its last words")
        if self.fault == "ours":
            raise KeyError(self.name)
        read = [part.read(options) for part in self.parts]
        note(self.log, f"{self.name} done")
        return Text("+".join([self.name, *read]))


@dataclass(frozen=True)
class Deep(ToyNode):
    """A step that is the same each time."""

    recomputed_if_fresh = False


@dataclass(frozen=True)
class Foreign(ToyNode):
    """A step that a plug-in of somebody else computes."""

    def plugins(self) -> Iterator[Spec]:
        yield replace(Spec.parse("mine.py:Mine"), target="mine.py:Mine")


class Lengths:
    """A board that scores the length of a text."""

    name = "lengths"

    def score(self, job: Job, answers: Text, options: RunOptions) -> Mapping[str, Score]:
        if job.settings == "no score":
            raise ZeroDivisionError("no score")
        if job.settings == "interrupted":
            raise KeyboardInterrupt
        return {"length": Score(float(len(answers)), "1", "higher", 1)}


def note(log: Path, line: str) -> None:
    """Append a whole line, also while other processes append."""
    handle = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(handle, f"{line}\n".encode())
    os.close(handle)


def job(answers: ToyNode, **fields: Any) -> Job:
    return Job(Lengths(), answers.name, Episode("motorway", 1, "lux", 1.0), answers, **fields)


def outcomes(jobs: list[Job], workers: int = 1, **options: Any) -> dict[str, Outcome]:
    taken: dict[str, Outcome] = {}

    def take(job: Job, outcome: Outcome) -> None:
        assert job.entry not in taken
        taken[job.entry] = outcome

    run_jobs(jobs, take, workers=WorkerSettings(workers), options=RunOptions(**options))
    return taken


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "log"


def begun(log: Path) -> Counter[str]:
    lines = log.read_text().splitlines() if log.exists() else []
    return Counter(line for line in lines if not line.endswith("done"))


def diamond(log: Path, **fields: Any) -> list[ToyNode]:
    """Return three answers that share two steps; the one step is computed from the other."""
    deep = Deep("deep", log)
    shared = ToyNode("shared", log, (deep,), **fields)
    return [ToyNode(name, log, (shared, deep)) for name in ("a", "b", "c")]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_node_is_computed_once_after_its_sources_and_stored(log: Path, workers: int) -> None:
    jobs = [job(step) for step in diamond(log)]
    outcome_of = outcomes(jobs, workers)
    assert {name: o.scores["length"].value for name, o in outcome_of.items()} == {
        name: len(f"{name}+shared+deep+deep") for name in "abc"
    }
    assert begun(log) == dict.fromkeys(["deep", "shared", "a", "b", "c"], 1)
    lines = log.read_text().splitlines()
    assert lines[:4] == ["deep", "deep done", "shared", "shared done"]
    assert outcomes(jobs, workers) == outcome_of
    assert log.read_text().splitlines() == lines


def test_nodes_are_stored_by_what_they_depend_on(log: Path) -> None:
    one, same, other = ToyNode("x", log), ToyNode("x", log / "elsewhere"), ToyNode("y", log)
    assert one.key == same.key != other.key
    assert ToyNode("z", log, (one,)).key != ToyNode("z", log, (other,)).key
    assert one.path == same.path
    assert one.path.is_relative_to(Path(os.environ["ROADSCOPE_CACHE"]))


def test_fresh_computes_again_all_but_what_is_the_same_each_time(log: Path) -> None:
    jobs = [job(step) for step in (*diamond(log), ToyNode("source", log))]
    outcomes(jobs)
    outcomes(jobs, fresh=True)
    assert begun(log) == {"deep": 1, "shared": 2, "a": 2, "b": 2, "c": 2, "source": 2}


@pytest.mark.parametrize(("workers", "fresh"), [(1, False), (2, True)])
def test_answers_of_several_jobs_are_computed_once_in_a_run(
    log: Path, workers: int, fresh: bool
) -> None:
    answers = ToyNode("answers", log, wait_s=0.1)
    jobs = [replace(job(answers, settings=name), entry=name) for name in "abcd"]
    for runs in (1, 2):
        outcome_of = outcomes(jobs, workers, fresh=fresh)
        assert {name: o.scores["length"].value for name, o in outcome_of.items()} == dict.fromkeys(
            "abcd", len("answers")
        )
        assert begun(log) == {"answers": runs if fresh else 1}


@pytest.mark.parametrize("workers", [1, 2])
def test_answers_of_several_jobs_that_fail_are_tried_once(log: Path, workers: int) -> None:
    answers = ToyNode("answers", log, fault="plug-in")
    outcome_of = outcomes([replace(job(answers), entry=name) for name in "ab"], workers)
    assert begun(log) == {"answers": 1}
    assert {outcome.reason for outcome in outcome_of.values()} == {"answers: it broke"}
    assert {outcome.log for outcome in outcome_of.values()} == {"its last words"}


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_answers_that_others_need_too_are_computed_once_in_a_fresh_run(
    log: Path, workers: int
) -> None:
    first, *others = diamond(log)
    jobs = [job(first.parts[0]), job(first), *map(job, others)]
    outcomes(jobs, workers)
    outcome_of = outcomes(jobs, workers, fresh=True)
    assert all(outcome.reason is None for outcome in outcome_of.values())
    assert begun(log) == {"deep": 1, "shared": 2, "a": 2, "b": 2, "c": 2}


def test_a_damaged_node_is_computed_again_and_named(log: Path) -> None:
    first, *_ = diamond(log)
    outcomes([job(first)])
    before = first.path.read_bytes()
    first.path.write_bytes(before[:-3])
    with pytest.warns(UserWarning, match=first.path.name):
        outcome_of = outcomes([job(first)])
    assert outcome_of["a"].reason is None
    assert first.path.read_bytes() == before
    assert begun(log) == {"deep": 1, "shared": 1, "a": 2}


def test_a_file_that_another_program_changed_meanwhile_is_not_left_to_later_runs(log: Path) -> None:
    victim, other = job(Foreign("victim", log)), job(ToyNode("other", log))
    outcome_of = {}

    def spoil(done: Job, outcome: Outcome) -> None:
        outcome_of[done.entry] = outcome
        if done == other:
            victim.answers.path.write_bytes(other.answers.path.read_bytes())

    with pytest.warns(UserWarning, match=victim.answers.path.name):
        run_jobs([victim, other], spoil)
    assert outcomes([victim, other]) == outcome_of
    assert begun(log) == {"victim": 2, "other": 1}


def test_a_run_of_our_own_plug_ins_leaves_what_another_run_wrote_meanwhile(log: Path) -> None:
    first, last = job(ToyNode("first", log)), job(ToyNode("last", log))

    def write(done: Job, outcome: Outcome) -> None:
        if done == last:
            first.answers.read(recompute=True)

    run_jobs([first, last], write)
    assert outcomes([first, last])["first"].reason is None
    assert begun(log) == {"first": 2, "last": 1}


def test_a_changed_file_that_cannot_be_removed_ends_no_run(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, *, missing_ok: bool = False) -> None:
        if path.suffix == ".cache":
            raise PermissionError(13, "Permission denied", str(path))

    victim, other = job(Foreign("victim", log)), job(ToyNode("other", log))

    def spoil(done: Job, outcome: Outcome) -> None:
        if done == other:
            victim.answers.path.write_bytes(other.answers.path.read_bytes())

    monkeypatch.setattr(Path, "unlink", refuse)
    with (
        pytest.warns(UserWarning, match="was changed"),
        pytest.warns(UserWarning, match="cannot be removed"),
    ):
        run_jobs([victim, other], spoil)


def test_an_interrupted_run_does_not_say_that_another_program_changed_its_files(log: Path) -> None:
    done, stopped = job(Foreign("done", log)), job(ToyNode("stopped", log), settings="interrupted")
    with pytest.raises(KeyboardInterrupt):
        outcomes([done, stopped])
    assert done.answers.path.exists()
    assert set(outcomes([replace(stopped, settings=None)])) == {"stopped"}


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_source_does_wrong_is_named_by_each_dependent_and_tried_once(
    log: Path, workers: int
) -> None:
    other = ToyNode("other", log)
    jobs = [job(step) for step in (*diamond(log, fault="plug-in"), other)]
    outcome_of = outcomes(jobs, workers)
    assert begun(log) == {"deep": 1, "shared": 1, "other": 1}
    for name in "abc":
        assert outcome_of[name].reason == "shared: it broke"
        assert outcome_of[name].log == "its last words"
        assert outcome_of[name].scores == {}
    assert outcome_of["other"].reason is None


def test_failures_are_not_stored(log: Path) -> None:
    assert outcomes([job(diamond(log, fault="plug-in")[0])])["a"].reason
    assert outcomes([job(diamond(log)[0])])["a"].reason is None
    assert begun(log) == {"deep": 1, "shared": 2, "a": 1}


@pytest.mark.parametrize(
    ("fault", "settings"), [("ours", None), ("", "no score")], ids=["node", "score"]
)
def test_what_is_no_plug_ins_fault_is_said_to_be_ours(
    log: Path, fault: str, settings: str | None
) -> None:
    broken = job(ToyNode("broken", log, fault=fault), settings=settings)
    outcome_of = outcomes([broken, job(ToyNode("sound", log))])
    assert outcome_of["sound"].reason is None
    reason = outcome_of["broken"].reason or ""
    assert "not the entry's fault" in reason
    assert "test_graph.py:" in reason
    assert len(reason.splitlines()) == 1


def test_an_entry_that_is_not_installed_is_not_computed_and_neither_is_what_it_needs(
    log: Path,
) -> None:
    absent = job(ToyNode("absent", log, (ToyNode("only", log),)), missing="x is not installed")
    outcome_of = outcomes([absent, job(ToyNode("sound", log))])
    assert outcome_of["absent"].reason == "absent: x is not installed"
    assert begun(log) == {"sound": 1}


def test_progress_says_how_much_of_each_stage_is_done(log: Path) -> None:
    calls = []
    jobs = [job(step) for step in diamond(log)]
    run_jobs(jobs, lambda *_: None, progress=lambda *call: calls.append(call))
    stages = list(dict.fromkeys(stage for stage, _, _ in calls))
    assert stages[0] == "steps"
    assert "lengths" in stages[-1]
    for stage, count in zip(stages, (1, 3), strict=True):
        assert (stage, 0, count) in calls
        assert (stage, count, count) in calls


def test_first_calls_leave_no_outcome_whatever_happens_in_them(log: Path) -> None:
    calls: list[tuple[str, int, int]] = []
    taken: dict[str, Outcome] = {}
    first = [
        Deep("traffic", log),
        job(ToyNode("short", log, (Deep("source", log),))),
        ToyNode("broken", log, fault="ours"),
        job(ToyNode("plug-in", log, fault="plug-in")),
        job(ToyNode("unscored", log), settings="no score"),
    ]
    run_jobs(
        [job(step) for step in diamond(log)],
        lambda job, outcome: taken.update({job.entry: outcome}),
        progress=lambda *call: calls.append(call),
        first_calls=first,
    )
    assert {name: outcome.reason for name, outcome in taken.items()} == dict.fromkeys("abc")
    lines = list(begun(log))
    assert lines[:6] == ["traffic", "short", "source", "broken", "plug-in", "unscored"]
    assert calls[0] == (calls[0][0], 0, 5)


CHILD = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[1].split(":")
from test_graph import many, outcomes
for name, outcome in outcomes(many(Path(sys.argv[2])), int(sys.argv[3])).items():
    print(name, outcome.scores["length"].value, flush=True)
"""


def many(log: Path) -> list[Job]:
    """Return twelve jobs of a tenth of a second on four sources."""
    sources = [ToyNode(f"source-{k}", log, wait_s=0.1) for k in range(4)]
    return [
        job(ToyNode(f"answer-{k}", log, (sources[k % 4], sources[(k + 1) % 4]), wait_s=0.1))
        for k in range(12)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_that_was_killed_goes_on_where_it_was(log: Path, workers: int) -> None:
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    command = [sys.executable, "-c", CHILD, ":".join(paths), str(log), str(workers)]
    for kills_after in (2, 6, 10):
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while sum(begun(log).values()) < kills_after:
            assert child.poll() is None
            time.sleep(0.01)
        child.send_signal(signal.SIGKILL)
        child.wait()
        time.sleep(1.5 if workers > 1 else 0.0)
    finished_lines = [line for line in log.read_text().splitlines() if line.endswith("done")]
    assert 0 < len(finished_lines) < 16
    last = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    lines = dict(line.split() for line in last.splitlines())
    assert lines == {
        f"answer-{k}": str(float(len(f"answer-{k}+source-0+source-0"))) for k in range(12)
    }
    every = Counter(line for line in log.read_text().splitlines() if line.endswith("done"))
    assert len(every) == 16
    # Only what was being written at the moment of a kill may be computed twice.
    assert sum(every.values()) <= 16 + 3 * workers
