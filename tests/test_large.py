"""Fits to more data than are searched: the same as a search of everything would say, wherever the data lie."""

from __future__ import annotations

import numpy as np
import pytest

from problems import make, make_continuous
from rpil import RPIL, large
from rpil.demonstrations import PIECE_STEPS, Demonstrations
from rpil.engines import InMemory, Streamed
from rpil.large import sample

ADVERSARIES = ["uniform", "marginal", "normalised complement", "confusion", "own policy"]


@pytest.fixture
def small(monkeypatch):
    """A world in which thousands of steps are many, and hundreds fill a piece."""
    monkeypatch.setattr(large, "SAMPLE_STEPS", 600)
    monkeypatch.setattr(large, "STEPS_PER_COEFFICIENT", 20)
    monkeypatch.setattr(large, "SAMPLE_DEMONSTRATIONS", 20)
    monkeypatch.setattr(large, "TIMES", 4)
    monkeypatch.setattr("rpil.demonstrations.PIECE_STEPS", 700)


def demonstrations(kind="random", seed=0, n_good=80, n_bad=40, maker=make):
    toy = maker(kind, seed, n_good=n_good, n_bad=n_bad, steps=(20, 60))
    return toy, Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets, toy.ids)


@pytest.mark.parametrize("adversary", ADVERSARIES)
def test_it_says_what_a_search_of_everything_says(small, monkeypatch, adversary):
    toy, data = demonstrations()
    labels = dict.fromkeys(toy.ids[:2], "expert") if adversary == "own policy" else None
    model = RPIL(adversary=adversary, labels=labels, tol=1e-6).fit(data)
    assert large.is_large(model, data)
    monkeypatch.setattr(large, "TIMES", 1e9)
    other = RPIL(adversary=adversary, labels=labels, tol=1e-6).fit(data)
    assert not large.is_large(other, data)
    assert model.audit_.verdicts == other.audit_.verdicts
    assert model.lower_bound_ > other.lower_bound_ - 0.5  # the ridges differ by the scale of columns
    difference = np.abs(model.predict_proba(data.observations) - other.predict_proba(data.observations))
    assert difference.max() < 0.02


@pytest.mark.parametrize("maker", [make, make_continuous])
@pytest.mark.parametrize("kind", ["random", "noisy"])
def test_where_the_data_lie_changes_nothing(small, kind, maker):
    _, data = demonstrations(kind, maker=maker)
    here, streamed = (RPIL(engine=engine, adversary="marginal").fit(data) for engine in (InMemory(), Streamed()))
    for name in ("log_odds", "expert_proba", "step_weight", "step_log_ratio", "reliability"):
        np.testing.assert_allclose(getattr(here.audit_, name), getattr(streamed.audit_, name), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(here.coef_, streamed.coef_, rtol=1e-6, atol=1e-6)


def test_the_objective_never_falls(small):
    _, data = demonstrations("noisy", 1)
    history = RPIL(adversary="confusion").fit(data).audit_.history
    assert len(history) > 2
    assert np.diff(history).min() >= -1e-6


def test_parts_hold_everything_once_in_order(small):
    _, data = demonstrations()
    for n_parts in (1, 3, 1000):
        parts = data.parts(n_parts)
        pieces = [piece for part in parts for piece in part]
        assert len(parts) == min(n_parts, len(pieces))
        np.testing.assert_array_equal(np.concatenate([p.actions for p in pieces]), data.actions)
        np.testing.assert_array_equal(np.concatenate([np.diff(p.offsets) for p in pieces]), data.lengths)
        assert [p.demonstrations.start for p in pieces[1:]] == [p.demonstrations.stop for p in pieces[:-1]]
        assert pieces[0].first == 0
    assert PIECE_STEPS > 0


def test_a_sample_holds_every_label():
    rng = np.random.default_rng(0)
    labels = np.zeros(5000, dtype=int)
    labels[[3, 4000]] = 1, -1
    chosen = sample(np.full(5000, 200), labels, 20_000, rng)
    assert {3, 4000} <= set(chosen.tolist())
    assert len(chosen) == 100
    assert (np.diff(chosen) > 0).all()
