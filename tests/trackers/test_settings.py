"""Constructor arguments that make no sense are refused, and the message names them."""

import pytest
from tracked_scenes import make

WRONG = {
    "nearest": [
        {"gate_m": 0.0},
        {"sigma_m_m": -0.2},
        {"coast_frames": -1},
        {"acceleration_m_s2": float("nan")},
        {"confirm_hits": 0},
        {"frame": "lidar"},
    ],
    "greedy": [{"pedestrian_gate_m": 0}, {"speed_m_s": float("inf")}],
    "gnn": [
        {"gate_share": 1.0},
        {"position_m": 0.0},
        {"velocity_walk": float("nan")},
        {"confirm_hits": 2.5},
        {"least_score": 1.5},
    ],
    "ab3dmot": [{"overlap": "bev"}, {"least": -0.2}, {"max_age": 0}],
    "bytetrack": [{"high_score": 0.8}, {"low_score": -0.1}, {"least_again": 1.0}],
    "oc-sort": [
        {"overlap": "dice"},
        {"least": -2.0},
        {"momentum": -1.0},
        {"momentum_ticks": 0},
        {"shown_misses": -1},
    ],
    "simple-track": [{"low_score": 0.8}, {"most_overlap": 1.5}, {"max_age": 0}],
    "pc3t": [{"decay": 1.5}, {"gate_m": 0.0}, {"coast_frames": -1}],
    "mctrack": [{"least": -1.5}, {"least_again": 2.0}, {"least_score": -0.1}],
    "imm": [{"gate_share": 0.0}, {"sojourn_s": 0.0}, {"turn_walk": -1.0}],
    "jpda": [{"gate_share": float("nan")}, {"detection": 1.0}, {"clutter_m2": 0.0}, {"drop": 2.0}],
    "pmbm": [
        {"gate_share": 0.0},
        {"hypotheses": 0},
        {"birth_m2": 0.0},
        {"least_share": 2.0},
        {"shown_misses": -1},
    ],
    "existence": [{"coast_s": 0}, {"shown_probability": 1}, {"least_overlap": 1}],
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_settings_are_named(name):
    for settings in WRONG[name]:
        (argument, value) = next(iter(settings.items()))
        words = "least" if argument.startswith("least_a") else argument
        with pytest.raises(ValueError, match=words) as error:
            make(name, **settings)
        assert str(value) in str(error.value)
