import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression
from sklearn.tree import DecisionTreeClassifier

from archives import mountain_car, npy, refused, rewrite
from rpil import RPIL, BehavioralCloning, Confusion, RMEnt, load, save
from rpil.data.errors import DataError
from rpil.mixture.adversaries.discrete import Uniform
from small import mixture as mixture_settings


@pytest.fixture(scope="module")
def data():
    return mountain_car()


@pytest.mark.parametrize(
    "estimator",
    [
        RPIL(labels={"é0": "good", "é7": "bad"}, random_state=5),
        RPIL("folded", adversary="marginal", settings=mixture_settings(prior=0.5, m_step="expert_only")),
        RPIL(adversary=Confusion.given(np.full((3, 3), 1 / 3)), progress=print),
        BehavioralCloning(features="folded", C=3.0),
    ],
)
def test_loaded_estimator_predicts_the_same_bits(estimator, data, tmp_path):
    estimator.fit(data)
    path = tmp_path / "any.name"
    save(estimator, path)
    loaded = load(path)
    assert type(loaded) is type(estimator)
    states = np.random.default_rng(0).normal(size=(300, 2))
    for method in ("predict", "predict_proba", "predict_log_proba"):
        np.testing.assert_array_equal(getattr(loaded, method)(states), getattr(estimator, method)(states))
    for name in ("coef_", "intercept_", "classes_", "n_features_in_", "observation_names_"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(estimator, name))
    ours, theirs = (
        loaded.get_params(),
        estimator.get_params() | ({"progress": None} if "progress" in vars(estimator) else {}),
    )
    adversary = ours.pop("adversary", None), theirs.pop("adversary", None)
    assert ours == theirs
    if isinstance(adversary[1], Confusion):
        np.testing.assert_array_equal(adversary[0].log_matrix, adversary[1].log_matrix)
        assert not adversary[0].learned
    else:
        assert adversary[0] == adversary[1]
    again = tmp_path / "again"
    save(loaded, again)
    assert again.read_bytes() == path.read_bytes()


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
    refused(path, "do not belong together")
    save(model, path)
    rewrite(path, header=lambda tree: tree["fitted"]["ids_"].pop())
    refused(path, "do not belong together")


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
    with pytest.raises(
        DataError, match="a LogisticRegression cannot be saved; save one of RPIL, RMEnt, BehavioralCloning"
    ):
        save(LogisticRegression(), tmp_path / "p")
    assert not list(tmp_path.iterdir())
