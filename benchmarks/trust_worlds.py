"""Generated worlds for the benchmark of trust: demonstrations with a known truth.

    from trust_worlds import cells
    world = cells()["simulated MountainCar-v0 noisy 75 % 1000"].make()

Four families. `simulated`: an environment's expert and one kind of bad demonstration. `styles`: all are good, but
two operators act differently in a part of the states. `nothing`: whatever was good or bad can no longer be learned.
`well_specified`: the model's own assumptions hold, and the likelihood ratio of every demonstration is known. All are
functions of their arguments and a seed; demonstrations come in random order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from grid import ENVIRONMENTS, N_GOOD, SHARES, n_bad, unknowable
from rpil.data.demonstrations import Demonstrations
from rpil.simulation.corruptions import KINDS
from rpil.simulation.simulate import simulate
from trust_operators import N_ACTIONS, N_CONTROLS, N_STATES, Operators, drawn, wandering

CONTINUOUS = ("Pendulum-v1", "MountainCarContinuous-v0", "LunarLanderContinuous-v3")
CONTINUOUS_KINDS = ("corrupted", "random", "noisy", "window", "sensor")
SIMULATED_SEEDS = (1000, 1001)

DIFFERENCES, STYLE_SHARES, STYLE_STEPS, STYLE_SIZES = (5, 10, 30), (50, 70, 90), (40, 200, 1000), (6, 20, 60)
STYLE_SEEDS, NOTHING_SEEDS, WELL_SPECIFIED_SEEDS = range(2), range(3), range(5)
STYLE_CENTER = {"difference": 10, "share": 70, "steps": 200, "size": 20}

STRENGTH = 4.0
"""Norm of the experts' weights in well-specified worlds: how much they look at the state."""

NOTHING = ("100 columns", "random observations", "shuffled actions")
SIZES = ((20, 10), (40, 10), (20, 30), (60, 20))
ADVERSARIES = ("uniform", "marginal")
FAMILIES = ("simulated", "styles", "nothing", "well-specified")

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class World:
    """M demonstrations of N steps, and the truth about them, which no method may read.

    Attributes
    ----------
    name, family : str
    observations : (N, D) array
    actions : (N,) array of int or (N, A) array of float
    episode_ids : (N,) array of int
        0 to M - 1, ascending.
    is_good : (M,) array of int
        1 good, 0 bad, -1 in between.
    quality : (M,) array or None
        Higher is better.
    extra : dict
        What else is known: `unknowable` (bool, `simulated`); `style`, the operator of each demonstration,
        `log_ratio`, the expected log likelihood ratio in nats of the operator's own policy against the other's, and
        `style_log_ratio`, the ratio of the first operator's to the second's for the actions taken, all (M,) (`styles`);
        `oracle_log_ratio` (M,), log pi - log psi summed over steps (`well_specified`); the arguments.
    """

    name: str
    family: str
    observations: Array
    actions: Array
    episode_ids: Array
    is_good: Array
    quality: Array | None = None
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def demonstrations(self) -> Demonstrations:
        """What a method may see."""
        return Demonstrations.from_groups(self.observations, self.actions, self.episode_ids, source=self.name)


@dataclass(frozen=True)
class Cell:
    """A world that has not been made yet."""

    name: str
    family: str
    function: Callable[..., World]
    arguments: tuple[Any, ...]

    def make(self) -> World:
        return self.function(*self.arguments)


# ---- simulated environments ------------------------------------------------------------------------------------------


def simulated(env: str, kind: str, share: int, seed: int) -> World:
    """Ten good demonstrations, and as many bad ones of one kind as make up a share in percent."""
    made = simulate(env, kind, n_good=N_GOOD, n_bad=n_bad(share), seed=seed)
    order = np.argsort(-made.is_good, kind="stable")[np.random.default_rng(seed).permutation(len(made.episodes))]
    observations, actions = (np.concatenate([made.episodes[m][part] for m in order]) for part in (0, 1))
    lengths = [len(made.episodes[m][1]) for m in order]
    extra = {"env": env, "kind": kind, "share": share, "seed": seed, "unknowable": unknowable(kind, share)}
    return World(
        simulated_name(env, kind, share, seed),
        "simulated",
        observations,
        actions,
        np.repeat(np.arange(len(order)), lengths),
        made.is_good[order],
        extra=extra,
    )


def simulated_name(env: str, kind: str, share: int, seed: int) -> str:
    return f"simulated {env} {kind} {share} % {seed}"


# ---- two styles, both good -------------------------------------------------------------------------------------------


def styles(difference: int, share: int, steps: int, size: int, continuous: bool, seed: int) -> World:
    """Two operators who are both good and act differently in `difference` percent of the states.

    The first gave `share` percent of the `size` demonstrations. States are a stationary AR(1) series.
    """
    rng = np.random.default_rng([seed, difference, share, steps, size, continuous])
    operators = Operators.drawn(difference, continuous, rng)
    style = rng.permutation(np.arange(size) >= round(size * share / 100)).astype(int)
    states = wandering(size, steps, rng).reshape(-1, N_STATES)
    outputs, by, each = operators.outputs(states), np.repeat(style, steps), np.arange(size * steps)
    own, other = outputs[by, each], outputs[1 - by, each]
    actions = operators.act(own, rng)
    realised = operators.log_prob(outputs[0], actions) - operators.log_prob(outputs[1], actions)
    truth = {
        "style": style,
        "log_ratio": operators.divergence(own, other).reshape(size, steps).sum(axis=1),
        "style_log_ratio": realised.reshape(size, steps).sum(axis=1),
    }
    named = {"difference": difference, "share": share, "steps": steps, "size": size, "continuous": continuous}
    return World(
        style_name(difference, share, steps, size, continuous, seed),
        "styles",
        states,
        actions,
        np.repeat(np.arange(size), steps),
        np.ones(size, dtype=int),
        extra=named | truth | {"seed": seed},
    )


def style_name(difference: int, share: int, steps: int, size: int, continuous: bool, seed: int) -> str:
    return f"styles {difference} % {share}:{100 - share} {steps} steps {size} {actions_are(continuous)} {seed}"


def actions_are(continuous: bool) -> str:
    return "continuous" if continuous else "discrete"


# ---- nothing to learn ------------------------------------------------------------------------------------------------


def nothing(kind: str, continuous: bool, seed: int) -> World:
    """Twenty demonstrations, half of them random, that leave nothing to be learned.

    "100 columns": 20 steps each, and an expert who depends a little on every one of 100 columns. "random observations"
    and "shuffled actions": 100 steps of 8 columns, then the observations are drawn anew, or the actions exchanged among
    all steps. The random demonstrations have the same distribution of actions as the expert.
    """
    rng = np.random.default_rng([seed, NOTHING.index(kind), continuous])
    size, (steps, width) = 20, (20, 100) if kind == "100 columns" else (100, N_STATES)
    is_good = rng.permutation(np.arange(size) % 2)
    states = rng.normal(size=(size * steps, width))
    weights = rng.normal(size=(width, N_CONTROLS if continuous else N_ACTIONS)) / np.sqrt(width)

    def acted(states: Array) -> Array:
        if continuous:
            return states @ weights + rng.normal(size=(len(states), N_CONTROLS))
        return drawn(log_softmax(2 * states @ weights, axis=-1), rng)

    actions, unrelated = acted(states), acted(rng.normal(size=states.shape))
    by_expert = np.repeat(is_good, steps) == 1
    actions = np.where(by_expert[:, None] if continuous else by_expert, actions, unrelated)
    if kind == "random observations":
        states = rng.normal(size=states.shape)
    elif kind == "shuffled actions":
        actions = actions[rng.permutation(len(actions))]
    name, extra = nothing_name(kind, continuous, seed), {"kind": kind, "continuous": continuous, "seed": seed}
    return World(name, "nothing", states, actions, np.repeat(np.arange(size), steps), is_good, extra=extra)


def nothing_name(kind: str, continuous: bool, seed: int) -> str:
    return f"nothing {kind} {actions_are(continuous)} {seed}"


# ---- worlds in which the model holds ---------------------------------------------------------------------------------


def well_specified(size: int, steps: int, adversary: str, seed: int) -> World:
    """Half experts with a softmax policy over standard normal states, half adversaries who do not look at the state.

    A "uniform" adversary takes every action equally often, a "marginal" one as often as the expert does over all
    states. Which demonstrations are whose, and the states, depend on neither.
    """
    rng = np.random.default_rng([seed, size, steps])
    weights, bias = expert_policy(rng)
    is_good = rng.permutation(np.arange(size) % 2)
    states = rng.normal(size=(size * steps, 4))
    log_pi = log_softmax(states @ weights + bias, axis=1)
    log_psi = np.full(N_ACTIONS, -np.log(N_ACTIONS))
    if adversary == "marginal":
        many = np.random.default_rng(0).normal(size=(100_000, 4))
        log_psi = np.log(np.exp(log_softmax(many @ weights + bias, axis=1)).mean(axis=0))
    by_expert = np.repeat(is_good, steps) == 1
    actions = drawn(np.where(by_expert[:, None], log_pi, log_psi), rng)
    ratio = np.take_along_axis(log_pi - log_psi, actions[:, None], axis=1).reshape(size, steps).sum(axis=1)
    extra = {"steps": steps, "adversary": adversary, "seed": seed, "oracle_log_ratio": ratio}
    name = well_specified_name(size, steps, adversary, seed)
    return World(
        name, "well-specified", states, actions, np.repeat(np.arange(size), steps), is_good, ratio, extra=extra
    )


def expert_policy(rng: np.random.Generator) -> tuple[Array, Array]:
    """Weights (4, K) of norm `STRENGTH` and biases (K,) of a softmax policy."""
    weights = rng.normal(size=(4, N_ACTIONS))
    weights -= weights.mean(axis=1, keepdims=True)
    return weights * STRENGTH / np.linalg.norm(weights), 0.5 * rng.normal(size=N_ACTIONS)


def well_specified_name(size: int, steps: int, adversary: str, seed: int) -> str:
    return f"well-specified {size} x {steps} {adversary} {seed}"


# ---- which worlds are judged -----------------------------------------------------------------------------------------


def cells(families: Iterable[str] = FAMILIES) -> dict[str, Cell]:
    """The worlds of some families by their names, in the order in which they are best judged."""
    found: list[Cell] = []
    for family in families:
        found += LISTS[family]()
    return {cell.name: cell for cell in found}


def simulated_cells() -> list[Cell]:
    """Both grids, draw by draw."""
    grids = ((ENVIRONMENTS, KINDS), (CONTINUOUS, CONTINUOUS_KINDS))
    every = [
        (env, kind, share, seed)
        for seed in SIMULATED_SEEDS
        for environments, kinds in grids
        for env, kind, share in product(environments, kinds, SHARES)
    ]
    return [Cell(simulated_name(*of), "simulated", simulated, of) for of in every]


def style_cells() -> list[Cell]:
    """All differences, shares and numbers of steps for twenty demonstrations with discrete actions; one factor at a
    time about the centre for the number of demonstrations, and for continuous actions."""
    center = tuple(STYLE_CENTER.values())
    settings = [(*of, center[3], False) for of in product(DIFFERENCES, STYLE_SHARES, STYLE_STEPS)]
    settings += [(*center[:3], size, False) for size in STYLE_SIZES]
    for place, values in enumerate((DIFFERENCES, STYLE_SHARES, STYLE_STEPS, STYLE_SIZES)):
        settings += [(*center[:place], value, *center[place + 1 :], True) for value in values]
    every = [(*of, seed) for seed in STYLE_SEEDS for of in dict.fromkeys(settings)]
    return [Cell(style_name(*of), "styles", styles, of) for of in every]


def nothing_cells() -> list[Cell]:
    """Every kind, discrete and continuous."""
    every = [(kind, continuous, seed) for seed, kind, continuous in product(NOTHING_SEEDS, NOTHING, (False, True))]
    return [Cell(nothing_name(*of), "nothing", nothing, of) for of in every]


def well_specified_cells() -> list[Cell]:
    """Every size with both adversaries."""
    every = [(*of, adversary, seed) for seed, of, adversary in product(WELL_SPECIFIED_SEEDS, SIZES, ADVERSARIES)]
    return [Cell(well_specified_name(*of), "well-specified", well_specified, of) for of in every]


LISTS: dict[str, Callable[[], list[Cell]]] = {
    "simulated": simulated_cells,
    "styles": style_cells,
    "nothing": nothing_cells,
    "well-specified": well_specified_cells,
}
