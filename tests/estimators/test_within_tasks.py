"""A recording is judged within its tasks and sessions, from Python as by the command."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet as pq
import pytest

import rpil
from problems import coefficients, make, refused
from rpil import Demonstrations
from rpil.data.errors import DataError
from rpil.estimators.within_tasks import with_reference
from rpil.formats import table as flat
from small import FAST, SMALL


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Two tasks whose experts act in opposite ways; the second one's operator is another."""
    table = flat.from_demonstrations(make("random", 0, n_good=8, n_bad=3, steps=(20, 30)).demonstrations, {})
    episode = table.column_names.index("episode_index")
    action = table.column_names.index("action")
    mirrored = table.set_column(action, "action", pa.array(2 - table["action"].to_numpy()))
    left = pa.array([int(name[1:]) for name in table["episode_index"].to_pylist()])
    table = table.set_column(episode, "episode_index", left)
    mirrored = mirrored.set_column(episode, "episode_index", pa.compute.add(left, 100))
    tasks, n = pa.concat_tables([table, mirrored]), len(table)
    tasks = tasks.append_column("clock", pa.compute.divide(tasks["step_index"], 10.0))
    path = tmp_path_factory.mktemp("tasks") / "both.parquet"
    tasks = tasks.append_column("task", [["left"] * n + ["right"] * n])
    pq.write_table(tasks.append_column("who", [["Ann"] * n + ["Bob"] * n]), path)
    return path


def rpil_of(recording, **options):
    return rpil.RPIL(features="folded", settings=FAST).fit(recording, **options)


@pytest.fixture(scope="module")
def judged(both):
    return rpil_of(rpil.open(both))


def test_each_task_is_judged_as_if_it_were_alone(both, judged, tmp_path):
    table = pq.read_table(both)
    pq.write_table(table.filter(pa.compute.equal(table["task"], "left")), tmp_path / "left.parquet")
    alone = rpil_of(rpil.open(tmp_path / "left.parquet")).audit_
    np.testing.assert_array_equal(judged.audit_.log_odds[: len(alone.ids)], alone.log_odds)


@pytest.mark.parametrize("outcome", [None, {m: m % 100 % 4 for m in (*range(11), *range(100, 111))}])
def test_an_answer_that_is_added_speaks_of_its_own_task_alone(both, outcome):
    labels = {0: "good", 1: "good", 9: "bad", 10: "bad", 2: "better than 8", 100: "good", (104, 2, 9): "bad"}
    audit, added = (rpil.audit(both, given, outcome, settings=FAST, session="who") for given in (labels, None))
    for name, word in labels.items():
        added = added.answered({name: word})
    for name in ("log_odds", "verdicts", "rejected_by", "said", "notes", "doubts", "method", "sessions"):
        np.testing.assert_array_equal(getattr(added, name), getattr(audit, name), name)
    np.testing.assert_allclose(added.step_weight, audit.step_weight)
    assert {own.fps for own in audit.by_task.args[0].values()} == {10.0}, "their reasons name seconds"


def test_one_policy_is_learned_from_all_tasks(both, judged, tmp_path):
    demonstrations = rpil.read(both)
    weighted = rpil.BehavioralCloning(features="folded").fit(
        demonstrations.observations, demonstrations.actions, sample_weight=judged.audit_.step_weight
    )
    (found, _), (expected, _) = coefficients(judged), coefficients(weighted)
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(expected).max())
    assert judged.predict(demonstrations.observations).shape == demonstrations.actions.shape
    rpil.save(judged, tmp_path / "policy")
    loaded = rpil.load(tmp_path / "policy")
    of_each = (model.predict(demonstrations.observations) for model in (loaded, judged))
    np.testing.assert_array_equal(*of_each)


def test_labels_and_pairs_go_to_their_task(both):
    labels = [(0, "good"), (1, "better than 101"), (2, "better than 9"), (3, "same as 5"), (4, "same as 102")]
    with pytest.warns(UserWarning, match="the labels: 2 pairs compare demonstrations of different tasks, and are left"):
        audit = rpil_of(rpil.open(both), labels=labels).audit_
    assert audit.answers.labels[0] == 1
    assert (audit.answers.pairs.tolist(), audit.answers.tied.tolist()) == ([[2, 9]], [[3, 5]])


def test_what_was_named_when_it_was_opened_is_used(both):
    audit = rpil_of(rpil.open(both, exclude="task", operator="who")).audit_
    assert {one.name for one in audit.demonstrators} == {"Ann", "Bob"}
    assert not rpil_of(rpil.open(both, exclude="task")).audit_.demonstrators
    by_hand = rpil_of(rpil.open(both, exclude="task"), demonstrators=["Ann"] * 11 + ["Bob"] * 11).audit_
    np.testing.assert_array_equal(audit.log_odds, by_hand.log_odds)
    with pytest.raises(DataError, match="give one for each of the 22 demonstrations"):
        rpil_of(rpil.open(both), demonstrators=["Ann"] * 3)
    sessions = rpil_of(rpil.open(both, exclude="task", session="who")).audit_
    assert sessions.assumptions[0].startswith("Demonstrations are judged within their sessions: Ann (11:")
    assert sessions.sessions == ("Ann",) * 11 + ("Bob",) * 11


def test_data_on_disk(both, judged):
    on_disk = rpil.open(both, on_disk=True)
    assert isinstance(on_disk.demonstrations, rpil.Dataset)
    np.testing.assert_allclose(rpil_of(on_disk).audit_.log_odds, judged.audit_.log_odds)
    one_task = rpil.RPIL(features="folded", settings=SMALL).fit(rpil.open(both, on_disk=True, exclude="task"))
    assert len(one_task.audit_.ids) == 22


def test_who_is_called_bad_has_no_weight_in_a_task_without_a_good_one_either(both):
    labels = {0: "good", 1: "good", 10: "bad", 100: "bad", 101: "bad"}
    audit = rpil.audit(both, labels=labels, settings=FAST)
    mean = np.add.reduceat(audit.step_weight, audit.offsets[:-1]) / audit.lengths
    assert audit.step_weight.mean() == pytest.approx(1)
    assert max(mean[audit.ids.index(name)] for name in (10, 100, 101)) < 1e-3
    np.testing.assert_allclose(mean[13:], mean[13])  # of the others in that task nothing is known
    one_side = rpil.audit(both, labels={100: "bad", 101: "bad"}, settings=FAST)
    np.testing.assert_array_equal(one_side.step_weight, 1.0)


RNG = np.random.default_rng(0)


def some(n, ids=None, names=("x", "v"), actions=1, source="a.csv", action_names=()):
    episodes = [(RNG.normal(size=(5, len(names))), RNG.normal(size=(5, actions))) for _ in range(n)]
    made = Demonstrations.from_episodes(episodes, ids, observation_names=names, source=source)
    return Demonstrations(
        made.observations, made.actions, made.offsets, made.ids, names, source, action_names=action_names
    )


def test_reference_comes_last_and_no_ids_clash():
    for ids, prefix in ((None, ""), (["0", "reference 0", "a"], " 2"), (["0", "reference 0", "reference 2 0"], " 3")):
        one, other = some(3, ids), some(2, source="good.csv")
        both = with_reference(one, other)
        assert both.ids == (*map(str, one.ids), f"reference{prefix} 0", f"reference{prefix} 1")
        for m in range(5):
            expected = one[m] if m < 3 else other[m - 3]
            for found, value in zip(both[m], expected, strict=True):
                np.testing.assert_array_equal(found, value)


def test_columns_in_another_order_are_matched_by_name():
    one, other = some(2), some(2, names=("v", "x"))
    both = with_reference(one, other)
    assert both.observation_names == ("x", "v")
    np.testing.assert_array_equal(both[2][0], other[0][0][:, ::-1])


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (some(2, names=("x",), source="b.csv"), "lacks 'v'"),
        (some(2, names=("x", "v", "w"), source="b.csv"), "has 'w' too"),
        (some(2, actions=2, source="b.csv"), "2 continuous numbers, and those of a.csv are 1 continuous"),
        (some(2, action_names=("grip",), source="b.csv"), "grip"),
        (replace(some(2, source="b.csv"), actions=np.arange(10) % 2, action_kind="discrete"), "discrete"),
    ],
)
def test_other_observations_or_actions_are_refused(other, words):
    with refused(rf"^b\.csv.*{words}"):
        with_reference(some(2), other)
