"""Settings of a fit of `RPIL` or `RMEnt` that only an expert changes."""

from __future__ import annotations

from rpil.data.archive import settings_record
from rpil.inference.settings import JudgeSettings
from rpil.mixture.settings import MixtureSettings
from rpil.policies.settings import CrossFitSettings, SelectionSettings
from rpil.results.judged import AuditSettings
from rpil.scale.settings import AscentSettings, SampleSettings


@settings_record(min_feature_weight="[0, 1)", single_precision="[0, inf)")
class Settings:
    """Settings of every stage of a fit.

    Examples
    --------
    >>> from rpil import RPIL, MixtureSettings, Settings
    >>> model = RPIL(adversary="uniform", settings=Settings(mixture=MixtureSettings(prior=0.5)))
    """

    judge_features: str = "auto"
    """Features of the judge: a kind, or "auto": the kind of the final policy, but "folded" instead of "raw"
    and "auto". A straight line takes an expert in a rare situation for an adversary.
    benchmarks/ablations.py ("raw features")."""
    min_feature_weight: float = 0.5
    """Weight of a step, divided by 1 or by the largest weight where that is smaller, above which the feature map of the
    final policy is fitted to it. Chosen by hand, not tuned."""
    single_precision: int = 50_000
    """Entries of the observations above which the judge reads discrete actions in single precision. By hand, not tuned.
    """
    judge: JudgeSettings = JudgeSettings()
    mixture: MixtureSettings = MixtureSettings()
    """Settings of a named adversary: the M-step, and when EM stops; the prior is that of the learner, too."""
    audit: AuditSettings = AuditSettings()
    """Settings of verdicts and weights of steps."""
    selection: SelectionSettings = SelectionSettings()
    """Settings of feature maps, and of the choice of one where features are "auto"."""
    cross_fit: CrossFitSettings = CrossFitSettings()
    """Settings of the folds of an estimator that is given as `policy`."""
    sample: SampleSettings = SampleSettings()
    ascent: AscentSettings = AscentSettings()
    """Settings of the fit of the final policy."""
