"""Settings of the judge: one record for each stage. docs/model.md has the formulas in which they stand.

`benchmarks/ablations.py` compared the values that name it; docs/ablations.md has the table. Values without a source
were chosen by hand, not tuned.
"""

from __future__ import annotations

from rpil.data.settings_record import check_settings, settings_record
from rpil.mixture.settings import DemonstratorSettings
from rpil.numerics.regression import ErrorSettings


@settings_record(max_folds="[2, inf)", max_left_out="[0, inf)", lapse="(0, 1)")
class HeldOutSettings:
    """Held-out log-probabilities (`rpil.inference.held_out`)."""

    max_folds: int = 5
    """Folds of demonstrations at most, where each is not a fold of its own. More folds call more good demonstrations
    outlier, because another dealing of them changes less. benchmarks/ablations.py ("ten folds")."""
    max_left_out: int = 25
    """Demonstrations up to which each is a fold of its own, so that chance deals no folds. With five folds another seed
    changed the finding of 10 in 62 small worlds (benchmarks/stability.py)."""
    lapse: float = 0.01
    """Share eps of the steps in which an expert takes any action, drawn from q: bounds the log-ratio of a step.
    docs/tried.md: .05 and .15 were no better."""
    ridges: tuple[float, ...] = (1e-1, 1e-2, 1e-3, 1e-4)
    """Ridges a step to choose from, the strongest first. benchmarks/ablations.py ("one ridge, 1e-4")."""
    errors: ErrorSettings = ErrorSettings()
    """Distribution of the errors of continuous actions."""

    def __post_init__(self) -> None:
        check_settings(self.errors, min_scale="[0, inf)")


@settings_record(share="(0, 1]", max_iter="[0, inf)")
class TrimmingSettings:
    """The training group (`rpil.inference.trimming`)."""

    share: float = 0.6
    """Share of the demonstrations in the training group. benchmarks/ablations.py (1, .8, .3)."""
    max_iter: int = 4
    """Concentration steps at most."""


@settings_record(noise_shares="(0, 1]", start_quantiles="(0, 1)", prior_spread="(0, inf)", tol="[0, inf)")
class GroupSettings:
    """One group of scores or two (`rpil.inference.groups`)."""

    noise_shares: tuple[float, ...] = (1.0, 0.3)
    """Shares c of the variance of a score to choose from, by the likelihood. benchmarks/ablations.py ("error bars as
    they are")."""
    start_quantiles: tuple[float, ...] = (0.2, 0.5, 0.8)
    """Quantiles of the scores at which EM for two groups divides them at first."""
    prior_spread: float = 1 / 16
    """Prior value of the variance of a group, worth one demonstration, relative to the variance of all scores.
    benchmarks/ablations.py ("no prior on the spread of a group")."""
    min_steps: int = 8
    """Steps of the median demonstration from which a mean over steps is about normal."""
    max_scores: int = 2_000
    """Scores to which the groups are fitted; of more, this many quantiles."""
    max_iter: int = 300
    """EM iterations at most."""
    tol: float = 1e-4
    """Gain of the penalised log-likelihood, in nats, at which EM stops."""


@settings_record(max_shared_gain="[0, 1]", max_noise="[0, 1]", min_own_gain="[0, inf)")
class RivalSettings:
    """Rival groups (`rpil.inference.rivals`)."""

    max_shared_gain: float = 0.5
    """Gain of a rival group by the policy of the upper group, relative to that by its own, at most.
    benchmarks/ablations.py ("no rival groups")."""
    max_noise: float = 0.1
    """Gain of a policy of the lower demonstrations, relative to that of the upper group, up to which they are noise."""
    standard_errors: float = 2.0
    """By which a gain is above 0."""
    n_lapses: int = 3
    """Shares of lapses of which the best is taken."""
    min_own_gain: float = 1 / 3
    """Gain of a policy of the outliers with features that bend, relative to that of the upper group, from
    which they may be a second way. benchmarks/claims.py prints it of every set."""
    max_steps: int = 10_000
    max_entries: int = 100_000
    """Steps of either group from which such policies learn, and features of these steps, at most."""


@settings_record(min_p_two="[0.5, 1)", min_proba="(0.5, 1)", min_agreement="[-1, 1]")
class ClaimSettings:
    """What the scores support (`rpil.inference.claims`)."""

    min_p_two: float = 0.99
    """The least P(two groups), with both assignments to folds, at which a demonstration is called an outlier."""
    min_p_two_of_noise: float = 0.2
    """P(two groups) from which those that act as noise does are called outliers."""
    noise_share: float = 0.5
    """Gain of the upper group, times this, by which a demonstration is explained worse than by frequent actions."""
    min_proba: float = 0.9
    """P of the upper group from which a demonstration is similar, and 1 - P from which it is an outlier."""
    min_group: int = 2
    """Demonstrations of a group, at least."""
    min_agreement: float = 0.2
    """Rank correlation of the likelihood and of its gain over frequent actions, at least. benchmarks/ablations.py ("no
    agreement")."""
    max_runs_p: float = 0.01
    """Probability of so few runs in the order of recording, below which the outliers follow one another."""


@settings_record(idle_share="[0, 1]")
class ChannelSettings:
    """Channels (`rpil.inference.channels`)."""

    idle_share: float = 0.1
    """A step is idle that moves by less than this share of the median move."""
    n_components: int = 8
    """Principal components of the summaries of a demonstration, at most."""


@settings_record(
    p_agreement="(0, 1)",
    min_proba="(0.5, 1)",
    error_rates="(0, 0.5)",
    max_contradicted_proba="(0, 1)",
    max_left_out="[0, inf)",
    luck="[0, 1)",
    weak_precision="(0, inf)",
    asked_quantiles="[0, 1]",
)
class AnswerSettings:
    """Bayesian logistic regression on answers (`rpil.inference.answers`). The values were chosen on recorded data, with
    families left out (benchmarks/answers.py)."""

    p_agreement: float = 0.85
    """Prior probability that the demonstrations that agree are the good ones."""
    precision: float = 1.0
    """Prior precision of the weight of a channel."""
    component_precision: float = 0.25
    """The same of a principal component, of which the first has variance 1."""
    weak_precision: float = 16.0
    """The same where all answers are of one side, all good or all bad, but for outcomes of 0 and 1."""
    offset_precision: float = 0.25
    """Of the offset."""
    error_rates: tuple[float, ...] = (0.02, 0.1)
    """Rates of wrong answers, equally likely beforehand; the smallest first."""
    luck: tuple[float, ...] = (0.0, 0.5, 0.9)
    """Shares of bad demonstrations whose outcome is 1 where outcomes are 0 and 1, equally likely beforehand; at least
    the rate of wrong answers. These values, and `weak_precision` with them, were chosen on eight sets of Meta-World's
    arm with six kinds of bad demonstrations, as the best of about 45 choices."""
    group_weight: float = 2.0
    """Prior weight of the group of scores; that of agreement is 1."""
    sharpness: float = 1.75
    """Factor of what the columns say of P(good)."""
    max_group_log_odds: float = 3.0
    """Nats by which the log-odds of the upper group are bounded as a channel."""
    min_proba: float = 0.9
    """P(good) from which a demonstration is good, and 1 - P from which it is bad."""
    min_proba_bound: float = 1e-6
    """P(good) stays so far from 0 and 1."""
    max_contradicted_proba: float = 0.2
    """Probability of a label by the other answers below which it contradicts them."""
    min_other_answers: int = 4
    """Other answers, at least, that a label can contradict."""
    max_left_out: int = 64
    """Answers up to which each label is compared with the others."""
    asked_quantiles: tuple[float, ...] = (0.9, 0.1, 0.5)
    """Places in the ranking by P(good) at which labels are asked for, one after the other; further ones at the last: a
    likely good one and a likely bad one, then the middle, by the number of labels so far (benchmarks/answers.py)."""


@settings_record(stay="[0, 1)", p_stretches="(0, 1)")
class StepSettings:
    """Whose step it is (`rpil.inference.step_trust`)."""

    stay: float = 0.95
    """Probability that the next step of a stretch is the same one's: stretches have 20 steps or more on average.
    benchmarks/windows.py ("stay .8", "stay .99")."""
    whole_reliability: float = 0.9
    """Reliability against the others, divided by the median of the training group, from which all steps of a
    demonstration have the same share. Without it the gain of the weights on robot arms is halved
    (benchmarks/policy_value.py, preset arm)."""
    p_stretches: float = 0.5
    """Prior probability that the bad steps of a demonstration come in stretches. benchmarks/windows.py ("alone")."""


@settings_record(variance_steps="[0, inf)", reliability_nodes="[2, inf)", min_gain="[0, inf)", monotony="[0, inf)")
class JudgeSettings:
    """Everything that the judge (`rpil.inference.trust`) assumes: the settings of its stages, and its own.

    The seed is no field: it is an argument of `judge`.
    """

    held_out: HeldOutSettings = HeldOutSettings()
    trimming: TrimmingSettings = TrimmingSettings()
    groups: GroupSettings = GroupSettings()
    rivals: RivalSettings = RivalSettings()
    claims: ClaimSettings = ClaimSettings()
    channels: ChannelSettings = ChannelSettings()
    answers: AnswerSettings = AnswerSettings()
    demonstrators: DemonstratorSettings = DemonstratorSettings()
    steps: StepSettings = StepSettings()
    variance_steps: float = 20.0
    """Steps that the variance pooled over demonstrations is worth in the variance of one demonstration's steps."""
    min_gain: float = 0.1
    """Nats a step by which the state must help to predict the actions of the median demonstration of the training
    group; else nothing could be learned. Of discrete actions whose entropy is less than 1 nat, a share of the entropy.
    Of actions at random it is -.15 to .1, in recorded data .11 or more."""
    monotony: float = 1 / 3
    """Share of the nats by which own actions are easier to predict without the state than similar ones, that a score
    lacks. With 1 or 1/2 experts are last among many who act at random (docs/tried.md)."""
    reliability_nodes: int = 21
    """Values of the reliability on the grid over which it is summed."""
    max_log_ratio: float = 50.0
    """Nats by which the log-ratio of a step is bounded where the reliability is estimated: exp(50) is certain."""
