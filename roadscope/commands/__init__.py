"""The commands, a file each. What they do is a function of `roadscope.benchmarks`.

Imports beyond typer happen inside the commands, so that `--help` answers at once.
"""
