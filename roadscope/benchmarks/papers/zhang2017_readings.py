"""Other readings of what Zhang 2017 leaves open, beside those that were taken."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType

from roadscope.benchmarks.papers.zhang2017_errors import errors, rmse
from roadscope.benchmarks.papers.zhang2017_methods import Method, estimate, multi, ransac, single
from roadscope.benchmarks.papers.zhang2017_scene import Run

READINGS: Mapping[str, Method] = MappingProxyType(
    {
        "single (taken)": single,
        "single, extent only": partial(single, template="extent"),
        "single, no near edge": partial(single, template="plateau"),
        "single, over 90 deg": partial(single, search_deg=90.0),
        "multi (taken)": multi,
        "multi, extent only": partial(multi, template="extent"),
        "multi, no near edge": partial(multi, template="plateau"),
        "multi, over 90 deg": partial(multi, search_deg=90.0),
        "multi, free shifts": partial(multi, tied=False),
        "RANSAC (taken)": ransac,
        "RANSAC, main is flank": partial(ransac, long_side="main"),
    }
)
NOTE = (
    "The filter's step function is not printed. Taken: faces weigh as their extent and as echoes "
    "fade with incidence. Also tried: extent only; without the near edge. The search over 180 "
    "deg, the paper's over 90; three frames tied by one speed, or shifted freely; RANSAC's first "
    "line is the side it is nearest to in size, or always the flank. Sharp body."
)


def compare(run: Run) -> dict[str, dict[str, float]]:
    """Return the columns of tables 1 and 2 by reading."""
    return {name: rmse(run, errors(run, estimate(m, run)[0])) for name, m in READINGS.items()}
