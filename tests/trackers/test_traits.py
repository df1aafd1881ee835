import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tracked_scenes import make

from roadscope.core import Category
from roadscope.trackers import (
    EDGES,
    FOLDER,
    TraitsChoice,
    UnknownDetectorWarning,
    detector_names,
    read_detector,
)

UNKNOWN = read_detector("unknown").traits
KITTI = read_detector("kitti-pointrcnn")


def drawn(deciles, uniform):
    """Scores of a detector, from numbers in 0 to 1."""
    return np.interp(10 * uniform, np.arange(11), deciles)


def test_a_detector_is_recognised_by_its_scores():
    choice, rng, count = TraitsChoice("auto"), np.random.default_rng(0), 0
    for name in (each for each in detector_names() if each != "unscaled"):
        traits, scores = read_detector(name)
        for category in (Category.CAR, Category.CYCLIST, Category.PEDESTRIAN):
            if scores.deciles[category][0] < EDGES[0]:
                continue
            choice.reset()
            for _ in range(60):
                odds = drawn(scores.deciles[category], rng.uniform(size=10))
                chosen = choice.update(odds, np.full(10, category))
            assert chosen == traits, (name, category)
            count += 1
    assert count >= 7


def test_scores_like_those_of_no_known_detector_are_taken_as_they_are():
    """Even odds of either kind, as a noise model draws them."""
    rng = np.random.default_rng(0)
    odds = 2 * (rng.standard_normal(200) + rng.choice([-1, 1], 200))
    assert TraitsChoice("auto").update(odds, np.zeros(200, int)) == UNKNOWN


@pytest.mark.parametrize("scores", [(0.84, 0.98), (0.95, 0.95, 0.95)])
def test_a_few_scores_decide_nothing_by_repetition(scores):
    choice, scores = TraitsChoice("auto"), np.array(scores)
    odds, people = np.log(scores / (1 - scores)), np.full(len(scores), Category.PEDESTRIAN)
    assert choice.update(odds, people) == UNKNOWN
    for _ in range(999):
        choice.update(odds, people)
    assert not choice._decided


some_scores = st.lists(
    st.tuples(st.floats(-9.21, 9.21), st.sampled_from(list(Category))), min_size=1, max_size=30
)


@settings(max_examples=25)
@given(some_scores, st.randoms(use_true_random=False))
def test_order_and_ticks_of_scores_do_not_matter(scores, shuffler):
    one, other = TraitsChoice("auto"), TraitsChoice("auto")
    one.update(*map(np.array, zip(*scores, strict=True)))
    shuffler.shuffle(scores)
    for odds, category in scores:
        if other._decided:
            # From then on weights stay as they are.
            return
        other.update(np.array([odds]), np.array([category]))
    assert other._log_weights == pytest.approx(one._log_weights)


def test_scores_below_all_of_training_are_not_the_detectors():
    """With one in ten below its lowest score another is hardly ever taken for that detector."""
    category, rng = Category.PEDESTRIAN, np.random.default_rng(3)
    deciles = KITTI.scores.deciles[category]
    own = drawn(deciles, rng.uniform(size=400))
    lower = np.where(rng.uniform(size=400) < 0.1, deciles[0] - rng.uniform(0.02, 3, 400), own)
    counts = []
    for odds in (own, lower):
        choice = TraitsChoice("auto")
        chosen = [choice.update(some, np.full(10, category)) for some in odds.reshape(40, 10)]
        counts.append(sum(traits == KITTI.traits for traits in chosen))
    assert counts[0] >= 36
    assert counts[1] <= 5


@pytest.mark.parametrize("transform", [lambda odds: odds / 2, lambda odds: odds / 4 - 3])
def test_transformed_scores_are_of_no_known_detector_for_good(transform, monkeypatch):
    monkeypatch.setattr(TraitsChoice, "has_warned", False)
    category, rng = Category.CAR, np.random.default_rng(4)
    odds = transform(drawn(KITTI.scores.deciles[category], rng.uniform(size=(60, 10))))
    choice = TraitsChoice("auto")
    with pytest.warns(UnknownDetectorWarning):
        chosen = [choice.update(some, np.full(10, category)) for some in odds]
    assert all(traits == UNKNOWN for traits in chosen[30:])


def test_a_process_warns_once_of_an_unknown_detector_and_names_the_option(monkeypatch):
    monkeypatch.setattr(TraitsChoice, "has_warned", False)
    category, rng = Category.CAR, np.random.default_rng(4)
    odds = drawn(KITTI.scores.deciles[category], rng.uniform(size=(60, 10))) / 2
    choice = TraitsChoice("auto")

    def drive(choice):
        choice.reset()
        for some in odds:
            choice.update(some, np.full(10, category))

    with pytest.warns(UnknownDetectorWarning, match="traits=auto"):
        drive(choice)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drive(choice)
        drive(TraitsChoice("auto"))


def test_a_choice_stays():
    category, rng = Category.CAR, np.random.default_rng(5)
    choice = TraitsChoice("auto")
    for detector in (KITTI, read_detector("roadscope")):
        odds = drawn(detector.scores.deciles[category], rng.uniform(size=400))
        assert choice.update(odds, np.full(400, category)) == KITTI.traits


def test_the_next_score_is_beyond_all_by_the_rule_of_succession():
    choice, scores = TraitsChoice("kitti-pointrcnn"), KITTI.scores
    deciles = scores.deciles[Category.PEDESTRIAN]
    beyond = (choice._edges[1:] <= deciles[0]) | (choice._edges[:-1] >= deciles[-1])
    shares = choice._shares.reshape(3, -1)
    assert shares.sum(axis=1) == pytest.approx(1)
    expected = 1 / (scores.counts[Category.PEDESTRIAN] + 2)
    assert shares[-1, beyond].sum() == pytest.approx(expected)


@pytest.mark.parametrize("count", ["-1", "2.5", "true", "'many'"])
def test_the_number_of_scores_is_checked(tmp_path, count):
    text = (FOLDER / "unknown.toml").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(text.replace("scores = 0", f"scores = {count}"), "utf-8")
    with pytest.raises(ValueError, match=r"\[car\], as scores, got"):
        read_detector(str(tmp_path / "mine.toml"))


def test_a_share_below_one_is_wanted(tmp_path):
    lines = (FOLDER / "unknown.toml").read_text("utf-8").splitlines()
    changed = ["born = 1.0" if line.startswith("born =") else line for line in lines]
    path = tmp_path / "mine.toml"
    path.write_text("\n".join(changed), "utf-8")
    with pytest.raises(ValueError, match=r"below 1 as born in \[car\], got 1.0"):
        read_detector(str(path))


def test_missing_traits_are_named(tmp_path):
    with pytest.raises(ValueError, match="kitti-pointrcnn, roadscope, unknown, unscaled"):
        make("existence", traits="mine")
    text = (FOLDER / "roadscope.toml").read_text("utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("along_m", "long_m", 1), "utf-8")
    with pytest.raises(ValueError, match=r"along_m in \[car\]"):
        read_detector(str(path))
