"""Passes on tensors say what NumPy's say, on a CPU always and on a GPU where there is one."""

from __future__ import annotations

import copy
import sys
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from problems import make, make_continuous, zoo
from rpil import RPIL, DataError, Demonstrations, TorchEngine, large
from rpil.errors import MissingExtraError
from rpil.large import Weigh, measure
from rpil.passes import linear
from rpil.policies import SoftmaxPolicy, linear_policy
from rpil.polish import clone_pass

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")

from rpil.tensors import Device  # noqa: E402

DEVICES = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
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
    problem = problem_of(name, False)
    start = linear_policy(problem.space, np.full(problem.features.shape[1], 0.1), len(problem.actions))
    return start.learn(problem, np.ones(len(problem.actions)), max_iter=3)[0]


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
    monkeypatch.setattr("rpil.tensors._ROWS", 32)
    return Device(request.param)


def faster(device, function):
    way = device.faster(function)
    assert way is not None
    return way


@pytest.mark.parametrize("name", ZOO)
def test_a_clone_pass(device, name):
    for single, rtol in ((True, 1e-5), (False, 1e-10)):
        problem = problem_of(name, single)
        weight = np.random.default_rng(0).random(len(problem.actions))
        one_pass = partial(clone_pass, policy=policy_of(name))
        lesson = problem, weight, weight
        same(faster(device, one_pass)(lesson), one_pass(lesson), rtol, size(problem))


def test_what_has_no_way_on_tensors_is_left_to_numpy(device):
    continuous = make_continuous("random", 0).problem()
    student = linear_policy(continuous.space, np.full(continuous.features.shape[1], 0.1), len(continuous.actions))
    assert device.faster(partial(clone_pass, policy=policy_of("random"))) is not None
    for function in (linear, partial(measure, judge=None), Weigh(None, None, None, 1.0), partial(linear, weights=None)):
        assert device.faster(function) is None
    assert device.faster(partial(clone_pass, policy=student)) is None

    class Own(SoftmaxPolicy):
        """Another class may do something else."""

    assert device.faster(partial(clone_pass, policy=Own.zero(3, np.ones(2)))) is None


def test_the_design_is_kept_while_its_problem_is(device):
    problem = problem_of("random")
    one_pass = partial(clone_pass, policy=policy_of("random"))
    weight = np.ones(len(problem.actions))
    faster(device, one_pass)((problem, weight, weight))
    first = device.held(problem)
    faster(device, one_pass)((problem, 2 * weight, weight))
    assert device.held(problem) is first
    assert len(device._held) == 1
    del problem, first
    assert not device._held


def demonstrations(kind="noisy", seed=0, maker=make):
    toy = maker(kind, seed, n_good=80, n_bad=40, steps=(20, 60))
    return Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets, toy.ids)


@pytest.mark.parametrize("where", DEVICES)
@pytest.mark.parametrize("kind", ["random", "noisy"])
def test_a_fit_on_tensors_is_the_fit_in_memory(small, monkeypatch, where, kind):
    monkeypatch.setattr(large, "REFIT_TOL", 1e-9)  # to the end, or one may stop a step before the other
    data = demonstrations(kind)
    here = RPIL().fit(data)
    used = []
    original = Device.faster
    monkeypatch.setattr(Device, "faster", lambda d, f: used.append(way := original(d, f)) or way)
    there = RPIL(engine=TorchEngine(where)).fit(data)
    assert large.is_large(there, data)
    assert sum(way is not None for way in used) > 2
    assert there.audit_.verdicts == here.audit_.verdicts
    for name in ("log_odds", "expert_proba", "reliability", "history", "step_weight", "step_log_ratio"):
        np.testing.assert_array_equal(getattr(there.audit_, name), getattr(here.audit_, name))
    same(there.coef_, here.coef_, 1e-5)
    assert (there.coef_ != here.coef_).any()  # it was fitted on tensors


def test_the_same_bits_every_time(small):
    data = demonstrations()
    one, other = (RPIL(engine=TorchEngine("cpu")).fit(data) for _ in range(2))
    np.testing.assert_array_equal(one.coef_, other.coef_)
    np.testing.assert_array_equal(one.log_odds_, other.log_odds_)


def test_the_bits_do_not_depend_on_the_cores(small, monkeypatch):
    data = demonstrations()
    fits = []
    for n_cores in (1, 2):
        monkeypatch.setattr("rpil.engines.memory.cores", lambda n=n_cores: n)
        fits.append(RPIL(engine=TorchEngine("cpu")).fit(data))
    np.testing.assert_array_equal(fits[0].coef_, fits[1].coef_)
    np.testing.assert_array_equal(fits[0].log_odds_, fits[1].log_odds_)


def test_continuous_actions_are_fitted_as_without_an_engine(small):
    data = demonstrations(maker=make_continuous)
    here, there = (RPIL(engine=e).fit(data) for e in (None, TorchEngine("cpu")))
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
        RPIL(engine=TorchEngine("cpu")).fit(demonstrations())


def test_no_torch_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"TorchEngine needs .*rpil\[torch\]"):
        TorchEngine("cpu")
