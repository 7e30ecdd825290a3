"""Passes in blocks equal the products of whole matrices."""

import numpy as np
import pytest
from scipy.special import log_softmax as reference_log_softmax

from rpil.numerics import blocks
from rpil.numerics.blocks import BLOCK_BYTES

ROWS = BLOCK_BYTES // (7 * 8)
"""Rows in one block of seven columns."""


@pytest.mark.parametrize("n", [1, 63, ROWS - 1, ROWS, ROWS + 1, 3 * ROWS + 5])
def test_passes_equal_products_of_whole_matrices(n):
    rng = np.random.default_rng(n)
    features, weights = rng.normal(size=(n, 7)), rng.normal(size=(7, 3))
    proba, weight, direction = rng.dirichlet(np.ones(3), n), rng.random(n), rng.normal(size=(7, 3))
    assert len(list(blocks.blocks(features))) == -(-n // ROWS)
    z = features @ direction
    jacobian = weight[:, None] * proba * (z - (proba * z).sum(axis=1, keepdims=True))
    actions, log_proba = rng.integers(3, size=n), reference_log_softmax(features @ weights, axis=1)
    taken, slope = blocks.softmax_pass(features, weights, actions, weight)
    for found, expected in (
        (taken, log_proba[np.arange(n), actions]),
        (slope, features.T @ (weight[:, None] * (np.eye(3)[actions] - np.exp(log_proba)))),
        (blocks.linear(features, weights), features @ weights),
        (blocks.gradient(features, proba), features.T @ proba),
        (blocks.hessian_product(features, proba, weight, direction), features.T @ jacobian),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


def test_add_adds_entry_by_entry():
    first, second = (np.arange(3.0), (1, np.ones((2, 2)))), (np.ones(3), (2, np.eye(2)))
    total = blocks.add(first, second)
    np.testing.assert_array_equal(total[0], [1.0, 2.0, 3.0])
    assert total[1][0] == 3
    np.testing.assert_array_equal(total[1][1], np.ones((2, 2)) + np.eye(2))
    with pytest.raises(ValueError, match="zip"):
        blocks.add(first, second[:1])


def test_a_block_of_wide_rows_has_64_of_them():
    wide = np.empty((130, BLOCK_BYTES // 8))
    assert [(block.start, block.stop) for block in blocks.blocks(wide)] == [(0, 64), (64, 128), (128, 130)]


def test_softmax_pass_of_large_logits_is_finite_and_entries_are_at_the_actions():
    features, actions = np.array([[1e4], [-1e4]]), np.array([1, 1])
    taken, slope = blocks.softmax_pass(features, np.array([[1.0, 0.0]]), actions, np.ones(2))
    np.testing.assert_allclose(taken, [-1e4, 0])
    np.testing.assert_allclose(slope, [[-1e4, 1e4]])
    log_proba = blocks.log_softmax(features @ np.array([[1.0, 0.0]]))
    np.testing.assert_allclose(blocks.at_actions(log_proba, actions), taken)
