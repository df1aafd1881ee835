"""A paper of two parts; each call leaves a line in the file that `TOY_PAPER_LOG` names."""

import os
from functools import partial
from pathlib import Path

from roadscope.benchmarks.papers import FIRST_SEED, ClaimRange, FigureKey, Paper, judge, summarise

KEY = FigureKey("toy", "ours", "error")
FEW = FigureKey("toy", "ours", "of the first seed")
"""A figure that other seeds do not have."""
TWICE = FigureKey("toy", "ours", "twice")
HIDDEN = FigureKey("raw", "ours", "error")


def measure(part, key, seed):
    with Path(os.environ["TOY_PAPER_LOG"]).open("a") as log:
        log.write(f"{part} {seed}\n")
    figures = {key: float(seed - FIRST_SEED), HIDDEN: 1.0}
    return figures if key != FEW or seed == FIRST_SEED else {}


REPRODUCTION = Paper(
    parts={"long": partial(measure, "long", KEY), "short": partial(measure, "short", FEW)},
    of_seed=lambda figures: {TWICE: 2 * figures[KEY]},
    hidden=frozenset({"raw"}),
    rows=lambda measured: [summarise(key, "m", values) for key, values in measured.items()],
    verdicts=lambda measured: [
        judge("errors are small", "ours", "m", measured[KEY], ClaimRange(high=1.5))
    ],
    note_of=lambda experiment: None,
)
