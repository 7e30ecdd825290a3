import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression
from sklearn.tree import DecisionTreeClassifier

import problems
from archives import LOST, mountain_car, npy, refused, rewrite
from rpil import RPIL, BehavioralCloning, RMEnt, load, save
from rpil.data.errors import DataError
from rpil.mixture.adversaries.discrete import Uniform


@pytest.fixture(scope="module")
def data():
    return mountain_car()


def test_a_loaded_rpil_has_the_state_of_its_mixture_and_no_audit(data, tmp_path):
    fitted = RPIL(adversary="uniform").fit(data)
    save(fitted, tmp_path / "p")
    loaded = load(tmp_path / "p")
    assert not hasattr(loaded, "audit_")
    np.testing.assert_array_equal(loaded.state_.prior.log, fitted.state_.prior.log)
    for name in ("n_iter_", "lower_bound_", "converged_"):
        assert getattr(loaded, name) == getattr(fitted, name)


def test_loaded_rment_has_the_same_weights(data, tmp_path):
    model = RMEnt(4, n_starts=2).fit(data)
    path = tmp_path / "p"
    save(model, path)
    loaded = load(path)
    for name in ("weights_", "log_likelihood_", "ids_", "objective_", "n_iter_", "converged_"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(model, name))
    rewrite(path, {"weights.npy": npy(np.ones(7))})
    refused(path, LOST)
    save(model, path)
    rewrite(path, header=lambda tree: tree["fitted"]["ids_"].pop())
    refused(path, LOST)


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
