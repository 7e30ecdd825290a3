"""Passes on tensors say what NumPy's say, on a CPU always and on a GPU where there is one."""

from __future__ import annotations

import copy
import sys
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from problems import LEVELS, make, make_continuous, pooled_state, zoo
from rpil import RPIL, Confusion, DataError, Demonstrations, TorchEngine, large
from rpil.adversaries import adversary
from rpil.demonstrations import Piece
from rpil.em import State, e_step
from rpil.errors import MissingExtraError
from rpil.large import Weigh
from rpil.passes import linear
from rpil.polish import clone_pass, em_pass
from rpil.priors import Share
from rpil.reliability import TwoBetas

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")

from rpil.tensors import Device  # noqa: E402

DEVICES = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
ADVERSARIES = ["constant", "uniform", "marginal", "complement", "normalised complement", "confusion"]
ZOO = zoo()


def test_on_a_gpu():
    if not torch.cuda.is_available():
        pytest.skip("there is no CUDA device here: every test of this file ran on the CPU alone")
    assert "cuda" in DEVICES


def problem_of(name, single=True):
    problem = ZOO[name].problem("folded")
    return replace(problem, features=problem.features.astype(np.float32)) if single else problem


@cache
def policy_of(name):
    return pooled_state(problem_of(name, False), "uniform", TwoBetas.start()).policy


def trained(name, which, level):
    """A state in which every part has something to say."""
    problem, policy = problem_of(name, False), policy_of(name)
    state = State(policy, adversary(which, problem.space, policy), Share(), LEVELS[level]())
    outputs = state.policy.outputs(problem.features)
    step = e_step(problem, state, outputs).step
    return replace(state, adversary=state.adversary.fit(problem, outputs, 1 - step))


def size(problem):
    """Of the terms in a gradient: where they cancel it is no more exact than they are."""
    return float(np.abs(problem.features).sum(axis=0).max())


def same(mine, other, rtol, scale=0.0):
    """The same sums, to a share of the largest entry of each, or a tenth of that share of `scale`."""
    if isinstance(other, tuple):
        assert isinstance(mine, tuple)
        for one, two in zip(mine, other, strict=True):
            same(one, two, rtol, scale)
        return
    mine, other = np.asarray(mine), np.asarray(other)
    assert mine.shape == other.shape
    infinite = ~np.isfinite(other)
    np.testing.assert_array_equal(mine[infinite], other[infinite])
    mine, other = mine[~infinite], other[~infinite]
    if other.size:
        np.testing.assert_allclose(mine, other, rtol=rtol, atol=rtol * max(np.abs(other).max(), 0.1 * scale))


@pytest.fixture(params=DEVICES)
def device(request, monkeypatch):
    monkeypatch.setattr("rpil.tensors._IN_CACHE", 50)  # so that chunks cut demonstrations
    monkeypatch.setattr("rpil.tensors._IN_MEMORY", 50)
    monkeypatch.setattr("rpil.tensors._ROWS", 32)
    return Device(request.param)


def faster(device, function):
    way = device.faster(function)
    assert way is not None
    return way


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("which", ADVERSARIES)
@pytest.mark.parametrize("name", ZOO)
def test_an_em_pass(device, name, which, level):
    for single, rtol in ((True, 1e-5), (False, 1e-10)):
        problem = problem_of(name, single)
        state = trained(name, which, level)
        for mode in ("joint", "expert_only"):
            one_pass = partial(em_pass, state=state, mode=mode)
            mine, numpys = faster(device, one_pass)(problem), one_pass(problem)
            same(mine[1], numpys[1], rtol, size(problem))
            same((mine[0], *mine[2:]), (numpys[0], *numpys[2:]), rtol)


@pytest.mark.parametrize("name", ZOO)
def test_a_clone_pass(device, name):
    for single, rtol in ((True, 1e-5), (False, 1e-10)):
        problem = problem_of(name, single)
        weight = np.random.default_rng(0).random(len(problem.actions))
        one_pass = partial(clone_pass, policy=policy_of(name))
        lesson = problem, weight, weight
        same(faster(device, one_pass)(lesson), one_pass(lesson), rtol, size(problem))


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("which", ADVERSARIES)
@pytest.mark.parametrize("name", ["noisy", "unequal lengths", "one step each", "labelled"])
def test_weights(device, name, which, level):
    problem = problem_of(name)
    state = trained(name, which, level)
    rng, n = np.random.default_rng(0), problem.n_demonstrations
    weigh = Weigh(state, rng.random(n), rng.random(n), 0.9, None)
    piece = Piece(0, problem.features, problem.actions, problem.offsets)
    mine, numpys = faster(device, weigh)((piece, problem)), weigh((piece, problem))
    assert mine[0] is problem
    same(mine[1:], numpys[1:], 1e-5)


def test_a_confusion_that_is_given_and_knows_no_way_out(device):
    problem = problem_of("random", single=False)
    never = np.array([[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.0, 1.0, 0.0]])
    never[:, 0] = 0.0
    never /= never.sum(axis=1, keepdims=True)
    state = replace(trained("random", "uniform", "both"), adversary=Confusion.given(never))
    one_pass = partial(em_pass, state=state, mode="joint")
    mine = faster(device, one_pass)(problem)
    assert np.isfinite(mine[0])
    same(mine, one_pass(problem), 1e-10)


def test_what_has_no_way_on_tensors_is_left_to_numpy(device):
    problem = problem_of("random")
    state = trained("random", "uniform", "both")
    assert device.faster(linear) is None
    own = trained("random", "own policy", "both")
    assert device.faster(partial(em_pass, state=own, mode="joint")) is None
    continuous = make_continuous("random", 0).problem()
    student = pooled_state(continuous, "uniform", TwoBetas.start())
    assert device.faster(partial(em_pass, state=student, mode="joint")) is None
    assert device.faster(partial(clone_pass, policy=student.policy)) is None
    weighted = replace(problem, weight=np.linspace(0.0, 1.0, len(problem.actions)))
    one_pass = partial(em_pass, state=state, mode="joint")
    same(faster(device, one_pass)(weighted), one_pass(weighted), 0.0)


def test_the_design_is_kept_while_its_problem_is(device):
    problem = problem_of("random")
    one_pass = partial(em_pass, state=trained("random", "uniform", "both"), mode="joint")
    faster(device, one_pass)(problem)
    first = device.held(problem)
    faster(device, one_pass)(problem)
    assert device.held(problem) is first
    assert len(device._held) == 1
    del problem, first
    assert not device._held


def demonstrations(kind="noisy", seed=0, maker=make):
    toy = maker(kind, seed, n_good=80, n_bad=40, steps=(20, 60))
    return Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets, toy.ids)


@pytest.mark.parametrize("where", DEVICES)
@pytest.mark.parametrize("which", ["uniform", "marginal", "normalised complement", "confusion", "own policy"])
def test_a_fit_on_tensors_is_the_fit_in_memory(small, monkeypatch, where, which):
    monkeypatch.setattr(large, "REFIT_TOL", 1e-9)  # to the end, or one may stop a step before the other
    data = demonstrations()
    settings = {"adversary": which, "labels": {"d0": "expert"} if which == "own policy" else None}
    here = RPIL(**settings).fit(data)
    used = []
    original = Device.faster
    monkeypatch.setattr(Device, "faster", lambda d, f: used.append(way := original(d, f)) or way)
    there = RPIL(**settings, engine=TorchEngine(where)).fit(data)
    assert large.is_large(there, data)
    assert sum(way is not None for way in used) > (0 if which == "own policy" else 4)
    assert there.audit_.verdicts == here.audit_.verdicts
    for name in ("log_odds", "expert_proba", "reliability", "history", "step_weight", "step_log_ratio"):
        same(getattr(there.audit_, name), getattr(here.audit_, name), 1e-5)
    same(there.coef_, here.coef_, 1e-5)


def test_the_same_bits_every_time(small):
    data = demonstrations()
    one, other = (RPIL(adversary="confusion", engine=TorchEngine("cpu")).fit(data) for _ in range(2))
    np.testing.assert_array_equal(one.coef_, other.coef_)
    np.testing.assert_array_equal(one.audit_.history, other.audit_.history)
    np.testing.assert_array_equal(one.log_odds_, other.log_odds_)


def test_the_bits_do_not_depend_on_the_cores(small, monkeypatch):
    data = demonstrations()
    fits = []
    for n_cores in (1, 2):
        monkeypatch.setattr("rpil.engines.memory.cores", lambda n=n_cores: n)
        fits.append(RPIL(adversary="marginal", engine=TorchEngine("cpu")).fit(data))
    np.testing.assert_array_equal(fits[0].coef_, fits[1].coef_)
    np.testing.assert_array_equal(fits[0].log_odds_, fits[1].log_odds_)


def test_continuous_actions_are_fitted_as_without_an_engine(small):
    data = demonstrations(maker=make_continuous)
    here, there = (RPIL(adversary="marginal", engine=e).fit(data) for e in (None, TorchEngine("cpu")))
    np.testing.assert_array_equal(there.coef_, here.coef_)
    np.testing.assert_array_equal(there.log_odds_, here.log_odds_)


def test_settings_can_be_copied():
    engine = TorchEngine("cpu")
    assert copy.deepcopy(engine) == engine
    assert engine.n_parts == 1


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_no_cuda_is_said_at_once():
    with pytest.raises(
        DataError, match=r"^device='cuda': torch finds no CUDA device .*use device='cpu' or leave engine"
    ):
        TorchEngine()


@pytest.mark.parametrize("name", ["no such thing", "meta"])
def test_no_device_is_said_at_once(name):
    with pytest.raises(DataError, match="finds no such device"):
        TorchEngine(name)


def test_too_little_memory_is_said(small, monkeypatch):
    def full(*_):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate much.")

    monkeypatch.setattr(Device, "held", full)
    with pytest.raises(DataError, match=r"do not fit into the memory of device='cpu'; leave engine out\.$"):
        RPIL(adversary="marginal", engine=TorchEngine("cpu")).fit(demonstrations())


def test_no_torch_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"TorchEngine needs .*rpil\[torch\]"):
        TorchEngine("cpu")
