"""Features are chosen by the trusted, for their actions, and the same every time."""

import numpy as np
import pytest

from problems import curved, told
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.estimators.cloning import BehavioralCloning
from rpil.policies import selection
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.policies.selection import FeatureChoice, choose_features
from rpil.policies.settings import SelectionSettings


def choose(observations, codes, offsets, weight=None):
    weight = np.ones(len(codes)) if weight is None else weight
    return choose_features(FitData(observations, codes, offsets, Discrete(2)), weight, None, SelectionSettings())


def straight(o):
    return o @ [1.0, -2.0] > 0.3


FOLDED, WAVY = (lambda o: np.abs(o[:, 0]) > 0.7, "folded"), (lambda o: np.sin(4 * o[:, 0]) > 0.0, "nystroem")


@pytest.mark.parametrize(("rule", "kind"), [FOLDED, WAVY, (curved, "nystroem")])
def test_the_kind_that_can_follow_the_rule_is_chosen(rule, kind):
    found = choose(*told(rule))
    assert found.kind == kind
    assert found.ridge in SelectionSettings.ridges


@pytest.mark.parametrize("seed", range(2))
def test_a_straight_rule_is_followed_whichever_kind_is_chosen(seed):
    """All kinds can, so that chance decides between them; what must not happen is that decisions get worse."""
    observations, codes, offsets = told(straight, seed=seed)
    data = Demonstrations(observations, codes, offsets)
    asked, right, _ = told(straight, seed=100 + seed)
    chosen, raw = (BehavioralCloning(features=kind).fit(data).score(asked, right) for kind in ("auto", "raw"))
    assert chosen >= raw - 0.005
    assert chosen >= 0.99


def test_the_untrusted_do_not_choose():
    observations, codes, offsets = told(curved, 16)
    bad = np.arange(len(codes)) >= offsets[4]  # three of four demonstrations follow another rule
    codes = np.where(bad, straight(observations), codes)
    of_bad = {weight: choose(observations, codes, offsets, np.where(bad, weight, 1.0)).kind for weight in (0, 0.05, 1)}
    assert of_bad[0] == of_bad[0.05] == "nystroem" != of_bad[1]
    observations, codes, offsets = told(curved, 9)  # of which one is like no other
    observations[offsets[8] :] += 30.0  # where nobody else was, and with random actions
    codes[offsets[8] :] = np.random.default_rng(1).integers(2, size=120)
    assert choose(observations, codes, offsets).kind == "nystroem"


def test_steps_far_off_do_not_teach_which_numbers_are_due():
    """Coefficients of the clean steps, where a tenth of the actions is many times too large."""
    rng = np.random.default_rng(0)
    design = np.column_stack([rng.normal(size=(500, 2)), np.ones(500)])
    right = np.array([[1.0, 0.0], [-2.0, 1.0], [0.5, 3.0]])
    actions = design @ right + 0.1 * rng.normal(size=(500, 2))
    actions[::10] += 20.0 * np.abs(design[::10, :1])
    (robust,) = selection._fit_least_squares(design, actions, np.ones(500), [np.full(3, 1e-6)], SelectionSettings())
    plain = np.linalg.lstsq(design, actions)[0]
    assert np.abs(robust - right).max() < 0.3 * np.abs(plain - right).max()
    # Nor do units of a part of the action say how well it is predicted.
    sample, values = selection._Sample(FitData.from_steps(design, actions, Box.around(actions)), np.ones(500)), []
    for units in ([1.0, 1.0], [1.0, 1e3]):
        of = design @ right * units, actions * units, sample, SelectionSettings()
        values.append(selection._assess_means(FeatureChoice("raw", 1.0), *of).value)
    assert values[0] == pytest.approx(values[1])


def test_as_good_is_less_accurate_by_a_standard_error_at_most_and_medians_are_weighted():
    best = selection._Candidate(FeatureChoice("raw", 1.0), 0.0, np.zeros(4))
    for loss, expected in ((0.577, True), (0.578, False)):  # of 1 / sqrt(3)
        worse = best._replace(accuracy=np.array([-1.0, 1.0] * 2) - loss)
        assert selection._is_as_good(worse, best, np.full(4, 0.5)) == expected
    assert [selection._median(np.array(of), np.ones(len(of))) for of in ([3.0, 1, 2], [4.0, 1, 3, 2])] == [2.0, 2.5]
    assert selection._median(np.arange(3.0), np.array([1.0, 1.0, 9.0])) == 2.0


def test_few_demonstrations_and_steps_are_enough():
    observations, codes, offsets = told(curved, 1, 300)
    assert choose(observations, codes, offsets).kind == "nystroem"
    found = choose(np.arange(6.0)[:, None], np.array([0, 0, 0, 1, 1, 1]), np.array([0, 3, 6]))
    assert isinstance(found, FeatureChoice)
    # One is held out and one is learned from, however long; of an only one the parts, without untrusted steps.
    few, weight = SelectionSettings(max_steps=1), np.where(np.arange(300) < 100, 0.0, 1.0)
    for bounds, n_steps in ((np.array([0, 60, 120, 180, 240, 300]), 120), (offsets, 200)):
        data = FitData(observations, codes, bounds, Discrete(2))
        assert len(selection._sample(data, np.ones(300) if len(bounds) > 2 else weight, few).data.actions) == n_steps


def test_nystroem_approximates_the_kernel():
    """With every row a landmark the features' inner products are the kernel."""
    rows = np.random.default_rng(0).normal(size=(60, 8))  # of fewer columns not all are needed
    found = FeatureMap.fit("nystroem", rows, settings=FeatureSettings())
    assert len(found.landmarks) == 60
    columns = found.design(rows)[:, 16:-1] * found.scale[16:] + found.center[16:]
    z = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    folded = np.hstack([z, np.abs(z)])
    squared = ((folded[:, None] - folded[None]) ** 2).sum(axis=2)
    np.testing.assert_allclose(columns @ columns.T, np.exp(-0.1 / 16 * squared), atol=1e-6)
    again = FeatureMap.fit("nystroem", rows, settings=FeatureSettings())
    np.testing.assert_array_equal(found.design(rows), again.design(rows))
