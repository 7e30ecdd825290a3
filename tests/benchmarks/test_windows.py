"""The benchmark of demonstrations with a window of bad steps."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

import windows
from problems import make
from rpil.data.errors import DataError
from value.operators import GOOD
from value.rules import Judged

needs_arm = pytest.mark.skipif(
    importlib.util.find_spec("metaworld") is None, reason="pip install 'rpil[value]': metaworld is missing"
)


def bad_of_demonstrations(world):
    return np.split(world.is_bad, np.cumsum(world.demonstrations.lengths)[:-1])


def test_the_window_of_a_game_is_an_unbroken_half_of_half_of_the_demonstrations():
    pytest.importorskip("gymnasium", reason="pip install 'rpil[gym]': gymnasium is missing")
    world = windows.make_world("MountainCar-v0", windows.RANDOM, 6, 0)
    again = windows.make_world("MountainCar-v0", windows.RANDOM, 6, 0)
    np.testing.assert_array_equal(again.demonstrations.actions, world.demonstrations.actions)
    assert world.has_window.sum() == 3
    for is_bad, has_window in zip(bad_of_demonstrations(world), world.has_window, strict=True):
        assert is_bad.any() == has_window
        assert np.count_nonzero(np.diff(is_bad.astype(int))) <= 2
        assert is_bad.mean() == pytest.approx(0.5 * has_window, abs=0.05)


@pytest.mark.slow
@needs_arm
@pytest.mark.filterwarnings("ignore")  # of packages that the arm comes with
def test_the_arm_pauses_in_its_window_alone():
    world = windows.make_world("reach", "pause", 4, 0)
    motion = np.abs(world.demonstrations.actions[:, :3])
    assert motion[world.is_bad].max() < 6 * GOOD["normal"].tremor
    assert motion[~world.is_bad].max() == 1
    assert [is_bad.any() for is_bad in bad_of_demonstrations(world)] == world.has_window.tolist()
    assert max(is_bad.sum() for is_bad in bad_of_demonstrations(world)) <= windows.LENGTH


def test_an_operator_who_never_succeeds_is_refused(monkeypatch):
    tried = []

    def failed(task, employed, seed):
        tried.append(seed)
        return (np.zeros((5, 3)), np.zeros((5, 4))), False

    monkeypatch.setattr(windows, "record_arm", failed)
    with pytest.raises(DataError, match="in 20 episodes; choose another task, kind or seed"):
        windows.make_world("reach", "pause", 4, 0)
    assert len(tried) == windows.TRIES


def test_figures_are_means_and_standard_errors():
    assert windows.figures(np.array([[1.0, 5.0], [3.0, 5.0]])) == ["2.00 ± 1.00", "5.00 ± 0.00"]
    assert windows.figures(np.array([[0.25]])) == ["0.25 ± nan"]


def test_other_constants_give_other_probabilities_of_steps():
    toy = make("random", 3, n_good=7, n_bad=4, steps=(13, 13))
    found = windows.scores_of(Judged(toy.demonstrations))
    assert found.keys() > windows.OTHERS.keys()
    assert all(np.abs(found[name] - found["P(step)"]).max() > 1e-4 for name in windows.OTHERS)


@pytest.mark.slow
def test_the_quick_mode_prints_a_row_for_its_world(capsys):
    pytest.importorskip("gymnasium", reason="pip install 'rpil[gym]': gymnasium is missing")
    assert windows.main(["--quick"]) == 0
    assert "| MountainCar-v0 random |" in capsys.readouterr().out
