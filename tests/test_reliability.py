"""The table of Betas: log-concave, normalised, and its M-step finds the best pair it holds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import betaln
from scipy.stats import beta as beta_distribution

from rpil.reliability import ADVERSARY, EXPERT, PointMasses, TwoBetas, beta_table


def parameters() -> tuple[NDArray, NDArray]:
    """a and b of every candidate."""
    table = beta_table()
    return table.mean * table.concentration, (1 - table.mean) * table.concentration


def test_rows_are_distributions_over_the_grid():
    table = beta_table()
    assert ((table.nodes > 0) & (table.nodes < 1)).all()
    assert (np.diff(table.nodes) > 0).all()
    np.testing.assert_allclose(np.exp(table.log_weight).sum(axis=1), 1.0)


def test_every_candidate_is_log_concave():
    """Or else the experts' Beta turns U-shaped and swallows everybody (model.md)."""
    a, b = parameters()
    assert a.min() >= 1 - 1e-9
    assert b.min() >= 1 - 1e-9
    assert len(np.unique(np.stack([a, b]).round(6), axis=1).T) == len(a)  # and none is there twice


def test_sums_over_the_grid_are_integrals():
    """Evidence of k of n steps under Beta(a, b): against the closed form of the beta-binomial."""
    table, (a, b) = beta_table(), parameters()
    smooth = table.concentration <= 32  # sharper ones fall between the nodes, a little
    np.testing.assert_allclose((np.exp(table.log_weight) @ table.nodes)[smooth], table.mean[smooth], atol=0.01)
    for k, n in ((3, 4), (10, 20), (20, 20)):
        found = np.exp(table.log_weight) @ (table.nodes**k * (1 - table.nodes) ** (n - k))
        expected = betaln(a + k, b + n - k) - betaln(a, b)
        np.testing.assert_allclose(np.log(found)[smooth], expected[smooth], atol=0.1)


def test_start_is_near_what_was_asked_for():
    expert, adversary = TwoBetas.start(0.9, 0.3).means
    assert expert == pytest.approx(0.9, abs=0.03)
    assert adversary == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("seed", range(5))
def test_fit_is_the_best_pair_with_the_gap(seed):
    """Against the double loop; never worse than the pair before."""
    rng = np.random.default_rng(seed)
    table = beta_table()
    counts = rng.gamma(0.3, size=(2, len(table.nodes))) * 10
    old = TwoBetas.start()
    new = old.fit(counts)

    def score(pair: TwoBetas) -> float:
        return float((counts * pair.log_weight).sum() + pair.log_prior())

    assert score(new) >= score(old)
    best = max(
        score(TwoBetas(e, a, old.gap))
        for e in range(len(table.mean))
        for a in range(len(table.mean))
        if table.mean[e] >= table.mean[a] + old.gap
    )
    assert score(new) == pytest.approx(best)
    expert, adversary = new.means
    assert expert >= adversary + new.gap


def test_fit_recovers_two_betas():
    nodes = beta_table().nodes
    edges = np.concatenate([[0.0], (nodes[1:] + nodes[:-1]) / 2, [1.0]])
    counts = np.stack([1000 * np.diff(beta_distribution.cdf(edges, a, b)) for a, b in ((18, 2), (4, 4))])
    expert, adversary = TwoBetas.start().fit(counts).means
    assert expert == pytest.approx(0.9, abs=0.03)
    assert adversary == pytest.approx(0.5, abs=0.05)


def test_point_masses_are_the_papers_model():
    paper = PointMasses()
    np.testing.assert_array_equal(paper.nodes, [0.0, 1.0])
    np.testing.assert_array_equal(np.exp(paper.log_weight[EXPERT]), [0.0, 1.0])
    np.testing.assert_array_equal(np.exp(paper.log_weight[ADVERSARY]), [1.0, 0.0])
    assert paper.fit(np.ones((2, 2))) is paper
    assert paper.log_prior() == 0.0
