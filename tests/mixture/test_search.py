"""Starts, and the best objective among the runs from them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from problems import make, ridge
from rpil.data.fit_data import FitData
from rpil.estimators.pipeline import Settings, judged_starts
from rpil.mixture import search
from rpil.mixture.search import SearchSettings, fit_mixture, starts
from rpil.mixture.settings import MixtureSettings
from rpil.policies.softmax import SoftmaxPolicy

STEPS = (40, 60)


def setting_for(problem: FitData) -> SearchSettings:
    policy = SoftmaxPolicy.zero(problem.space.n, ridge(problem) / 100)
    return SearchSettings(policy, MixtureSettings(m_step="joint"), partial(judged_starts, problem, Settings()))


def test_starts_without_labels():
    problem = make("random", 0, steps=(5, 100)).problem()
    found = starts(problem, setting_for(problem))
    np.testing.assert_array_equal(found["pooled"], 1.0)
    share = found["equal"] * problem.lengths
    np.testing.assert_allclose(share, share[0])
    assert (found["equal"] * problem.lengths).sum() == pytest.approx(len(problem.actions))
    assert {"pooled", "equal", "agreeing"} <= set(found)
    singles = [weight for name, weight in found.items() if name.startswith("single")]
    assert len({int(weight.argmax()) for weight in singles}) == len(singles) == 8
    assert all(sorted(weight) == [0.0] * 11 + [1.0] for weight in singles)


def test_starts_with_labels_begin_from_the_known_experts_and_trust_no_known_adversary():
    problem = make("shifted", 0).labelled({2: 1, 8: -1}).problem()
    found = starts(problem, setting_for(problem))
    np.testing.assert_array_equal(np.flatnonzero(found["labelled experts"]), [2])
    assert {"unlike labelled adversaries", "most unlike"} <= set(found)
    assert all(weight[8] == 0.0 for weight in found.values())
    assert "agreeing" not in found


def test_experts_agree_where_these_are_few():
    problem = make("random", 0, n_good=10, n_bad=30, steps=STEPS).problem()
    found = starts(problem, setting_for(problem))
    assert set(np.flatnonzero(found["agreeing"])) == set(range(10))
    assert max(int(weight.argmax()) for name, weight in found.items() if name.startswith("single")) < 10


def test_a_start_of_fewer_than_half_is_fitted_once_more_to_those_that_it_explains(monkeypatch):
    problem, fit, asked = make("random", 0).problem(), search._fit_start, []
    monkeypatch.setattr(search, "_fit_start", lambda *given: asked.append(given[2]) or fit(*given))
    for n, n_more in ((6, 0), (5, 1)):
        weight = (np.arange(12) < n).astype(float)
        search._first_iterations(problem, setting_for(problem), "marginal", weight)
        assert len(asked) == 1 + n_more
        asked, more = [], asked[-1]
    assert ((more >= weight).all(), (more > weight).any()) == (True, True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed", "n_bad", "known", "which"),
    [
        ("random", 0, 4, {}, "marginal"),
        ("random", 0, 10, {}, "uniform"),
        ("shifted", 1, 10, {0: 1}, "confusion"),  # the likelihood prefers the larger group, and a label knows better
        ("shifted", 1, 10, {11: -1}, "confusion"),
    ],
)
def test_bad_ones_are_found_where_they_are_many_and_labels_overrule_a_majority(kind, seed, n_bad, known, which):
    toy = make(kind, seed, n_good=12 - n_bad, n_bad=n_bad, steps=STEPS).labelled(known)
    problem = toy.problem()
    found = fit_mixture(problem, setting_for(problem), which).posterior.log_odds
    np.testing.assert_array_equal(found > 0, toy.is_good)
