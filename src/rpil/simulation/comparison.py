"""Policies that were trained on different choices of demonstrations, compared on the user's own simulator."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from rpil.data.errors import DataError
from rpil.numerics.types import Array, Float
from rpil.simulation.rollouts import mean_interval, wilson

Choice = TypeVar("Choice")
Policy = TypeVar("Policy")

LEVEL = 0.05
"""Probability of calling any choice better or worse where all are alike."""

UNCHANGED = 1e-9
"""A standard error of this share of its difference is rounding: the seeds change nothing."""


@dataclass(frozen=True)
class ComparedChoice:
    """One row of a `Comparison`."""

    name: str
    episodes: int
    """Of all seeds together."""
    mean: float
    """Success rate, or mean return."""
    ci95: tuple[float, float]
    """95 % interval of `mean` over the episodes of these policies: Wilson's of successes, Student's of returns. It
    does not say how much another training would differ."""
    difference: float
    """The mean less that of the first choice, paired by seed; 0 for the first choice itself."""
    standard_error: float
    """Of the difference, over seeds: of training and of episodes together. NaN for the first choice or one seed."""
    verdict: str
    """"better" or "worse" than the first choice; else why no difference can be told; empty for the first choice."""


@dataclass(frozen=True, repr=False)
class Comparison:
    """A table of choices of demonstrations, which prints as one.

    Attributes
    ----------
    measure : {"success rate", "mean return"}
    seeds : tuple of int
    rows : tuple of ComparedChoice
        In the order of the choices; the first is the one that the others are compared with.
    """

    measure: str
    seeds: tuple[int, ...]
    rows: tuple[ComparedChoice, ...]

    def __getitem__(self, name: str) -> ComparedChoice:
        """The row of a choice."""
        return {row.name: row for row in self.rows}[name]

    def __repr__(self) -> str:
        def number(value: float, sign: str = "") -> str:
            return f"{value:{sign}{'.3f' if self.measure == 'success rate' else '#.4g'}}"

        def difference(row: ComparedChoice, sign: str) -> str:
            error = f" +- {number(row.standard_error)}" if row.standard_error >= 0 else ""
            return number(row.difference if sign else abs(row.difference), sign) + error

        first, *others = self.rows
        cells = [["", "episodes", self.measure, "95 % interval", f"minus {first.name}"]]
        for row in self.rows:
            low, high = map(number, row.ci95)
            minus = "" if row is first else difference(row, "+")
            interval = "" if np.isnan(row.ci95[0]) else f"{low} to {high}"
            cells.append([row.name, f"{row.episodes:,}", number(row.mean), interval, minus])
        name_width, *widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [f"{name:{name_width}}  " + "  ".join(map(str.rjust, rest, widths)) for name, *rest in cells]
        for row in others:
            compared = f"{row.name} and {first.name}: {row.verdict}."
            if row.verdict in ("better", "worse"):
                size = difference(row, "")
                compared = f"{row.name} is {row.verdict} than {first.name} by {size} over {len(self.seeds)} seeds."
            lines.append(compared)
        return "\n".join(line.rstrip() for line in lines)


def compare(
    choices: Mapping[str, Choice],
    train: Callable[[Choice, int], Policy],
    evaluate: Callable[[Policy, int], ArrayLike],
    *,
    seeds: int | Iterable[int] = 3,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Train and play a policy for each choice of demonstrations and each seed, and tell which choice is better.

    A policy that is trained again succeeds more or less often by chance alone, so the unit is the seed: the difference
    of a choice to the first is taken within each seed, and its standard error is that of its mean over the seeds. The
    error is never less than what the episodes alone would give, because a few seeds may agree by chance. A choice is
    called better or worse by Student's test at 5 %, shared among the choices.

    Parameters
    ----------
    choices : mapping of str to anything
        What `train` learns from, by name: `Demonstrations`, say, or a pair of these and weights. The others are
        compared with the first.
    train : function of a choice and a seed
        Returns a policy. All that is random in it should follow the seed.
    evaluate : function of a policy and a seed
        Plays the policy, from the same starts for the same seed, which every choice is given. Returns the outcome of
        each episode: successes (bool, or 0 and 1) or returns. Values that are all 0 or 1 are successes.
    seeds : int or iterable of ints
        3 stands for the seeds 0, 1 and 2. With one seed no difference can be told.
    progress : callable, optional
        Called as `progress(n_finished, n)` after each of the `n` policies.

    Returns
    -------
    Comparison

    Raises
    ------
    DataError
        Without choices or seeds; or where `evaluate` returns nothing, values that are not finite, or another number of
        episodes for one policy than for the others.

    Examples
    --------
    >>> import numpy as np, rpil
    >>> def train(skill, seed):  # stands for the training of a policy
    ...     return skill + 0.02 * np.random.default_rng(seed).normal()
    >>> def evaluate(policy, seed):
    ...     return np.random.default_rng(seed).random(200) < policy
    >>> rpil.compare({"all": 0.5, "kept": 0.8}, train, evaluate, seeds=3)
          episodes  success rate   95 % interval        minus all
    all        600         0.480  0.440 to 0.520
    kept       600         0.780  0.745 to 0.811  +0.300 +- 0.019
    kept is better than all by 0.300 +- 0.019 over 3 seeds.
    """
    numbers = tuple(seeds) if isinstance(seeds, Iterable) else tuple(range(seeds))
    if not numbers or len({*numbers}) < len(numbers):
        raise DataError(f"seeds is {seeds!r}: give at least one, each once, and three or more to tell a difference.")
    if not isinstance(choices, Mapping) or not choices:
        raise DataError("There are no choices of demonstrations: give a mapping with at least one, by its name.")
    outcomes: list[Float[Array, " E"]] = []
    for seed in numbers:
        for name, choice in choices.items():
            outcome = _checked(evaluate(train(choice, seed), seed), name, seed)
            if outcomes and len(outcome) != len(outcomes[0]):
                raise DataError(
                    f"evaluate, for {name!r} with seed {seed}, returned {len(outcome)} episodes, and {len(outcomes[0])}"
                    " before: play the same number for every choice and seed."
                )
            outcomes.append(outcome)
            if progress is not None:
                progress(len(outcomes), len(numbers) * len(choices))
    by_choice = np.array(outcomes).reshape(len(numbers), len(choices), -1).swapaxes(0, 1)
    return _compared(dict(zip(map(str, choices), by_choice, strict=True)), numbers)


def _checked(outcome: ArrayLike, name: str, seed: int) -> Float[Array, " E"]:
    """The outcomes of the episodes of one policy, as numbers."""
    try:
        values = np.asarray(outcome, dtype=float)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        returned = " ".join(reprlib.repr(outcome).split())
        raise DataError(
            f"evaluate, for {name!r} with seed {seed}, returned {returned}: return the success or return "
            "of every episode, a finite number for each, and one episode at least."
        )
    return values


def _compared(outcomes: Mapping[str, Float[Array, "S E"]], seeds: tuple[int, ...]) -> Comparison:
    are_successes = all(np.isin(values, (0.0, 1.0)).all() for values in outcomes.values())
    base, *others = outcomes
    paired = {name: _paired(outcomes[name], outcomes[base], are_successes) for name in others}
    level = LEVEL / max(len(others), 1)  # Bonferroni
    rows = []
    for name, values in outcomes.items():
        difference, error = paired.get(name, (0.0, float("nan")))
        interval = wilson(int(values.sum()), values.size) if are_successes else mean_interval(values.ravel())
        verdict = "" if name == base else _verdict(difference, error, len(seeds), level)
        rows.append(ComparedChoice(name, values.size, float(values.mean()), interval, difference, error, verdict))
    return Comparison("success rate" if are_successes else "mean return", seeds, tuple(rows))


def _paired(outcomes: Float[Array, "S E"], of_base: Float[Array, "S E"], are_successes: bool) -> tuple[float, float]:
    """The mean difference of episodes that share their seed, and its standard error over seeds.

    The means of seeds differ by training and by episodes, so their variance is at least that of the episodes. Where
    episodes differ, but each seed repeats them, the error is 0: the seeds change nothing.
    """
    differences = outcomes - of_base
    by_seed = differences.mean(axis=1)
    n_seeds, n_episodes = differences.shape
    if n_seeds == 1:
        return float(by_seed.mean()), float("nan")
    both = np.stack([outcomes, of_base])
    if (both == both[:, :1]).all() and (both != both[:, :, :1]).any():
        return float(by_seed[0]), 0.0
    deviations = differences - by_seed[:, None]
    of_episodes = float((deviations**2).sum() / max(n_seeds * (n_episodes - 1), 1))
    if are_successes:
        # Half an episode more in each of the four cells of successes (Agresti and Min 2005): never sure of a few.
        total, squares, n = float(differences.sum()), float((differences**2).sum()), differences.size
        of_episodes = max(of_episodes, (squares + 1) / (n + 2) - (total / (n + 2)) ** 2)
    error = np.sqrt(max(float(by_seed.var(ddof=1)), of_episodes / n_episodes) / n_seeds)
    difference = float(by_seed.mean())
    return difference, 0.0 if error < UNCHANGED * abs(difference) else float(error)


def _verdict(difference: float, error: float, n_seeds: int, level: float) -> str:
    """What a difference says, to stand between or after the names of the choices."""
    if n_seeds == 1:
        return "no difference can be told with 1 seed, because another training may turn it around"
    if error == 0 and difference != 0:
        return "the difference is the same with every seed, so train and evaluate do not seem to use their seed"
    if abs(difference) > stdtrit(n_seeds - 1, 1 - level / 2) * error:
        return "better" if difference > 0 else "worse"
    return f"no difference can be told with {n_seeds} seeds; play more of them"
