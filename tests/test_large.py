"""Fits to more data than are searched: the same as a search of everything would say, wherever the data lie."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

from problems import make, make_continuous
from rpil import RPIL, DataError, large, load, save
from rpil.demonstrations import PIECE_STEPS, Demonstrations
from rpil.engines import InMemory, Streamed
from rpil.large import sample

ADVERSARIES = ["uniform", "marginal", "normalised complement", "confusion", "own policy"]


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


@pytest.mark.parametrize("kind", ["random", "noisy"])
def test_numbers_are_learned_as_a_search_of_everything_learns_them(small, monkeypatch, kind):
    _, data = demonstrations(kind, maker=make_continuous)
    model = RPIL(adversary="uniform").fit(data)
    monkeypatch.setattr(large, "TIMES", 1e9)
    other = RPIL(adversary="uniform").fit(data)
    assert model.policy_.freedom == other.policy_.freedom
    np.testing.assert_allclose(model.policy_.cholesky, other.policy_.cholesky, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(model.coef_, other.coef_, atol=1e-3)


@pytest.mark.parametrize("adversary", ["marginal", "own policy"])
def test_what_the_sample_has_not_seen_is_learned_too(small, monkeypatch, adversary):
    toy, data = demonstrations(n_good=300, n_bad=150)
    actions, observations = np.array(data.actions), np.hstack([data.observations, np.zeros((data.n_steps, 1))])
    chosen = sample(data.lengths, np.zeros(450, dtype=int), 600, np.random.default_rng(0))
    rare = data.offsets[np.setdiff1d(np.arange(300), chosen)[[10, 20, 30]]]
    actions[np.concatenate([rare, rare + 1])] = 7
    observations[rare, -1] = 1.0
    data = Demonstrations.from_arrays(observations, actions, data.offsets, data.ids)
    labels = dict.fromkeys(toy.ids[:2], "expert") if adversary == "own policy" else None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = RPIL(adversary=adversary, labels=labels, features="raw").fit(data)
    assert model.converged_
    monkeypatch.setattr(large, "TIMES", 1e9)
    other = RPIL(adversary=adversary, labels=labels, features="raw").fit(data)
    assert model.audit_.verdicts == other.audit_.verdicts
    for one in (model, other):  # an intercept has no ridge: the policy does it as often as those it learns from
        weight = one.audit_.step_weight
        assert weight @ one.predict_proba(observations)[:, -1] == pytest.approx(weight @ (actions == 7), rel=0.02)


def test_the_papers_own_m_step_reads_everything(small):
    """It promises no ascent, which passes rely on."""
    _, data = demonstrations()
    assert not large.is_large(RPIL(adversary="complement", m_step="expert_only").fit(data), data)


def test_steps_of_class_blocks_are_not_twice_too_long(small, monkeypatch):
    _, data = demonstrations()
    data = Demonstrations.from_arrays(data.observations, data.actions == 0, data.offsets, data.ids)
    whole = RPIL(adversary="marginal", tol=1e-5).fit(data)
    monkeypatch.setattr("rpil.solvers._LARGEST", 1)
    blocks = RPIL(adversary="marginal", tol=1e-5).fit(data)
    assert blocks.n_iter_ <= 2 * whole.n_iter_ + 2
    assert blocks.lower_bound_ == pytest.approx(whole.lower_bound_, abs=0.05)


def test_labels_of_one_sort_leave_room_for_the_others(small, recwarn):
    toy, data = demonstrations("flipped", 1, n_good=100, n_bad=100)
    labels = dict.fromkeys(toy.ids[100:160], "adversary")
    model = RPIL(labels=labels).fit(data)
    np.testing.assert_array_equal(np.array(model.audit_.verdicts) == "expert", toy.is_good)
    assert not [w for w in recwarn if w.category is RuntimeWarning]


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
    assert len(chosen) == 2 + 100
    assert (np.diff(chosen) > 0).all()


def test_a_sample_holds_more_than_labels():
    rng = np.random.default_rng(0)
    labels = np.repeat([1, -1, 0], 2000)
    chosen = sample(np.full(6000, 100), labels, 20_000, rng)
    np.testing.assert_array_equal(np.bincount(labels[chosen] + 1), [200, 200, 200])


@pytest.mark.parametrize("engine", [InMemory(), Streamed()])
def test_it_is_saved(small, engine, tmp_path):
    _, data = demonstrations()
    model = RPIL(engine=engine, adversary="marginal").fit(data)
    save(model, tmp_path / "policy")
    back = load(tmp_path / "policy")
    np.testing.assert_array_equal(back.audit_.step_weight, model.audit_.step_weight)
    np.testing.assert_array_equal(back.predict_proba(data.observations), model.predict_proba(data.observations))
    assert back.audit_.suggest_labels(2) == model.audit_.suggest_labels(2)


def test_an_interrupted_fit_goes_on_to_the_same_bits(small, tmp_path):
    _, data = demonstrations("noisy", 1)
    path = tmp_path / "so far"
    settings = {"adversary": "confusion", "tol": 1e-7}
    whole = RPIL(**settings).fit(data)

    def interrupt(stage: str) -> None:
        if stage.startswith("pass 4"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        RPIL(**settings, checkpoint=path, progress=interrupt).fit(data)
    assert path.exists()
    stages: list[str] = []
    again = RPIL(**settings, checkpoint=path, progress=stages.append).fit(data)
    assert not path.exists()
    assert stages[1].startswith("pass 4")  # no search, and no pass twice
    np.testing.assert_array_equal(again.audit_.history, whole.audit_.history)
    np.testing.assert_array_equal(again.log_odds_, whole.log_odds_)
    np.testing.assert_array_equal(again.coef_, whole.coef_)


def test_a_checkpoint_of_another_fit_is_refused(small, tmp_path):
    _, data = demonstrations("noisy", 1)
    path = tmp_path / "so far"

    def interrupt(stage: str) -> None:
        if stage.startswith("pass 2"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        RPIL(adversary="marginal", checkpoint=path, progress=interrupt).fit(data)
    with pytest.raises(DataError, match="other settings; delete it"):
        RPIL(adversary="uniform", checkpoint=path).fit(data)
    path.write_bytes(b"something else")
    with pytest.raises(DataError, match="no checkpoint"):
        RPIL(adversary="marginal", checkpoint=path).fit(data)
    assert path.read_bytes() == b"something else"


def test_the_time_left_is_told(small):
    _, data = demonstrations("noisy", 1)
    stages: list[str] = []
    RPIL(adversary="confusion", tol=1e-7, progress=stages.append).fit(data)
    assert any(re.search(r"^pass \d+ over everything, objective -[\d.e+]+, about \d+ s left$", s) for s in stages)
