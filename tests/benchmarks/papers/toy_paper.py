"""A paper of two parts; each call leaves a line in the file that `TOY_PAPER_LOG` names."""

import os
from functools import partial
from pathlib import Path

from roadscope.benchmarks.papers import FIRST_SEED, ClaimRange, FigureKey, Paper, judge, summarise

KEY = FigureKey("toy", "ours", "error")
FEW = FigureKey("toy", "ours", "of the first seed")
TWICE = FigureKey("toy", "ours", "twice")
HIDDEN = FigureKey("raw", "ours", "error")


def measure(part, key, seed):
    with Path(os.environ["TOY_PAPER_LOG"]).open("a") as log:
        log.write(f"{part} {seed}\n")
    return {key: float(seed - FIRST_SEED), HIDDEN: 1.0}


REPRODUCTION = Paper(
    parts={"long": partial(measure, "long", KEY), "short": partial(measure, "short", FEW)},
    seeds_of={"short": 1},
    of_seed=lambda figures: {TWICE: 2 * figures[KEY]},
    hidden=frozenset({"raw"}),
    rows=lambda measured: [summarise(key, "m", values) for key, values in measured.items()],
    verdicts=lambda measured: [
        judge("errors are small", "ours", "m", measured[KEY], ClaimRange(high=1.5))
    ],
    note_of=lambda experiment: None,
)
