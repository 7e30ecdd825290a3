"""Starts, and the best objective among the runs from them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from problems import Toy, make, ridge
from rpil.data.fit_data import FitData
from rpil.estimators.pipeline import Settings, judged_starts
from rpil.mixture.search import SearchSettings, fit_mixture, starts
from rpil.mixture.settings import MixtureSettings
from rpil.policies.softmax import SoftmaxPolicy

STEPS = (40, 60)


def setting_for(problem: FitData) -> SearchSettings:
    policy = SoftmaxPolicy.zero(problem.space.n, ridge(problem) / 100)
    return SearchSettings(policy, MixtureSettings(m_step="joint"), partial(judged_starts, problem, Settings()))


def fitted(problem: FitData, which="uniform"):
    return fit_mixture(problem, setting_for(problem), which)


def right(toy: Toy, log_odds: np.ndarray) -> bool:
    return bool(((log_odds > 0) == toy.is_good).all())


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


@pytest.mark.slow
@pytest.mark.parametrize(("bad", "which"), [(4, "marginal"), (10, "uniform")])
def test_random_actions_are_found_also_where_they_are_many(which, bad):
    toy = make("random", 0, n_good=12 - bad, n_bad=bad, steps=STEPS)
    assert right(toy, fitted(toy.problem(), which).posterior.log_odds)


@pytest.mark.slow
@pytest.mark.parametrize("known", [{0: 1}, {11: -1}])
def test_labels_overrule_a_coherent_majority(known):
    """The likelihood prefers the larger group; a label knows the right one."""
    toy = make("shifted", 1, n_good=2, n_bad=10, steps=STEPS).labelled(known)
    assert right(toy, fitted(toy.problem(), "confusion").posterior.log_odds)
