import numpy as np
import pytest

from research.tracker_traits import PRIOR_OBJECTS, NeesRatios, shrunk_surplus


def test_few_objects_are_drawn_towards_all_classes():
    classes = {
        "car": NeesRatios(np.full(9000, 2.0), 400),
        "cyclist": NeesRatios(np.full(100, 1.2), 5),
    }
    surplus = shrunk_surplus(classes)
    everything = (9000 * 2.0 + 100 * 1.2) / 9100
    assert surplus["car"] == pytest.approx(2.0, abs=0.01)
    assert surplus["cyclist"] == pytest.approx((1.2 + everything) / 2, abs=0.01)
    assert PRIOR_OBJECTS == 5


def test_without_objects_a_class_is_as_all_are():
    surplus = shrunk_surplus(
        {"car": NeesRatios(np.full(10, 3.0), 2), "cyclist": NeesRatios(np.empty(0), 0)}
    )
    assert surplus == {"car": 3.0, "cyclist": 3.0}


def test_no_class_has_smaller_errors_than_the_filter_states():
    assert shrunk_surplus({"car": NeesRatios(np.full(50, 0.4), 30)}) == {"car": 1.0}
