"""A stranger's plug-in in a process of its own, with a deadline.

Whatever it does there, hang, use up memory, end the program, costs it its own row and no more.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from roadscope.benchmarks.jobs.workers import leave_with

R = TypeVar("R")

DEADLINE_S = 300.0
"""For an entry that is not ours, on one episode."""
MEMORY_GB = 8.0
"""For one that has to do with less than all."""
RUN = f"from {__name__} import main; main()"
"""As `-m` it would be loaded twice, once with its package, which Python warns of."""


class ApartError(RuntimeError):
    """The process did not answer; the message says why."""


def apart(
    function: Callable[..., R], *arguments: Any, deadline_s: float = DEADLINE_S,
    memory_gb: float | None = None,
) -> R:  # fmt: skip
    """Call a function of a module in another process and return what it returns.

    memory_gb: what the process may use; beyond it gets `MemoryError`, where the system can do so.
    Arguments and result are pickled. `ApartError` when it takes longer, or ends otherwise.
    """
    with tempfile.TemporaryDirectory(prefix="roadscope-") as place:
        given, answer = Path(place) / "given", Path(place) / "answer"
        given.write_bytes(
            pickle.dumps((os.getpid(), memory_gb, list(sys.path), function, arguments))
        )
        child = subprocess.Popen(
            [sys.executable, "-c", RUN, str(given), str(answer)],
            stdout=sys.stderr if hasattr(sys.stderr, "fileno") and _has_file() else None,
        )
        try:
            code = child.wait(deadline_s)
        except subprocess.TimeoutExpired:
            raise ApartError(f"no answer within {deadline_s:g} s: it hangs") from None
        finally:
            child.kill()
            child.wait()
        if code != 0 or not answer.exists():
            raise ApartError(f"ended its whole process, {_ended(code)}")
        result: R = pickle.loads(answer.read_bytes())
        return result


def _limit_memory(memory_gb: float) -> None:
    try:
        import resource
    except ImportError:
        return
    limit = int(memory_gb * 1e9)
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    within = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (within, hard))


def _has_file() -> bool:
    try:
        sys.stderr.fileno()
    except (OSError, ValueError):
        return False
    return True


def _ended(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"


def main() -> None:
    """Do what the file says and write the answer."""
    given, answer = map(Path, sys.argv[1:3])
    # Both are files of the parent's own.
    parent, memory_gb, sys.path[:], function, arguments = pickle.loads(given.read_bytes())
    leave_with(parent)
    if memory_gb is not None:
        _limit_memory(memory_gb)
    part = answer.with_suffix(".part")
    part.write_bytes(pickle.dumps(function(*arguments)))
    part.replace(answer)
