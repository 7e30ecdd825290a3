"""Settings of the audit."""

from __future__ import annotations

from dataclasses import dataclass

from rpil.data.archive import stored
from rpil.inference.settings import JudgeSettings


@stored()
@dataclass(frozen=True)
class AuditSettings:
    """From probabilities to verdicts and step weights."""

    min_verdict_proba: float = 0.9
    """Probability from which the mixture with a named adversary calls a demonstration an expert's; an adversary's from
    one minus this down."""
    min_label_log_odds: float = 20.0
    """Nats. A label raises the log-odds to at least this: as good as certain. Chosen by hand, not tuned."""
    judge: JudgeSettings = JudgeSettings()
    """Settings of answers, of verdicts without answers, of steps and of demonstrators; a fit puts its own here."""
    weighs_for_learner: bool = True
    """Whether weights of steps are those of `RPIL`, or those for other trainings; a fit puts its own here."""

    def min_proba(self, anchor: str) -> float:
        """The probability from which an audit with this `anchor` says that a demonstration is of the upper group."""
        if anchor == "named adversary":
            return self.min_verdict_proba
        return self.judge.answers.min_proba if anchor == "answers" else self.judge.outliers.min_proba
