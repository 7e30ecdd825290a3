"""Settings of the judge: one record for each stage. docs/model.md has the formulas in which they stand.

`benchmarks/ablations.py` compared the values that name it; docs/results.md has the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import Literal, get_args

from rpil.data.archive import stored
from rpil.mixture.settings import DemonstratorSettings

Minority = Literal["ask", "trust", "distrust"]
"""What to do about a rival group where no label decides: report that the answer cannot be known and ask for a label;
trust the rival group as well; or trust the larger group."""

MINORITY: tuple[str, ...] = get_args(Minority)


@stored()
@dataclass(frozen=True)
class HeldOutSettings:
    """Held-out log-probabilities (`rpil.inference.held_out`).

    Attributes
    ----------
    max_folds_discrete, max_folds_continuous : int
        Folds of demonstrations at most. Fifty folds cost least squares no more than five, but softmax policies ten
        times as much. benchmarks/ablations.py ("five folds", "ten folds").
    lapse : float
        Share eps of the steps in which an expert takes any action, drawn from q: bounds the log-ratio of a step.
        docs/tried.md: .05 and .15 were no better.
    ridges : tuple of float
        Ridges a step to choose from, the strongest first. benchmarks/ablations.py ("one ridge, 1e-4").
    tol : float
        Gradient, a step, at which the fit of a softmax policy stops; the final policy is fitted further.
    max_iter, max_cg : int
        Newton steps of such a fit at most, and iterations of conjugate gradients in each. Chosen by hand, not tuned.
    """

    max_folds_discrete: int = 5
    max_folds_continuous: int = 50
    lapse: float = 0.01
    ridges: tuple[float, ...] = (1e-1, 1e-2, 1e-3, 1e-4)
    tol: float = 1e-3
    max_iter: int = 15
    max_cg: int = 30


@stored()
@dataclass(frozen=True)
class TrimmingSettings:
    """The training group (`rpil.inference.trimming`).

    Attributes
    ----------
    share : float
        Share of the demonstrations in the first training group. benchmarks/ablations.py (1, .8, .3).
    halvings : int
        Times that the share may be halved: experts may be as few as one demonstration in ten.
        benchmarks/ablations.py ("the share is not halved").
    min_group : int
        Demonstrations of a training group with a halved share, at least: a fold of it is left out of each fit. Chosen
        by hand, not tuned.
    max_iter : int
        Concentration steps at most. Chosen by hand, not tuned.
    """

    share: float = 0.6
    halvings: int = 3
    min_group: int = 5
    max_iter: int = 4


@stored()
@dataclass(frozen=True)
class EffectiveStepsSettings:
    """Autocovariances of a series (`rpil.inference.effective_steps`). All were chosen by hand, not tuned.

    Attributes
    ----------
    max_lags : int
        Lags, in steps, beyond which no autocovariance is estimated.
    min_pairs : int
        Products from which an autocovariance is estimated, at least.
    quiet_lags : int
        Consecutive lags without correlation at which the estimation stops: a series may be uncorrelated at every other
        lag.
    standard_errors : float
        Standard errors (Bartlett 1946) within which a correlation is taken for zero.
    """

    max_lags: int = 1_000
    min_pairs: int = 30
    quiet_lags: int = 4
    standard_errors: float = 1.5


@stored()
@dataclass(frozen=True)
class GroupSettings:
    """One group of scores or two (`rpil.inference.groups`).

    Attributes
    ----------
    min_p_two : float
        P(two groups) from which they are told apart; below it no demonstration gets a verdict. Chosen by hand.
    noise_shares : tuple of float
        Shares c of the variance of a score to choose from, by the likelihood. benchmarks/ablations.py ("error bars as
        they are").
    min_noise : float
        Lower bound of c, relative to the variance that independent steps would give. Chosen by hand, not tuned.
    start_quantiles : tuple of float
        Quantiles of the scores at which EM for two groups divides them at first. Chosen by hand, not tuned.
    prior_spread : float
        Prior value of the variance of a group, worth one demonstration, relative to the variance of all scores.
        benchmarks/ablations.py ("no prior on the spread of a group").
    min_spread : float
        Lower bound of the variance of a group, relative to the variance of all scores. Chosen by hand, not tuned.
    min_distance : float
        Distance of the two means, in root mean square standard deviations: two groups with one centre are one group
        with heavy tails. benchmarks/ablations.py ("two groups may have one centre").
    tail : float
        Share of the experts whose scores are as widely spread as those of the wider group. benchmarks/ablations.py
        ("no odd experts").
    min_steps : int
        Steps of the median demonstration from which a mean over steps is about normal. Chosen by hand, not tuned.
    min_demonstrations : int
        Demonstrations from which two groups are fitted. Chosen by hand, not tuned.
    rank_correlation : float
        Assumed correlation of rank and quality where the scores are one group. benchmarks/ablations.py ("ranks are
        worth nothing").
    max_scores : int
        Scores to which the groups are fitted; of more, this many quantiles.
    max_iter : int
        EM iterations at most.
    tol : float
        Gain of the penalised log-likelihood, in nats, at which EM stops.
    """

    min_p_two: float = 0.9
    noise_shares: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01)
    min_noise: float = 0.3
    start_quantiles: tuple[float, ...] = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
    prior_spread: float = 1 / 16
    min_spread: float = 1e-3
    min_distance: float = 1.0
    tail: float = 0.05
    min_steps: int = 8
    min_demonstrations: int = 4
    rank_correlation: float = 0.6
    max_scores: int = 2_000
    max_iter: int = 300
    tol: float = 1e-4

    @property
    def verdict_log_odds(self) -> float:
        """logit of `min_p_two`: the bound of the log-odds of demonstrations that were not told apart, in nats."""
        return log(self.min_p_two / (1 - self.min_p_two))


@stored()
@dataclass(frozen=True)
class RivalSettings:
    """Rival groups and styles (`rpil.inference.rivals`).

    Attributes
    ----------
    min_gain : float
        Gain of a rival group, relative to that of the trusted group: between the gains of noise and of flipped or
        shifted actions in simulated worlds (benchmarks/robustness.py).
    max_shared_gain : float
        Gain of the policy of one style on the demonstrations of the other, relative to the other's own, up to which two
        styles are opposed. Chosen by hand, not tuned.
    min_overlap : float
        Overlap of the states of a rival group with those of the trusted group: between flipped actions, recorded in the
        same states, and robot arms that fail.
    min_log_ratio : float
        Nats, for the median demonstration of either group, by which its own policy explains it better than the other's:
        two groups of demonstrations of one policy reach one or two by chance.
    shared_weight : float
        Weight of a step of the other group in the fit of a style: two styles act alike in most states. By hand.
    min_group : int
        Demonstrations of a group, at least.
    max_iter : int
        Rounds of fitting policies and assigning demonstrations, at most. Chosen by hand, not tuned.
    overlap_folds : int
        Folds of demonstrations of the classifier that estimates the overlap.
    overlap_ridge : float
        Its ridge, a step. Chosen by hand, not tuned.
    """

    min_gain: float = 0.45
    max_shared_gain: float = 0.5
    min_overlap: float = 0.6
    min_log_ratio: float = 5.0
    shared_weight: float = 0.25
    min_group: int = 2
    max_iter: int = 3
    overlap_folds: int = 5
    overlap_ridge: float = 1e-3


@stored()
@dataclass(frozen=True)
class JudgeSettings:
    """Everything that the judge (`rpil.inference.trust`) assumes: the settings of its stages, and its own.

    The seed and `minority` are no fields: they are arguments of `judge`.

    Attributes
    ----------
    variance_steps : float
        Steps that the variance pooled over demonstrations is worth in the variance of one demonstration's steps. Chosen
        by hand, not tuned.
    min_standard_errors : float
        Standard errors by which the state must predict held-out actions better than their frequencies do; else nothing
        could be learned.
    known_log_bayes_factor : float
        Log Bayes factor of two groups, in nats, where a label says that there are two.
    max_size_ratio : float
        Size of a trusted group relative to its rival group up to which a labelled adversary alone may decide against
        it: among many trusted demonstrations one adversary may have been overlooked. Chosen by hand, not tuned.
    reliability_nodes : int
        Values of the reliability on the grid over which it is summed.
    """

    held_out: HeldOutSettings = HeldOutSettings()
    trimming: TrimmingSettings = TrimmingSettings()
    effective_steps: EffectiveStepsSettings = EffectiveStepsSettings()
    groups: GroupSettings = GroupSettings()
    rivals: RivalSettings = RivalSettings()
    demonstrators: DemonstratorSettings = DemonstratorSettings()
    variance_steps: float = 20.0
    min_standard_errors: float = 2.0
    known_log_bayes_factor: float = 20.0
    max_size_ratio: float = 3.0
    reliability_nodes: int = 21
