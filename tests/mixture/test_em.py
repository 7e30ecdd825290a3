"""EM against enumeration in plain probabilities, and its promise: the objective never falls."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.special import log_softmax

from problems import Toy, continuous_zoo, make, make_continuous, pooled_state, ridge, zoo
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.mixture.adversaries.discrete import Complement
from rpil.mixture.adversaries.named import ADVERSARIES, adversary
from rpil.mixture.em import State, e_step, lower_bound, m_step, run_em
from rpil.mixture.expert_prior import ExpertPrior
from rpil.mixture.settings import MixtureSettings
from rpil.policies.softmax import SoftmaxPolicy

ZOO = zoo(0)


def tiny(seed: int = 0, labels: tuple[int, ...] = (0, 0, 0, 0), n_actions: int = 3) -> Toy:
    toy = make("random", seed, n_actions=n_actions, n_good=2, n_bad=2, steps=(1, 4))
    return toy.labelled(dict(enumerate(labels)))


def tiny_state(problem: FitData, which: str, seed: int = 0) -> State:
    """Parameters at no special place."""
    rng = np.random.default_rng(seed)
    policy = SoftmaxPolicy(rng.normal(size=(problem.features.shape[1], problem.space.n)), ridge(problem))
    return State(policy, adversary(which, problem.space, policy), ExpertPrior(0.3))


@pytest.mark.parametrize("which", ["uniform", "complement", "confusion"])
def test_e_step_is_enumeration(which):
    labels = (1, -1, 0, 0)
    problem = tiny(labels=labels).problem()
    state = tiny_state(problem, which)
    log_proba, actions = state.policy.outputs(problem.features), problem.actions
    pi = np.exp(log_proba[np.arange(len(actions)), actions])  # of the actions taken, in plain probabilities, as psi
    psi = np.exp(state.adversary.log_prob(problem.features, log_proba, actions))
    posterior = e_step(problem, state, log_proba)
    for m in range(problem.n_demonstrations):
        steps = slice(problem.offsets[m], problem.offsets[m + 1])
        expert, bad = 0.3 * np.prod(pi[steps]), 0.7 * np.prod(psi[steps])
        assert posterior.log_odds[m] == pytest.approx(np.log(expert / bad), abs=1e-9)
        expert, bad = expert * (labels[m] >= 0), bad * (labels[m] <= 0)
        assert posterior.log_evidence[m] == pytest.approx(np.log(expert + bad), abs=1e-9)
        assert posterior.expert[m] == pytest.approx(expert / (expert + bad), abs=1e-12)
    np.testing.assert_allclose(posterior.log_ratio, np.log(pi / psi), atol=1e-9)


def test_lower_bound_is_likelihood_and_priors():
    problem = tiny().problem()
    state = tiny_state(problem, "confusion")
    posterior = e_step(problem, state, state.policy.outputs(problem.features))
    prior = np.log(0.3) + np.log(0.7)  # Beta(2, 2)
    own = state.adversary.log_prior() - 0.5 * (state.policy.ridge[:, None] * state.policy.weights**2).sum()
    expected = posterior.log_evidence.sum() + prior + own
    assert lower_bound(state, posterior) == pytest.approx(expected)


@pytest.mark.parametrize("which", ADVERSARIES["discrete"])
def test_log_odds_of_long_demonstrations_are_finite(which):
    """An expert's and a random one's, under a sharp policy."""
    n = 2000
    log_proba = log_softmax(np.tile([8.0, 0.0, -8.0], (2 * n, 1)), axis=1)
    actions = np.concatenate([np.zeros(n, dtype=int), np.random.default_rng(0).integers(3, size=n)])
    offsets = np.array([0, n, 2 * n])
    problem = FitData(np.ones((2 * n, 1)), actions, offsets, Discrete(3), np.zeros(2, dtype=int))
    state = tiny_state(problem, which)
    posterior = e_step(problem, state, log_proba)
    for values in (posterior.log_odds, posterior.log_evidence, posterior.expert):
        assert np.isfinite(values).all()
    if which == "uniform":
        assert posterior.log_odds[0] > 2000
        assert posterior.log_odds[1] < -2000
        problem = make_continuous("random", 0, n_good=2, n_bad=2, steps=(3000, 3000)).problem()
        state = pooled_state(problem, "uniform")
        posterior = e_step(problem, state, state.policy.outputs(problem.features))
        assert np.isfinite([posterior.log_odds, posterior.expert]).all()


@pytest.mark.parametrize(("kind", "which"), [(kind, name) for kind, names in ADVERSARIES.items() for name in names])
def test_objective_never_falls(kind, which):
    """Over the whole zoo; hmmlearn's own test lets it fall so long as it rises once."""
    problems = {name: toy.problem() for name, toy in (ZOO if kind == "discrete" else continuous_zoo(0)).items()}
    toy = make("noisy", 0) if kind == "discrete" else make_continuous("window", 0)
    problems |= {"landmarks": toy.problem("nystroem")}
    for name, problem in problems.items():
        history = run_em(problem, pooled_state(problem, which), MixtureSettings(max_iter=8, tol=0.0)).history
        assert np.isfinite(history).all(), name
        assert np.diff(history).min() >= -(1e-10 if kind == "discrete" else 1e-9) * np.abs(history).max(), name


@pytest.mark.parametrize("which", ["marginal", "normalised complement", "confusion"])
def test_run_ends_at_a_stationary_point(which):
    """By Fisher's identity the likelihood itself is flat in the policy where EM has converged."""
    problem = ZOO["random"].problem()
    result = run_em(problem, pooled_state(problem, which), MixtureSettings(max_iter=2000, tol=1e-10, cg_iter=100))
    assert result.converged
    state, rng = result.state, np.random.default_rng(0)

    def objective(weights):
        moved = State(SoftmaxPolicy(weights, state.policy.ridge), state.adversary, state.prior)
        return lower_bound(moved, e_step(problem, moved, moved.policy.outputs(problem.features)))

    for _ in range(5):
        direction = rng.normal(size=state.policy.weights.shape)
        up, down = (objective(state.policy.weights + h * direction) for h in (1e-4, -1e-4))
        assert abs(up - down) / 2e-4 < 0.02  # nats for a unit step, of hundreds


def test_em_ends_where_it_gains_little_or_changes_no_responsibility():
    problem = ZOO["one step each"].problem()
    start = pooled_state(problem, "marginal")
    runs = [run_em(problem, start, MixtureSettings(max_iter=k, tol=0.0, steady=0.0)) for k in range(16)]
    gains = np.abs(np.diff(runs[-1].history)) / problem.n_demonstrations
    changes = np.array([np.abs(b.posterior.expert - a.posterior.expert).max() for a, b in pairwise(runs)])
    for tol, steady in ((gains[8], 0.0), (gains[8] / 5, 1.001 * changes[8]), (gains[8] / 5, 0.999 * changes[8])):
        ends = (gains <= tol) | ((gains <= 10 * tol) & (changes <= steady))
        found = run_em(problem, start, MixtureSettings(max_iter=15, tol=float(tol), steady=float(steady)))
        assert (len(found.history), found.converged) == (2 + int(np.argmax(ends)), True)


def test_start_at_zero_is_a_stationary_point_of_two_actions():
    """model.md: with two actions and the complement, pi = psi = 1/2 is a fixed point; the pooled start is none."""
    toy = make("flipped", 0, n_actions=2, n_bad=3)
    problem = toy.problem()
    zero = SoftmaxPolicy.zero(2, ridge(problem))
    trapped = State(zero, Complement(), ExpertPrior())
    result = run_em(problem, trapped, MixtureSettings(max_iter=20, tol=0.0))
    np.testing.assert_allclose(result.state.policy.weights, 0.0, atol=1e-9)
    np.testing.assert_allclose(result.posterior.expert, 0.5)
    free = run_em(problem, pooled_state(problem, "complement"), MixtureSettings(max_iter=50, tol=1e-4))
    assert free.history[-1] > result.history[-1] + 50
    assert ((free.posterior.log_odds > 0) == toy.is_good).all()


def test_m_step_uses_soft_targets_or_the_experts_term_alone():
    """The joint M-step maximises its surrogate; "expert_only" ignores what the adversary intended."""
    problem = tiny().problem()
    state = tiny_state(problem, "complement")
    posterior = e_step(problem, state, state.policy.outputs(problem.features))
    r, taken = problem.per_step(posterior.expert), np.eye(3)[problem.actions]
    q = state.adversary.intended_action_proba(posterior.outputs, problem.actions)
    for mode, targets in (("joint", r[:, None] * taken + (1 - r)[:, None] * q), ("expert_only", r[:, None] * taken)):
        new, log_proba = m_step(problem, state, posterior, MixtureSettings(m_step=mode, newton_iter=100, cg_iter=100))
        best, _ = SoftmaxPolicy.zero(3, ridge(problem)).fit(problem, np.zeros(len(taken)), targets, tol=1e-10)
        np.testing.assert_allclose(log_proba, best.outputs(problem.features), atol=1e-3)
        np.testing.assert_allclose(log_proba, new.policy.outputs(problem.features), atol=1e-9)
        assert new.prior.p == pytest.approx((posterior.expert.sum() + 1) / (4 + 2))
