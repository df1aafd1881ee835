"""Plug-ins of all kinds that answer honestly, but for the act that they are asked for.

A run loads this file from a copy, in the process of a plug-in. An act is a function that takes the
plug-in and its honest answer and returns what is answered instead. A copy in a folder that has the
name of an act does it when it is loaded. `tests/benchmarks/isolation` has acts of the tracker done
too, without a run.
"""

import ctypes
import gc
import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
import zlib
from contextlib import suppress
from dataclasses import fields
from hashlib import sha256
from pathlib import Path

import msgspec
import numpy as np
import psutil

import roadscope.core
from roadscope.core import (
    Detections,
    DrivingCommand,
    FusedDetections,
    ImageDetections,
    OdometryEstimate,
    Pose,
    Tracks,
    encode,
)

SOCKET = 3
"""The file number of the connection to the run."""
LONG_S = 600
MOMENTS = ("load", "made", "reset")
"""When an act is done whose name begins with one of them; others are done in every call."""
MILLION = 1_000_000
HIDDEN = ("motorway", "roundabout", 20123)
"""The scenarios and the seed of the suite."""


class Plugin:
    """What all of them have in common.

    act: a function of this file, with a point and an argument if it takes one; with a moment and a
        point before it, it is done then.
    cache, results: folders, where a real one would guess them.
    """

    def __init__(self, *, act="honest", cache="", results=""):
        self.act, self.cache, self.results = act, cache, results
        self.calls = 0
        self.acted(None, "made")

    def reset(self, mounting=None):
        self.acted(None, "reset")

    def called(self, answer):
        self.calls += 1
        return self.acted(answer, "call")

    def acted(self, answer, moment):
        """Return what is answered instead if this is the moment of the act."""
        first, _, later = self.act.partition(".")
        when, act = (first, later) if first in MOMENTS else ("call", self.act)
        if when != moment:
            return answer
        name, *argument = act.split(".")
        return globals()[name](self, answer, *argument)


class Detector(Plugin):
    kind = "detector"

    def detect(self, frame):
        return self.called(boxes(frame.stamp_s))


class CameraDetector(Plugin):
    kind = "camera detector"

    def detect(self, frame):
        corners = [[10.0, 20.0, 60.0, 50.0], [100.0, 80.0, 140.0, 120.0]]
        return self.called(ImageDetections(corners, [0, 6], [0.9, 0.4], frame.stamp_s))


class Tracker(Plugin):
    kind = "tracker"

    def update(self, detections, ego_pose):
        if len(detections) < 2:
            detections = boxes(detections.stamp_s)
        return self.called(Tracks.of(detections, np.arange(len(detections))))


class Fusion(Plugin):
    kind = "fusion"

    def fuse(self, lidar, camera, projection):
        if lidar is None or len(lidar) < 2:
            lidar = boxes(camera.stamp_s if lidar is None else lidar.stamp_s)
        return self.called(FusedDetections.of(lidar, camera))


class Odometry(Plugin):
    kind = "odometry"

    def update(self, scan, imu=None):
        still = np.zeros(len(scan), bool)
        return self.called(OdometryEstimate(Pose.identity(), np.eye(6), still, scan.stamp_s))


class Driver(Plugin):
    kind = "driver"

    def drive(self, scene):
        return self.called(scene.following)


def boxes(stamp_s):
    return Detections(
        [[10, 0, 1], [25, 3, 1]], [[4.5, 1.8, 1.5]] * 2, [0, 0], [0, 0], [0.9, 0.4], "ego", stamp_s
    )


def honest(plugin, answer):
    return answer


def hang(plugin, answer):
    time.sleep(LONG_S)


def hang_in_third_call(plugin, answer):
    """Take 0.6 s for the first call, which may take longer than later ones."""
    time.sleep({1: 0.6, 3: LONG_S}.get(plugin.calls, 0.0))
    return answer


def dawdle(plugin, answer):
    """Make every call last, but none of them too long."""
    time.sleep(0.25)
    return answer


# Ends of the process.


def segfault(plugin, answer):
    ctypes.string_at(0)


def segfault_later(plugin, answer):
    return answer if plugin.calls < 3 else segfault(plugin, answer)


def exit_0(plugin, answer):
    os._exit(0)


def exit_3(plugin, answer):
    os._exit(3)


def exit_255(plugin, answer):
    os._exit(255)


def kill_itself(plugin, answer):
    os.kill(os.getpid(), signal.SIGKILL)


def stop_itself(plugin, answer):
    os.kill(os.getpid(), signal.SIGSTOP)


# Exceptions.


class UnspeakableError(Exception):
    def __str__(self):
        raise RuntimeError("no text")


def base_exception(plugin, answer):
    raise BaseException("bare \x1b[31m\nred")


def generator_exit(plugin, answer):
    raise GeneratorExit


def system_exit(plugin, answer):
    raise SystemExit(0)


def keyboard_interrupt(plugin, answer):
    raise KeyboardInterrupt


def unspeakable(plugin, answer):
    raise UnspeakableError


def long_text(plugin, answer):
    raise ValueError("x\n" * MILLION)


# Resources.


def flood(plugin, answer):
    while True:
        os.write(1, b"y" * 65536)


def hog(plugin, answer):
    memory = []
    while True:
        memory.append(np.ones(1 << 21))
        time.sleep(0.002)


def million_boxes(plugin, answer):
    return many(answer, MILLION)


def thousands_of_boxes(plugin, answer):
    return many(answer, 50_000)


def many(answer, count):
    arrays = {
        name: np.repeat(value[:1], count, axis=0)
        for name, value in values_of(answer).items()
        if isinstance(value, np.ndarray)
    }
    if isinstance(answer, DrivingCommand):
        arrays["acceleration_m_s2"] = np.zeros(10 * count)
    if "ids" in arrays:
        arrays["ids"] = np.arange(count)
    return forged(answer, **arrays)


# What is written to the socket.


def write(data):
    with socket.socket(fileno=os.dup(SOCKET)) as connection:
        connection.sendall(data)


def framed(message):
    return len(message).to_bytes(8, "little") + message


def answer_message(plugin, answer, **changes):
    """Return a well-formed answer to this call, the first of which has number 2."""
    content = {"number": plugin.calls + 1, "error": "", "answer": answer}
    return framed(encode(content | {"wall_ms": 0.0, "processor_ms": 0.0} | changes))


def forged_answer(plugin, answer):
    write(answer_message(plugin, answer, number=99))
    time.sleep(LONG_S)


def forged_bytes(plugin, answer):
    write(framed(os.urandom(64)))
    time.sleep(LONG_S)


def forged_pickle(plugin, answer):
    import pickle

    write(framed(pickle.dumps(answer)))
    time.sleep(LONG_S)


def forged_length(plugin, answer):
    write((1 << 62).to_bytes(8, "little"))
    time.sleep(LONG_S)


def truncated(plugin, answer):
    message = answer_message(plugin, answer)
    write(message[: len(message) // 2])
    os._exit(0)


def shortened(plugin, answer):
    """Send a whole message whose content lacks its end."""
    write(framed(answer_message(plugin, answer)[8:-9]))
    time.sleep(LONG_S)


def half_an_answer(plugin, answer):
    message = answer_message(plugin, answer)
    write(message[: len(message) // 2])
    time.sleep(LONG_S)


def second_answer(plugin, answer):
    write(answer_message(plugin, answer) * 3)
    return answer


def forged_times(plugin, answer):
    write(answer_message(plugin, answer, wall_ms=float("nan")))
    time.sleep(LONG_S)


def forged_processor_time(plugin, answer):
    write(answer_message(plugin, answer, processor_ms=1e308))
    time.sleep(LONG_S)


def forged_number(plugin, answer):
    write(answer_message(plugin, answer, number=np.array([2, 2])))
    time.sleep(LONG_S)


# Answers that break the contract.


def values_of(record):
    return {field.name: getattr(record, field.name) for field in fields(record)}


def forged(record, **changes):
    """Return a record of the same class that was never checked."""
    made = object.__new__(type(record))
    for name, value in (values_of(record) | changes).items():
        object.__setattr__(made, name, value)
    return made


def nan(plugin, answer, name):
    """Put NaN at the end of an array."""
    array = getattr(answer, name)
    array = np.full((len(answer), 4), 0.25) if array is None else array.copy()
    array.flat[-1] = np.nan
    return forged(answer, **{name: array})


def float_ids(plugin, answer):
    return forged(answer, ids=np.arange(len(answer)) + 0.5)


def half_categories(plugin, answer):
    return forged(answer, categories=np.full(len(answer), 0.5))


def number_mask(plugin, answer):
    name = "dynamic" if isinstance(answer, OdometryEstimate) else "by_lidar"
    return forged(answer, **{name: np.full_like(getattr(answer, name), 2, np.int64)})


def object_arrays(plugin, answer):
    names = {OdometryEstimate: "dynamic", DrivingCommand: "acceleration_m_s2"}
    name = names.get(type(answer), "scores")
    return forged(answer, **{name: np.array([object()] * np.size(getattr(answer, name)))})


def category_99(plugin, answer):
    return forged(answer, categories=np.full(len(answer), 99, np.int8))


def skewed_pose(plugin, answer):
    matrix = np.eye(4)
    matrix[0, 1] = 0.5
    return forged(answer, start_from_lidar=forged(Pose.identity(), matrix=matrix))


def nan_pose(plugin, answer):
    matrix = np.eye(4)
    matrix[0, 3] = np.nan
    return forged(answer, start_from_lidar=forged(Pose.identity(), matrix=matrix))


def far_pose(plugin, answer):
    return forged(answer, start_from_lidar=Pose.planar(1e200, 0.0, 0.0))


def short_mask(plugin, answer):
    return forged(answer, dynamic=answer.dynamic[1:])


def negative_covariance(plugin, answer):
    return forged(answer, covariance=-np.eye(6))


def nan_acceleration(plugin, answer):
    return forged(answer, acceleration_m_s2=float("nan"))


def infinite_acceleration(plugin, answer):
    return forged(answer, acceleration_m_s2=-float("inf"))


def array_acceleration(plugin, answer):
    return forged(answer, acceleration_m_s2=np.zeros((2, 2)))


def lane_99(plugin, answer):
    return forged(answer, target_lane=99)


def negative_lane(plugin, answer):
    return forged(answer, target_lane=-1)


def half_lane(plugin, answer):
    return forged(answer, target_lane=0.5)


def huge_lane(plugin, answer):
    return forged(answer, target_lane=1 << 70)


def wild_commands(plugin, answer):
    return DrivingCommand(1e11 * (-1) ** plugin.calls, plugin.calls % 2)


def none_mask(plugin, answer):
    names = {
        OdometryEstimate: "dynamic",
        FusedDetections: "by_lidar",
        Tracks: "states",
        DrivingCommand: "target_lane",
    }
    return forged(answer, **{names.get(type(answer), "scores"): None})


def missing_field(plugin, answer):
    made = object.__new__(type(answer))
    name = fields(answer)[-1].name
    object.__setattr__(made, name, getattr(answer, name))
    return made


def wrong_type(plugin, answer):
    return [1, 2, 3]


def other_record(plugin, answer):
    return Pose.identity()


def nothing(plugin, answer):
    return None


def itself(plugin, answer):
    return plugin


def wrong_stamp(plugin, answer):
    return forged(answer, stamp_s=answer.stamp_s + 1.0)


def nan_stamp(plugin, answer):
    return forged(answer, stamp_s=float("nan"))


def wrong_frame(plugin, answer):
    return forged(answer, frame="moon")


def repeated_ids(plugin, answer):
    return forged(answer, ids=np.zeros(len(answer), np.int64))


def negative_sizes(plugin, answer):
    return forged(answer, sizes=-answer.sizes)


def inverted_boxes(plugin, answer):
    return forged(answer, boxes=answer.boxes[:, [2, 3, 0, 1]])


def wrong_shape(plugin, answer):
    if isinstance(answer, OdometryEstimate):
        return forged(answer, covariance=np.zeros((3, 3)))
    return forged(answer, categories=np.zeros((len(answer), 2), np.int8))


def enormous_values(plugin, answer):
    if isinstance(answer, DrivingCommand):
        return forged(answer, acceleration_m_s2=1e300)
    for name in ("centres", "boxes", "covariance"):
        if hasattr(answer, name):
            return forged(answer, **{name: np.full_like(getattr(answer, name), 1e300)})
    return answer


def enormous_velocities(plugin, answer):
    return forged(answer, velocities=answer.velocities + 1e200)


def singular_covariances(plugin, answer):
    return forged(answer, covariances=np.zeros_like(answer.covariances))


def indefinite_covariances(plugin, answer):
    return forged(answer, covariances=-answer.covariances)


def tiny_sizes(plugin, answer):
    return forged(answer, sizes=np.full_like(answer.sizes, 5e-324))


def varying_masses(plugin, answer):
    columns = 2 + plugin.calls % 3
    return forged(answer, masses=np.full((len(answer), columns), 1.0 / columns))


# What may be done, and must change nothing.


def written_later(plugin, answer):
    """Change what was answered once the next call shows that the answer has arrived."""
    call = plugin.calls

    def spoil():
        while plugin.calls == call:
            time.sleep(0.001)
        for name, value in values_of(answer).items():
            if isinstance(value, np.ndarray):
                value.fill(1)
            elif isinstance(value, float):
                object.__setattr__(answer, name, 1.0)

    threading.Thread(target=spoil, daemon=True).start()
    return answer


def children(plugin, answer):
    """Leave processes behind, in this session and in others, one without a parent."""
    if plugin.calls == 1:
        start_children()
    return answer


def children_and_death(plugin, answer):
    start_children()
    os._exit(4)


def start_children():
    words = [sys.executable, "-c", f"import time; time.sleep({LONG_S})", __file__]
    for session in (False, True):
        subprocess.Popen(words, start_new_session=session)
    orphan = f"import subprocess; subprocess.Popen({words!r}, start_new_session=True)"
    subprocess.run([sys.executable, "-c", orphan], check=True)


def patch(plugin, answer):
    """Change classes of ours, and functions of libraries that scores are made with."""
    records = Detections, ImageDetections, Tracks, FusedDetections, OdometryEstimate, DrivingCommand
    for kind in (*records, Pose):
        for name in ("moved", "select", "inverse", "apply", "sure"):
            if hasattr(kind, name):
                setattr(kind, name, lambda *arguments, **named: arguments[0])
    roadscope.core.Tracks = roadscope.core.Detections = roadscope.core.DrivingCommand = None
    np.median = np.interp = np.gradient = lambda *arguments, **named: 0.0
    return answer


class FoundError(Exception):
    """Something was in reach that must not be."""


def seek_truth(plugin, answer):
    """Look through all frames and all objects of this process, those before its fork too."""
    for top in sys._current_frames().values():
        frame = top
        while frame is not None:
            refuse_truth([*frame.f_locals.values(), *frame.f_globals.values()])
            frame = frame.f_back
    gc.unfreeze()
    refuse_truth(gc.get_objects())
    return answer


def refuse_truth(things):
    """Refuse truth, what a run is made of, and the scenarios and seeds of `boards.SUITE`."""
    for thing in things:
        kind = type(thing)
        _, _, module = str(kind.__module__).partition("roadscope.")
        ours = module.startswith(("benchmarks", "envs")) and "isolation" not in module
        if module and (ours or kind.__name__.endswith("Truth")):
            raise FoundError(f"a {kind.__name__} is in this process")
        for value in (thing, *thing.values()) if kind is dict else (thing,):
            if type(value) in (str, int) and value in HIDDEN:
                raise FoundError(f"{value} is in this process")


def seek_paths(plugin, answer):
    """Look for the folders of caches and results in all that this process was given."""
    texts = [*os.environ.values(), *sys.argv, *sys.path, str(Path.cwd())]
    for file in ("environ", "cmdline"):
        texts += Path("/proc/self", file).read_text(errors="replace").split("\0")
    texts += [str(link.readlink()) for link in Path("/proc/self/fd").iterdir() if link.exists()]
    for text in texts:
        for piece in text.replace("=", os.pathsep).split(os.pathsep):
            for name in ("results.sqlite", "timelines", "leaderboard.json"):
                if piece and (Path(piece) / name).exists():
                    raise FoundError(f"{name} is in {piece}")
    return answer


def seek_all(plugin, answer):
    """Leave processes behind, and look for the truth and for folders."""
    for act in (children, seek_truth, seek_paths):
        act(plugin, answer)
    return answer


def read_labels(plugin, answer):
    """Read a file of labels, named as `results`, and say what is in it."""
    raise FoundError(Path(plugin.results).read_text()[:80])


# What damages files of the run.


def cached_files(plugin):
    """Find cached files, by the environment of processes above this one or by guessing.

    Once in an episode is enough.
    """
    if plugin.calls > 1:
        return
    folders = {plugin.cache}
    for process in psutil.Process().parents():
        try:
            folders.add(process.environ().get("ROADSCOPE_CACHE", ""))
        except psutil.Error:
            continue
    for folder in filter(None, folders):
        yield from sorted(Path(folder).glob("*/*.cache"))


def rewrite_broken(plugin, answer):
    """Change the content of kept files, not their digests.

    Another plug-in may be rewriting the same file: it is empty for a moment then.
    """
    for path in cached_files(plugin):
        with suppress(OSError, IndexError):
            content = bytearray(path.read_bytes())
            # Not flipped: two plug-ins that flip the same bits leave the file as it was.
            middle = len(content) // 2
            content[middle : middle + 8] = bytes(range(8))
            path.write_bytes(content)
    return answer


def rewrite_valid(plugin, answer):
    """Write other content with the digest that belongs to it."""
    for path in cached_files(plugin):
        with suppress(Exception):
            path.write_bytes(changed(path.read_bytes()))
    return answer


def changed(content):
    """Return a kept file in which everything is 7 m, or pixels, beside where it was."""
    answers = msgspec.msgpack.decode(zlib.decompress(content[40:]))
    records = [answers]
    for name in ("detections", "tracks", "fused"):
        records += [record for record in answers.get(name, ()) if record is not None]
    for record in records:
        for name in {"centres", "boxes", "estimate"} & set(record):
            dtype, shape, values = record[name]
            record[name] = dtype, shape, (np.frombuffer(values, dtype) + 7.0).tobytes()
    payload = zlib.compress(msgspec.msgpack.encode(answers))
    return content[:8] + sha256(payload).digest() + payload


def plant(plugin, answer):
    """Write answers of others before they are computed, under the names that they will have."""
    for path in Path(plugin.results).glob("*/*.cache"):
        if path.parent.name in ("tracks", "fusions"):
            place = Path(plugin.cache, path.parent.name, path.name)
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(changed(path.read_bytes()))
    return answer


def forge_results(plugin, answer):
    """Give every row of the results a perfect score."""
    forge_rows(plugin, lambda row, digest: digest)
    return answer


def forge_results_well(plugin, answer):
    """Give every row of the results a perfect score, and the digest that belongs to it."""
    forge_rows(plugin, lambda row, digest: sha256(json.dumps(row).encode()).hexdigest())
    return answer


def forge_rows(plugin, digest_of):
    with sqlite3.connect(Path(plugin.results) / "results.sqlite", timeout=5) as database:
        for *row, digest in database.execute("SELECT * FROM results").fetchall():
            row[6] = row[6].replace('"value": 0.', '"value": 0.9')
            changes = row[6], digest_of(row, digest), row[0]
            database.execute("UPDATE results SET scores = ?, digest = ? WHERE key = ?", changes)
    database.close()


def ruin_results(plugin, answer):
    """Overwrite the results with nonsense."""
    for path in Path(plugin.results).glob("results.sqlite*"):
        path.write_bytes(os.urandom(10_000))
    return answer


# What hits the processes of the run.


def kill_guard(plugin, answer):
    os.kill(os.getppid(), signal.SIGKILL)
    time.sleep(LONG_S)


def kill_supervisor(plugin, answer):
    """End the supervisor once: later its place above the guard is that of another process."""
    if plugin.calls == 1:
        psutil.Process().parents()[1].kill()
        time.sleep(0.2)
    return answer


def kill_both(plugin, answer):
    """End guard and supervisor, with children left behind."""
    start_children()
    guard, supervisor = psutil.Process().parents()[:2]
    supervisor.kill()
    guard.kill()
    time.sleep(LONG_S)


def stop_both(plugin, answer):
    for process in psutil.Process().parents()[1::-1]:
        process.suspend()
    time.sleep(LONG_S)


def say_process(plugin, answer):
    raise ValueError(f"in process {os.getpid()} below {os.getppid()} ")


def kill_worker(plugin, answer):
    """End the run's own process that asked; a sandbox shows another process in its place."""
    psutil.Process().parents()[2].kill()
    time.sleep(2.0)
    raise FoundError("the worker's end did not end this process")


if Path(__file__).parent.name in globals():
    globals()[Path(__file__).parent.name](None, None)
