"""The fitted judge."""

from __future__ import annotations

import numpy as np
import pytest

from problems import fit_data_of, make, make_continuous
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import judge

STEPS = (40, 60)


@pytest.mark.slow
def test_fitted_judge_gives_the_signs_of_the_judgement():
    for toy in (make("random", 0, n_good=10, n_bad=10, steps=STEPS), make_continuous("random", 0, steps=STEPS)):
        problem = fit_data_of(toy)
        judgement = judge(problem, held_out_model(problem, 0, HeldOutSettings()), JudgeSettings())
        kept = FittedJudge.of(judgement, problem, JudgeSettings())
        measure, _ = kept.step_ratios(problem.features, problem.actions, JudgeSettings())
        score = problem.sum_steps(measure) / problem.lengths
        np.testing.assert_allclose(score, judgement.scores.score, atol=0.3 * np.ptp(judgement.scores.score))
        again = kept.log_odds(measure, problem.offsets, JudgeSettings())
        np.testing.assert_array_equal(again > 0, judgement.log_odds > 0)
