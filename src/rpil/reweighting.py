"""EM around a policy that the user trains: two functions describe it, and it may be anything.

An ordinary training loop gives every step the same weight. Here each epoch is a round of EM: a step has the weight of
its trust, and its trust is how well the policy and the other demonstrations explain it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpil.adversaries import Adversary, Constant, Marginal, MarginalBox, UniformBox
from rpil.audit import Audit, Interval
from rpil.demonstrations import Demonstrations
from rpil.em import Result, State, e_step, lower_bound, m_step
from rpil.errors import DataError
from rpil.inputs import as_prior, coded_actions, known_labels
from rpil.passes import Array
from rpil.problem import Problem
from rpil.reliability import PointMasses, Reliability, TwoBetas
from rpil.verdicts import summarise

_ADVERSARIES: dict[str, dict[str, Callable[[Any], Adversary]]] = {
    "discrete": {
        "marginal": lambda space: Marginal.start(space.n),
        "uniform": lambda space: UniformBox(float(np.log(space.n))),  # K actions are a volume of K
        "constant": lambda space: Constant(),
    },
    "continuous": {
        "marginal": MarginalBox.start,
        "uniform": lambda space: UniformBox(space.log_volume),
    },
}
"""Adversaries that need no probabilities of the actions that were not taken."""

_LEVELS: dict[str, Callable[[], Reliability]] = {"both": TwoBetas.start, "demonstration": PointMasses}

_LEAST = -700.0
"""Least log-probability: its exponential is still a positive number."""

_PATIENCE = 3
"""Rounds without a gain after which training stops."""

_GAIN = 1e-3
"""Nats a step that a round of training must gain on held-out steps to count as a gain."""

_NEGLIGIBLE = 1e-6
"""Where no weight is larger, a policy is not trained."""

_ASSUMED = (
    "Experts agree with one another: in similar states they act alike.",
    "Given the policy, the steps of a demonstration are independent.",
    "There are two groups of demonstrations, experts and adversaries.",
    "The order of demonstrations and any reward were not used.",
    "Whether several groups of demonstrations each agree among themselves was not looked into.",
)
_IN_SAMPLE = "The policy was judged by what it was trained on: it cannot memorise actions."

LogProb = Callable[[Any, Array, Array], Any]
Train = Callable[[Any, Array, Array, Array], Any]


@dataclass(frozen=True, eq=False)
class Reweighted:
    """What `reweight` finds.

    Attributes
    ----------
    policy : object
        The policy, trained on steps by their trust.
    audit : Audit
        Verdicts, log-odds, ``step_weight``: as `RPIL.audit_`.
    n_rounds : int
        How often the policy was trained.
    converged : bool
        Whether trust had settled.
    """

    policy: Any
    audit: Audit
    n_rounds: int
    converged: bool

    @property
    def step_weight(self) -> Array:
        """Weight of each step for training, in [0, 1], (N,)."""
        return self.audit.step_weight


@dataclass(frozen=True, eq=False)
class _Theirs:
    """The user's policy as a `Policy`, whose outputs are the log-probabilities of the actions taken, (N,).

    Each of several members judges its own fold of the demonstrations and is trained on the others; members are copied
    before they are trained. A single member judges all demonstrations and is trained in place.
    """

    members: tuple[Any, ...]
    fold: Array
    data: Demonstrations
    ask: LogProb
    teach: Train

    def outputs(self, features: Array) -> Array:
        """Of all steps: the policy reads the observations of `data`, and not the `features`."""
        out = np.empty(len(self.fold))
        for member, rows in zip(self.members, self._asked, strict=True):
            out[rows] = self._ask(member, rows)
        return out

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        return outputs

    def learn(
        self,
        problem: Problem,
        weight: Array,
        lesson: Array | None = None,
        *,
        tol: float = 0.0,
        max_iter: int = 1,
        max_cg: int = 0,
    ) -> tuple[_Theirs, Array]:
        """One more round of training."""
        alone = len(self.members) == 1
        taught = [
            self.train(member if alone else deepcopy(member), np.sort(rows), weight)
            for member, rows in zip(self.members, self._taught, strict=True)
        ]
        new = replace(self, members=tuple(taught))
        return new, new.outputs(problem.features)

    def tempered(self, temperature: float) -> _Theirs:
        return self

    def penalty(self) -> float:
        return 0.0

    def train(self, member: Any, rows: Array, weight: Array) -> Any:
        """`member` after a round of training on `rows`."""
        if weight[rows].max() < _NEGLIGIBLE:  # the weighted mean of no steps is not a number
            return member
        new = self.teach(member, self.data.observations[rows], self.data.actions[rows], weight[rows].copy())
        if new is None:
            return member
        if not isinstance(new, type(member)):
            types = type(new).__name__, type(member).__name__
            raise DataError("train returned {}; let it return nothing, or the new policy, of type {}.".format(*types))
        return new

    def _ask(self, member: Any, rows: Array) -> Array:
        observations, actions = self.data.observations[rows], self.data.actions[rows]
        said = self.ask(member, observations, actions)
        for method in ("detach", "cpu"):  # a tensor becomes an array without torch being known here
            said = getattr(said, method)() if hasattr(said, method) else said
        try:
            found = np.asarray(said, dtype=float)
        except (TypeError, ValueError):
            raise DataError(f"log_prob returned {type(said).__name__}; let it return {len(rows)} numbers.") from None
        if found.shape != (len(rows),):
            raise DataError(
                f"log_prob returned the shape {found.shape} for {len(rows)} steps; let it return ({len(rows)},), the "
                "log-probability of each action taken."
            )
        wrong = np.isnan(found) | (found == np.inf)
        if wrong.any():
            step = int(rows[np.argmax(wrong)])
            m = self.data.ids[self.data.groups[step]]
            raise DataError(
                f"{self.data.source}, demonstration {m!r}: log_prob returned {found[np.argmax(wrong)]} at step "
                f"{step - self.data.offsets[self.data.groups[step]]}; look at the loss, or lower the learning rate."
            )
        if self.data.is_discrete and found.max() > 1e-4:
            above = f"{found.max():.3g} for a discrete action"
            raise DataError(f"log_prob returned {above}, more than log 1; take logarithms.")
        return np.maximum(found, _LEAST)

    @property
    def _asked(self) -> list[Array]:
        return [np.flatnonzero(self.fold == k) for k in range(len(self.members))]

    @property
    def _taught(self) -> list[Array]:
        n = len(self.members)
        return [np.arange(len(self.fold)) if n == 1 else np.flatnonzero(self.fold != k) for k in range(n)]


def reweight(
    policy: Any,
    demonstrations: Demonstrations,
    *,
    log_prob: LogProb,
    train: Train,
    n_folds: int = 3,
    adversary: str = "marginal",
    prior: float | tuple[float, float] | None = None,
    level: str = "both",
    labels: Mapping[Any, str] | None = None,
    max_rounds: int = 50,
    tol: float = 0.01,
    action_box: tuple[Any, Any] | None = None,
    random_state: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Reweighted:
    """Train a policy of any kind on demonstrations weighted by their trust, and find that trust.

    All steps are trusted at first, until training gains nothing more; then training and judging take turns until trust
    has settled. The policy is used through two functions only.

    Parameters
    ----------
    policy : object
        A torch module, parameters, anything. It is trained, and returned.
    demonstrations : Demonstrations
    log_prob : function of (policy, observations (N, D), actions (N,) or (N, A))
        log pi(a|s) of each action taken, (N,): an array or a tensor; -inf is taken as -700.
    train : function of (policy, observations, actions, weights (N,))
        Trains with steps that count by their weights, from 0 to 1, for an epoch, say. Returns nothing, or the new
        policy, of the same type.
    n_folds : int
        Copies of the policy that judge demonstrations, each trained without those that it judges; the policy itself is
        trained at the end. All that `train` changes must be copied along with a policy, so an optimiser belongs to it.
        With 1 there are no copies: the policy judges what it was trained on, which costs a third of the time and is
        right only if it cannot memorise: a flexible policy explains bad actions as well as good ones.
    adversary : {"marginal", "uniform", "constant"}
        What bad demonstrators do: their own favourite actions whatever the state, anything, or (discrete actions) what
        scores log psi = 0.
    prior, level, labels
        As `RPIL`'s. Known adversaries are not trained on.
    max_rounds : int
        How often a copy is trained at most.
    tol : float
        Trust has settled when no probability changes by more in a round.
    action_box : (low, high), optional
        Bounds of continuous actions; by default what the demonstrations span.
    random_state : int
        For the folds.
    progress : callable, optional
        Called with a few words at every round.

    Returns
    -------
    Reweighted
        The trained policy, the audit with its ``step_weight``, and how many rounds it took.

    Raises
    ------
    DataError
        One sentence: `log_prob` returns something not finite or of the wrong shape, `train` something that is no
        policy or changes nothing, a parameter makes no sense, or the demonstrations are too few.

    Examples
    --------
    >>> found = reweight(net, demonstrations, log_prob=log_prob, train=one_epoch)    # doctest: +SKIP
    >>> found.audit.verdicts                                                         # doctest: +SKIP
    """
    if not isinstance(demonstrations, Demonstrations):
        raise DataError(f"reweight needs Demonstrations, not {type(demonstrations).__name__}; see rpil.read.")
    progress = progress or (lambda _: None)
    source, n_demonstrations = demonstrations.source, len(demonstrations)
    if n_demonstrations < 2:
        raise DataError(f"{source}: one demonstration alone cannot be compared; give at least two.")
    if not 1 <= n_folds <= n_demonstrations:
        raise DataError(f"n_folds={n_folds!r} must be from 1 to the number of demonstrations, {n_demonstrations}.")
    if max_rounds < 1:
        raise DataError(f"max_rounds={max_rounds!r} must be 1 or more.")
    space, _, codes = coded_actions(demonstrations, action_box)
    for name, value, known in (("adversary", adversary, _ADVERSARIES[space.kind]), ("level", level, _LEVELS)):
        if value not in known:
            raise DataError(f"There is no {name} {value!r} here; choose {' or '.join(known)}.")
    given = known_labels(labels, demonstrations)
    problem = Problem(demonstrations.observations, codes, demonstrations.offsets, space, given)
    order = np.random.default_rng(random_state).permutation(n_demonstrations)
    fold = problem.spread(np.argsort(order) % n_folds)
    members = (policy,) if n_folds == 1 else tuple(deepcopy(policy) for _ in range(n_folds))
    theirs = _Theirs(members, fold, demonstrations, log_prob, train)
    theirs, outputs, n_warm = _warm(theirs, problem, max_rounds, progress)
    start = State(theirs, _ADVERSARIES[space.kind][adversary](space), as_prior(prior), _LEVELS[level]())
    result, n_rounds = _rounds(problem, start, outputs, max_rounds, tol, progress)
    n_rounds += n_warm
    share = Interval(*result.state.prior.interval(result.posterior.expert))
    audit = summarise(problem, result, share, demonstrations.ids)
    if n_folds == 1:
        policy = result.state.policy.members[0]  # type: ignore[attr-defined]
    else:
        for n in range(n_rounds):
            progress(f"training the policy: {n + 1} of {n_rounds}")
            policy = theirs.train(policy, np.arange(len(fold)), audit.step_weight)
    said = (*_ASSUMED, _IN_SAMPLE) if n_folds == 1 else _ASSUMED
    return Reweighted(policy, replace(audit, assumptions=said), n_rounds, result.converged)


def _warm(
    theirs: _Theirs, problem: Problem, max_rounds: int, progress: Callable[[str], None]
) -> tuple[_Theirs, Array, int]:
    """Training with uniform trust until it gains nothing more: the best policy, its outputs, and the rounds.

    An untrained policy explains no demonstration, and EM would take them all for adversaries'.
    """
    weight = problem.spread((problem.labels >= 0).astype(float))
    alone = len(theirs.members) == 1
    outputs = theirs.outputs(problem.features)
    best, kept, when = -np.inf, (theirs, outputs), 0
    for n in range(1, max_rounds + 1):
        progress(f"trusting all: {n}")
        before = outputs
        theirs, outputs = theirs.learn(problem, weight)
        if n == 1 and not alone and np.array_equal(before, outputs):
            raise DataError(
                "train changed nothing in copies of the policy; keep the optimiser with the policy, so that both are "
                "copied, or make it within train, or give n_folds=1."
            )
        score = float(weight @ outputs / weight.sum())
        if score > best + _GAIN:
            best, when = score, n
            kept = theirs, outputs
        elif n - when >= _PATIENCE:
            break
    return (theirs, outputs, n) if alone else (*kept, when)


def _rounds(
    problem: Problem, state: State, outputs: Array, max_rounds: int, tol: float, progress: Callable[[str], None]
) -> tuple[Result, int]:
    """EM until responsibilities are steady, or held-out likelihood no longer rises; and the number of rounds.

    With several copies the objective is one of held-out data, so the result is the best round. With one policy, which
    judges what it was trained on, the objective only rises, so the result is the last round.
    """
    alone = len(state.policy.members) == 1  # type: ignore[attr-defined]
    posterior = e_step(problem, state, outputs)
    history = [lower_bound(state, posterior)]
    best, when, steady = Result(state, posterior, np.array(history), False), 0, 0
    for n in range(1, max_rounds + 1):
        progress(f"round {n}: {posterior.expert.sum():.1f} of {problem.n_demonstrations} trusted")
        before = posterior.expert
        state, outputs = m_step(problem, state, posterior, "expert_only")
        posterior = e_step(problem, state, outputs)
        history.append(lower_bound(state, posterior))
        steady = steady + 1 if np.abs(posterior.expert - before).max() <= tol else 0
        if alone or history[-1] > best.objective:
            best, when = Result(state, posterior, np.array(history), False), n
        if steady >= _PATIENCE or n - when >= _PATIENCE:
            return replace(best, converged=True), when
    return best, when
