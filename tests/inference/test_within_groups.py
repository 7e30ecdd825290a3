"""Two groups that are both good, or both bad: each is judged by itself, and answers learn from that."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit
from sklearn.linear_model import LinearRegression
from sklearn.metrics import roc_auc_score

from rpil import RPIL, Demonstrations, load, save
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.inference.answered import learned_from
from rpil.inference.answers import Answers, posterior
from rpil.inference.channels import CHANNELS
from rpil.inference.held_out import HeldOutPolicy, held_out_model
from rpil.inference.scores import Scoring
from rpil.inference.settings import AnswerSettings, JudgeSettings
from rpil.inference.trust import columns_within, judge
from rpil.policies.cross_fitted import cross_fitted_policy
from rpil.policies.settings import CrossFitSettings
from rpil.results.record import Audit
from rpil.results.tasks import select

SETTINGS, JUDGE = AnswerSettings(), JudgeSettings()
N, STEPS = 40, 40
FIRST = np.arange(N) < N // 2
"""The demonstrations of the first way; the others go the second way."""
NOISY = np.isin(np.arange(N), [3, 8, 13, 18, 24, 28, 32, 36])
"""Four of each way."""
COMPONENTS = range(len(CHANNELS), len(CHANNELS) + 8)
SEEN = np.random.default_rng(0).normal(size=(N, 8))
"""Components."""
GOOD_PAIR, BAD_PAIR = (0, 21), (3, 24)


def two_ways(seed: int = 3) -> Demonstrations:
    """Two policies, each of half of the demonstrations, some of which are noisy."""
    rng, episodes = np.random.default_rng(seed), []
    for m in range(N):
        states = np.cumsum(rng.normal(0, 0.3, (STEPS, 4)), axis=0)
        actions = states[:, 2:] if FIRST[m] else states[:, :2]
        episodes.append((states, actions + rng.normal(0, 0.25 if NOISY[m] else 0.05, actions.shape)))
    states, actions = (np.concatenate(each) for each in zip(*episodes, strict=True))
    return Demonstrations.from_arrays(states, actions, np.arange(0, N * STEPS + 1, STEPS))


@pytest.fixture(scope="module")
def data() -> Demonstrations:
    return two_ways()


@pytest.fixture(scope="module")
def model(data) -> RPIL:
    return RPIL().fit(data)


@pytest.fixture(scope="module")
def audit(model) -> Audit:
    return model.audit_


def labelled(word: str, pair=GOOD_PAIR) -> dict[int, str]:
    return dict.fromkeys(pair, word)


@pytest.mark.parametrize(("word", "pair"), [("good", GOOD_PAIR), ("bad", BAD_PAIR)])
def test_labels_of_both_groups_that_are_alike_rank_within_each(audit, word, pair):
    assert audit.finding == "two groups"
    assert roc_auc_score(~NOISY, audit.log_odds) < 0.8
    found = audit.answered(labelled(word, pair))
    assert roc_auc_score(~NOISY, found.log_odds) >= 0.95
    assert any("each group is ranked by itself" in sentence for sentence in found.assumptions)
    assert "bad" not in found.verdicts or word == "bad"


def test_the_columns_are_kept(model, audit, tmp_path):
    once = audit.answered(labelled("good"))
    save(model, tmp_path / "model")
    kept = load(tmp_path / "model").audit_
    np.testing.assert_array_equal(kept.columns_within, audit.columns_within)
    np.testing.assert_array_equal(kept.answered(labelled("good")).log_odds, once.log_odds)
    backwards = select(audit, range(N - 1, -1, -1)).answered(labelled("good"))
    np.testing.assert_allclose(backwards.log_odds[::-1], once.log_odds, atol=1e-6)


def fit_data(data: Demonstrations) -> FitData:
    features = np.column_stack([data.observations, np.ones(data.n_steps)])
    return FitData(features, data.actions, data.offsets, Box.around(data.actions), np.zeros(N, dtype=int))


def test_the_columns_are_those_of_each_group_alone(data):
    posed = fit_data(data)
    scoring = Scoring.of(posed, held_out_model(posed, 0, JUDGE.held_out), JUDGE)
    upper = np.flatnonzero(FIRST)
    found = columns_within(scoring, (upper[2:], np.flatnonzero(~FIRST)), SEEN, 0)  # two are of neither
    for members, group in ((upper, 1.0), (np.flatnonzero(~FIRST), -1.0)):
        own = posed.select(members)
        alone = np.delete(judge(own, held_out_model(own, 0, JUDGE.held_out), JUDGE).columns, COMPONENTS, axis=1)
        np.testing.assert_array_equal(found[members][:, COMPONENTS], SEEN[members])
        np.testing.assert_allclose(np.delete(found[members], [*COMPONENTS, -2], axis=1), alone, atol=1e-9)
        assert (found[members, -2] == group).all()
    assert columns_within(scoring, None, SEEN, 0).shape == (N, 0)


def test_a_policy_that_deals_its_own_folds_has_none(data):
    posed = fit_data(data)
    policy = cross_fitted_policy(LinearRegression(), posed.space, data.n_steps, CrossFitSettings())
    scoring = Scoring.of(posed, HeldOutPolicy(posed, policy, JUDGE.held_out), JUDGE)
    assert columns_within(scoring, (np.flatnonzero(FIRST), np.flatnonzero(~FIRST)), SEEN, 0).shape == (N, 0)


# ---- which columns ---------------------------------------------------------------------------------------------------

BETWEEN = np.column_stack([np.linspace(1.5, -1.5, 12), np.repeat([1.0, -1.0], 6)])
WITHIN = np.column_stack(
    [np.tile(np.linspace(1.5, -1.5, 6), 2), np.repeat([1.0, -1.0], 6), np.tile(np.linspace(1, -1, 6), 2)]
)


def by_labels(*signs: tuple[int, int]) -> Answers:
    labels = np.zeros(12, dtype=np.int64)
    for m, sign in signs:
        labels[m] = sign
    return Answers.of_labels(labels)


@pytest.mark.parametrize(
    ("answers", "within"),
    [
        (by_labels((0, 1), (6, 1)), True),
        (by_labels((5, -1), (11, -1)), True),
        (by_labels((0, 1), (6, -1)), False),
        (by_labels((0, 1), (1, 1)), False),
        (by_labels(), False),
        (by_labels((0, 1), (1, 1), (2, 1), (3, 1), (4, 1), (6, -1), (7, -1), (8, -1), (9, -1), (10, 1)), False),
    ],
)
def test_columns_within_are_learned_from_where_labels_of_both_groups_are_alike(answers, within):
    assert learned_from(BETWEEN, WITHIN, answers, SETTINGS) is (WITHIN if within else BETWEEN)
    assert learned_from(BETWEEN, WITHIN[:, :0], answers, SETTINGS) is BETWEEN


def test_the_evidence_is_the_integral_over_the_weights():
    answers = by_labels((0, 1), (2, -1), (7, -1), (9, 1))
    column, settings = (
        BETWEEN[:, :1],
        AnswerSettings(error_rates=(0.05, 0.2), p_agreement=0.7, precision=9.0, offset_precision=4.0),
    )  # narrow, so that Laplace's approximation is near
    grid = np.arange(-6, 6, 0.02)
    offset, weight = np.meshgrid(grid, grid)
    total = 0.0
    for direction, prior in ((1.0, 0.35), (-1.0, 0.15), (0.0, 0.5)):
        anchor = direction * settings.group_weight  # the only column is the last one
        precision = settings.precision if direction else 1e4
        density = np.exp(-0.5 * (settings.offset_precision * offset**2 + precision * (weight - anchor) ** 2))
        density *= prior * np.sqrt(settings.offset_precision * precision) / (2 * np.pi) * 0.02**2
        for error in settings.error_rates:
            chance = np.ones_like(offset)
            for m, sign in ((0, 1), (2, -1), (7, -1), (9, 1)):
                chance *= error + (1 - 2 * error) * expit(sign * (offset + weight * column[m, 0]))
            total += float((density * chance).sum()) / len(settings.error_rates)
    assert posterior(column, answers, settings).log_evidence == pytest.approx(np.log(total), abs=0.05)
