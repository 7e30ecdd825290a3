"""A fit to more data than a search should read: a sample decides what they are like, passes over all of them the rest.

Which starts, which adversary, which groups compete: a hundred demonstrations tell as well as a million. What everybody
does tell is the policy, the shares, and who is who; that is what `rpil.polish` learns from all of them, and nothing but
parameters and sums leaves the place where the data lie.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Any, Protocol

import numpy as np

from rpil.audit import step_weight, typical_reliability
from rpil.belief import evidence, power, resemblance, sum_out
from rpil.demonstrations import Demonstrations, Piece
from rpil.demonstrators import Company
from rpil.em import MStep, Posterior, Result, State, e_step
from rpil.engines import Engine, InMemory
from rpil.features import N_LANDMARKS, FeatureMap
from rpil.identify import competing_groups
from rpil.inputs import known_actions, ridge_of
from rpil.passes import Array
from rpil.policies import linear_policy
from rpil.polish import Polished, clone, lesson_of, polish, primed, resumed
from rpil.problem import Problem
from rpil.selection import Choice
from rpil.spaces import Space

SAMPLE_STEPS = 20_000
SAMPLE_DEMONSTRATIONS = 100
STEPS_PER_COEFFICIENT = 50
"""Of the sample that is searched, at least."""

_MOST_TIMES, _FEWEST = 10, 20
"""So many demonstrations are in it only if they have no more than so many times these steps, but for the fewest."""

TIMES = 10
"""How many samples there must be before a sample is all that is searched: then a policy has seen so much that a single
demonstration matters little."""


REFIT_TOL = 1e-6
"""Gradient, a step, at which the final policy is done: its actions have long stopped changing."""


class Source(Protocol):
    """Demonstrations in memory, or on disk."""

    @property
    def ids(self) -> tuple[Any, ...]: ...

    @property
    def offsets(self) -> Array: ...

    @property
    def source(self) -> str: ...

    def parts(self, n_parts: int = 1) -> list[Any]:
        """All demonstrations in order: parts, each to be iterated over for its pieces."""

    def select(self, indices: Any) -> Demonstrations:
        """Some of them, in memory."""


def sample_steps(n_coefficients: int) -> int:
    """Steps of the sample that is searched for a policy of so many coefficients."""
    return max(SAMPLE_STEPS, STEPS_PER_COEFFICIENT * n_coefficients)


def sample(lengths: Array, labels: Array, n_steps: int, rng: np.random.Generator) -> Array:
    """Demonstrations to search, in order: of known experts, known adversaries, and all others, at random until there
    are enough of each."""

    def enough(order: Array) -> Array:
        least, most = np.searchsorted(np.cumsum(lengths[order]), [n_steps, _MOST_TIMES * n_steps]) + 1
        return order[: max(least, min(SAMPLE_DEMONSTRATIONS, max(most, _FEWEST)))]

    order = rng.permutation(len(lengths))
    return np.sort(np.concatenate([enough(order[labels[order] == label]) for label in (1, -1, 0)]))


@dataclass(frozen=True, eq=False)
class Stretch:
    """Values of demonstrations from number `first` on, to be found by their numbers among all."""

    values: Array
    first: int

    def __getitem__(self, those: slice) -> Array:
        return self.values[those.start - self.first : those.stop - self.first]


@dataclass(frozen=True, eq=False)
class Prepare:
    """A piece of demonstrations as the data of a fit, in single precision.

    Attributes
    ----------
    features : FeatureMap
    space : Space
    classes : (K,) array
    labels : (M,) array
        Of all demonstrations.
    """

    features: FeatureMap
    space: Space
    classes: Array
    labels: Any

    def only(self, those: slice) -> Prepare:
        """The same for `those` demonstrations."""
        return replace(self, labels=Stretch(self.labels[those], those.start))

    def __call__(self, piece: Piece) -> tuple[Piece, Problem]:
        codes = known_actions(self.classes, piece.actions, "the demonstrations")
        design = self.features.design(piece.observations, single=True)
        return piece, Problem(design, codes, piece.offsets, self.space, self.labels[piece.demonstrations])


@dataclass(frozen=True, eq=False)
class Judged:
    """What a pass at the final parameters says of some demonstrations; arrays as in `rpil.em.Posterior`."""

    evidence: Array
    joint: Array
    log_odds: Array
    log_evidence: Array
    together: float
    variance: float


def judge(problem: Problem, state: State, mode: MStep) -> Judged:
    """What `state` says of demonstrations; their evidence is that of policies which did not learn from them."""
    policy: Any = state.policy
    found = e_step(problem, state, policy.outputs(problem.features))
    outputs = policy.unseen(problem, found.outputs, found.step, lesson_of(problem, state, found, mode))
    log_ratio = policy.log_prob(outputs, problem.actions)
    log_ratio = log_ratio - state.adversary.log_prob(problem.features, outputs, problem.actions)
    by_node = evidence(problem, state, outputs)
    return Judged(by_node, found.joint, found.log_odds, found.log_evidence, *resemblance(problem, log_ratio))


def together(judged: Iterable[Judged], polished: Polished) -> tuple[Result, Array, float]:
    """The result for everybody, without their steps; their evidence (M, J), and the power of a likelihood."""
    parts = list(judged)
    joint, by_node = (np.concatenate([getattr(p, name) for p in parts]) for name in ("joint", "evidence"))
    log_odds, log_evidence = (np.concatenate([getattr(p, n) for p in parts]) for n in ("log_odds", "log_evidence"))
    none = np.empty(0)
    posterior = Posterior(log_odds, joint, none, log_evidence, none, none)
    tempering = power(sum(p.together for p in parts), sum(p.variance for p in parts))
    return Result(polished.state, posterior, polished.history, polished.converged), by_node, tempering


@dataclass(frozen=True, eq=False)
class Weigh:
    """What the final policy learns from a piece, the weights of its steps, and their log-ratios.

    Attributes
    ----------
    state : State
    trust, reliability : (M,) arrays
        Of all demonstrations.
    typical : float
        Reliability of an expert.
    final : Prepare or None
        With the features of the final policy, where they are others than the search's.
    """

    state: State
    trust: Any
    reliability: Any
    typical: float
    final: Prepare | None

    def only(self, those: slice) -> Weigh:
        """The same for `those` demonstrations."""
        trust, reliability = (Stretch(values[those], those.start) for values in (self.trust, self.reliability))
        final = self.final.only(those) if self.final else None
        return replace(self, trust=trust, reliability=reliability, final=final)

    def __call__(self, ready: tuple[Piece, Problem]) -> tuple[Problem, Array, Array]:
        problem = ready[1]
        posterior = e_step(problem, self.state, self.state.policy.outputs(problem.features))
        return self.lesson(ready, posterior.step, posterior.log_ratio)

    def lesson(self, ready: tuple[Piece, Problem], step: Array, log_ratio: Array) -> tuple[Problem, Array, Array]:
        """What it is, given what an E-step says of the steps."""
        piece, problem = ready
        weight = self.weight(problem, step, piece.demonstrations)
        return (self.final(piece)[1] if self.final else problem), weight, log_ratio

    def weight(self, problem: Problem, step: Array, those: Any) -> Array:
        """Weights of the steps of `those` demonstrations."""
        return step_weight(problem.lengths, self.trust[those], self.reliability[those], step, self.typical)


def everyone(data: Source, prepare: Prepare, company: Company) -> Problem:
    """All demonstrations as such, without their steps: lengths, labels, who gave which."""
    none = np.empty(0)
    return Problem(none, none, data.offsets, prepare.space, prepare.labels, company=company)


def in_groups(competing: Sequence[Array], chosen: Array, expert: Array) -> list[Array]:
    """Groups that compete in the sample (its demonstrations `chosen`), for everybody: who is like the group that leads,
    and all others, of whom nobody can say in which of the groups they are."""
    if not competing:
        return []
    leads = expert > 0.5
    leads[chosen[competing[0]]] = True
    for rival in competing[1:]:
        leads[chosen[rival]] = False
    return [np.flatnonzero(leads), np.flatnonzero(~leads)]


def gathered(pieces: Iterator[tuple[Array, Array]], n_steps: int, on_disk: bool) -> tuple[Array, Array, float]:
    """Log-ratios and weights of all steps, (N,) each, in a temporary file where memory should not hold them; and the
    sum of the weights."""
    total = 0.0
    if not on_disk:
        log_ratio, weight = np.empty((2, n_steps))
        end = 0
        for one, other in pieces:
            begin, end = end, end + len(one)
            log_ratio[begin:end], weight[begin:end] = one, other
            total += float(other.sum())
        return log_ratio, weight, total
    with tempfile.TemporaryFile() as first, tempfile.TemporaryFile() as second:
        for one, other in pieces:
            total += float(other.sum())
            first.write(one.astype(np.float32).tobytes())
            second.write(other.astype(np.float32).tobytes())
        first.flush()
        second.flush()
        one, other = (np.memmap(file, np.float32, "r", shape=(n_steps,)) for file in (first, second))
    return one, other, total


def is_large(model: Any, data: Source) -> bool:
    """Whether a sample of `data` is enough to search; not for the paper's own M-step, with which nothing ascends."""
    if model.m_step != "joint":
        return False
    n_steps, budget = int(data.offsets[-1]), _budget(model, data)
    least = max(budget, min(SAMPLE_DEMONSTRATIONS * n_steps / (len(data.offsets) - 1), _MOST_TIMES * budget))
    return n_steps > max(TIMES * budget, 2 * least)


def _budget(model: Any, data: Source) -> int:
    enough = int(np.searchsorted(data.offsets, N_LANDMARKS))  # to see how many columns the features have
    columns = model._search_map(data.select(slice(0, enough))).n_columns
    return sample_steps(columns * model.space_.n_parts)


def fit_large(model: Any, data: Source, labels: Array, company: Company, engine: Engine) -> None:
    """`RPIL.fit`, of which `model` has the settings and gets the attributes.

    Parameters
    ----------
    model : RPIL
    data : Source
    labels : (M,) array
        Of all demonstrations.
    company : Company
        Who gave which of them.
    engine : Engine
        Who runs the passes.
    """
    progress, rng = model.progress or (lambda _: None), np.random.default_rng(model.random_state)
    lengths, n_steps, space = np.diff(data.offsets), int(data.offsets[-1]), model.space_
    progress("a sample")
    chosen = sample(lengths, labels, _budget(model, data), rng)
    few = data.select(chosen)
    checkpoint = _checkpoint(model, data, few, labels)
    begun = checkpoint.read() if checkpoint else None
    codes = known_actions(model.classes_, few.actions, data.source)
    features = model._search_map(few)
    some, setting = model._pose(features, few, codes, labels[chosen], lengths)
    if begun is None:
        result, runs = model._search(few, some, setting, lengths, rng)
        progress("competing groups")
        begun = result.state, competing_groups(some, setting, result, runs, rng), None
    state, competing, before = begun

    prepare = Prepare(features, space, model.classes_, labels)
    ready = engine.place(data.parts(engine.n_parts)).then(prepare)
    problems = ready.then(itemgetter(1))
    ridge = ridge_of(prepare.features, model.C, n_steps, space)

    def prime(at: State) -> State:
        posterior = e_step(some, at, at.policy.outputs(some.features))
        return primed(at, some, posterior, setting.mode, ridge, n_steps / len(some.actions))

    start = prime(state)
    polished = polish(
        problems.summed(),
        replace(before, state=resumed(before.state, prime(before.anchor or state))) if before else Polished(start),
        prime,
        setting.mode,
        len(lengths),
        model.tol,
        model.max_iter,
        progress,
        partial(checkpoint.keep, state, competing) if checkpoint else lambda _: None,
    )

    progress("verdicts")
    everybody = everyone(data, prepare, company)
    found, by_node, tempering = together(
        problems.map(partial(judge, state=polished.state, mode=setting.mode)), polished
    )
    belief, log_odds = sum_out(everybody, polished.state, by_node, tempering)
    groups = in_groups(competing, chosen, found.posterior.expert)
    model._keep(everybody, found, belief, log_odds, data, groups)
    model.search_features_ = prepare.features
    if competing:
        longest = [group[np.argmax(some.lengths[group])] for group in competing]
        model.audit_ = replace(model.audit_, to_label=tuple(few.ids[m] for m in longest))

    progress("the policy")
    # Where nobody is trusted, what little is the expert's is learned from, wherever it is.
    trust, reliability = model.audit_.expert_proba, model.audit_.reliability
    typical = typical_reliability(reliability, trust)
    if trust @ lengths < 1.0:
        trust, typical = np.ones(len(trust)), np.inf
    weigh = Weigh(polished.state, trust, reliability, typical, None)
    outputs = polished.state.policy.outputs(some.features)
    weight = weigh.weight(some, e_step(some, polished.state, outputs).step, chosen)
    choice = model._choice(few, some.actions, weight)
    read = prepare.features
    asked = choice == Choice(read.kind)  # for what the search read
    if not asked:
        trusted = weight > 0.5 * weight.max()
        read = FeatureMap.fit(choice.kind, few.observations[trusted], weight[trusted], choice.ridge)
        weigh = replace(weigh, final=replace(prepare, features=read))
        some = replace(some, features=read.design(few.observations, single=True))
    policy: Any = linear_policy(space, ridge_of(read, model.C, weight.sum(), space), weight.sum())
    policy = policy.at(polished.state.policy) if asked else policy.learn(some, weight)[0]
    lessons = ready.then(weigh)
    on_disk = not isinstance(engine, InMemory)
    log_ratio, step_weight, total = gathered(lessons.map(_of_steps), n_steps, on_disk)
    model.audit_ = replace(model.audit_, step_log_ratio=log_ratio, step_weight=step_weight)
    final_ridge, more = ridge_of(read, model.C, total, space), total / weight.sum()

    def prime_policy(at: Any) -> Any:
        return at.primed(some, weight, final_ridge, more, remembers=True)

    final = clone(lessons.summed(), policy, prime_policy, REFIT_TOL, model.max_iter, progress)
    model.features_, model.policy_ = read, final.state.tempered(choice.temperature)
    model._tell(everybody, data.source)
    if checkpoint:
        checkpoint.done()


def _checkpoint(model: Any, data: Source, few: Demonstrations, labels: Array) -> Any:
    if model.checkpoint is None:
        return None
    from rpil.checkpoints import Checkpoint  # it knows all that can be saved, which is more than a fit needs

    return Checkpoint.of(model.checkpoint, model, data.offsets, few, labels)


def _of_steps(lesson: tuple[Problem, Array, Array]) -> tuple[Array, Array]:
    return lesson[2], lesson[1]
