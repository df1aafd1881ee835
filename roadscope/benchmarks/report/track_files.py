"""Writes tracks of recorded sequences as result files of KITTI and of MOTChallenge."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import usable_folder, write_atomically
from roadscope.benchmarks.formats.kitti_labels import KittiObjects, write_kitti_results
from roadscope.benchmarks.formats.motchallenge import MotRows, mot_rows, write_mot
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.recorded.mot import MotRecording
from roadscope.benchmarks.recorded.recording import Recording, sequence_of
from roadscope.benchmarks.records import EpisodeTracks
from roadscope.benchmarks.workers import WorkerSettings, open_workers
from roadscope.core import Tracks

KITTI_FOLDER, MOT_FOLDER = "kitti", "motchallenge"
MOST_NAME = 50
"""Characters of an entry in the name of a file, the last ones; file systems allow 255 bytes."""


def save_tracks(
    jobs: Sequence[Job],
    folder: Path | str,
    *,
    workers: WorkerSettings | None = None,
    options: RunOptions | None = None,
    progress: Progress | None = None,
) -> list[str]:
    """Write the tracks of recorded sequences as files; return the entries that failed.

    Tracks are read from the cache, or computed. A tracker that fails on a sequence has no files of
    it. Tentative tracks are left out.

    jobs: of boards of recorded data.
    folder: for `kitti/TRACKER/SEQ.txt`, with all classes in one file, and
        `motchallenge/TRACKER/CLASS/SEQ.txt`, as that format has no classes. Boxes in the image are
        those around the projected boxes; tracks outside of the image are left out. Image sequences
        have only the latter. `FolderError` if it cannot be written.
    workers: the processes that compute; None: this process.
    """
    root = usable_folder(folder)
    names = folder_names([job.entry for job in jobs])
    groups: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        if isinstance(job.episode, Recording):
            groups.setdefault((job.entry, job.episode.sequence), []).append(job)
    tasks = list(groups.values())
    failed = []
    report = progress or silent
    work = partial(_answers, options or RunOptions())
    with open_workers(workers or WorkerSettings()) as opened:
        for done, (index, answers) in enumerate(opened.each(work, tasks), start=1):
            report("tracks", done, len(tasks))
            entry = tasks[index][0].entry
            if answers is None:
                failed.append(entry)
            else:
                _save(tasks[index], answers, root, names[entry])
    return list(dict.fromkeys(failed))


def folder_names(entries: Sequence[str]) -> Mapping[str, str]:
    """Return a different name for each entry that every file system allows."""
    names: dict[str, str] = {}
    for entry in dict.fromkeys(entries):
        allowed = re.sub(r"[^\w.=+-]+", "_", entry)[-MOST_NAME:]
        plain = name = allowed.strip("._") or "entry"
        while name.lower() in {other.lower() for other in names.values()}:
            name = f"{plain}_{len(names)}"
        names[entry] = name
    return names


def _answers(options: RunOptions, jobs: Sequence[Job]) -> list[EpisodeTracks] | None:
    """Return the tracks of each job of one sequence, None where the tracker failed."""
    if any(job.missing for job in jobs):
        return None
    try:
        with options.probing():
            return [job.answers.read(options) for job in jobs]
    except PluginError:
        return None


def _save(jobs: Sequence[Job], answers: Sequence[EpisodeTracks], folder: Path, name: str) -> None:
    """Write the files of one tracker on one sequence, whose jobs are those of each class."""
    kitti: list[list[KittiObjects]] = []
    sequence, next_id = "", 0
    for job, answer in zip(jobs, answers, strict=True):
        recording = job.episode
        assert isinstance(recording, Recording)
        tracks = [each.sure for each in answer.tracks]
        place = folder / MOT_FOLDER / name / recording.category / f"{recording.sequence}.txt"
        if isinstance(recording, MotRecording):
            write_atomically(place, partial(write_mot, frames=recording.rows(tracks)))
            continue
        rows, boxes = _rows(tracks, recording)
        write_atomically(place, partial(write_mot, frames=boxes))
        # Each class has a tracker of its own, so ids repeat; in a file they must differ.
        kitti.append([replace(row, ids=row.ids + next_id) for row in rows])
        next_id += 1 + max((int(row.ids.max(initial=-1)) for row in rows), default=-1)
        sequence = recording.sequence
    if not kitti:
        return
    path = folder / KITTI_FOLDER / name / f"{sequence}.txt"
    merged = [row for frame in zip(*kitti, strict=True) for row in frame]
    write_atomically(path, lambda part: write_kitti_results(part, merged))


def _rows(
    tracks: Sequence[Tracks], recording: Recording
) -> tuple[list[KittiObjects], list[MotRows]]:
    """Return the rows of every frame in both formats."""
    kitti, image_rows = sequence_of(recording).result_rows(tracks), []
    for frame, (record, rows) in enumerate(zip(tracks, kitti, strict=True), start=1):
        boxes = np.zeros((len(record), 4))
        boxes[np.isin(record.ids, rows.ids)] = rows.boxes
        image_rows.append(mot_rows(record, frame, boxes))
    return kitti, image_rows
