"""The training group."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from hand_made import Written, same_actions, scoring_of
from rpil.inference.scores import choose_ridge
from rpil.inference.settings import JudgeSettings, TrimmingSettings

EVERYONE = np.ones(6, dtype=bool)


def scoring(gains, *trimming):
    return scoring_of(same_actions(6), gains, JudgeSettings(trimming=TrimmingSettings(*trimming)))


def test_best_explained_are_the_first_of_equals():
    fit = scoring(lambda group: np.zeros(6), 0.5).fit_trimmed()
    assert np.flatnonzero(fit.group).tolist() == [0, 1, 2]


def test_concentration_steps_end_where_the_group_stays():
    ends = [[0, 1, 2], [1, 2, 3], [2, 3, 4], [2, 3, 4]]

    def gains(group):
        step = 0 if group.all() else 1 + ends.index(np.flatnonzero(group).tolist())
        return np.isin(np.arange(6), ends[min(step, 3)]) * (1.0 + step)

    some = scoring(gains, 0.5, 9)
    fit = some.fit_trimmed()
    assert [np.flatnonzero(group).tolist() for group in some.model.fitted] == [list(range(6)), *ends[:3]]
    assert np.flatnonzero(fit.group).tolist() == [2, 3, 4]
    base = some.data.mean_steps(fit.log_prob).min()
    np.testing.assert_allclose(fit.history - base, [0.5, 4 / 3, 2.0, 4.0])
    assert fit.ridge == 1e-2
    short = scoring(gains, 0.5, 1).fit_trimmed()
    assert (np.flatnonzero(short.group).tolist(), len(short.history)) == ([0, 1, 2], 2)


@pytest.mark.parametrize(("share", "count"), [(0.6, 4), (0.5, 3), (0.01, 2)])
def test_a_training_group_has_its_share_and_two_at_least(share, count):
    fit = scoring(lambda group: np.arange(6.0), share).fit_trimmed()
    assert fit.group.sum() == count


class Ridges(Written):
    """Ridges, the strongest first, with the gain of each demonstration."""

    explained: ClassVar = {1.0: [0, 0, 0, 0, 0, 9], 0.1: [1, 1, 1, -9, -9, -9], 0.01: [-1, -1, -1, 9, 9, 9]}

    @property
    def ridges(self):
        return tuple(self.explained)

    def evaluate(self, weight, ridge):
        self.fitted.append(ridge)
        return self.data.per_step(np.array(self.explained[ridge], dtype=float))


def ridge_of(group):
    model = Ridges(same_actions(6), lambda group: 0.0, JudgeSettings())
    return choose_ridge(model.data, model, group), model.fitted


def test_ridge_is_that_of_the_median_demonstration_of_the_group(monkeypatch):
    assert ridge_of(np.arange(6) < 3) == (0.1, [1.0, 0.1, 0.01])
    assert ridge_of(np.arange(6) < 5) == (0.1, [1.0, 0.1, 0.01])
    # the search ends where a weaker ridge explains no more
    assert ridge_of(np.arange(6) >= 3) == (1.0, [1.0, 0.1])
    monkeypatch.setattr(Ridges, "explained", {1.0: [0] * 6, 0.1: [0] * 6, 0.01: [1] * 6})
    assert ridge_of(EVERYONE) == (1.0, [1.0, 0.1])
    monkeypatch.setattr(Ridges, "explained", {1.0: [0] * 6, 0.1: [1] * 6, 0.01: [2] * 6})
    assert ridge_of(EVERYONE) == (0.01, [1.0, 0.1, 0.01])
    without = scoring(lambda group: 0.0)
    assert choose_ridge(without.data, without.model, EVERYONE) == 0.0
