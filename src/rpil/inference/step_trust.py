"""Which steps of a demonstration are an expert's:

    a_n ~ rho_m pi + (1 - rho_m) q,      rho_m uniform on a grid in (0, 1)

rho_m, the reliability of demonstration m, is the share of its steps that are an expert's. Bad steps come alone or in
stretches. In stretches, whose step it is, z_n, is a Markov chain, so each step is judged by its neighbours too:

    z_{n+1} = z_n with probability `stay`, else drawn anew,      P(z_n is an expert) = rho_m

Which of the two holds is summed out for each demonstration. `JudgeSettings` has `stay` and the prior probability of
stretches.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit, log_expit, logit, softmax

from rpil.data.fit_data import FitData
from rpil.inference.settings import JudgeSettings
from rpil.numerics.types import Array, Float, Int

LEAST_SHARE = 1e-9
"""Reliabilities stay so far from 0 and 1, which no step could change."""


def reliability_of(
    data: FitData,
    log_ratio: Float[Array, " N"],
    settings: JudgeSettings,
) -> tuple[Float[Array, " M"], Float[Array, "M 2"]]:
    """Reliability of each demonstration and its 95 % interval, given the `log_ratio` log pi - log q of each step."""
    n_nodes, bound = settings.reliability_nodes, settings.max_log_ratio
    nodes = (np.arange(n_nodes) + 0.5) / n_nodes
    evidence = np.empty((data.n_demonstrations, n_nodes))
    clipped = np.clip(log_ratio, -bound, bound)
    for j, rho in enumerate(nodes):
        evidence[:, j] = data.sum_steps(np.logaddexp(np.log(rho) + clipped, np.log1p(-rho)))
    proba = softmax(evidence, axis=1)
    cumulated = proba.cumsum(axis=1)
    ends = [nodes[np.minimum((cumulated < q).sum(axis=1), n_nodes - 1)] for q in (0.025, 0.975)]
    return proba @ nodes, np.stack(ends, axis=1)


def step_proba(
    reliability: Float[Array, " M"], log_ratio: Float[Array, " N"], lengths: Int[Array, " M"], settings: JudgeSettings
) -> Float[Array, " N"]:
    """P(step n is an expert's | all steps of its demonstration), from bounded log-ratios.

    In stretches by forward and backward passes: a chain of two states is the same read backwards, so the backward pass
    is the forward pass of the reversed steps; the step itself and its reliability are in both.
    """
    share = np.clip(reliability, LEAST_SHARE, 1 - LEAST_SHARE)
    prior = np.repeat(logit(share), lengths)
    forward = filtered(share, log_ratio, lengths, settings.stay)
    backward = filtered(share[::-1], log_ratio[::-1], lengths[::-1], settings.stay)[::-1]
    gain = _log_evidence(forward - log_ratio, log_ratio) - _log_evidence(prior, log_ratio)
    gains = np.bincount(np.repeat(np.arange(len(lengths)), lengths), gain)
    in_stretches = expit(logit(settings.p_stretches) + gains)
    chain, alone = expit(forward + backward - log_ratio - prior), expit(prior + log_ratio)
    return np.asarray(alone + np.repeat(in_stretches, lengths) * (chain - alone))


def _log_evidence(before: Float[Array, " N"], log_ratio: Float[Array, " N"]) -> Float[Array, " N"]:
    """log p(a_n | the steps before) - log q(a_n), given the log-odds of an expert's step `before` it is seen."""
    return np.asarray(np.logaddexp(log_expit(before) + log_ratio, log_expit(-before)))


def filtered(
    share: Float[Array, " M"], log_ratio: Float[Array, " N"], lengths: Int[Array, " M"], stay: float
) -> Float[Array, " N"]:
    """Log-odds that each step is an expert's, given the steps up to it, of demonstrations of which the `share` is."""
    longest = np.argsort(-lengths, kind="stable")
    first, share = (np.cumsum(lengths) - lengths)[longest], share[longest]
    running = np.searchsorted(-lengths[longest], -np.arange(lengths.max()))  # how many are longer than n steps
    log_odds = np.array(log_ratio, dtype=float)
    before = share
    for n, count in enumerate(running.tolist()):
        steps = first[:count] + n
        log_odds[steps] += logit(before[:count])
        before = stay * expit(log_odds[steps]) + (1 - stay) * share[:count]
    return log_odds
