"""The fitted judge."""

from dataclasses import replace

import numpy as np
import pytest

from problems import make, make_continuous
from rpil.inference.channels import own_log_prob
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import judge

STEPS = (40, 60)
SETTINGS = JudgeSettings()


@pytest.fixture(scope="module", params=["discrete", "continuous"])
def judged(request):
    """Data, their judgement, the fitted judge and its log pi and log pi - log q."""
    discrete = request.param == "discrete"
    toy = make("random", 0, n_good=10, n_bad=10, steps=STEPS) if discrete else make_continuous("random", 0, steps=STEPS)
    data = toy.problem()
    judgement = judge(data, held_out_model(data, HeldOutSettings()), SETTINGS)
    kept = FittedJudge.of(judgement, data, SETTINGS)
    return data, judgement, kept, kept.ratio.step_ratios(data.features, data.actions, SETTINGS.held_out)


def test_fitted_judge_gives_the_signs_of_the_judgement(judged):
    data, judgement, kept, (log_prob, log_ratio, measure) = judged
    assert measure is (log_ratio if data.space.kind == "discrete" else log_prob)
    own = own_log_prob(data, kept.ratio.indicators(data.actions), SETTINGS.held_out.errors)
    score, _ = kept.score(data, measure, own, SETTINGS)
    np.testing.assert_allclose(score, judgement.scores.score, atol=0.3 * np.ptp(judgement.scores.score))
    np.testing.assert_array_equal(kept.groups.upper(score, judgement.scores.variance), judgement.log_odds > 0)
    np.testing.assert_allclose(data.mean_steps(log_ratio), data.mean_steps(judgement.log_ratio), atol=0.5)


def test_a_demonstration_that_holds_still_scores_lower_by_how_predictable_it_is(judged):
    data, _, kept, (log_prob, *_) = judged
    if data.space.kind == "discrete":
        assert kept.typical_own is None
        return
    still = replace(
        data, actions=np.where(data.per_step(np.arange(data.n_demonstrations) == 3)[:, None], 0.0, data.actions)
    )
    own = own_log_prob(still, kept.ratio.indicators(still.actions), SETTINGS.held_out.errors)
    lost = data.mean_steps(log_prob) - kept.score(still, log_prob, own, SETTINGS)[0]
    np.testing.assert_allclose(lost, np.maximum(own - kept.typical_own, 0.0) / 3, atol=1e-9)
    assert lost[3] > 1.0 > np.median(lost)
