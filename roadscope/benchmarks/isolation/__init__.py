"""A plug-in that is not ours, in a process of its own.

A worker has a supervisor, a process that never held anything of a suite. For each plug-in it forks
a guard, and the guard forks the plug-in's process and watches over it:

    worker ---- supervisor ---- guard ---- plug-in's process
       |___________________________|___________|

The supervisor imports once what plug-ins need: our records, and of the slow libraries (torch,
scipy, numba) those that an earlier plug-in loaded. The worker sends records and gets records, in
a checked format and not as pickles, over a socket to the plug-in's process; over another one the
guard says how that process ended. A plug-in that raised may be asked again; one that ended, hung
or forged an answer is over.

What is prevented. A crash, an exit, an exception of any kind, a hang, a flood of output, memory
beyond the limit, and a forged, truncated, oversized or malformed answer cost the plug-in its own
row and no more. What it changes in its modules, and what it writes into an answer after it gave
it, reaches nobody. Its process holds no truth, no seeds and no folder of caches. All processes
that it started end with it, on Linux also those in sessions of their own; where it ended those that
watch over it, its processes are known by a variable of their environment.

What is not prevented. Its process belongs to the same user: it can read and write that user's
files, use the network, and signal that user's processes, the worker among them. It can misstate
the times of its calls to its own favour, as far as they are no longer than the wait. Memory is
measured ten times a second, and what is not resident (files in /dev/shm) is not counted. With
`sandbox=True` bubblewrap takes network, files and processes from its sight; scenarios are public
code, and what can be computed from that it can still compute. A class is loaded once before a run,
to see what it says of itself; `probing` has that done with the limits and the sandbox of the run.

Where the system is not Linux, processes that left the plug-in's session outlive it. Where it
cannot fork (Windows) there is no isolation, and `open_plugin` says so.
"""

from roadscope.benchmarks.isolation.host import (
    PluginHandle,
    open_plugin,
    probe,
    probing,
)
from roadscope.benchmarks.isolation.limits import (
    Limits,
    PluginError,
    PluginSpec,
    SandboxError,
    Timed,
    Traits,
)
from roadscope.benchmarks.isolation.sandbox import sandbox_available

__all__ = [
    "Limits",
    "PluginError",
    "PluginHandle",
    "PluginSpec",
    "SandboxError",
    "Timed",
    "Traits",
    "open_plugin",
    "probe",
    "probing",
    "sandbox_available",
]
