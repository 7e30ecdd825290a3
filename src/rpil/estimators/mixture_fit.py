"""`RPIL` with a named adversary: the paper's mixture, fitted by EM to demonstrations in memory."""

from __future__ import annotations

from typing import Any

from rpil.audit.record import Interval
from rpil.audit.summary import audit_from_mixture
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.inference.search import SearchSettings
from rpil.inference.search import fit_mixture as search
from rpil.inference.settings import MINORITY
from rpil.mixture.expert_prior import as_prior
from rpil.mixture.settings import MixtureSettings
from rpil.numerics.types import Array
from rpil.policies.features import ridge_of
from rpil.policies.linear import linear_policy


def fit_mixture(model: Any, demonstrations: Demonstrations, codes: Array, known: Array) -> tuple[FitData, Array]:
    """Fit the mixture with the settings of `model`, an `RPIL`, which gets the attributes; the problem, and the weights
    (N,) of the steps that the final policy learns from. `codes` (N, ...) are of actions, and `known` (M,) are labels:
    1 expert, -1 adversary, 0 unknown.
    """
    features = model.judge_map(demonstrations)
    data = FitData(features.design(demonstrations.observations), codes, demonstrations.offsets, model.space_, known)
    policy = linear_policy(model.space_, ridge_of(features, model.C, len(codes), model.space_), len(codes))
    mixture = MixtureSettings(model.prior, model.m_step, model.max_iter, model.tol)
    settings = SearchSettings(policy, mixture, seed=model.random_state)
    result = search(data, settings, model.adversary, model.progress or (lambda _: None))
    share = Interval(*result.state.prior.interval(result.posterior.expert))
    model.audit_ = audit_from_mixture(data, result, share, demonstrations.ids)
    model.state_, model.judge_, model.judge_features_ = result.state, None, features
    model.n_iter_ = max(1, len(result.history) - 1)
    model.lower_bound_, model.converged_ = result.objective, result.converged
    return data, model.audit_.step_weight


def check_options(model: Any) -> None:
    """Refuse an unknown option of `RPIL` before any work."""
    for name, known in (("m_step", ("joint", "expert_only")), ("minority", MINORITY)):
        value = getattr(model, name)
        if value not in known:
            raise DataError(f"There is no {name} {value!r}; choose {' or '.join(known)}.")
    as_prior(model.prior)
