"""The judge (`rpil.inference.trust`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import fit_data_of, make
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import GroupSettings, HeldOutSettings, JudgeSettings, TrimmingSettings
from rpil.inference.trust import judge

STEPS = (40, 60)


@pytest.mark.parametrize("n_bad", [4, 6, 18])
def test_group_with_its_own_policy_in_the_same_states_is_a_rival(n_bad):
    toy = make("shifted", 1, n_bad=n_bad, steps=STEPS)
    judgement = judge(fit_data_of(toy), held_out_model(fit_data_of(toy), 0, HeldOutSettings()), JudgeSettings())
    assert judgement.finding == "two groups"
    assert judgement.rival is not None
    groups = {frozenset(judgement.rival.trusted.tolist()), frozenset(judgement.rival.rival.tolist())}
    assert groups == {frozenset(range(6)), frozenset(range(6, 6 + n_bad))}


@pytest.mark.parametrize(("kind", "seed", "n_good", "n_bad"), [("noisy", 2, 8, 40), ("window", 1, 8, 56)])
def test_rare_experts_need_a_halved_training_group(kind, seed, n_good, n_bad):
    toy = make(kind, seed, n_good=n_good, n_bad=n_bad, steps=STEPS)
    data = toy.problem("folded")
    judgement = judge(data, held_out_model(data, 0, HeldOutSettings()), JudgeSettings())
    certain = GroupSettings().verdict_log_odds
    assert judgement.finding == "some are unlike"
    assert (judgement.log_odds[toy.is_good] > certain).all()
    assert (judgement.log_odds[~toy.is_good] < -certain).mean() > 0.95
    settings = JudgeSettings(trimming=TrimmingSettings(halvings=0))
    assert judge(data, held_out_model(data, 0, HeldOutSettings()), settings).finding == "nobody stands out"


@pytest.mark.parametrize("seed", range(3))
def test_nothing_could_be_learned_from_random_observations(seed):
    toy = make("noisy", seed, n_good=10, n_bad=10, steps=STEPS)
    data = toy.problem()
    noise = np.random.default_rng(seed).normal(size=data.features.shape)
    noise[:, -1] = 1.0
    data = replace(data, features=noise)
    judgement = judge(data, held_out_model(data, 0, HeldOutSettings()), JudgeSettings())
    assert judgement.finding == "nothing could be learned"
    assert (np.abs(judgement.log_odds) <= GroupSettings().verdict_log_odds).all()
