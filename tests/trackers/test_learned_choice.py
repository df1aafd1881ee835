import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import Category
from roadscope.trackers import learned
from roadscope.trackers.learned.choice import EDGES, SETTLED, Choice

UNKNOWN = learned.learned("unknown")


def foretold():
    """Names of what is shipped, and categories of whose scores it says something."""
    for name in learned.names():
        for category in (Category.CAR, Category.CYCLIST, Category.PEDESTRIAN):
            deciles = learned.read(name)[1].deciles[category]
            if deciles[0] >= EDGES[0]:
                yield name, category, deciles


def test_traits_are_chosen_by_the_scores_met():
    choice, rng, asked = Choice("auto"), np.random.default_rng(0), 0
    for name, category, deciles in foretold():
        choice.reset()
        for _ in range(60):
            scores = np.interp(rng.uniform(0, 10, 10), np.arange(11), deciles)
            traits = choice.after(scores, np.full(10, category))
        assert traits == learned.learned(name), (name, category)
        asked += 1
    assert asked >= 7


def test_scores_like_no_known_detectors_are_taken_as_they_are():
    """Even odds of either kind, as a noise model draws them."""
    rng = np.random.default_rng(0)
    scores = 2 * (rng.standard_normal(200) + rng.choice([-1, 1], 200))
    assert Choice("auto").after(scores, np.zeros(200, int)) == UNKNOWN


@pytest.mark.parametrize("scores", [(0.84, 0.98), (0.7, 0.9), (0.95, 0.95, 0.95)])
def test_a_few_sure_scores_are_of_no_known_detector_and_settle_nothing_by_coming_again(scores):
    """They are likely of many detectors, and their repetition adds little to that."""
    choice, odds = Choice("auto"), np.log(np.array(scores) / (1 - np.array(scores)))
    people = np.full(len(scores), Category.PEDESTRIAN)
    assert choice.after(odds, people) == UNKNOWN
    for _ in range(999):
        choice.after(odds, people)
    assert choice._lead() < SETTLED / 2


scores = st.lists(
    st.tuples(st.floats(-9.21, 9.21), st.sampled_from(list(Category))), min_size=1, max_size=30
)


@settings(max_examples=25)
@given(scores, st.randoms(use_true_random=False))
def test_the_order_and_the_ticks_in_which_scores_come_mean_nothing(told, shuffler):
    one, other = Choice("auto"), Choice("auto")
    one.after(*map(np.array, zip(*told, strict=True)))
    shuffler.shuffle(told)
    taken = 0
    for odds, category in told:
        if other._lead() >= SETTLED:
            return
        other.after(np.array([odds]), np.array([category]))
        taken += 1
    assert taken == len(told)
    assert other._told == pytest.approx(one._told)
    assert (other._counts == one._counts).all()


def test_evidence_is_the_chain_of_predictions():
    """Score by score: cases of an interval so far, and what its share counts for, over all."""
    choice, rng = Choice("auto"), np.random.default_rng(1)
    odds = rng.normal(1, 2, 25)
    slow, counts = choice._prior.copy(), np.zeros(len(choice._edges) - 1)
    for value in odds:
        edges = choice._edges
        here = np.flatnonzero((edges[:-1] <= value) & (value < edges[1:]))[0]
        slow += np.log(30 * choice._shares[:, here] + counts[here])
        counts[here] += 1
    choice.after(odds, np.zeros(25, int))
    assert choice._told == pytest.approx(slow)


def test_scores_below_all_that_a_detector_ever_gave_are_not_its_own():
    """With one in ten below its least score another is hardly ever taken for that detector."""
    name, category, rng = "kitti-pointrcnn", Category.PEDESTRIAN, np.random.default_rng(3)
    deciles = learned.read(name)[1].deciles[category]
    own = np.interp(rng.uniform(0, 10, 400), np.arange(11), deciles)
    lower = np.where(rng.uniform(size=400) < 0.1, deciles[0] - rng.uniform(0.02, 3, 400), own)
    taken = []
    for odds in (own, lower):
        choice = Choice("auto")
        picks = [choice.after(some, np.full(10, category)) for some in odds.reshape(40, 10)]
        taken.append(sum(pick == learned.learned(name) for pick in picks))
    assert taken[0] >= 36
    assert taken[1] <= 5


def test_the_next_score_lies_beyond_all_met_with_the_chance_of_the_rule_of_succession():
    choice = Choice("kitti-pointrcnn")
    scores = learned.read("kitti-pointrcnn")[1]
    beyond = choice._edges[1:] <= scores.deciles[Category.PEDESTRIAN][0]
    shares = choice._shares.reshape(3, -1)
    told = 1 / (scores.counts[Category.PEDESTRIAN] + 2)
    above = choice._edges[:-1] >= scores.deciles[Category.PEDESTRIAN][-1]
    assert shares.sum(axis=1) == pytest.approx(1)
    assert shares[-1, beyond | above].sum() == pytest.approx(told)


def test_a_detector_is_unknown_until_another_is_likelier_than_not():
    choice = Choice("auto")
    chances = np.exp(choice._told - np.logaddexp.reduce(choice._told))
    assert chances[learned.names().index("unknown")] == pytest.approx(0.5)
    for lead, known in ((-0.01, False), (0.01, True)):
        choice._told = np.zeros(len(learned.names()))
        choice._told[0] = np.log(len(choice._told) - 1) + lead
        assert (choice.after(np.zeros(0), np.zeros(0, int)) != UNKNOWN) == known


@pytest.mark.parametrize("count", ["-1", "2.5", "true", "'many'"])
def test_a_file_says_how_many_scores_there_were(tmp_path, count):
    text = (learned.FOLDER / "unknown.toml").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(text.replace("scores = 0", f"scores = {count}"), "utf-8")
    with pytest.raises(ValueError, match=r"how many scores there were in \[car\], as scores, got"):
        learned.read(str(tmp_path / "mine.toml"))
