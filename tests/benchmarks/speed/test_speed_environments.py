"""How fast environments are."""

import pytest

from roadscope.benchmarks.speed import RIGS, measure_environment


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
def test_a_reset_and_steps_of_every_rig_are_timed(rig: str) -> None:
    reset, steps = measure_environment(rig)
    assert (reset.unit, steps.unit) == ("ms", "times real time")
    assert reset.name.endswith(rig)
    assert steps.name.endswith(rig)
    # Above these limits a step or a reset does something that it did not do before.
    assert 0.0 < reset.value < 2000.0
    assert steps.value > 0.4
