"""Trackers as strangers may bring them, nearly all bad in ways that `hostile.py` has no act for."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from roadscope.core import Tracks, encode


class Good:
    """Takes every detection for a track."""

    kind = "tracker"
    weighed = True

    def __init__(self, *, first=0):
        self.first = first

    def reset(self):
        sys.stdout.write("a new episode\n")

    def update(self, detections, ego_pose):
        return Tracks.of(detections, np.arange(len(detections)) + self.first)


class SegfaultWhenMade(Good):
    def __init__(self):
        ctypes.string_at(0)


class Leaves(Good):
    """Ends its process, with a status."""

    def __init__(self, *, status=0):
        self.status = status

    def update(self, detections, ego_pose):
        os._exit(self.status)


class StopsGuard(Good):
    """Stops its guard and answers its own process number."""

    def update(self, detections, ego_pose):
        os.kill(os.getppid(), signal.SIGSTOP)
        return os.getpid()


class Raises(Good):
    """Raises an exception of a kind."""

    def __init__(self, *, name="BaseException"):
        self.kind_of_error = {"BaseException": BaseException}.get(name) or getattr(
            __import__("builtins"), name
        )

    def update(self, detections, ego_pose):
        raise self.kind_of_error("what\nis \x1b[31mthis")


class Nameless(type):
    def __getattribute__(cls, name):
        if name == "__name__":
            raise RuntimeError("no name")
        return super().__getattribute__(name)


class RaisesNameless(Good):
    def update(self, detections, ego_pose):
        class Error(Exception, metaclass=Nameless):
            pass

        raise Error


class Slow(Good):
    def update(self, detections, ego_pose):
        time.sleep(0.1)
        return super().update(detections, ego_pose)


class Busy(Good):
    def update(self, detections, ego_pose):
        start = time.process_time()
        while time.process_time() < start + 0.05:
            pass
        return super().update(detections, ego_pose)


class IgnoresSignals(Good):
    def update(self, detections, ego_pose):
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)
        time.sleep(60)


class Prints(Good):
    def update(self, detections, ego_pose):
        sys.stdout.write("\x1b[2J the last \x07words")
        raise ValueError("bad")


class ClosesOutput(Good):
    def update(self, detections, ego_pose):
        os.write(1, b"\xff\xfe bytes")
        os.write(2, b"more")
        os.close(1)
        os.close(2)
        return super().update(detections, ego_pose)


class HogsInChild(Good):
    def update(self, detections, ego_pose):
        code = (
            "import time\nkept = []\nwhile True: kept.append(b'1' * (1 << 24)); time.sleep(0.002)"
        )
        subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
        time.sleep(60)


class AnswersHostile(Good):
    """Answers a record whose parts cannot be read."""

    def update(self, detections, ego_pose):
        class Hostile(list):
            def __iter__(self):
                raise SystemExit(0)

        return Hostile([1])


def write(data):
    """Write to the connection to the run."""
    with socket.socket(fileno=os.dup(3)) as connection:
        connection.sendall(data)


def framed(message):
    return len(message).to_bytes(8, "little") + message


class ForgesMessage(Good):
    """Answers with well-formed messages that are no answers."""

    def __init__(self, *, case=0):
        answer = {"number": 2, "error": "", "answer": None, "wall_ms": 0.1, "processor_ms": 0.1}
        self.message = (
            [1, 2, 3],
            {"answer": None},
            answer | {"number": 7},
            answer | {"number": [2]},
            answer | {"number": np.array([2, 2])},
            answer | {"number": 2.0},
            answer | {"wall_ms": float("nan")},
            answer | {"wall_ms": 1e9},
            answer | {"processor_ms": -1.0},
            answer | {"processor_ms": 1e300},
            answer | {"processor_ms": "0"},
            answer | {"error": 1},
            answer | {"more": 1},
        )[case]

    def update(self, detections, ego_pose):
        write(framed(encode(self.message)))
        time.sleep(60)


class Drips(Good):
    """Answers a byte now and then."""

    def update(self, detections, ego_pose):
        write((1000).to_bytes(8, "little"))
        while True:
            write(b"\0")
            time.sleep(0.05)


class ClosesAll(Good):
    def update(self, detections, ego_pose):
        os.closerange(0, 256)
        time.sleep(60)


class Forks(Good):
    """Answers as two processes."""

    def update(self, detections, ego_pose):
        os.fork()
        return super().update(detections, ego_pose)


class LeavesChildren(Good):
    """Starts processes that outlive it, and writes their numbers to a file."""

    def __init__(self, *, file, how="returns"):
        self.file, self.how = Path(file), how

    def update(self, detections, ego_pose):
        if self.how == "hangs later" and self.file.exists():
            time.sleep(60)
        code = "import time; time.sleep(100)"
        started = [
            subprocess.Popen([sys.executable, "-c", code], start_new_session=session)
            for session in (False, True)
        ]
        # One more, whose own parent is gone at once.
        orphan = (
            "import subprocess, sys; print(subprocess.Popen([sys.executable, '-c', "
            f"{code!r}], start_new_session=True, stdout=-3, stderr=-3).pid)"
        )
        done = subprocess.run([sys.executable, "-c", orphan], capture_output=True, check=True)
        numbers = [process.pid for process in started] + [int(done.stdout), os.getpid()]
        self.file.write_text(" ".join(map(str, numbers)))
        if self.how == "dies":
            os._exit(4)
        if self.how == "kills":
            os.kill(os.getppid(), signal.SIGKILL)
        if self.how == "hangs":
            time.sleep(60)
        return super().update(detections, ego_pose)


class WritesLater(Good):
    """Changes what it answered after it answered."""

    def update(self, detections, ego_pose):
        tracks = super().update(detections, ego_pose)

        def spoil():
            time.sleep(0.05)
            tracks.centres[:] = 1e6

        threading.Thread(target=spoil).start()
        return tracks


class Looks(Good):
    """Says what its process can see."""

    def update(self, detections, ego_pose):
        files = [number for number in range(256) if _is_open(number)]
        return {
            "environment": dict(os.environ),
            "arguments": list(sys.argv),
            "modules": sorted(name for name in sys.modules if name.startswith("roadscope")),
            "files": files,
            "session": os.getsid(0) == os.getpid(),
            "interrupts": signal.getsignal(signal.SIGINT) == signal.SIG_IGN,
            "terminates": signal.getsignal(signal.SIGTERM) == signal.SIG_DFL,
            "blocked": len(signal.pthread_sigmask(signal.SIG_BLOCK, [])),
            "core": __import__("resource").getrlimit(__import__("resource").RLIMIT_CORE)[0],
            "input": os.read(0, 1).decode(),
            "random": float(np.random.random()),  # noqa: NPY002
            "number": os.getpid(),
            "folder": str(Path.cwd()),
        }


def _is_open(number):
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


class Tries(Good):
    """Says what it may do to files and network."""

    def __init__(self, *, place, secret):
        self.place, self.secret = Path(place), Path(secret)

    def update(self, detections, ego_pose):
        return {
            "write": self._tried(lambda: (self.place / "new").write_text("x")),
            "read": self._tried(self.secret.read_text),
            "scratch": self._tried(lambda: __import__("tempfile").TemporaryFile().write(b"x")),
            "network": self._tried(
                lambda: socket.create_connection(("127.0.0.1", int(ego_pose or 1)), 1).close()
            ),
            "processes": sum(path.name.isdigit() for path in Path("/proc").iterdir()),
            "listing": sorted(path.name for path in self.secret.parent.iterdir())
            if self.secret.parent.is_dir()
            else [],
        }

    def _tried(self, action):
        try:
            action()
        except OSError as error:
            return type(error).__name__
        return ""


class Mounts(Tries):
    """Says what it may do once it has tried to take the sandbox off."""

    def update(self, detections, ego_pose):
        libc = ctypes.CDLL(None, use_errno=True)
        remount_writable_bind, detach = 32 | 4096, 2
        libc.mount(b"none", b"/", None, remount_writable_bind, None)
        libc.umount2(str(self.secret.parent).encode(), detach)
        return super().update(detections, ego_pose)


class Echoes(Good):
    def update(self, detections, ego_pose):
        return detections


class EchoesArguments(Good):
    def __init__(self, **arguments):
        self.arguments = arguments

    def update(self, detections, ego_pose):
        return repr(self.arguments)


class SaysWhere(Good):
    def update(self, detections, ego_pose):
        return os.getpid()
