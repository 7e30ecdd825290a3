"""Fits to more data than the judge reads: what it would say of everything, wherever the data lie."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from problems import make, make_continuous
from rpil import Settings
from rpil.data.demonstrations import Demonstrations
from rpil.results.vocabulary import SIDES
from rpil.scale.fit import JudgedSample
from rpil.scale.local import LocalEngine
from small import SAMPLE, small_rpil


def demonstrations(kind="random", seed=0, n_good=80, n_bad=40, maker=make):
    toy = maker(kind, seed, n_good=n_good, n_bad=n_bad, steps=(20, 60))
    return toy, toy.demonstrations


def both(data, fit=None, **options):
    """A fit in which the judge reads a third of the data, and one in which it reads everything."""
    sampled, whole = (replace(SAMPLE, min_steps=1500, min_samples=times) for times in (2, 1e9))
    n_steps = sampled.steps(1)
    assert sampled.is_smaller_than(data.offsets, n_steps)
    assert not whole.is_smaller_than(data.offsets, n_steps)
    model, other = (
        small_rpil(settings=Settings(sample=sample), **options).fit(data, **(fit or {})) for sample in (sampled, whole)
    )
    return model, other


def assert_alike(model, other, most_open=0.0, least_correlation=0.99):
    """The same finding, and no word against the other; a share of words may be open in one of the two, because a sample
    supports fewer words, or more by chance."""
    one, two = model.audit_, other.audit_
    assert one.finding == two.finding
    assert np.corrcoef(one.log_odds, two.log_odds)[0, 1] > least_correlation
    sides = [[SIDES[word] for word in audit.verdicts] for audit in (one, two)]
    differ = [pair for pair in zip(*sides, strict=True) if pair[0] != pair[1]]
    assert len(differ) <= most_open * len(one.ids)
    assert all("open" in pair for pair in differ)


@pytest.mark.parametrize(
    ("maker", "kind", "n_bad", "most_open"),
    [(make, "random", 40, 0), (make_continuous, "noisy", 40, 0.2), (make, "flipped", 20, 0)],
)
def test_verdicts_from_a_sample_are_those_from_all_demonstrations(maker, kind, n_bad, most_open):
    toy, data = demonstrations(kind, n_bad=n_bad, maker=maker)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model, other = both(data)
    assert_alike(model, other, most_open)
    assert roc_auc_score(toy.is_good, model.audit_.log_odds) > 0.99
    assert len(model.audit_.reasons) == len(data)
    assert model.audit_.deviations == ()  # actions are compared in memory only
    if maker is make:
        assert np.abs(model.predict_proba(data.observations) - other.predict_proba(data.observations)).max() < 0.1
    else:
        np.testing.assert_allclose(model.predict(data.observations), other.predict(data.observations), atol=0.05)


def test_labels_outside_the_sample_are_used():
    _, data = demonstrations()
    labels = {"d0": "good", "d3": "bad", "d100": "bad"}  # the second is wrong
    model, other = both(data, {"labels": labels})
    assert model.audit_.finding == other.audit_.finding == "answered"
    assert_alike(model, other, 0.2, 0.95)
    assert np.flatnonzero(model.audit_.answers.labels).tolist() == [0, 3, 100]
    own = dict(zip(model.audit_.ids, model.audit_.log_odds, strict=True))
    without = dict(zip(model.audit_.ids, both(data)[0].audit_.log_odds, strict=True))
    assert without["d3"] > 0 > own["d3"]
    weight = model.audit_.step_weight
    assert weight[data.offsets[3] : data.offsets[4]].max() < 0.5  # the policy is hardly taught by it


def test_engines_judge_copies_in_the_sample_once(monkeypatch):
    _, data = demonstrations("random")
    rows = [data.observations, *[data.observations[: data.offsets[1]]] * 60]
    actions = [data.actions, *[data.actions[: data.offsets[1]]] * 60]
    offsets = np.append(data.offsets, data.offsets[-1] + data.lengths[0] * np.arange(1, 61))
    more = Demonstrations(np.concatenate(rows), np.concatenate(actions), offsets)
    seen = []
    monkeypatch.setattr("rpil.scale.fit.JudgedSample", lambda *parts: seen.append(parts[1]) or JudgedSample(*parts))
    here, shared = (small_rpil(engine=engine).fit(more) for engine in (None, LocalEngine(n_shards=3)))
    np.testing.assert_array_equal(seen[0], seen[1])
    assert sum(m == 0 or m >= len(data) for m in seen[0].tolist()) == 1
    np.testing.assert_allclose(here.audit_.log_odds, shared.audit_.log_odds, rtol=1e-6, atol=1e-6)


def test_final_policy_learns_states_outside_the_sample():
    _, data = demonstrations(n_good=300, n_bad=150)
    actions, observations = np.array(data.actions), np.hstack([data.observations, np.zeros((data.n_steps, 1))])
    chosen = SAMPLE.draw(data.lengths, np.zeros(450, dtype=int), 600, np.random.default_rng(0))
    rare = data.offsets[np.setdiff1d(np.arange(300), chosen)[[10, 20, 30]]]
    actions[np.concatenate([rare, rare + 1])] = 7
    observations[rare, -1] = 1.0
    data = Demonstrations(observations, actions, data.offsets, data.ids)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = small_rpil(features="raw").fit(data)
    assert model.converged_
    # An intercept has no ridge: the policy does it as often as those it learns from.
    weight = model.audit_.step_weight
    assert weight @ (actions == 7) > 3
    assert weight @ model.predict_proba(observations)[:, -1] == pytest.approx(weight @ (actions == 7), rel=0.02)
