"""What the paper did: six experiments, and the policies that are compared in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rpil.data.demonstrations import Demonstrations
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from study.recipe import NO_PENALTY, PaperRecipe
from worlds.simulated import N_GOOD

OUR_FEATURES = "auto"
N_BAD = N_GOOD
EXPERT, RECIPE, RM_ENT, OURS = "expert", "paper's recipe", "rm-ent", "rpil"
TRUST_ALL, RAW_TRUST_ALL, ORACLE, RAW_ORACLE = "trust all", "raw trust all", "oracle", "raw oracle"


@dataclass(frozen=True)
class Experiment:
    """One table of the paper."""

    table: int
    """Its number, in the order in which the paper lists environments and kinds."""
    env_id: str
    kind: str
    """"corrupted": the expert drives and each recorded action is a uniform draw; "random": uniform draws drive."""
    prior: float
    """The P(expert) that the paper's recipe is given."""
    rpil: float
    logreg: float
    """These two: the mean returns that the paper prints."""

    @property
    def printed(self) -> dict[str, float]:
        """What the paper prints for each policy that it has."""
        return {RAW_TRUST_ALL: self.logreg, RECIPE: self.rpil}


EXPERIMENTS = (
    Experiment(1, "MountainCar-v0", "corrupted", 0.2, rpil=-104.45, logreg=-132.0),
    Experiment(2, "MountainCar-v0", "random", 0.2, rpil=-106.25, logreg=-119.5),
    Experiment(3, "LunarLander-v3", "corrupted", 0.5, rpil=195.06, logreg=-22.24),
    Experiment(4, "LunarLander-v3", "random", 0.5, rpil=226.49, logreg=-342.64),
    Experiment(5, "Acrobot-v1", "corrupted", 0.75, rpil=-102.7, logreg=-102.05),
    Experiment(6, "Acrobot-v1", "random", 0.75, rpil=-92.85, logreg=-397.65),
)
ENVIRONMENTS = tuple(dict.fromkeys(experiment.env_id for experiment in EXPERIMENTS))

Method = Callable[[Demonstrations, Experiment, int], Any]
"""Demonstrations, the experiment and a seed to a policy with `predict`, or None where the method only ranks. Where the
policy has `expert_proba_` its verdicts are counted."""


def raw_trust_all(demonstrations: Demonstrations, experiment: Experiment, seed: int) -> BehavioralCloning:
    """The paper's LogReg: raw observations, no penalty."""
    return BehavioralCloning("raw", C=NO_PENALTY).fit(demonstrations)


def trust_all(demonstrations: Demonstrations, experiment: Experiment, seed: int) -> BehavioralCloning:
    """The same with our features and ridge."""
    return BehavioralCloning(OUR_FEATURES).fit(demonstrations)


def paper_recipe(demonstrations: Demonstrations, experiment: Experiment, seed: int) -> PaperRecipe:
    return PaperRecipe(experiment.prior).fit(demonstrations)


def rm_ent(demonstrations: Demonstrations, experiment: Experiment, seed: int) -> RMEnt:
    """The paper's second method, which is told how many are good."""
    return RMEnt(N_GOOD, OUR_FEATURES, random_state=seed).fit(demonstrations)


def ours(demonstrations: Demonstrations, experiment: Experiment, seed: int) -> RPIL:
    """One setting for all tables; the prior is estimated."""
    return RPIL(OUR_FEATURES, random_state=seed).fit(demonstrations)


METHODS: dict[str, Method] = {
    RAW_TRUST_ALL: raw_trust_all,
    TRUST_ALL: trust_all,
    RECIPE: paper_recipe,
    RM_ENT: rm_ent,
    OURS: ours,
}
