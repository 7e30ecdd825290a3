"""The benchmark of demonstrations with a window of bad steps."""

from __future__ import annotations

import numpy as np
import pytest

import windows


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


def test_figures_are_means_and_standard_errors():
    assert windows.figures(np.array([[1.0, 5.0], [3.0, 5.0]])) == ["2.00 ± 1.00", "5.00 ± 0.00"]
    assert windows.figures(np.array([[0.25]])) == ["0.25 ± nan"]


@pytest.mark.slow
def test_the_quick_mode_prints_a_row_for_its_world(capsys):
    pytest.importorskip("gymnasium", reason="pip install 'rpil[gym]': gymnasium is missing")
    assert windows.main(["--quick"]) == 0
    assert "| MountainCar-v0 random |" in capsys.readouterr().out
