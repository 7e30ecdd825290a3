"""Settings of the judge: one record for each stage. docs/model.md has the formulas in which they stand.

`benchmarks/ablations.py` compared the values that name it; docs/ablations.md has the table. Values without a source
were chosen by hand, not tuned.
"""

from __future__ import annotations

from dataclasses import field

from rpil.data.archive import NOT_STORED, check_settings, settings_record
from rpil.numerics.regression import ErrorSettings


@settings_record(max_folds="[2, inf)", max_left_out="[0, inf)", lapse="(0, 1)", tol="(0, inf)")
class HeldOutSettings:
    """Held-out log-probabilities (`rpil.inference.held_out`)."""

    max_folds: int = 5
    """Folds of demonstrations at most, where each is not a fold of its own. More folds call more good demonstrations
    outlier, because another dealing of them changes less. benchmarks/ablations.py ("ten folds")."""
    max_left_out: int = 25
    """Demonstrations up to which each is a fold of its own, so that no dealing of folds changes anything."""
    lapse: float = 0.01
    """Share eps of the steps in which an expert takes any action, drawn from q: bounds the log-ratio of a step.
    docs/tried.md: .05 and .15 were no better."""
    ridges: tuple[float, ...] = (1e-1, 1e-2, 1e-3, 1e-4)
    """Ridges a step to choose from, the strongest first. benchmarks/ablations.py ("one ridge, 1e-4")."""
    tol: float = 5e-5
    """Tolerance of fits to discrete actions, see `rpil.numerics.newton.NewtonSettings`. At 1e-3 the order was
    another one in a third of 112 sets; here it is that of fits to 1e-6 (rank correlation .999)."""
    errors: ErrorSettings = ErrorSettings()
    """Distribution of the errors of continuous actions."""

    def __post_init__(self) -> None:
        check_settings(self.errors, min_scale="[0, inf)")


@settings_record(share="(0, 1]", max_iter="[0, inf)")
class TrimmingSettings:
    """The training group (`rpil.inference.scores`)."""

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


@settings_record(min_p_two="[0.5, 1)", min_proba="(0.5, 1)", min_gap="(0, inf)", max_share="(0, 1)")
class OutlierSettings:
    """Demonstrations that differ from most others (`rpil.inference.outliers`)."""

    min_gap: float = 4.0
    """Robust standard deviations below the median from which a demonstration is far below it. benchmarks/ablations.py
    ("min_gap 3", "nobody far below")."""
    min_p_two: float = 0.99
    """The least P(two groups) at which members of the lower group are named."""
    min_distance: float = 3.0
    """Distance of the means of two groups, in deviations of the wider one, from which the lower one lies apart.
    benchmarks/ablations.py ("min_distance 2")."""
    min_proba: float = 0.9
    """1 - P of the upper group from which a demonstration is of the lower one."""
    max_own_gain: float = 0.3
    """Gain of the lower part by its own policy, relative to that of the others by theirs, up to which it is noise.
    benchmarks/ablations.py ("max_own_gain .45", "max_own_gain .15")."""
    max_share: float = 1 / 3
    """Share of the demonstrations in a group apart, at most."""
    min_group: int = 2
    """Demonstrations of a lower part, at least."""


@settings_record(max_noise="[0, 1)", max_tie="[0.5, 1)", min_gain="[0, 1)", max_iter="[1, inf)", tol="(0, inf)")
class PartSettings:
    """The part of the demonstrations that a learner trusts (`rpil.inference.two_parts`)."""

    max_noise: float = 0.15
    """Gain of a part by its own policy, relative to that of the other by its own, up to which it has no rule."""
    max_tie: float = 0.545
    """P(experts) of a part, by its size, up to which all are trusted."""
    prior: float | tuple[float, float] | None = field(default=None, metadata=NOT_STORED)
    """P(expert), or (a, b) of its Beta prior; of `RPIL` it is `rpil.MixtureSettings.prior`."""
    min_gain: float = 0.02
    """Nats a step by which two policies explain more than one, relative to the larger gain of a part, at least."""
    min_rule: float = 0.05
    """Gain of a part by its own policy, nats a step, that shows a rule; random actions gain up to .044."""
    max_iter: int = 12
    """Times that demonstrations change sides, at most."""
    tol: float = 5e-4
    """Tolerance of fits to discrete actions, in the place of `HeldOutSettings.tol`."""
    max_steps: int = 8_000
    """Steps from which the parts are found; of more, every second, third and so on."""


@settings_record()
class ChannelSettings:
    """Channels (`rpil.inference.channels`)."""

    n_components: int = 8
    """Principal components of the summaries of a demonstration, at most."""


@settings_record(
    by_ranking="[0, inf)",
    by_group="[0, inf)",
    demonstrator_scale="[0, inf)",
    sharpness="(0, inf)",
    full_trust="(0, 1]",
    min_trust="(0, 1)",
    min_proba="(0.5, 1)",
    error="(0, 0.5)",
    max_contradicted_proba="(0, 1)",
    prior_log_odds="[0, inf)",
    max_levels="[2, inf)",
    end_place="[0, 0.5)",
    max_folds="[2, inf)",
)
class AnswerSettings:
    """Bayesian logistic regression on answers (`rpil.inference.answers`)."""

    by_ranking: float = 0.8
    by_group: float = 0.5
    """Prior means of the weights of the ranking and of the group of scores; those of all other columns are 0."""
    precision: float = 1.0
    """Prior precision of each weight and of the offset."""
    demonstrator_scale: float = 1.4
    """Scale of the columns of demonstrators; 0: they count for nothing."""
    error: float = 0.02
    """Rate of wrong answers."""
    prior_log_odds: float = 2.0
    """Prior nats by which the highest value of a witness speaks more for good than the lowest one."""
    prior_counts: float = 4.0
    """Demonstrations that this prior is worth."""
    max_levels: int = 3
    """Different values of a witness; of more, as many quantiles."""
    sharpness: float = 3.1
    """Factor of the log-odds by columns where answers predict each other."""
    full_trust: float = 0.35
    """Trust from which this factor is full; below, it falls with the square of the trust."""
    min_trust: float = 0.05
    """Trust that stays where answers do not predict each other, so that the order does."""
    min_proba: float = 0.95
    """P(good) from which a demonstration is good, and 1 - P from which it is bad."""
    min_proba_bound: float = 1e-6
    """P(good) stays so far from 0 and 1."""
    max_contradicted_proba: float = 0.2
    """Probability of a label by the other answers below which it contradicts them."""
    min_other_answers: int = 4
    """Other answers, at least, that a label can contradict."""
    max_folds: int = 16
    """Answers up to which each is predicted by all others; of more, each by those of the other folds."""
    end_place: float = 0.05
    """Place in the ranking, from the lowest, of the first label that is asked for; from the highest, of the second."""
    max_lead: int = 2
    """Labels by which one known kind leads the other before one that is likely of the other kind is asked for, at
    `end_place` of the order of P(good), from its end."""


@settings_record(variance_steps="[0, inf)", min_gain="[0, inf)", monotony="[0, inf)")
class JudgeSettings:
    """Everything that the judge (`rpil.inference.trust`) assumes: the settings of its stages, and its own."""

    held_out: HeldOutSettings = HeldOutSettings()
    trimming: TrimmingSettings = TrimmingSettings()
    groups: GroupSettings = GroupSettings()
    outliers: OutlierSettings = OutlierSettings()
    parts: PartSettings = PartSettings()
    channels: ChannelSettings = ChannelSettings()
    answers: AnswerSettings = AnswerSettings()
    variance_steps: float = 20.0
    """Steps that the variance pooled over demonstrations is worth in the variance of one demonstration's steps."""
    min_gain: float = 0.1
    """Nats a step by which the state must help to predict the actions of the median demonstration of the training
    group; else nothing could be learned. For discrete actions whose entropy is below 1 nat, a share of the entropy.
    Random actions reach -.15 to .1, recorded data .11 or more."""
    monotony: float = 1 / 3
    """Share of the nats by which own actions are easier to predict without the state than those of others, subtracted
    from a score. With 1 or 1/2 experts are last among many who act at random (docs/tried.md)."""
