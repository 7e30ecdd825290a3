"""Settings of the judge: one record for each stage. docs/model.md has the formulas in which they stand.

`benchmarks/ablations.py` compared the values that name it; docs/results.md has the table. Values without a source were
chosen by hand, not tuned.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import Literal, get_args

from rpil.data.archive import stored
from rpil.data.checks import check_settings
from rpil.data.errors import DataError
from rpil.mixture.settings import DemonstratorSettings
from rpil.numerics.regression import ErrorSettings

Minority = Literal["ask", "trust", "distrust"]
"""What to do about a rival group where no label decides: report that the answer cannot be known and ask for a label;
trust the rival group as well; or trust the larger group."""

MINORITY: tuple[str, ...] = get_args(Minority)


@stored()
@dataclass(frozen=True)
class HeldOutSettings:
    """Held-out log-probabilities (`rpil.inference.held_out`)."""

    max_folds_discrete: int = 5
    max_folds_continuous: int = 50
    """Folds of demonstrations at most. Fifty folds cost least squares no more than five, but softmax policies ten times
    as much. benchmarks/ablations.py ("five folds", "ten folds")."""
    lapse: float = 0.01
    """Share eps of the steps in which an expert takes any action, drawn from q: bounds the log-ratio of a step.
    docs/tried.md: .05 and .15 were no better."""
    ridges: tuple[float, ...] = (1e-1, 1e-2, 1e-3, 1e-4)
    """Ridges a step to choose from, the strongest first. benchmarks/ablations.py ("one ridge, 1e-4")."""
    tol: float = 1e-3
    """Gradient, a step, at which the fit of a softmax policy stops; the final policy is fitted further."""
    max_iter: int = 15
    max_cg: int = 30
    """Newton steps of such a fit at most, and iterations of conjugate gradients in each."""
    errors: ErrorSettings = ErrorSettings()
    """Distribution of the errors of continuous actions."""

    def __post_init__(self) -> None:
        check_settings(self, max_folds_discrete="[2, inf)", max_folds_continuous="[2, inf)", lapse="(0, 1)")
        check_settings(self.errors, min_scale="[0, inf)")


@stored()
@dataclass(frozen=True)
class TrimmingSettings:
    """The training group (`rpil.inference.trimming`)."""

    share: float = 0.6
    """Share of the demonstrations in the first training group. benchmarks/ablations.py (1, .8, .3)."""
    halvings: int = 3
    """Times that the share may be halved: experts may be as few as one demonstration in ten. benchmarks/ablations.py
    ("the share is not halved")."""
    min_group: int = 5
    """Demonstrations of a training group with a halved share, at least: a fold of it is left out of each fit."""
    max_iter: int = 4
    """Concentration steps at most."""

    def __post_init__(self) -> None:
        check_settings(self, share="(0, 1]", halvings="[0, inf)", max_iter="[0, inf)")


@stored()
@dataclass(frozen=True)
class EffectiveStepsSettings:
    """Autocovariances of a series (`rpil.inference.effective_steps`)."""

    max_lags: int = 1_000
    """Lags, in steps, beyond which no autocovariance is estimated."""
    min_pairs: int = 30
    """Products from which an autocovariance is estimated, at least."""
    quiet_lags: int = 4
    """Consecutive lags without correlation at which the estimation stops: a series may be uncorrelated at every other
    lag."""
    standard_errors: float = 1.5
    """Standard errors (Bartlett 1946) within which a correlation is taken for zero."""

    def __post_init__(self) -> None:
        check_settings(self)


@stored()
@dataclass(frozen=True)
class GroupSettings:
    """One group of scores or two (`rpil.inference.groups`)."""

    min_p_two: float = 0.9
    """P(two groups) from which they are told apart; below it no demonstration gets a verdict."""
    noise_shares: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01)
    """Shares c of the variance of a score to choose from, by the likelihood. benchmarks/ablations.py ("error bars as
    they are")."""
    min_noise: float = 0.3
    """Lower bound of c, relative to the variance that independent steps would give."""
    start_quantiles: tuple[float, ...] = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
    """Quantiles of the scores at which EM for two groups divides them at first."""
    prior_spread: float = 1 / 16
    """Prior value of the variance of a group, worth one demonstration, relative to the variance of all scores.
    benchmarks/ablations.py ("no prior on the spread of a group")."""
    min_spread: float = 1e-3
    """Lower bound of the variance of a group, relative to the variance of all scores."""
    min_distance: float = 1.0
    """Distance of the two means, in root mean square standard deviations: two groups with one centre are one group with
    heavy tails. benchmarks/ablations.py ("two groups may have one centre")."""
    tail: float = 0.05
    """Share of the experts whose scores are as widely spread as those of the wider group. benchmarks/ablations.py ("no
    odd experts")."""
    min_steps: int = 8
    """Steps of the median demonstration from which a mean over steps is about normal."""
    min_demonstrations: int = 4
    """Demonstrations from which two groups are fitted."""
    rank_correlation: float = 0.6
    """Assumed correlation of rank and quality where the scores are one group. benchmarks/ablations.py ("ranks are worth
    nothing")."""
    max_scores: int = 2_000
    """Scores to which the groups are fitted; of more, this many quantiles."""
    max_iter: int = 300
    """EM iterations at most."""
    tol: float = 1e-4
    """Gain of the penalised log-likelihood, in nats, at which EM stops."""

    def __post_init__(self) -> None:
        check_settings(
            self,
            min_p_two="[0.5, 1)",
            noise_shares="(0, 1]",
            min_noise="[0, 1]",
            start_quantiles="(0, 1)",
            prior_spread="[0, inf)",
            min_distance="[0, inf)",
            tol="[0, inf)",
            tail="(0, 1)",
            rank_correlation="[0, 1]",
        )
        if max(self.noise_shares) < self.min_noise:
            raise DataError(f"GroupSettings: one of noise_shares={self.noise_shares} must be {self.min_noise} or more.")

    @property
    def verdict_log_odds(self) -> float:
        """logit of `min_p_two`: the bound of the log-odds of demonstrations that were not told apart, in nats."""
        return log(self.min_p_two / (1 - self.min_p_two))


@stored()
@dataclass(frozen=True)
class RivalSettings:
    """Rival groups and styles (`rpil.inference.rivals`)."""

    min_gain: float = 0.45
    """Gain of a rival group, relative to that of the trusted group: between the gains of noise and of flipped or
    shifted actions in simulated worlds (benchmarks/robustness.py)."""
    max_shared_gain: float = 0.5
    """Gain of the policy of one style on the demonstrations of the other, relative to the other's own, up to which two
    styles are opposed."""
    min_overlap: float = 0.6
    """Overlap of the states of a rival group with those of the trusted group: between flipped actions, recorded in the
    same states, and robot arms that fail."""
    min_log_ratio: float = 5.0
    """Nats, for the median demonstration of either group, by which its own policy explains it better than the other's:
    two groups of demonstrations of one policy reach one or two by chance."""
    shared_weight: float = 0.25
    """Weight of a step of the other group in the fit of a style: two styles act alike in most states."""
    gradient_ridge: float = 1e-3
    """Ridge, a step, of the regression whose gradients divide demonstrations into two styles, where the judge chose
    none."""
    min_group: int = 2
    """Demonstrations of a group, at least."""
    max_iter: int = 3
    """Rounds of fitting policies and assigning demonstrations, at most."""
    overlap_folds: int = 5
    """Folds of demonstrations of the classifier that estimates the overlap."""
    overlap_ridge: float = 1e-3
    """Its ridge, a step."""

    def __post_init__(self) -> None:
        shares = dict.fromkeys(("min_gain", "max_shared_gain", "min_overlap", "shared_weight"), "[0, 1]")
        check_settings(self, min_log_ratio="[0, inf)", overlap_folds="[2, inf)", **shares)


@stored()
@dataclass(frozen=True)
class JudgeSettings:
    """Everything that the judge (`rpil.inference.trust`) assumes: the settings of its stages, and its own.

    The seed and `minority` are no fields: they are arguments of `judge`.
    """

    held_out: HeldOutSettings = HeldOutSettings()
    trimming: TrimmingSettings = TrimmingSettings()
    effective_steps: EffectiveStepsSettings = EffectiveStepsSettings()
    groups: GroupSettings = GroupSettings()
    rivals: RivalSettings = RivalSettings()
    demonstrators: DemonstratorSettings = DemonstratorSettings()
    variance_steps: float = 20.0
    """Steps that the variance pooled over demonstrations is worth in the variance of one demonstration's steps."""
    min_standard_errors: float = 2.0
    """Standard errors by which the state must predict held-out actions better than their frequencies do; else nothing
    could be learned."""
    known_log_bayes_factor: float = 20.0
    """Log Bayes factor of two groups, in nats, where a label says that there are two."""
    max_size_ratio: float = 3.0
    """Size of a trusted group relative to its rival group up to which a labelled adversary alone may decide against it:
    among many trusted demonstrations one adversary may have been overlooked."""
    reliability_nodes: int = 21
    """Values of the reliability on the grid over which it is summed."""
    max_log_ratio: float = 50.0
    """Nats by which the log-ratio of a step is bounded where the reliability is estimated: exp(50) is certain."""

    def __post_init__(self) -> None:
        check_settings(self, variance_steps="[0, inf)", min_standard_errors="[0, inf)", reliability_nodes="[2, inf)")
