import io
import json
import pickle
import zipfile

import numpy as np
import pytest

from rpil import RPIL, BehavioralCloning, Confusion, Demonstrations, RMEnt, Settings, load, save
from rpil.data.errors import DataError
from rpil.mixture.adversaries.discrete import Uniform
from rpil.scale.ascent import AscentState
from rpil.scale.checkpoint import Checkpoint
from rpil.simulation.simulate import simulate
from small import mixture as mixture_settings


class MyAdversary(Uniform):
    """A user's own."""


@pytest.fixture(scope="module")
def data():
    made = simulate("MountainCar-v0", "corrupted", n_good=4, n_bad=4, seed=0)
    return Demonstrations.from_episodes(
        made.episodes, ids=[f"é{m}" for m in range(8)], observation_names=["x", "v"], source="mc"
    )


@pytest.fixture(scope="module")
def fitted(data):
    return RPIL().fit(data)


@pytest.fixture(scope="module")
def mixture(data):
    return RPIL(adversary="uniform").fit(data)


@pytest.fixture
def saved(fitted, tmp_path):
    path = tmp_path / "policy.rpil"
    save(fitted, path)
    return path


@pytest.fixture
def saved_mixture(mixture, tmp_path):
    path = tmp_path / "mixture.rpil"
    save(mixture, path)
    return path


def members(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def rewrite(path, changes=(), header=None):
    """Write the archive again with other members (None: without), and with the header changed in place."""
    content = members(path) | dict(changes)
    if header is not None:
        tree = json.loads(content["header.json"])
        header(tree)
        content["header.json"] = json.dumps(tree).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, part in content.items():
            if part is not None:
                archive.writestr(name, part)


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def refused(path, match):
    """Loading fails with one sentence that names the file and the remedy."""
    with pytest.raises(DataError, match=match) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert message.endswith(".")
    assert ". " not in message
    assert ";" in message


@pytest.mark.parametrize(
    "estimator",
    [
        RPIL(labels={"é0": "expert", "é7": "adversary"}, minority="trust", random_state=5),
        RPIL(features="spline", settings=Settings(judge_features="poly")),
        RPIL(adversary="uniform", settings=mixture_settings(prior=(3, 2))),
        RPIL(features="spline", adversary="own policy"),
        RPIL(
            features="poly",
            adversary="marginal",
            settings=mixture_settings(prior=0.5, m_step="expert_only"),
        ),
        RPIL(adversary="normalised complement"),
        RPIL(adversary=Confusion.given(np.full((3, 3), 1 / 3)), progress=print),
        RMEnt(n_trusted=5, n_starts=2),
        BehavioralCloning(features="poly", C=3.0),
        BehavioralCloning(features="spline"),
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


@pytest.mark.parametrize("kind", ["fitted", "mixture"])
def test_loaded_rpil_has_the_same_audit_and_scores(kind, data, tmp_path, request):
    fitted = request.getfixturevalue(kind)
    save(fitted, tmp_path / "p")
    loaded = load(tmp_path / "p")
    assert loaded.audit_.to_dict() == fitted.audit_.to_dict()
    for name in ("ids", "finding", "verdicts", "competing", "to_label", "assumptions", "prior"):
        assert getattr(loaded.audit_, name) == getattr(fitted.audit_, name)
    for name in ("offsets", "step_log_ratio", "step_weight", "reliability_interval", "history", "from_actions"):
        np.testing.assert_array_equal(getattr(loaded.audit_, name), getattr(fitted.audit_, name))
    np.testing.assert_array_equal(loaded.score_demonstrations(data), fitted.score_demonstrations(data))
    assert (loaded.judge_ is None) == (kind == "mixture") == (loaded.state_ is not None)
    assert (loaded.n_iter_, loaded.lower_bound_, loaded.converged_) == (
        fitted.n_iter_,
        fitted.lower_bound_,
        fitted.converged_,
    )


def test_loaded_judge_of_continuous_actions_scores_the_same(tmp_path):
    rng = np.random.default_rng(0)
    X = rng.normal(size=(400, 3))
    y = X[:, :2] + np.where(np.arange(400) < 240, 0.1, 2.0)[:, None] * rng.normal(size=(400, 2))
    data = Demonstrations.from_arrays(X, y, np.arange(0, 401, 40))
    model = RPIL().fit(data)
    save(model, tmp_path / "p")
    loaded = load(tmp_path / "p")
    assert type(loaded.judge_.scale).__name__ == "StudentRatio"
    np.testing.assert_array_equal(loaded.score_demonstrations(data), model.score_demonstrations(data))
    rewrite(tmp_path / "p", {"judge/scale/width.npy": npy(np.ones(3))})
    refused(tmp_path / "p", LOST)


def test_loaded_rment_has_the_same_weights(data, tmp_path):
    model = RMEnt(4).fit(data)
    path = tmp_path / "p"
    save(model, path)
    loaded = load(path)
    for name in ("weights_", "log_likelihood_"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(model, name))
    for name in ("ids_", "objective_", "n_iter_", "converged_"):
        assert getattr(loaded, name) == getattr(model, name)
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


def test_save_refuses_an_adversary_of_the_users_class(data, tmp_path):
    model = RPIL(adversary=MyAdversary()).fit(data)
    with pytest.raises(DataError, match="an adversary of the class MyAdversary cannot be saved without pickle; keep"):
        save(model, tmp_path / "p")
    assert not list(tmp_path.iterdir())


def test_save_refuses_other_and_unfitted_estimators(tmp_path):
    from sklearn.exceptions import NotFittedError
    from sklearn.linear_model import LogisticRegression

    with pytest.raises(NotFittedError):
        save(RPIL(), tmp_path / "p")
    with pytest.raises(
        DataError, match="a LogisticRegression cannot be saved; save one of RPIL, RMEnt, BehavioralCloning"
    ):
        save(LogisticRegression(), tmp_path / "p")
    assert not list(tmp_path.iterdir())


def test_failed_save_keeps_the_existing_file(fitted, saved, monkeypatch):
    before = saved.read_bytes()
    monkeypatch.setattr(zipfile.ZipFile, "writestr", lambda *args: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(DataError, match="No space left"):
        save(fitted, saved)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_load_refuses_a_missing_file(tmp_path):
    refused(tmp_path / "nothing", "there is no such file")


def test_load_refuses_an_empty_file(tmp_path):
    (tmp_path / "empty").touch()
    refused(tmp_path / "empty", "empty")


@pytest.mark.parametrize("content", [b"hello", pickle.dumps({"a": 1}), npy(np.ones(3)), npy(np.array([{}]))])
def test_load_refuses_other_files(content, tmp_path):
    path = tmp_path / "other"
    path.write_bytes(content)
    refused(path, "no policy that rpil saved")


def test_load_refuses_an_archive_of_demonstrations(tmp_path):
    np.savez(tmp_path / "d.npz", observations=np.ones((2, 2)))
    refused(tmp_path / "d.npz", "no policy that rpil saved; make one with rpil fit")


def test_load_refuses_truncated_and_damaged_files(saved):
    content = saved.read_bytes()
    for n in (5, 100, len(content) // 2, len(content) - 1):
        saved.write_bytes(content[:n])
        refused(saved, "damaged or truncated")
    middle = content.index(b"policy/weights.npy") + 200
    saved.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    refused(saved, "damaged or truncated")


@pytest.mark.parametrize(
    ("field", "value", "match"),
    [
        ("schema", "other", "no policy that rpil saved"),
        ("version", 1, r"version 1 of the format, but rpil .* reads version 6; use"),
        ("version", 3, r"version 3 of the format, but rpil .* reads version 6; use"),
        ("version", None, "version None"),
        ("class", "GaussianPolicy", "holds a 'GaussianPolicy', which rpil .* does not know"),
    ],
)
def test_load_refuses_unknown_schemas_versions_and_classes(saved, field, value, match):
    rewrite(saved, header=lambda tree: tree.update({field: value}))
    refused(saved, match)


WEIGHTS = "policy/weights.npy"
LOST = "do not belong together"


@pytest.mark.parametrize(
    ("member", "array"),
    [
        (WEIGHTS, None),
        ("audit/log_odds.npy", None),
        ("audit/from_label.npy", None),
        ("audit/from_actions.npy", np.ones(7)),
        ("judge/scale/weights.npy", None),
        ("judge/scale/weights.npy", np.ones((3, 3))),
        ("judge/scale/frequency.npy", np.ones(2)),
        ("judge/groups/mean.npy", np.ones(3)),
        ("judge/groups/quantiles.npy", np.ones((2, 2))),
        ("judge/groups/spread.npy", np.array([-9.0, -9.0])),
        ("more.npy", np.ones(3)),
        (WEIGHTS, np.ones((3, 3), dtype=np.float32)),
        (WEIGHTS, np.ones((3, 3), dtype=np.int64)),
        (WEIGHTS, np.ones((4, 3))),
        (WEIGHTS, np.ones((3, 2))),
        (WEIGHTS, np.ones(9)),
        (WEIGHTS, np.full((3, 3), np.nan)),
        (WEIGHTS, np.full((3, 3), np.inf)),
        ("features/scale.npy", np.ones(1)),
        ("features/location.npy", np.ones(3)),
        ("classes.npy", np.arange(4)),
        ("classes.npy", np.array([2, 1, 0])),
        ("audit/offsets.npy", np.arange(9.0)),
        ("audit/offsets.npy", np.arange(9)),
        ("audit/step_weight.npy", np.ones(7)),
        ("audit/log_odds.npy", np.ones(7)),
    ],
)
def test_load_refuses_missing_extra_and_misshapen_arrays(saved, member, array):
    rewrite(saved, {member: None if array is None else npy(array)})
    refused(saved, LOST)


def set_in(tree, path, value):
    *parents, last = path
    for key in parents:
        tree = tree[key]
    if value is ...:
        del tree[last]
    else:
        tree[last] = value


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("params", "colour"), "red"),
        (("fitted", "policy_"), ...),
        (("fitted", "more_"), 1),
        (("fitted", "policy_", "class"), "os.system"),
        (("fitted", "policy_", "fields", "more"), 1),
        (("fitted", "policy_", "fields", "ridge"), ...),
        (("fitted", "features_", "fields", "kind"), "spline"),
        (("fitted", "audit_", "fields", "ids"), [1, 2]),
        (("fitted", "audit_", "fields", "deviations"), ["it takes action 1"]),
        (("fitted", "audit_", "fields", "deviations"), 3),
        (("fitted", "audit_", "fields", "labelled"), ...),
        (("fitted", "audit_"), 3),
        (("fitted", "audit_", "fields", "finding"), "all is well"),
        (("fitted", "judge_"), None),
        (("fitted", "judge_", "fields", "groups"), None),
        (("fitted", "judge_", "fields", "scale"), None),
        (("fitted", "judge_", "fields", "pooled"), "a"),
        (("fitted", "judge_features_"), None),
        (("names", "observation_names_"), ["x"]),
        (("names", "predict"), ["x", "y"]),
        (("classes",), None),
        (("params",), None),
    ],
)
def test_load_refuses_inconsistent_headers(saved, path, value):
    rewrite(saved, header=lambda tree: set_in(tree, path, value))
    refused(saved, LOST)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("state", "fields", "prior", "fields", "p"), "a"),
        (("state",), None),
        (("fitted", "audit_", "fields", "prior"), None),
    ],
)
def test_load_refuses_inconsistent_headers_of_a_mixture(saved_mixture, path, value):
    rewrite(saved_mixture, header=lambda tree: set_in(tree, path, value))
    refused(saved_mixture, LOST)


def test_load_refuses_a_mixture_without_its_policy(saved_mixture):
    rewrite(saved_mixture, {"state/policy/weights.npy": None})
    refused(saved_mixture, LOST)


def test_nothing_is_unpickled(saved, monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("unpickled")

    rewrite(saved, {WEIGHTS: npy(np.array([{}, []], dtype=object))})
    monkeypatch.setattr(pickle, "load", never)
    monkeypatch.setattr(pickle, "loads", never)
    refused(saved, "never unpickled")


def test_load_refuses_bytes_after_an_array(saved):
    rewrite(saved, {WEIGHTS: members(saved)[WEIGHTS] + b"x"})
    refused(saved, "damaged or truncated")


def test_numpy_reads_saved_arrays(fitted, saved):
    with np.load(saved, allow_pickle=False) as stored:
        np.testing.assert_array_equal(stored["policy/weights"], fitted.policy_.weights)


def test_checkpoint_holds_the_final_policy_of_one_fit(fitted, data, tmp_path):
    path, trust = tmp_path / "checkpoint", fitted.audit_.expert_proba
    checkpoint = Checkpoint.of(path, "C=None", (data.observations, trust))
    assert checkpoint.read() is None
    passes = np.array([[-3.0, 0.5], [-2.0, 0.1]])
    for radius, n_places in ((np.inf, 0), (2.0, 3)):
        places = np.random.default_rng(0).random((n_places, 2, *fitted.policy_.weights.shape))
        checkpoint.keep(AscentState(fitted.policy_, passes, radius, places))
        found = checkpoint.read()
        np.testing.assert_array_equal(found.policy.weights, fitted.policy_.weights)
        np.testing.assert_array_equal(found.curvature, places)
        assert (found.history.tolist(), found.radius) == (passes.tolist(), radius)
    others = [Checkpoint.of(path, "C=2.0", (data.observations, trust))]
    others.append(Checkpoint.of(path, "C=None", (data.observations, trust / 2)))
    for one in others:
        with pytest.raises(DataError, match="of other data, or other settings; delete it to start anew"):
            one.read()
    rewrite(path, {"state/policy/weights.npy": None})
    with pytest.raises(DataError, match="its parts do not belong together; delete it to start anew"):
        checkpoint.read()
    rewrite(path, header=lambda tree: tree.update(state=3))
    with pytest.raises(DataError, match="its parts do not belong together"):
        checkpoint.read()
    checkpoint.done()
    checkpoint.done()  # nothing is there any more, which is as it should be
    assert list(tmp_path.iterdir()) == []
    save(fitted, path)
    with pytest.raises(DataError, match="it is no checkpoint of rpil; choose another name"):
        checkpoint.read()


def test_action_box_of_arrays_is_saved(tmp_path):
    rng = np.random.default_rng(0)
    made = Demonstrations.from_arrays(rng.normal(size=(80, 2)), rng.uniform(-1, 1, size=(80, 2)), np.arange(0, 81, 10))
    model = RPIL(features="raw", action_box=(np.array([-2.0, -1.0]), np.array([1.0, 2.0]))).fit(made)
    save(model, tmp_path / "p")
    np.testing.assert_array_equal(load(tmp_path / "p").action_box, model.action_box)
