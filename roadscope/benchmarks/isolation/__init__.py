"""Runs a plug-in that is not part of roadscope in a process of its own.

A worker process of a run has a supervisor, a process that never has data of a suite. For each
plug-in the supervisor forks a guard, and the guard forks the plug-in's process and watches it:

    worker ---- supervisor ---- guard ---- plug-in's process
       |___________________________|___________|

The supervisor imports once what plug-ins need: our records, and those slow libraries (torch,
scipy, numba) that an earlier plug-in loaded. The worker exchanges records with the plug-in's
process over a socket, in a checked format and not as pickles; over another socket the guard
reports how that process ended. A plug-in that raised an exception may be called again; after an
exit, a hang or a forged answer it may not.

What is prevented. A crash, an exit, an exception of any kind, a hang, a flood of output, memory
beyond the limit, and a forged, truncated, oversized or malformed answer fail only the plug-in's own
row. Changes to modules, and to an answer after it was given, have no effect outside its process,
which has no truth, no seeds and no path of the cache. All processes that it started end with it, on
Linux also those in sessions of their own; if it killed its supervisor, they are recognised by a
variable of their environment.

What is not prevented. Its process belongs to the same user: it can read and write that user's
files, use the network, and signal that user's processes, also the worker. It can report times of
its calls that are too short. Memory is measured ten times a second, and memory that is not resident
(files in /dev/shm) is not counted. With `sandbox=True` bubblewrap hides network, processes, cache,
results and the folder of recorded data, and lets it write no file; but scenarios are public code,
and a plug-in can still compute the traffic from that, or find copies of recorded data elsewhere. A
class is loaded once before a run to read its traits; `probing` applies the limits and the sandbox
of the run to that.

On other systems than Linux, processes that left the plug-in's session may outlive it. On systems
that cannot fork (Windows) there is no isolation, and `open_plugin` raises `PluginError`.
"""

from roadscope.benchmarks.isolation.describing import describe
from roadscope.benchmarks.isolation.host import PluginHandle, open_plugin, probe, probing
from roadscope.benchmarks.isolation.limits import Limits, PluginError, SandboxError, Timed, Traits
from roadscope.benchmarks.isolation.sandbox import sandbox_available

__all__ = [
    "Limits",
    "PluginError",
    "PluginHandle",
    "SandboxError",
    "Timed",
    "Traits",
    "describe",
    "open_plugin",
    "probe",
    "probing",
    "sandbox_available",
]
