"""Hostile plug-ins of all kinds against whole runs, by the public functions.

`hostile.py` holds the plug-ins: an entry such as `hostile.py:Tracker?act=segfault` answers honestly
but for its act. `acts.py` lists the acts, for which kinds they are, and what a failure must say.
`boards.py` has a suite of all six boards that takes seconds, and runs it in folders of its own.
Runs without strangers are the measure: scores of all other entries are compared digit by digit, but
for times. All acts are done for all kinds that can do them, with one worker and with two; drivers
drive on true tracks. In `test_stacks.py` plug-ins of perception stacks fail in the closed loop. All
of this is `slow`; `tests/benchmarks/isolation` has quick tests of the same mechanisms.

What is prevented
-----------------
- Whatever ends, stops or hangs the process of a plug-in, at any moment, is one row with a reason.
- So is whatever it answers that is not in the contract, by whatever bytes on its socket, and what
  it uses of output, memory and time beyond the limits.
- Changes in its own process (classes of ours, functions of libraries, answers that it gave before)
  reach no other process. Neither truth nor folders of the run are in its process.
- Processes that it started end with it, in sessions of their own too, and when it ended those that
  watch over it first. They are known by a variable of their environment then.
- With several workers, one that a plug-in killed costs the plug-in its row, after three tries.
- Kept files that are changed while a run goes on are not used: the run's own process knows the
  digests of all that were there at its start and of all that it wrote. They are computed again,
  with a warning that names them, or removed at the end of the run. The same holds for files that
  appear under names that the run will use, and for files that were damaged between runs.
- Outcomes of a run come from its memory. Its rows in `results.sqlite` that were changed meanwhile
  are written again. Rows whose digest does not fit do not count in later runs, and a warning names
  them. A file that was ruined costs no board.
- Names and messages are shown without control characters, and are plain text for spreadsheets,
  Markdown and LaTeX.

What is not prevented without `--sandbox`
-----------------------------------------
A plug-in runs as the user does, so that it can do what the user can:

- kill the run itself where the run is its own worker (`--jobs 1`), or all workers again and again;
- change files before the run reads their digests, also while its class is loaded to see what kind
  it is, and between runs, and files and rows of other runs: with digests that fit they are used;
- start processes that clear their environment after it ended those that watch over it, or have
  others start them (cron, at);
- compute truth from the public code and seeds of a suite, read it from kept files, and use it;
- state shorter times of its calls than they took.

With `--sandbox` it sees no process, network, cache, results or folder of recorded data, and can
write to a scratch folder only, also while its class is loaded. What can be computed from public
code it can still compute.

On clusters (`--backend ray|dask` with an address) digests are not compared: machines may have files
of their own under the same names.
"""

import pytest

pytest.register_assert_rewrite("tests.torture.entries")
