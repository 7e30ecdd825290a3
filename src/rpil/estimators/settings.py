"""What only an expert changes about a fit of `RPIL`."""

from __future__ import annotations

from dataclasses import dataclass

from rpil.audit.settings import AuditSettings
from rpil.data.archive import stored
from rpil.inference.settings import JudgeSettings
from rpil.mixture.settings import MixtureSettings
from rpil.policies.selection import SelectionSettings
from rpil.scale.settings import AscentSettings, SampleSettings


@stored()
@dataclass(frozen=True)
class Settings:
    """Settings of every stage of a fit.

    Attributes
    ----------
    search_features : str
        The features while trust is decided: a kind of features, or "auto", which is the kind of the final policy, or
        "folded" where that is "raw" or "auto". A straight line takes an expert in a rare situation for an adversary.
        benchmarks/ablations.py ("raw features").
    single_precision : int
        Entries of the observations above which the judge reads discrete actions in single precision. Chosen by
        hand, not tuned.
    judge : JudgeSettings
    mixture : MixtureSettings
        Of a fit with a named adversary: the prior, the M-step, and when EM stops.
    audit : AuditSettings
        When a demonstration gets a verdict and its steps full weight.
    selection : SelectionSettings
        Of the choice of features, where these are "auto".
    sample : SampleSettings
    ascent : AscentSettings
        Of the fit of the final policy.

    Examples
    --------
    >>> from rpil import RPIL, MixtureSettings, Settings
    >>> model = RPIL(adversary="uniform", settings=Settings(mixture=MixtureSettings(prior=0.5)))
    """

    search_features: str = "auto"
    single_precision: int = 50_000
    judge: JudgeSettings = JudgeSettings()
    mixture: MixtureSettings = MixtureSettings()
    audit: AuditSettings = AuditSettings()
    selection: SelectionSettings = SelectionSettings()
    sample: SampleSettings = SampleSettings()
    ascent: AscentSettings = AscentSettings()
