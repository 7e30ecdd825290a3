"""Settings of the mixture and of the prior of demonstrators."""

from __future__ import annotations

from typing import Literal, get_args

from rpil.data.archive import settings_record
from rpil.data.errors import DataError

MStep = Literal["joint", "expert_only"]
"""Terms of the policy's M-step: the expert's and the adversary's, or the expert's alone as in the paper's code."""


@settings_record(max_iter="[0, inf)", tol="[0, inf)", steady="[0, inf)", single_starts="[0, inf)")
class MixtureSettings:
    """EM for the paper's mixture (`rpil.mixture.em`) and its starts (`rpil.mixture.search`).

    The seed is no field: it is an argument of the functions that draw.
    """

    prior: float | tuple[float, float] | None = None
    """P(expert): fixed, or estimated under Beta(a, b); None is Beta(2, 2). It decides between two parts of a judge."""
    m_step: MStep = "joint"
    """Terms of the policy's M-step; "expert_only" is the paper's code."""
    max_iter: int = 200
    """EM iterations at most. Chosen by hand, not tuned."""
    tol: float = 1e-3
    """Gain of the objective, in nats a demonstration, at which EM stops; ten times as much where no responsibility
    changes by more than `steady`. Chosen by hand, not tuned."""
    steady: float = 1e-3
    """Change of a responsibility in one iteration that counts as none. Chosen by hand, not tuned."""
    newton_iter: int = 1
    cg_iter: int = 10
    """Newton steps in one M-step of the policy, and iterations of conjugate gradients in each. One step makes it
    generalised EM (Dempster, Laird and Rubin 1977). Chosen by hand, not tuned."""
    single_starts: int = 8
    """Single demonstrations that are starts. Chosen by hand, not tuned."""
    start_iter: int = 18
    """EM iterations after which the starts are compared. Chosen by hand, not tuned."""

    def __post_init__(self) -> None:
        if self.prior is not None:
            from rpil.mixture.expert_prior import as_prior  # which a judge does without

            as_prior(self.prior)
        if self.m_step not in get_args(MStep):
            raise DataError(f"There is no m_step {self.m_step!r}; choose {' or '.join(get_args(MStep))}.")
