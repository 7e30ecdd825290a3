"""A checkpoint keeps the state of one fit, and is refused for another."""

from __future__ import annotations

import numpy as np
import pytest

from archives import mountain_car, rewrite
from rpil import RPIL, save
from rpil.data.errors import DataError
from rpil.scale.ascent import AscentState
from rpil.scale.checkpoint import Checkpoint


@pytest.fixture(scope="module")
def data():
    return mountain_car()


@pytest.fixture(scope="module")
def fitted(data):
    return RPIL().fit(data)


def test_checkpoint_holds_the_final_policy_of_one_fit(fitted, data, tmp_path):
    path, trust = tmp_path / "checkpoint", fitted.audit_.expert_proba
    checkpoint = Checkpoint.of(path, "C=None", (data.observations, trust))
    assert checkpoint.read() is None
    passes = np.array([[-3.0, 0.5], [-2.0, 0.1]])
    for radius, n_places in ((np.inf, 0), (2.0, 3)):
        places = np.random.default_rng(0).random((n_places, 2, *fitted.policy_.weights.shape))
        checkpoint.keep(AscentState(fitted.policy_, passes, radius, places))
        found = checkpoint.read()
        np.testing.assert_array_equal(found.policy.weights, fitted.policy_.weights)
        np.testing.assert_array_equal(found.curvature, places)
        assert (found.history.tolist(), found.radius) == (passes.tolist(), radius)
    others = [Checkpoint.of(path, "C=2.0", (data.observations, trust))]
    others.append(Checkpoint.of(path, "C=None", (data.observations, trust / 2)))
    for one in others:
        with pytest.raises(DataError, match="of other data, settings or kind of computer; delete it to start anew"):
            one.read()
    rewrite(path, {"state/policy/weights.npy": None})
    with pytest.raises(DataError, match=r"its parts do not belong together .*; delete it to start anew"):
        checkpoint.read()
    rewrite(path, header=lambda tree: tree.update(state=3))
    with pytest.raises(DataError, match="its parts do not belong together"):
        checkpoint.read()
    checkpoint.done()
    checkpoint.done()  # nothing is there any more, which is as it should be
    assert list(tmp_path.iterdir()) == []
    save(fitted, path)
    with pytest.raises(DataError, match="it is no checkpoint of rpil; choose another name"):
        checkpoint.read()
