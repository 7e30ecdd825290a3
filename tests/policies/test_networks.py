"""Stacked networks are networks one by one."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.policies.networks import initial_networks, on_device, raw_outputs
from rpil.policies.torch import TorchPolicy, train

pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")
RNG = np.random.default_rng(0)
INPUTS = RNG.normal(size=(60, 2))


def test_stacked_networks_give_the_outputs_of_each():
    shapes = ((2, 3, 4), (2, 1, 4), (2, 4, 2), (2, 1, 2))
    networks = tuple(RNG.normal(size=shape).astype(np.float32) for shape in shapes)
    outputs = raw_outputs(networks, INPUTS[:, [0, 1, 1]], "cpu")
    for k in range(2):
        hidden = np.maximum(INPUTS[:, [0, 1, 1]] @ networks[0][k] + networks[1][k], 0)
        np.testing.assert_allclose(outputs[k], hidden @ networks[2][k] + networks[3][k], rtol=1e-4, atol=1e-5)


def test_networks_start_at_zero():
    assert not raw_outputs(initial_networks((2, 8, 3), 4, np.random.default_rng(0)), INPUTS, "cpu").any()


def test_training_reduces_the_validation_loss_and_reads_the_training_rows_only():
    goal = INPUTS[:, :1] * 2
    targets = on_device(goal, "cpu")
    half = np.arange(60) < 40
    split = half[None], ~half[None]

    def loss(raw, chosen):
        return ((raw - targets[chosen]) ** 2).sum(dim=-1)

    policy = TorchPolicy(epochs=60, patience=None, batch_size=20, learning_rate=0.05)
    start = initial_networks((2, 8, 1), 1, np.random.default_rng(0))
    trained, epoch = train(policy, start, INPUTS, np.ones(60), loss, split, np.random.default_rng(1))
    assert epoch > 0
    error = np.abs(raw_outputs(trained, INPUTS, "cpu")[0] - goal)[~half].mean()
    assert error < 0.3 * np.abs(goal[~half]).mean()
    assert train(policy, start, INPUTS, np.zeros(60), loss, split, np.random.default_rng(1)) == (start, 0)
