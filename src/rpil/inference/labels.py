"""Which of two groups is the expert's: by labels, or by the larger size where the user distrusts minorities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.inference.rivals import Rival
from rpil.inference.scores import Scores, Scoring
from rpil.inference.settings import JudgeSettings, Minority
from rpil.numerics.types import Array, Float


@dataclass(frozen=True, eq=False)
class Decision:
    """The scores that count, after labels and `minority` were asked about a rival group."""

    scores: Scores
    rival: Rival | None
    """The rival group that remains: nothing decided between it and the trusted group."""
    minority: Minority
    log_odds: Float[Array, " M"] | None = None
    """Log-odds of expert against adversary, where they come from a comparison of two styles."""


def decide(scoring: Scoring, scores: Scores, rival: Rival | None, minority: Minority) -> Decision:
    """Decide between the trusted group of `scores` and its rival group or style.

    Labels decide where there are any, of adversaries alone under ``minority="trust"``; under "distrust" the larger
    group is the expert's. An expert labelled in each group means "trust".
    """
    labels, settings = scoring.data.labels, scoring.settings
    apart = scores.groups.told_apart(settings.groups)
    if rival is not None:
        if all((labels[group] > 0).any() for group in (rival.trusted, rival.rival)):
            minority = "trust"
        labelled = (labels < 0).any() if minority == "trust" else labels.any()
        if labelled or minority == "distrust":
            if not apart:  # after a label the rival style is not asked for again
                return Decision(scores, None, minority, _styles_log_odds(scoring, scores, rival))
            chosen = _chosen_scores(scoring, scores, rival)
            if chosen is not None:
                return Decision(chosen.with_two_groups(settings), None, minority)
    if apart and minority != "trust" and _labels_contradict(scoring.data, scores, settings):
        upper = scores.log_odds(settings) > 0
        rival = Rival(np.flatnonzero(upper), np.flatnonzero(~upper), np.empty(0))
    return Decision(scores, rival, minority)


def _chosen_scores(scoring: Scoring, scores: Scores, rival: Rival) -> Scores | None:
    """`scores`, or the scores under policies of the rival group: those that fewer labels contradict, then those whose
    policy explains labelled experts better and labelled adversaries worse; without labels those of the larger group.
    None where labels do not decide."""
    data, settings = scoring.data, scoring.settings
    is_rival = np.isin(np.arange(data.n_demonstrations), rival.rival)
    rival_scores = scoring.score(scoring.fit_group(is_rival))
    if not data.labels.any():
        return scores if len(rival.trusted) >= len(rival.rival) else rival_scores
    errors, rival_errors = (int((data.labels * s.log_odds(settings) < 0).sum()) for s in (scores, rival_scores))
    preference = rival_errors - errors or float(data.labels @ data.sum_steps(rival.log_ratio))
    if preference > 0:
        return scores
    return rival_scores if preference < 0 and _may_overrule(data, rival, settings) else None


def _may_overrule(data: FitData, rival: Rival, settings: JudgeSettings) -> bool:
    """Whether labels may make the rival group the expert's: if one is of an expert, or the groups are of similar size.

    A labelled adversary among many trusted demonstrations may be one that was overlooked.
    """
    return bool((data.labels > 0).any()) or settings.max_size_ratio * len(rival.rival) >= len(rival.trusted)


def _styles_log_odds(scoring: Scoring, scores: Scores, rival: Rival) -> Array | None:
    """Log-odds (M,) from the mean log-ratio of two styles, in favour of the style that labels, or else the size, say is
    the expert's. None where labels do not decide, or these scores are one group and the styles not opposed.

    Where the styles are not opposed, labels of one sort rank the demonstrations but give no verdicts: the other style
    may be as good, or as bad.
    """
    data, settings = scoring.data, scoring.settings
    labels = data.labels
    preference = float(labels @ data.sum_steps(rival.log_ratio)) if labels.any() else 1.0
    contrast = scoring.score_ratios(scores.fit, np.sign(preference) * rival.log_ratio)
    unclear = not contrast.groups.told_apart(settings.groups) and not rival.opposed
    overruled = preference < 0 and not _may_overrule(data, rival, settings)
    if labels.any() and (unclear or preference == 0 or overruled):
        return None
    log_odds = contrast.with_two_groups(settings).log_odds(settings)
    bound = settings.groups.verdict_log_odds
    gives_verdicts = rival.opposed or not labels.any() or labels.min() < 0 < labels.max()
    return log_odds if gives_verdicts else bound * np.tanh(log_odds / bound)


def _labels_contradict(data: FitData, scores: Scores, settings: JudgeSettings) -> bool:
    """Whether at least half of the labels, one of an expert or two, contradict the scores: the upper group may be the
    adversaries'."""
    wrong = data.labels * scores.log_odds(settings) < 0
    expert = bool((wrong & (data.labels > 0)).any())
    return bool(2 * wrong.sum() >= (data.labels != 0).sum()) and (expert or bool(wrong.sum() >= 2))
