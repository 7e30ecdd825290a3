import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.linear_model import LogisticRegression
from sklearn.tree import DecisionTreeClassifier

import problems
from archives import LOST, mountain_car, npy, refused, rewrite
from rpil import RPIL, BehavioralCloning, RMEnt, load, save
from rpil.data.archive import encode
from rpil.data.errors import DataError
from rpil.mixture.adversaries.discrete import Uniform


@pytest.fixture(scope="module")
def data():
    return mountain_car()


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize(
    "model",
    [
        BehavioralCloning("folded", C=0.5, tol=1e-6), RPIL(features="nystroem", random_state=3),
        RPIL(adversary="uniform"), RMEnt(4, n_starts=2, max_iter=7, groups="rows"),
    ],
)  # fmt: skip
def test_all_of_a_loaded_estimator_is_as_it_was_saved(model, named, data, tmp_path):
    X = pd.DataFrame(data.observations, columns=["x", "v"]) if named else data.observations
    groups = {} if isinstance(model, BehavioralCloning) else {"groups": data.groups}
    fitted = clone(model).fit(X, data.actions, **groups)
    save(fitted, tmp_path / "p")
    loaded = load(tmp_path / "p")
    assert "audit_" not in vars(loaded)
    for name in {*vars(fitted)} - {"audit_", "progress", "engine", "expert_proba_", "feature_names_in_"}:
        found, expected = {}, {}
        assert encode(getattr(loaded, name), "", found) == encode(getattr(fitted, name), "", expected)
        np.testing.assert_equal(found, expected)
    assert [*getattr(loaded, "feature_names_in_", "xv")] == ["x", "v"]
    assert hasattr(loaded, "feature_names_in_") is named
    np.testing.assert_array_equal(loaded.predict_proba(X), fitted.predict_proba(X))
    np.testing.assert_array_equal(loaded.predict(X), loaded.classes_[loaded.predict_proba(X).argmax(axis=1)])
    own = loaded.predict_proba(X)[np.arange(len(X)), np.searchsorted(loaded.classes_, data.actions)]
    np.testing.assert_allclose(loaded.log_prob(X, data.actions), np.log(own))
    assert loaded.score(X, data.actions) == np.mean(loaded.predict(X) == data.actions)


def test_weights_and_ids_are_of_the_same_demonstrations(data, tmp_path):
    for members, header in (({"weights.npy": npy(np.ones(7))}, None), ({}, lambda tree: tree["fitted"]["ids_"].pop())):
        save(RMEnt(4, n_starts=1).fit(data), tmp_path / "p")
        rewrite(tmp_path / "p", members, header)
        refused(tmp_path / "p", LOST)


@pytest.mark.parametrize("low", [-np.inf, np.nan, 1.0])
def test_bounds_of_actions_are_finite_and_in_order(low, tmp_path):
    save(BehavioralCloning().fit(np.arange(20.0)[:, None], np.linspace(0, 1, 20)[:, None]), tmp_path / "p")
    assert load(tmp_path / "p").space_.low == [0.0]
    rewrite(tmp_path / "p", {"space/low.npy": npy(np.array([low]))})
    refused(tmp_path / "p", LOST)


@pytest.mark.parametrize(
    "actions", [["left", "right"], np.array(["left", "right"], dtype=object), [True, False], [2.0, 5.0]]
)
def test_classes_of_every_type_are_saved(actions, tmp_path):
    rng = np.random.default_rng(0)
    X, codes = rng.normal(size=(50, 2)), rng.integers(2, size=50)
    y = np.asarray(actions)[codes]
    model = BehavioralCloning().fit(X, y)
    save(model, tmp_path / "p")
    loaded = load(tmp_path / "p")
    assert loaded.predict(X).tolist() == model.predict(X).tolist()
    assert not hasattr(loaded, "feature_names_in_")


class MyAdversary(Uniform):
    """A user's own."""


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")  # trees change by leaps
@pytest.mark.parametrize("part", [{"policy": DecisionTreeClassifier(max_depth=3)}, {"adversary": MyAdversary()}])
def test_save_refuses_a_part_of_another_class(part, data, tmp_path):
    name = type(*part.values()).__name__
    with pytest.raises(DataError, match=f"a {name} cannot be saved without pickle; leave it out, or keep"):
        save(RPIL(**part).fit(data), tmp_path / "p")
    assert not list(tmp_path.iterdir())


def test_save_refuses_other_and_unfitted_estimators(tmp_path):
    from sklearn.exceptions import NotFittedError

    with pytest.raises(NotFittedError):
        save(RPIL(), tmp_path / "p")
    with problems.refused("a LogisticRegression cannot be saved; save one of RPIL, RMEnt, BehavioralCloning"):
        save(LogisticRegression(), tmp_path / "p")
    assert not list(tmp_path.iterdir())
