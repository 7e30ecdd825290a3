"""From a problem to the EM run to believe: several starts, then several adversaries.

Which local optimum EM reaches is decided by its start, so there are several and the best objective wins. Which
adversary is right is decided by the likelihood of demonstrations that were held out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rpil.adversaries import Adversary, adversary, marginal, usual
from rpil.agreement import agreement
from rpil.em import MStep, Result, State, e_step, lower_bound, m_step, run
from rpil.parallel import in_parallel
from rpil.passes import Array
from rpil.policies import Policy
from rpil.priors import Prior
from rpil.problem import Problem
from rpil.reliability import Reliability

_STICKY = 0.5
"""Stickiness of the steps when solutions are compared in its light: the more, the less a demonstration tells of rho."""

_CLEARLY = 5.0
"""Nats a solution must be better by in that light."""

_PARTLY, _FEW = 0.15, 0.03
"""A demonstration is partly bad with a reliability so far from 0 and 1, and so few of them do not count."""

_LIKE_EXPERTS = "like known experts"
_ASKED = 30
_JUDGED_STEPS = 10_000
"""Demonstrations that may become a start, and steps of others by which they are compared."""

_SHORT = 6
"""EM iterations after which starts are compared."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What does not change during a fit.

    Attributes
    ----------
    policy : Policy
        The policy before it has seen data.
    prior : Prior
    reliability : Reliability
    mode : {"joint", "expert_only"}
    n_single : int
        Starts from single demonstrations.
    annealing : int
        Temperatures between 1 / mean length and 1 that every start passes through.
    max_iter : int
    tol : float
        Nats a demonstration.
    stickiness : float
        With which the search begins, see `rpil.chains`.
    """

    policy: Policy
    prior: Prior
    reliability: Reliability
    mode: MStep = "joint"
    n_single: int = 3
    annealing: int = 0
    max_iter: int = 200
    tol: float = 1e-3
    stickiness: float = 0.0


Progress = Callable[[str], None]


def fit(
    problem: Problem,
    setting: Setting,
    candidates: Sequence[str | Adversary],
    rng: np.random.Generator,
    progress: Progress = lambda _: None,
    hints: Sequence[Array] = (),
) -> tuple[Result, list[Result]]:
    """The winning run among `candidates` for the adversary, and every start's run, for those who compare groups.

    `hints` are P(expert), (M,) each, found by other means: more solutions to compare, where the adversary has a policy
    of its own.
    """
    first = candidates[0] if len(candidates) == 1 else usual(problem.space, bool(problem.labels.any()))
    runs = _in_runs(problem, setting, first, search(problem, setting, first, rng, progress), rng, progress)
    best = runs[0]
    if len(candidates) == 1:
        if not best.state.adversary.symmetric:
            return _continue(problem, setting, best), runs
        hinted = [_from(problem, setting, best.state.adversary, hint) for hint in hints]
        return _who_agrees(problem, setting, [*runs, *hinted], rng), runs
    seeds = dict(zip(candidates, rng.spawn(len(candidates)), strict=True))

    def try_one(candidate: str | Adversary) -> Result:
        progress(f"adversary: {candidate}")
        new = adversary(candidate, problem.space, setting.policy)
        start = _with_adversary(problem, best, new)
        limit = 3 * _SHORT if new.symmetric else setting.max_iter
        found = _run(problem, setting, start, best.posterior.outputs, limit)
        if not new.symmetric:
            return found
        own = search(problem, setting, candidate, seeds[candidate])
        hinted = [_from(problem, setting, new, hint) for hint in hints]
        return _who_agrees(problem, setting, [found, *own, *hinted], seeds[candidate])

    results = in_parallel(try_one, candidates, problem.features)
    progress("comparing adversaries")
    folds = _folds(problem, 3, rng)
    scores = in_parallel(lambda result: held_out(problem, setting, result, folds), results, problem.features)
    against = [_contradicted(problem, setting, result) for result in results]
    return results[max(range(len(results)), key=lambda k: (-against[k], scores[k]))], runs


def _who_agrees(problem: Problem, setting: Setting, runs: Sequence[Result], rng: np.random.Generator) -> Result:
    """The solution whose experts agree best, among `runs` and those where the groups changed places.

    For an adversary with a policy of its own expert and adversary are alike, and any group that is easy to describe
    apart from the others makes a likely solution. Experts are those who agree with one another, on much.
    """
    likeliest: dict[tuple[bool, ...], Result] = {}  # of those who trust the same, in the order they came
    for of in runs:
        group = tuple(of.posterior.expert > 0.5)
        if group not in likeliest or of.objective > likeliest[group].objective:
            likeliest[group] = of
    tried = list(likeliest.values())
    tried += [_from(problem, setting, of.state.adversary, 1.0 - of.posterior.expert) for of in tried]

    def rank(result: Result) -> tuple[int, float]:
        experts = np.flatnonzero(result.posterior.expert > 0.5)
        against = _contradicted(problem, setting, result)
        return -against, agreement(problem, setting.policy, experts, np.random.default_rng(seed))

    seed = int(rng.integers(2**32))  # the same folds for the same group
    return _continue(problem, setting, max(tried, key=rank))


def _from(problem: Problem, setting: Setting, like: Adversary, expert: Array) -> Result:
    """A few iterations of EM from P(expert), (M,), with an adversary such as `like`, who has a policy of its own."""
    policy, outputs = _taught(problem, setting, expert)
    other, _ = _taught(problem, setting, 1.0 - expert)
    anew = State(policy, like.with_policy(other), setting.prior, setting.reliability)
    return _run(problem, setting, anew, outputs, 3 * _SHORT)


def _in_runs(
    problem: Problem,
    setting: Setting,
    which: str | Adversary,
    runs: list[Result],
    rng: np.random.Generator,
    progress: Progress,
) -> list[Result]:
    """`runs`, headed by the solution to which bad steps that come in runs point, should it be another, better one.

    An independent mixture pays for not knowing which steps are bad, so that a policy wins that is bad in the same
    situations. Chains do not pay (`rpil.chains`). But they explain a careless expert as well as an adversary, so they
    only point to an optimum of the independent mixture, and decide between two. Where every demonstration is all good
    or all bad, there is nothing to ask.
    """

    def in_that_light(result: Result) -> float:
        state = replace(result.state, stickiness=_STICKY)
        return lower_bound(state, e_step(problem, state, result.posterior.outputs))

    best = runs[0]
    reliability = best.posterior.joint.sum(axis=1) @ best.state.reliability.nodes
    partly = (reliability > _PARTLY) & (reliability < 1 - _PARTLY)
    if partly.mean() < _FEW or in_that_light(best) < best.objective + _CLEARLY:
        return runs
    progress("bad steps in runs")
    found = search(problem, replace(setting, stickiness=_STICKY), which, rng.spawn(1)[0])[0]
    anew = State(found.state.policy, found.state.adversary, setting.prior, setting.reliability)
    other = _run(problem, setting, anew, found.posterior.outputs, 3 * _SHORT)
    better = in_that_light(other) > in_that_light(best) + _CLEARLY
    if better and _contradicted(problem, setting, other) <= _contradicted(problem, setting, best):
        return [other, *runs]
    return runs


def starts(problem: Problem, setting: Setting, rng: np.random.Generator) -> dict[str, Array]:
    """Weights of the demonstrations (M,) from which the policy of each start is fitted."""
    labels = problem.labels
    possible = (labels >= 0).astype(float)
    found = {"pooled": possible, "equal": possible * problem.lengths.mean() / problem.lengths}
    if (labels < 0).any():
        found |= _unlike(problem, setting, labels < 0)
    if (labels > 0).any():
        found = {"known experts": (labels > 0).astype(float), **found}
        return found if not (labels < 0).any() else {_LIKE_EXPERTS: _like_experts(problem, setting), **found}
    for m in _promising(problem, setting, rng):
        found[f"single {m}"] = (np.arange(problem.n_demonstrations) == m).astype(float)
    return found


def _like_experts(problem: Problem, setting: Setting) -> Array:
    """Weights 1 for whom the known experts' policy explains better than the known adversaries' does."""
    expert, adversary = (_explained(problem, setting, problem.labels == sign) for sign in (1, -1))
    return (problem.sum_steps(expert - adversary) > 0).astype(float)


def _promising(problem: Problem, setting: Setting, rng: np.random.Generator) -> list[int]:
    """Demonstrations whose policy alone, beside frequent actions, explains most of the others: `n_single` of them.

    Where one in ten is an expert, thirty are asked: 96 % of the time one of them is.
    """
    asked = rng.permutation(np.flatnonzero(problem.labels == 0))[:_ASKED] if setting.n_single else np.empty(0, int)
    if len(asked) <= setting.n_single:
        return asked.tolist()
    order = rng.permutation(problem.n_demonstrations)
    enough = int(np.searchsorted(np.cumsum(problem.lengths[order]), _JUDGED_STEPS)) + 1
    jury = problem.select(np.sort(order[:enough]), unlabelled=True)
    frequent = marginal(jury, setting.policy)

    def explained(m: int) -> float:
        own = problem.select(np.array([m]))
        policy, _ = _taught(own, setting, np.ones(1))
        outputs = policy.outputs(jury.features)
        state = State(policy, frequent, setting.prior, setting.reliability, setting.stickiness)
        return float(e_step(jury, state, outputs).log_evidence.sum())

    return sorted(asked.tolist(), key=explained, reverse=True)[: setting.n_single]


def search(
    problem: Problem,
    setting: Setting,
    which: str | Adversary,
    rng: np.random.Generator,
    progress: Progress = lambda _: None,
    carried: int = 2,
) -> list[Result]:
    """Runs from every start, the best first; after a few iterations only the `carried` most promising go on.

    What contradicts a label is no candidate while something else is, whatever its objective: the likelihood prefers the
    larger of two groups, a label knows the right one.
    """

    def begin(named: tuple[str, Array]) -> Result:
        start, weight = named
        progress(f"start: {start}")
        policy, outputs = _taught(problem, setting, weight)
        first = adversary(which, problem.space, setting.policy)
        state = State(policy, first, setting.prior, setting.reliability, setting.stickiness)
        few = start != _LIKE_EXPERTS and (weight > 0).mean() < 0.5
        if few:  # they grow into the group that agrees with them
            agreeing = np.maximum(weight, e_step(problem, state, outputs).expert)
            policy, outputs = _taught(problem, setting, agreeing)
            state = replace(state, policy=policy)
        for beta in _temperatures(problem, setting.annealing):
            cooled = run(problem, state, outputs=outputs, mode=setting.mode, beta=beta, max_iter=3, tol=0.0)
            state, outputs = cooled.state, cooled.posterior.outputs
        return _run(problem, setting, state, outputs, _SHORT)

    def rank(result: Result) -> tuple[int, float]:
        return _contradicted(problem, setting, result), -result.objective

    begun = sorted(in_parallel(begin, starts(problem, setting, rng).items(), problem.features), key=rank)
    longer = partial(_continue, problem, setting, max_iter=3 * _SHORT)
    ended = in_parallel(longer, begun[:carried], problem.features)
    return sorted(ended, key=rank) + begun[carried:]


def _contradicted(problem: Problem, setting: Setting, result: Result) -> int:
    """Labels that a run disagrees with once labelled experts have no say in the policy they are judged by."""
    if not problem.labels.any():
        return 0
    others = np.where(problem.labels > 0, 0.0, result.posterior.expert)
    policy, outputs = _taught(problem, setting, others)
    log_odds = e_step(problem, replace(result.state, policy=policy), outputs).log_odds
    return int((problem.labels * np.sign(log_odds) < 0).sum())


def _taught(problem: Problem, setting: Setting, weight: Array) -> tuple[Policy, Array]:
    """The policy of demonstrations weighted by `weight` (M,), roughly, and its outputs (N, ...)."""
    return setting.policy.learn(problem, problem.spread(weight), tol=1e-3, max_iter=20, max_cg=20)


def _explained(problem: Problem, setting: Setting, teachers: Array) -> Array:
    """Log-probability of every step, (N,), under the policy of some demonstrations, (M,) bool."""
    policy, outputs = _taught(problem, setting, teachers.astype(float))
    return policy.log_prob(outputs, problem.actions)


def _unlike(problem: Problem, setting: Setting, adversaries: Array) -> dict[str, Array]:
    """Weights 1 for those of the other demonstrations which known adversaries (M,) explain worst: half of them, and,
    should the experts be few, a single one."""
    explained = problem.sum_steps(_explained(problem, setting, adversaries)) / problem.lengths
    explained[adversaries] = np.inf
    half = explained <= np.median(explained[~adversaries])
    return {"unlike known adversaries": half.astype(float), "most unlike": (explained == explained.min()).astype(float)}


def _run(problem: Problem, setting: Setting, state: State, outputs: Array, max_iter: int) -> Result:
    return run(problem, state, outputs=outputs, mode=setting.mode, max_iter=max_iter, tol=setting.tol)


def _continue(problem: Problem, setting: Setting, result: Result, max_iter: int | None = None) -> Result:
    if result.converged:
        return result
    limit = setting.max_iter if max_iter is None else max_iter
    more = _run(problem, setting, result.state, result.posterior.outputs, limit)
    return replace(more, history=np.concatenate([result.history, more.history[1:]]))


def _temperatures(problem: Problem, n: int) -> Array:
    """Powers of the likelihood, from about one step's worth up to (not including) 1."""
    return np.geomspace(1 / problem.lengths.mean(), 1.0, n, endpoint=False) if n else np.empty(0)


def _with_adversary(problem: Problem, result: Result, new: Adversary) -> State:
    """The state of `result` with another adversary, fitted to the steps that `result` takes for an adversary's."""
    posterior = result.posterior
    new = new.fit(problem, posterior.outputs, 1 - posterior.step)
    return replace(result.state, adversary=new)


def _folds(problem: Problem, n_folds: int, rng: np.random.Generator) -> list[Array]:
    """Demonstrations to hold out together, balanced in number."""
    order = rng.permutation(problem.n_demonstrations)
    return [np.sort(order[k::n_folds]) for k in range(min(n_folds, problem.n_demonstrations))]


def held_out(problem: Problem, setting: Setting, result: Result, folds: Sequence[Array]) -> float:
    """Mixture log-likelihood of demonstrations that were not fitted, summed over folds, in nats.

    Each fold starts from the fit to everything, so that all folds stay in its local optimum; a converged M-step then
    forgets what the policy knew of the held-out demonstrations.
    """
    total = 0.0
    for fold in folds:
        test = problem.select(fold, unlabelled=True)
        state = without(problem, setting, result, fold)
        total += float(e_step(test, state, state.policy.outputs(test.features)).log_evidence.sum())
    return total


def without(problem: Problem, setting: Setting, result: Result, fold: Array) -> State:
    """The state of `result` once it has forgotten the demonstrations of `fold`."""
    return taught_by(problem.select(np.setdiff1d(np.arange(problem.n_demonstrations), fold)), setting, result)


def taught_by(train: Problem, setting: Setting, result: Result) -> State:
    """The state of `result` once it knows what `train` holds, and no more."""
    state = result.state
    posterior = e_step(train, state, state.policy.outputs(train.features))
    state, outputs = m_step(train, state, posterior, setting.mode, max_iter=4, max_cg=20)
    state, _ = m_step(train, state, e_step(train, state, outputs), setting.mode)
    return state
