"""Pairs without a difference: what they say of two demonstrations, and what they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logit

from hand_made import COLUMNS, answers_of
from rpil.inference.answered import Answered, answer
from rpil.inference.answers import posterior
from rpil.inference.settings import AnswerSettings

SETTINGS = AnswerSettings()
COLUMN = np.linspace(-2, 2, 9)[:, None]


def log_odds(tied, pairs=()):
    return logit(posterior(COLUMN, answers_of(None, pairs, None, tied, 9), SETTINGS).proba(COLUMN))


def judged(tied, pairs=(), settings=SETTINGS, claimed=None) -> Answered:
    claimed = np.zeros(12, dtype=int) if claimed is None else claimed
    return answer(COLUMNS, answers_of(None, pairs, None, tied), settings, np.arange(len(COLUMNS)), claimed)


@pytest.mark.parametrize("others", [[(7, 1)], [(7, 1), (6, 2)], [(7, 1), (1, 6)]])
def test_a_tie_is_between_a_win_and_a_loss(others):
    win, tie, loss = log_odds([], [*others, (8, 0)]), log_odds([(8, 0)], others), log_odds([], [*others, (0, 8)])
    assert win[8] - win[0] > tie[8] - tie[0] > loss[8] - loss[0]


def test_neither_of_a_tie_is_the_first():
    np.testing.assert_allclose(log_odds([(8, 0)], [(7, 1)]), log_odds([(0, 8)], [(7, 1)]), atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_ties_alone_never_turn_the_direction(seed):
    """They are as probable by -w as by w, and the prior prefers one of the two."""
    rng = np.random.default_rng(seed)
    channels, tied = rng.normal(size=(20, 3)), [rng.choice(20, 2, replace=False) for _ in range(1 + 3 * seed)]
    found, nothing = (posterior(channels, answers_of(tied=some, m=20), SETTINGS) for some in (tied, []))
    assert len(found.mean) == 2 * len(SETTINGS.error_rates)
    along = found.mean[:2] @ nothing.mean[0]
    assert ((along > 0) & (along < nothing.mean[0] @ nothing.mean[0])).all()
    np.testing.assert_allclose(found.mean[:, 0], 0.0, atol=1e-4)  # nothing is said of the share of good ones


@pytest.mark.parametrize("seed", range(2))
def test_ties_alone_give_no_word_and_turn_no_ranking(seed):
    rng = np.random.default_rng(seed)
    tied, claimed = [rng.choice(12, 2, replace=False) for _ in range(1 + 2 * seed)], np.repeat([-1, 0, 1], 4)
    found = judged(tied, settings=replace(SETTINGS, min_proba=0.51), claimed=claimed)
    assert (found.verdicts == 0).all()
    assert (found.stays * claimed >= 0).all()
    assert np.corrcoef(found.log_odds, judged([]).log_odds)[0, 1] > 0.5


WINS, ACROSS = [(11, 0), (10, 1)], [(11, 0), (10, 1)]


def test_ties_against_what_answers_say_take_words_that_other_ties_leave():
    between = 0.5 * (judged([], WINS).log_odds[11] + judged(ACROSS, WINS).log_odds[11])
    some = replace(SETTINGS, min_proba=float(expit(between)))
    assert judged([], WINS, some).verdicts[11] == 1
    assert judged(ACROSS, WINS, some).verdicts[11] == 0
    assert judged(ACROSS, WINS, some).count == 4
    assert judged([(0, 1), (10, 11)], WINS, some).verdicts[11] == 1


def test_a_tie_of_copies_says_nothing_and_of_others_it_counts_once():
    copy_of = np.array([0, 0, 2, 2, 4, 4])
    known = answers_of(pairs=[(3, 5)], tied=[(0, 1), (0, 2), (3, 1), (2, 4), (4, 5)], m=6)
    once = known.once(copy_of)
    assert (once.tied.tolist(), once.pairs.tolist()) == ([[0, 1], [1, 2]], [[1, 2]])
    np.testing.assert_array_equal(known.shared(copy_of).tied, known.tied)
    every = np.append(np.arange(12), [11, 11, 0])  # two copies of the best, one of the worst
    nothing = np.zeros(15, dtype=int)
    found = answer(COLUMNS[every], answers_of(tied=[(11, 0), (14, 13), (11, 12)], m=15), SETTINGS, every, nothing)
    np.testing.assert_array_equal(found.log_odds, judged([(0, 11)]).log_odds[every])
    assert found.count == 1
    assert answer(COLUMNS[every], answers_of(tied=[(11, 12), (13, 12)], m=15), SETTINGS, every, nothing).count == 0
