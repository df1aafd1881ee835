"""The commands of the command line, one file each; each calls a function of `roadscope.benchmarks`.

Imports other than typer are inside the commands, so that `--help` answers at once.
"""

from roadscope._lazy import lazy_names

_PARTS = {"terminal": "headline progress_bars"}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
