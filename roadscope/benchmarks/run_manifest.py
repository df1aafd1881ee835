"""The manifest of a run: the versions, code, machine and suite that its results come from."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from roadscope import __version__
from roadscope.benchmarks.fingerprints import (
    PACKAGE,
    fingerprint,
    package_hash,
    package_version,
    sensing_hash,
)
from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.suite import Suite
from roadscope.envs.sensors.rigs import rig

LIBRARIES = ("numpy", "scipy", "numba", "gymnasium", "highway-env", "joblib")


def manifest(
    suite: Suite,
    jobs: int,
    boards: Sequence[str] = (),
    calibration: str = "",
    *,
    trust: bool = False,
) -> dict[str, Any]:
    """Return versions, code, machine, suite and boards of a run, as JSON can hold them.

    calibration: file that plug-ins get in place of the rig's calibration; empty: none.
    trust: whether code of others ran inside the processes of the run, which it can falsify.
    """
    chosen: dict[str, Any] = {"calibration": Path(calibration).name} if calibration else {}
    if trust:
        chosen["trust"] = True
    return chosen | {
        "roadscope": __version__,
        "commit": commit(),
        "code": package_hash(),
        "sensing_code": sensing_hash(),
        "metric_version": METRIC_VERSION,
        "suite": suite.name,
        "suite_version": suite.version,
        "suite_hash": fingerprint(suite),
        "duration_s": suite.duration_s,
        "eligibility_hash": fingerprint(suite.eligibility),
        "rig_hash": None if suite.recorded else fingerprint(rig(suite.rig)),
        "boards": list(boards),
        "scenarios": list(suite.scenarios),
        "weathers": list(suite.weathers),
        "faults": [" + ".join(faults) or "clear" for faults in suite.faults],
        "seeds": list(suite.seeds),
        "rig": suite.rig,
        "jobs": jobs,
        "python": platform.python_version(),
        "libraries": {name: package_version(name) for name in LIBRARIES},
        "platform": platform.platform(),
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def commit() -> str | None:
    """Return the commit of this checkout, `+` after it when files differ; None outside one."""
    if not (PACKAGE.parent / ".git").exists():
        return None
    head, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--", "roadscope")
    return None if head is None else head + ("+" if changes else "")


def cpu_model() -> str:
    """Return the processor's name as the system reports it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _git(*arguments: str) -> str | None:
    try:
        command = ["git", "-C", str(PACKAGE.parent), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
