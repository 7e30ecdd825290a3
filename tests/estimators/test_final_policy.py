"""The final policy: its features and ridge are chosen by the trusted demonstrations."""

from __future__ import annotations

import numpy as np

from problems import curved, told
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.estimators.cloning import BehavioralCloning
from rpil.policies.features import FeatureSettings
from rpil.policies.selection import choose_features
from rpil.policies.settings import SelectionSettings


def test_cloning_takes_what_is_chosen():
    observations, codes, offsets = told(curved)
    data = Demonstrations(observations, codes, offsets)
    steps = FitData(observations, codes, offsets, Discrete(2))
    chosen = choose_features(steps, np.ones(len(codes)), None, SelectionSettings())
    model = BehavioralCloning("auto").fit(data)
    assert (model.features_.kind, model.features_.ridge_per_step) == (chosen.kind, chosen.ridge)
    fixed = BehavioralCloning("nystroem").fit(data)
    assert fixed.features_.ridge_per_step == FeatureSettings.ridge_per_step
    assert np.mean(model.predict(observations) == codes) > 0.97
    rows = BehavioralCloning("auto").fit(observations, codes)  # every row is held out on its own
    assert rows.features_.kind == "nystroem"
