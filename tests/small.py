"""A fit that takes hundreds of steps for many: the judge reads a small sample, and passes do the rest."""

from __future__ import annotations

from typing import Any

from rpil import RPIL, MixtureSettings, SampleSettings, Settings
from rpil.inference.settings import GroupSettings, JudgeSettings

SAMPLE = SampleSettings(min_steps=600, steps_per_coefficient=20, n_demonstrations=20, min_samples=4, block_steps=700)
ONE_SHARE = JudgeSettings(groups=GroupSettings(noise_shares=(0.1,)))
"""One share of the variance of a score instead of two: their choice takes most of the time of a small fit."""

FAST = Settings(judge=ONE_SHARE)
SMALL = Settings(sample=SAMPLE, judge=ONE_SHARE)


def small_rpil(**options: Any) -> RPIL:
    """`RPIL` for which thousands of steps are many."""
    return RPIL(**{"settings": SMALL} | options)


def mixture(**chosen: Any) -> Settings:
    """Settings of the mixture with a named adversary alone."""
    return Settings(mixture=MixtureSettings(**chosen))
