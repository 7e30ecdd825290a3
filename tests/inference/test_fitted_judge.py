"""Policies of the groups of a sample, and the scores of demonstrations by them."""

from dataclasses import replace

import numpy as np
import pytest

from problems import make, make_continuous
from rpil.inference.channels import own_log_prob
from rpil.inference.fitted_judge import fit_ratio
from rpil.inference.held_out import held_out_model, indicators
from rpil.inference.scores import monotony
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import judge

STEPS = (40, 60)
SETTINGS = JudgeSettings()


@pytest.fixture(scope="module", params=["discrete", "continuous"])
def judged(request):
    """Data, their scores and log-ratios, the policy of the training group and its log pi and log pi - log q."""
    discrete = request.param == "discrete"
    toy = make("random", 0, n_good=10, n_bad=10, steps=STEPS) if discrete else make_continuous("random", 0, steps=STEPS)
    data = toy.problem()
    judgement = judge(data, held_out_model(data, HeldOutSettings()), SETTINGS)
    fit = judgement.scores.fit
    ratio = fit_ratio(data, fit.group, fit.ridge, SETTINGS.held_out)
    return data, judgement, ratio, ratio.step_ratios(data.features, data.actions, SETTINGS.held_out)


def less(data, ratio, typical_own):
    own = own_log_prob(data, indicators(data, ratio.scaling), SETTINGS.held_out.errors)
    return own, monotony(own, typical_own, SETTINGS)


def test_policies_of_a_sample_give_the_signs_of_the_judgement(judged):
    data, judgement, ratio, (log_prob, log_ratio) = judged
    measure, scores = log_ratio if data.space.kind == "discrete" else log_prob, judgement.scores
    score = data.mean_steps(measure) - less(data, ratio, scores.typical_own)[1]
    np.testing.assert_allclose(score, scores.score, atol=0.3 * np.ptp(scores.score))
    np.testing.assert_array_equal(scores.groups.upper(score, scores.variance), judgement.scores.log_odds > 0)
    np.testing.assert_allclose(data.mean_steps(log_ratio), data.mean_steps(judgement.log_ratio), atol=0.5)


def test_a_demonstration_that_holds_still_scores_lower_by_how_predictable_it_is(judged):
    data, judgement, ratio, _ = judged
    typical = judgement.scores.typical_own
    if data.space.kind == "discrete":
        assert not less(data, ratio, typical)[1].any()
        return
    is_third = data.per_step(np.arange(data.n_demonstrations) == 3)[:, None]
    still = replace(data, actions=np.where(is_third, 0.0, data.actions))
    own, lost = less(still, ratio, typical)
    np.testing.assert_allclose(lost, np.maximum(own - typical, 0.0) / 3, atol=1e-9)
    assert lost[3] > 1.0 > np.median(lost)
