"""Run a suite and return its leaderboard."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

from roadscope.benchmarks.boards import Board, board_named, chosen_boards
from roadscope.benchmarks.boards.board import JobOptions
from roadscope.benchmarks.cache import FolderError, cache_dir, usable_folder
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import (
    Job,
    Node,
    plugins_of,
    run_jobs,
    runs_trusted_code,
    trusted_files_removed,
)
from roadscope.benchmarks.isolation import Limits
from roadscope.benchmarks.kinds import Kind, entry_kind
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.benchmarks.nodes.tuned import is_tuned
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.recorded.kitti_drive import LIDAR_HEIGHT_M
from roadscope.benchmarks.recorded.mot import mot_suite
from roadscope.benchmarks.report.board_files import check_targets, label_of
from roadscope.benchmarks.report.export import save_all, save_logs
from roadscope.benchmarks.report.moments import worst_moments
from roadscope.benchmarks.report.page import Run, read_runs, save_moments, save_page
from roadscope.benchmarks.results import Results, gather
from roadscope.benchmarks.results.agreement import BoardAgreement
from roadscope.benchmarks.run_manifest import manifest
from roadscope.benchmarks.store import Outcome, Store, StoredJob, StoreError
from roadscope.benchmarks.suite import Suite, SuiteError, check_names
from roadscope.benchmarks.suite_files import SUITES, load_suite
from roadscope.benchmarks.suite_folders import kitti_suite
from roadscope.benchmarks.workers import WorkerSettings
from roadscope.core import Spec, SpecError
from roadscope.core.config import ConfigError
from roadscope.core.kernel_files import nothing_is_compiled
from roadscope.core.spec import FUSED, ORACLE

DATABASE = "results.sqlite"
FIRST_SCENARIO = "cut-ins"
"""Scenario of first calls; its traffic is scripted, so that no kernels of traffic are needed."""
FIRST_DURATION_S = 0.6
"""Length of first calls, seconds: enough scans for tracks to be confirmed; chosen by hand."""


class RunError(ValueError):
    """The arguments of a run are wrong."""


@dataclass(frozen=True, slots=True)
class RunPlan:
    """What a run computes: the jobs of its boards.

    boards: those that the suite or the user has entries for.
    entries: those that each board ranks, by the board's name.
    """

    suite: Suite
    boards: tuple[Board, ...]
    entries: Mapping[str, Sequence[Spec]]
    jobs: tuple[Job, ...]


def leaderboard(
    suite: Suite | str = "quick",
    entries: Sequence[str] = (),
    *,
    boards: Sequence[str] | None = None,
    only: bool = False,
    jobs: int = 1,
    out_dir: Path | str | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
    kitti: Path | str | None = None,
    mot: Path | str | None = None,
    lidar_height_m: float = LIDAR_HEIGHT_M,
    calibration: Path | str | None = None,
    deadline_s: float | None = None,
    limits: Limits | None = None,
    trust: bool = False,
    sandbox: bool = False,
    notice: Callable[[str], None] | None = None,
    backend: str = "loky",
    address: str | None = None,
    page: Path | str | None = None,
) -> Results:
    """Run a suite's entries and yours, and return the leaderboard.

    suite: a suite, its name or a path to its TOML file. One of recorded data is taken as it is:
        `kitti` or `mot` then only says which folder a sandbox hides.
    entries: specs of plug-ins to compare with those of the suite.
    only: run only these entries.
    boards: names of boards (`roadscope list boards`); None: all that the suite has entries for.
    jobs: worker processes; with an address, 0 stands for one for each core of the cluster.
    out_dir: folder for the results database (`results.sqlite`), `leaderboard.json`, `.csv`, `.md`
        and `.tex`, and `replay.json`, the worst moments of the entries. None: the database is in
        the cache folder, and no board is written. Boards of other suites in the folder are renamed
        to `leaderboard-SUITE-BOARD[-CALIBRATION].json`.
    fresh: compute again what an earlier run has computed.
    kitti: a folder of KITTI's data, whose drives take the place of the suite's traffic
        (`kitti_suite`); a malformed file in it raises `FormatError` before anything is run.
    mot: likewise a folder of MOTChallenge's image sequences (`mot_suite`).
    lidar_height_m: height of the LiDAR above the road in KITTI's data, whose files do not say it.
    calibration: a file of `roadscope calibrate`, which plug-ins of some boards get.
    deadline_s: most seconds for a plug-in that is not part of roadscope on one episode; None: that
        of `limits`, 300 s if they are left out.
    limits: of such a plug-in's process.
    trust: run such plug-ins inside the processes of the run, for debugging: they can then crash or
        falsify it. Their answers and scores are computed anew and are not kept for later runs.
    sandbox: hide network, cache, results and the folder of recorded data from such plug-ins, and
        let them write no file (needs bubblewrap).
    backend: what provides worker processes, `loky` (on this machine), `ray` or `dask`.
    address: of a running cluster of Ray or Dask; None: workers are started on this machine.
        Machines of a cluster need this package, the files of plug-ins and of recorded data at the
        same paths, and should share the folder that `ROADSCOPE_CACHE` names: computed files stay
        on their machine, and other machines compute them again.
    page: file for one HTML page of the boards, with plots and a replay of the worst moments; with
        `out_dir` it also has the other boards in that folder.
    notice: called before anything runs with a text for each entry that is not installed, and for
        each board that recorded data are not complete for.

    A worker process that dies costs only the jobs that it runs, and they are tried again.

    Unknown names and wrong arguments raise `SpecError` or `SuiteError` before anything runs. A
    plug-in that fails while it runs gets a row with the reason.
    """
    if jobs < (0 if address else 1):
        raise RunError(f"jobs: expected 1 or more worker processes, got {jobs}")
    workers = WorkerSettings(jobs, backend, address)
    workers.check()
    calibration_file = "" if calibration is None else str(calibration)
    limits = limits or Limits()
    if deadline_s is not None:
        limits = replace(limits, episode_s=deadline_s)
    folder = cache_dir() if out_dir is None else Path(out_dir)
    data = tuple(Path(path) for path in (kitti, mot) if path is not None)
    options = RunOptions(limits, trust, sandbox, fresh, hidden=(folder,), data=data)
    compile_first = workers.share_kernels and nothing_is_compiled()
    with options.probing():
        run_plan = plan(
            _suite(suite, kitti, mot, boards, lidar_height_m, notice),
            entries,
            boards=boards,
            only=only,
            calibration=calibration_file,
        )
    if notice is not None:
        left_out = [f"{j.entry} is left out: {j.missing}" for j in run_plan.jobs if j.missing]
        for text in dict.fromkeys(left_out):
            notice(text)
    board_names = [board.name for board in run_plan.boards]
    about = manifest(run_plan.suite, jobs, board_names, calibration_file, trust=trust)
    if out_dir is not None:
        check_targets(usable_folder(out_dir), label_of(about))
    with trusted_files_removed(run_plan.jobs, options):
        with Store(folder / DATABASE) as store:
            outcomes = _outcomes(
                store, run_plan, about, workers, options, progress or silent, compile_first
            )
            results = gather(run_plan.jobs, outcomes, about)
            try:
                with options.probing():
                    compared = agreements(results, run_plan, store.outcomes)
                results = replace(results, agreements=compared)
            except StoreError as error:
                # The file was damaged during the run; the board is made from memory.
                text = f"ranks are not compared with those of earlier runs: {error}"
                warnings.warn(text, stacklevel=2)
        results = save_logs(results, folder)
        if out_dir is not None:
            save_all(results, folder)
            # A run that is stopped now leaves no moments of an earlier one beside its boards.
            save_moments([], folder)
        if out_dir is not None or page is not None:
            latest = Run(results, worst_moments(run_plan.jobs, results, progress or silent))
            board_folder = None if out_dir is None else folder
            _save_moments_and_page(
                latest, board_folder, None if page is None else Path(page), notice
            )
    return results


def _save_moments_and_page(
    latest: Run, board_folder: Path | None, page: Path | None, notice: Callable[[str], None] | None
) -> None:
    """Write the worst moments to the folder of the boards, and a page of all runs in it.

    board_folder: None if no boards are written; the page then shows the latest run alone.
    """
    runs = [latest]
    if board_folder is not None:
        save_moments(latest.moments, board_folder)
    if page is None:
        return
    if board_folder is not None:
        try:
            runs = read_runs(board_folder)
        except FolderError as error:
            if notice is not None:
                notice(f"the page shows this run alone: {error}")
    save_page(runs, page)


def plan(
    suite: Suite,
    entries: Sequence[str],
    *,
    boards: Sequence[str] | None = None,
    only: bool = False,
    calibration: str = "",
) -> RunPlan:
    """Return the jobs of a run; unknown names and wrong arguments raise before anything runs.

    Arguments are those of `leaderboard`. Marks are shown only beside entries of the suite.
    """
    if only and not entries:
        raise SpecError("--only needs at least one --entry")
    chosen = chosen_boards(suite, boards)
    suite_entries = _entries_of_suite(suite, chosen)
    specs = [Spec.parse(text) for text in entries]
    user_entries = _by_board(specs, chosen, recorded=suite.recorded)
    ranked: dict[str, list[Spec]] = {}
    jobs: list[Job] = []
    options = JobOptions(marks=not only, calibration=calibration)
    for board in chosen:
        specs = [board.check_entry(spec) for spec in user_entries[board.name]]
        if not only:
            specs = [*suite_entries[board.name], *specs]
        if specs:
            ranked[board.name] = list(dict.fromkeys(specs))
            jobs += board.jobs(suite, ranked[board.name], options)
    if not jobs:
        names = ", ".join(board.name for board in chosen)
        raise SpecError(f"suite {suite.title} has nothing to run on: {names}")
    used = [board for board in chosen if board.name in ranked or board.suite_entries(suite)]
    return RunPlan(suite, tuple(used), ranked, tuple(jobs))


def read_recordings(run_plan: RunPlan) -> None:
    """Read all recordings of a plan; a malformed file raises `FormatError`."""
    for episode in dict.fromkeys(job.episode for job in run_plan.jobs):
        episode.check()


def agreements(
    results: Results, run_plan: RunPlan, outcomes: Callable[[Iterable[str]], Mapping[str, Outcome]]
) -> tuple[BoardAgreement, ...]:
    """Compare ranks on recorded data with those on every suite that was run with the same entries.

    outcomes: looks up the outcomes of earlier runs by the keys of jobs. A key covers the code, so
    outcomes of other code are not found.
    Nothing is computed here: only suites that earlier runs have finished are compared.
    """
    recorded_boards = [board for board in run_plan.boards if board.compared_with]
    compared = []
    for suite in map(load_suite, SUITES if recorded_boards else ()):
        # Several recorded boards, one for each class of objects, have the same simulated board.
        for simulated in dict.fromkeys(board.compared_with for board in recorded_boards):
            boards = [board for board in recorded_boards if board.compared_with == simulated]
            entries = (spec for board in boards for spec in run_plan.entries.get(board.name, ()))
            specs = [spec for spec in dict.fromkeys(entries) if not is_tuned(spec)]
            figures = _figures_of_earlier_runs(board_named(simulated), suite, specs, outcomes)
            for board in boards:
                recorded = _headline_figures(results, board, list(map(str, specs)))
                if agreement := BoardAgreement.of(board.name, suite.title, recorded, figures):
                    compared.append(agreement)
    return tuple(compared)


def _figures_of_earlier_runs(
    board: Board,
    suite: Suite,
    specs: Sequence[Spec],
    outcomes: Callable[[Iterable[str]], Mapping[str, Outcome]],
) -> dict[str, float]:
    """Return the headline metric on a suite, of the entries that have finished all of it."""
    if not board.suite_entries(suite):
        return {}
    names = [str(spec) for spec in specs]
    jobs = board.jobs(suite, specs, JobOptions(marks=False))
    jobs = [job for job in jobs if job.entry in names]
    stored = outcomes([job.key for job in jobs])
    finished = {key for key, outcome in stored.items() if outcome.reason is None}
    incomplete = {job.entry for job in jobs if job.key not in finished}
    complete_jobs = [job for job in jobs if job.entry not in incomplete]
    return _headline_figures(gather(complete_jobs, stored, {}), board, names)


def _headline_figures(results: Results, board: Board, entries: Sequence[str]) -> dict[str, float]:
    """Return the headline metric of each entry that has a value."""
    rows = {entry: results.row(board.name, entry, board.headline) for entry in entries}
    return {e: row.value for e, row in rows.items() if row is not None and row.value is not None}


def _entries_of_suite(suite: Suite, boards: Iterable[Board]) -> dict[str, list[Spec]]:
    """Return the resolved entries of a suite by board; one `SuiteError` has all of its problems.

    A suite of recorded data was made from files, so that only its entries are checked.
    """
    problems: list[str] = []

    def checked(key: str, check: Callable[[Any], object], argument: Any) -> Any:
        """Return what a check returns; None, and more `problems`, if it raises `ValueError`."""
        try:
            return check(argument)
        except ValueError as error:
            texts = error.problems if isinstance(error, SuiteError) else (str(error),)
            problems.extend(f"{key}: {text}" if key else text for text in texts)
            return None

    if not suite.recorded:
        checked("", check_names, suite)
    entries: dict[str, list[Spec]] = {}
    for board in boards:

        def entry(text: str, board: Board = board) -> Spec:
            return board.check_entry(Spec.parse(text))

        key = f"{board.name}.entries"
        entries[board.name] = [checked(key, entry, text) for text in board.suite_entries(suite)]
        for each in () if suite.recorded else board.suite_checks(suite):
            checked(each.key, each.check, each.argument)
    if problems:
        every = ConfigError(dict.fromkeys(problems))
        raise SuiteError(f"suite {suite.title}: {every}", every.problems)
    return entries


def _suite(
    suite: Suite | str,
    kitti: Path | str | None,
    mot: Path | str | None,
    boards: Sequence[str] | None,
    lidar_height_m: float,
    notice: Callable[[str], None] | None,
) -> Suite:
    """Return the suite of a run, or that of a folder of recorded data."""
    if isinstance(suite, Suite) and suite.recorded:
        return suite
    if kitti is not None:
        return kitti_suite(kitti, boards, lidar_height_m=lidar_height_m, notice=notice)
    if mot is not None:
        return mot_suite(mot)
    return load_suite(suite) if isinstance(suite, str) else suite


def _by_board(
    specs: Sequence[Spec], boards: Sequence[Board], *, recorded: bool
) -> dict[str, list[Spec]]:
    """Return the entries of each board; raise `SpecError` for one that no board ranks.

    recorded: whether the boards are of recorded data.
    """
    by_board: dict[str, list[Spec]] = {board.name: [] for board in boards}
    kinds: dict[str, Kind] = {}
    for board in boards:
        kinds.setdefault(board.kind.name, board.kind)
    for spec in specs:
        kind = _entry_kind(spec, list(kinds.values()))
        fitting = [board for board in boards if board.kind.name == kind.name]
        if not fitting:
            wanted = " or ".join(dict.fromkeys(str(board.kind) for board in boards))
            raise SpecError(f"'{spec}' is {kind}; the boards of this run are for {wanted}")
        for board in fitting:
            by_board[board.name].append(spec)
    return by_board


def _entry_kind(spec: Spec, possible: Sequence[Kind]) -> Kind:
    """Return the kind of an entry; refuse a source of detections that no board ranks."""
    is_row = spec.name == ORACLE and not spec.parts
    if is_row or spec.name in (FUSED, *NOISES):
        row = "a row beside the detectors of a suite, and " if is_row else ""
        use = "input of trackers in simulated traffic"
        raise SpecError(f"'{spec}' is no entry: it is {row}{use}, --detections '{spec}'")
    return entry_kind(spec, possible)


def _outcomes(
    store: Store,
    run_plan: RunPlan,
    about: Mapping[str, Any],
    workers: WorkerSettings,
    options: RunOptions,
    progress: Progress,
    compile_first: bool,
) -> dict[str, Outcome]:
    """Compute the outcomes that the store does not have; write each as it comes.

    about: the manifest of the run. compile_first: whether kernels are compiled before all else.
    """
    run_number = store.begin(about)
    # What trusted code of others computes may be false, and is not kept.
    trusted = {job.key for job in run_plan.jobs if runs_trusted_code(job.answers, options)}
    kept_keys = [job.key for job in run_plan.jobs if job.key not in trusted]
    stored = {} if options.fresh else store.outcomes(kept_keys)
    store_errors: list[str] = []
    # Failures are tried again.
    done = {key: outcome for key, outcome in stored.items() if outcome.reason is None}

    def write(job: Job, outcome: Outcome) -> None:
        episode = job.episode
        row = StoredJob(
            job.key,
            job.board.name,
            job.entry,
            episode.scenario,
            episode.seed,
            job.spec,
            inputs=job.inputs,
            condition=episode.condition,
        )
        done[job.key] = outcome
        if job.key in trusted:
            return
        try:
            store.put(row, outcome, run_number)
        except StoreError as error:
            store_errors.append(str(error))

    jobs = {job.key: job for job in run_plan.jobs}
    wanted = {key: job for key, job in jobs.items() if key not in done}
    first_calls: Sequence[Node | Job] = ()
    if wanted:
        read_recordings(run_plan)
        if compile_first and not run_plan.suite.recorded:
            with options.probing():
                first_calls = _first_calls(run_plan, wanted.values())
    run_jobs(
        list(wanted.values()),
        write,
        workers=workers,
        options=options,
        progress=progress,
        first_calls=first_calls,
    )
    # Where nothing ran, no plug-in could change anything.
    for key in _changed(store) if wanted else ():
        write(jobs[key], done[key])
    if store_errors:
        # The file was damaged during the run; the board is made from memory.
        warnings.warn(f"{len(store_errors)} results are not kept: {store_errors[0]}", stacklevel=3)
    return done


def _changed(store: Store) -> list[str]:
    """Return the keys of the rows that another program changed during a run, with a warning."""
    try:
        changed = store.changed()
    except StoreError:
        return []
    if changed:
        warnings.warn(
            f"{store.path}: {len(changed)} results were changed by another program during the "
            "run; they are written again",
            stacklevel=4,
        )
    return changed


def _first_calls(run_plan: RunPlan, wanted: Collection[Job]) -> list[Node | Job]:
    """Return short computations that compile the kernels of the wanted jobs.

    Without them all workers begin with traffic, then all need the ray caster, and wait for the one
    that compiles it. Here one worker begins with traffic, the others with scans of a scripted
    scenario. Plug-ins that run in a process of their own are not called. Some small files stay in
    the cache folder.
    """
    from roadscope.envs.traffic.scenarios import find

    suite = run_plan.suite
    unscripted = [name for name in suite.scenarios if not find(name).scripted]
    entries = {(job.board.name, job.entry) for job in wanted}
    jobs: list[Job] = []
    for board in run_plan.boards:
        scenarios = [FIRST_SCENARIO] if board.takes_scripted else unscripted[:1]
        if scenarios and (specs := run_plan.entries.get(board.name)):
            short = _shortened(suite, scenarios[0])
            jobs += board.jobs(short, specs, JobOptions(marks=False))
    jobs = [
        job
        for job in jobs
        if (job.board.name, job.entry) in entries
        and not job.missing
        and not any(spec.isolated for spec in plugins_of(job.answers))
    ]
    if not jobs:
        return []
    traffic = [
        TrafficNode.of(Episode(name, suite.seeds[0], suite.rig, FIRST_DURATION_S))
        for name in unscripted[:1]
    ]
    # Alternately from both ends, first, last, second, ...: workers that start at the same time get
    # jobs of different boards, which compile different kernels.
    both_ends = chain.from_iterable(zip(jobs, reversed(jobs), strict=True))
    return [*traffic, *islice(both_ends, len(jobs))]


def _shortened(suite: Suite, scenario: str) -> Suite:
    """Return a suite with one short episode."""
    return replace(
        suite,
        scenarios=(scenario,),
        seeds=suite.seeds[:1],
        duration_s=FIRST_DURATION_S,
        weathers=suite.weathers[:1],
        lights=suite.lights[:1],
        faults=suite.faults[:1],
    )
