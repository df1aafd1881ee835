"""The commands of the command line, one file each; each calls a function of `roadscope.benchmarks`.

Imports other than typer are inside the commands, so that `--help` answers at once.
"""
