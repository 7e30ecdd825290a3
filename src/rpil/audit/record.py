"""What the user is told: ranking, verdicts, the steps to look at, and what cannot be known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from rpil.audit.calibration import FEWEST, Recalibration
from rpil.audit.label_choice import suggest
from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.data.formats.id_values import match_labels

SURE = 0.9
"""Probability from which a demonstration is called an expert's, or an adversary's."""

_LABEL_LOG_ODDS = 20.0
"""What a label is worth at least: as good as certain, and finite."""

_MOST_LOG_ODDS = 1e9
"""Instead of infinity, which JSON does not know: of steps that a given adversary can never take."""

Verdict = Literal["expert", "adversary", "uncertain"]


@stored()
@dataclass(frozen=True)
class Interval:
    """A mean with a 95 % interval."""

    mean: float
    low: float
    high: float


@stored()
@dataclass(frozen=True)
class Demonstrator:
    """How far somebody can be trusted who gave several demonstrations.

    Attributes
    ----------
    name : Any
    trust : Interval
        P(expert) of such demonstrations as they gave.
    n_demonstrations : int
    experts, adversaries, uncertain : int
        Verdicts on them.
    """

    name: Any
    trust: Interval
    n_demonstrations: int
    experts: int
    adversaries: int
    uncertain: int


@stored(
    offsets="M+1",
    log_odds="M",
    from_actions="M",
    from_demonstrator="M",
    from_label="M",
    expert_proba="M",
    reliability="M",
    reliability_interval="M 2",
    step_log_ratio="N",
    step_weight="N",
    history="iterations",
)
@dataclass(frozen=True, eq=False)
class Audit:
    """How far each demonstration can be trusted.

    Attributes
    ----------
    ids : tuple
        Demonstration ids, in the order of the data (M of them).
    offsets : (M + 1,) int array
        Demonstration m owns the steps ``offsets[m]:offsets[m + 1]``.
    finding : str
        What the audit comes to: "told apart", "cannot be known", "nobody stands out" or "nothing could be learned"; see
        `rpil.inference.judgement.FINDINGS`. Verdicts are given where demonstrations were told apart.
    log_odds : (M,) array
        Log-odds of expert against adversary, in nats; the primary output. The sum of `evidence`.
    from_actions, from_demonstrator, from_label : (M,) arrays
        The parts of `log_odds`: what the demonstration's own actions say, what the other demonstrations of its
        demonstrator say, and what a label adds.
    expert_proba : (M,) array
        P(expert): ``sigmoid(log_odds)``, or 0.5 where it cannot be known which of two groups is the expert. It says how
        surely a demonstration acts as the group does that agrees best; that this group is good is assumed.
    reliability : (M,) array
        Posterior mean share of the demonstration's steps that are the expert's.
    reliability_interval : (M, 2) array
        Its 95 % posterior interval.
    verdicts : tuple of {"expert", "adversary", "uncertain"}
    step_log_ratio : (N,) array
        ``log pi(a|s) - log psi(a|s)`` per step, in nats.
    step_weight : (N,) array
        Weight of each step for training a policy, in [0, 1].
    prior : Interval
        Share of expert demonstrations.
    identifiable : bool
        False where several groups of demonstrations each agree among themselves and nothing says which one is the
        expert; then ``competing`` holds the groups and ``to_label`` the ids whose labels would settle it.
    competing : tuple of tuple of ids
        Two such groups; or two styles, which act differently in some states, where `identifiable` is true.
    to_label : tuple of ids
        One of each group.
    adversary : str
        What experts are compared with: the adversary of the mixture, or the reference of the judge.
    history : (T,) array
        The mean log-likelihood of the teachers each round, or the objective of EM at each iteration.
    assumptions : tuple of str
        What the audit took for granted, one sentence each.
    demonstrators : tuple of Demonstrator
        The most trusted first; empty where demonstrators were not given.
    labelled : tuple of ids
        Demonstrations whose label was given.
    """

    ids: tuple[Any, ...]
    offsets: NDArray[np.int64]
    finding: str
    log_odds: NDArray[np.float64]
    from_actions: NDArray[np.float64]
    from_demonstrator: NDArray[np.float64]
    from_label: NDArray[np.float64]
    expert_proba: NDArray[np.float64]
    reliability: NDArray[np.float64]
    reliability_interval: NDArray[np.float64]
    verdicts: tuple[Verdict, ...]
    step_log_ratio: NDArray[np.float64]
    step_weight: NDArray[np.float64]
    prior: Interval
    adversary: str
    history: NDArray[np.float64]
    identifiable: bool = True
    competing: tuple[tuple[Any, ...], ...] = ()
    to_label: tuple[Any, ...] = ()
    assumptions: tuple[str, ...] = ()
    demonstrators: tuple[Demonstrator, ...] = ()
    labelled: tuple[Any, ...] = ()

    @property
    def evidence(self) -> dict[str, NDArray[np.float64]]:
        """The parts that `log_odds` is the sum of, (M,) each, in nats."""
        return {"actions": self.from_actions, "demonstrator": self.from_demonstrator, "label": self.from_label}

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Steps per demonstration, (M,)."""
        return np.diff(self.offsets)

    def ranking(self) -> NDArray[np.int64]:
        """Indices of the demonstrations, the most trusted first."""
        return np.argsort(-self.log_odds, kind="stable")

    def suggest_labels(self, k: int = 3) -> tuple[Any, ...]:
        """Ids of the `k` demonstrations whose labels would tell most about the others, the most telling first.

        Of groups that compete one of each comes first (`to_label`); then those in the middle of the ranking, see
        `rpil.audit.label_choice`. Fewer where fewer are unlabelled.

        Raises
        ------
        DataError
            Where `k` is not positive.
        """
        if k < 1:
            raise DataError(f"k={k!r} labels cannot be suggested; ask for one at least.")
        index = {name: m for m, name in enumerate(self.ids)}
        first, labelled = ([index[name] for name in names] for names in (self.to_label, self.labelled))
        return tuple(self.ids[m] for m in suggest(self.log_odds, first, labelled, k))

    def calibrated(self, labels: Mapping[Any, str]) -> Audit:
        """The same audit with P(expert) corrected by `labels`, id to "expert" or "adversary", that `fit` did not see.

        A slope and an offset of the log-odds are fitted to them, see `rpil.audit.calibration`; verdicts and weights
        follow. The ranking of demonstrations without a label stays.

        Raises
        ------
        DataError
            Where fewer than four are labelled that were not in the fit, where groups compete, or an id or a label is
            unknown.
        """
        if not self.identifiable:
            raise DataError("Two groups compete for being the expert; fit with one label before calibrating.")
        expert = match_labels(labels, self.ids)
        index = np.array([m for m in expert if self.ids[m] not in self.labelled], dtype=int)
        if len(index) < FEWEST:
            raise DataError(
                f"{len(index)} labels that the fit did not see are too few to calibrate with; give {FEWEST} at least, "
                "to calibrated() alone and not to fit()."
            )
        given = np.zeros(len(self.ids), dtype=np.int64)
        given[index] = [1 if expert[m] else -1 for m in index.tolist()]
        before = np.array([name in self.labelled for name in self.ids])
        found = Recalibration.fit(self.log_odds[index], given[index] > 0)
        corrected = np.where(before, self.log_odds, found.log_odds(self.log_odds))
        log_odds = with_labels(corrected, given)
        proba = expit(log_odds)
        old = np.repeat(self.expert_proba, self.lengths)
        within = np.divide(self.step_weight, old, out=np.ones(len(old)), where=old > 0)
        return replace(
            self,
            log_odds=log_odds,
            finding="told apart",
            from_actions=self.from_actions + corrected - self.log_odds,
            from_label=self.from_label + log_odds - corrected,
            expert_proba=proba,
            verdicts=tuple(verdict(p, contested=False) for p in proba),
            step_weight=np.repeat(proba, self.lengths) * np.minimum(within, 1.0),
            labelled=(*self.labelled, *(self.ids[m] for m in index.tolist())),
            assumptions=(
                *self.assumptions,
                f"Calibrated on {len(index)} labels: log-odds times {found.slope:.2f}, {found.offset:+.2f}.",
            ),
        )

    def worst_steps(self, index: int, k: int = 5) -> list[int]:
        """Up to `k` steps of demonstration `index` (counted from 0 within it) that speak most against an expert."""
        ratio = self.step_log_ratio[self.steps(index)]
        worst = np.argsort(ratio, kind="stable")[:k]
        return [int(n) for n in worst if ratio[n] < 0]

    def index(self, demonstration: Any) -> int:
        """Index of the demonstration with this id.

        Raises
        ------
        DataError
            If there is none.
        """
        if demonstration not in self.ids:
            known = ", ".join(map(repr, self.ids[:5])) + ", ..." * (len(self.ids) > 5)
            raise DataError(f"No demonstration is called {demonstration!r}; choose one of the ids {known}.")
        return self.ids.index(demonstration)

    def steps(self, index: int) -> slice:
        """The rows of demonstration `index`."""
        return slice(int(self.offsets[index]), int(self.offsets[index + 1]))

    def to_dict(self) -> dict[str, Any]:
        """The audit as plain numbers and text, as ``rpil audit --json`` prints it; most trusted first."""
        return {
            "n_demonstrations": len(self.ids),
            "n_steps": int(self.offsets[-1]),
            "finding": self.finding,
            "adversary": self.adversary,
            "prior": asdict(self.prior),
            "identifiable": self.identifiable,
            "groups": [list(group) for group in self.competing],
            "to_label": list(self.to_label),
            "assumptions": list(self.assumptions),
            "demonstrations": [
                {
                    "id": self.ids[m],
                    "n_steps": int(self.lengths[m]),
                    "log_odds": float(self.log_odds[m]),
                    "evidence": {name: float(part[m]) for name, part in self.evidence.items()},
                    "expert_proba": float(self.expert_proba[m]),
                    "reliability": float(self.reliability[m]),
                    "verdict": self.verdicts[m],
                    "worst_steps": self.worst_steps(m),
                }
                for m in self.ranking().tolist()
            ],
            "demonstrators": [asdict(who) for who in self.demonstrators],
        }


def with_labels(log_odds: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Log-odds (M,) where `labels` (M,), 1 expert, -1 adversary, 0 unknown, are as good as certain."""
    log_odds = np.clip(log_odds, -_MOST_LOG_ODDS, _MOST_LOG_ODDS)
    return np.where(labels == 0, log_odds, labels * np.maximum(np.abs(log_odds), _LABEL_LOG_ODDS))


def verdict(proba: float, contested: bool) -> Verdict:
    """What to call a demonstration with this P(expert); "uncertain" where it is `contested`."""
    if contested or 1 - SURE < proba < SURE:
        return "uncertain"
    return "expert" if proba >= SURE else "adversary"
