"""Networks of skorch as policies, by the code that docs/policies.md shows."""

import numpy as np
import pytest
from sklearn.metrics import r2_score, roc_auc_score

from rpil import RPIL

pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")
skorch = pytest.importorskip("skorch", reason="skorch is not installed: pip install 'rpil[torch]'")
networks = pytest.importorskip("networks")  # of the benchmarks


@pytest.fixture(autouse=True)
def single_thread():
    threads = networks.torch.get_num_threads()
    networks.torch.set_num_threads(1)  # networks so small only lose by more
    yield
    networks.torch.set_num_threads(threads)


def test_classes():
    data, good = networks.classes(0)
    policy = networks.network(data)
    model = RPIL(policy=policy).fit(data)
    assert not hasattr(policy, "n_features_in_"), "copies of it are fitted"
    assert roc_auc_score(good, model.audit_.log_odds) > 0.99
    assert networks.right(model, data) > 0.95
    np.testing.assert_allclose(model.predict_proba(data.observations).sum(axis=1), 1.0, rtol=1e-6)


def test_numbers():
    data, good = networks.numbers(0)
    model = RPIL(policy=networks.network(data)).fit(data)
    assert roc_auc_score(good, model.audit_.log_odds) == 1.0
    x = np.random.default_rng(9).normal(size=(2000, 2))
    assert r2_score(networks.wave(x), model.predict(x)) > 0.9


def test_a_network_memorises_bad_data_only_in_sample():
    """Eighteen useless observations are enough to remember every single step by."""
    data, good = networks.classes(0, n_idle=18)
    bad = ~np.repeat(good, 40)
    large = networks.network(data).set_params(classifier__optimizer__max_iter=300)
    everyone = {"classifier__sample_weight": np.ones(len(bad))}
    fitted = large.fit(data.observations, data.actions, **everyone)
    assert (fitted.predict(data.observations) == data.actions)[bad].mean() > 0.9
    log_odds = RPIL(policy=networks.network(data)).fit(data).audit_.log_odds
    assert roc_auc_score(good, log_odds) > 0.99
