import numpy as np
import pytest

from roadscope.benchmarks.fit.tracker_surplus import OBJECTS, shrunk


def test_few_objects_are_drawn_towards_all_classes():
    classes = {"car": (np.full(9000, 2.0), 400), "cyclist": (np.full(100, 1.2), 5)}
    found = shrunk(classes)
    everything = (9000 * 2.0 + 100 * 1.2) / 9100
    assert found["car"] == pytest.approx(2.0, abs=0.01)
    assert found["cyclist"] == pytest.approx((1.2 + everything) / 2, abs=0.01)
    assert OBJECTS == 5


def test_without_objects_a_class_is_as_all_are():
    found = shrunk({"car": (np.full(10, 3.0), 2), "cyclist": (np.empty(0), 0)})
    assert found == {"car": 3.0, "cyclist": 3.0}


def test_nobody_is_said_to_err_less_than_the_filter_says():
    assert shrunk({"car": (np.full(50, 0.4), 30)}) == {"car": 1.0}
